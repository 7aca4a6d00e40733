"""A client of ROS 2 that isn't ours sees a run as a node: topics with types, services, late joiners, a lost router."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import zenoh
from helpers.ros2_peer import ATTACHMENT, STORE, Peer, node, peer, port, router
from helpers.wait import until

from srl.runtime.ipc.header import State
from srl.runtime.ros2.names import HASHES, TF, TRIGGER, dds_type

__all__ = ["peer", "port"]  # fixtures
pytestmark = pytest.mark.slow
SERVICES = 3 + 6 + 3  # start, stop, reset; of parameters; of the action


def test_a_run_is_a_node_with_the_robots_topics(tmp_path: Path, port: int, peer: Callable[[], Peer]) -> None:
    with router(port), node(tmp_path, port, "servo-jog"):
        seen = peer()
        until(lambda: "/servo_jog/robot_description" in seen.topics(), what="the topics")
        topics = seen.topics()
        assert topics["/servo_jog/joint_states"] == "sensor_msgs/msg/JointState"
        assert topics["/servo_jog/robot_description"] == "std_msgs/msg/String"
        assert topics["/servo_jog/finger/position_command/sent"] == "sensor_msgs/msg/JointState"
        assert {topics["/tf"], topics["/tf_static"]} == {TF}
        assert topics["/diagnostics"] == "diagnostic_msgs/msg/DiagnosticArray"
        assert [token.rpartition("/")[2] for token in seen.tokens("NN")] == ["servo_jog"]
        offered = [token for token in seen.tokens("SS") if "rcl_interfaces" not in token]
        assert not offered, "commands are off by default; parameters can be read"
        assert not [token for token in seen.tokens("MS") if "servo_jog" in token]
        joints = seen.echo("/servo_jog/joint_states", "sensor_msgs/msg/JointState")
        assert joints.name == ["proximal", "distal"]
        now = joints.header.stamp.sec + joints.header.stamp.nanosec * 1e-9
        assert abs(time.time() - now) < 5.0
        assert seen.echo("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray").status[0].name == "servo-jog"
        # These were sent before this peer was there.
        text = seen.echo("/servo_jog/robot_description", "std_msgs/msg/String", latched=True).data
        model = pin.buildModelFromXML(text)
        assert set(joints.name) <= set(model.names)
        static = seen.echo("/tf_static", TF, latched=True).transforms
        moving = seen.echo("/tf", TF).transforms
        frames = {t.child_frame_id for t in [*static, *moving]}
        links = {frame.name for frame in model.frames if frame.type == pin.BODY}
        assert links - frames <= {"universe", "srl_root", "finger"}


def test_a_peer_moves_the_limb_only_where_the_profile_lets_it(
    tmp_path: Path, port: int, peer: Callable[[], Peer]
) -> None:
    with router(port), node(tmp_path, port, "servo-jog", commands=True) as run:
        seen = peer()
        until(lambda: len(seen.tokens("SS")) == SERVICES, what="the services")
        assert seen.trigger("/servo_jog/stop") == (True, "")
        run.until(lambda: run.header("state") in (State.STOPPING, State.STOPPED), "the stop")
        until(lambda: seen.trigger("/servo_jog/reset")[0], pause=0.3, what="the reset")
        run.until(lambda: run.header("state") == State.ACTIVE, "motion")
        kind = "std_msgs/msg/Float64MultiArray"
        layout = STORE.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        key = f"0/servo_jog/client/position/commands/{dds_type(kind)}/RIHS01_{HASHES[kind]}"
        place = run.layout.fields["client.position"]

        def send(values: list[float]) -> None:
            message = STORE.types[kind](layout=layout, data=np.array(values))
            seen.manager.session.put(key, bytes(STORE.serialize_cdr(message, kind)), attachment=ATTACHMENT)

        def setpoint() -> list[float]:
            row = run.reader.newest()
            assert row is not None
            return [float(v) for v in run.layout.value(row, place.name)]

        until(lambda: setpoint() == [0.1, 0.2], lambda: send([0.1, 0.2]), what="the setpoint")
        for wrong in ([0.3], [0.3, np.nan], [0.3, 1e300]):
            send(wrong)
        until(lambda: setpoint() == [0.05, 0.1], lambda: send([0.05, 0.1]), what="the next one")


def test_a_trajectory_moves_the_joints_along_it_and_a_stop_ends_it(
    tmp_path: Path, port: int, peer: Callable[[], Peer]
) -> None:
    kind = "trajectory_msgs/msg/JointTrajectory"
    key = f"0/servo_jog/client/position/joint_trajectory/{dds_type(kind)}/RIHS01_{HASHES[kind]}"

    def message(*points: tuple[float, tuple[float, float]]) -> bytes:
        types = STORE.types
        empty = np.empty(0)
        made = [
            types["trajectory_msgs/msg/JointTrajectoryPoint"](
                positions=np.array(q), velocities=np.zeros(2), accelerations=empty, effort=empty,
                time_from_start=types["builtin_interfaces/msg/Duration"](sec=int(time), nanosec=round(time % 1 * 1e9)),
            )
            for time, q in points
        ]  # fmt: skip
        header = types["std_msgs/msg/Header"](stamp=types["builtin_interfaces/msg/Time"](sec=0, nanosec=0), frame_id="")
        whole = types[kind](header=header, joint_names=["distal", "proximal"], points=made)
        return bytes(STORE.serialize_cdr(whole, kind))

    # A busy machine may let the node stand still for longer than the profile's 0.5 s.
    patient = ("--set", "setpoints={client.position: {shape: [2], unit: rad, labels: [proximal, distal], max_age: 4}}")
    with router(port), node(tmp_path, port, "servo-jog", *patient, commands=True) as run:
        seen = peer()
        until(lambda: len(seen.tokens("SS")) == SERVICES, what="the services")

        def value(name: str) -> tuple[float, ...]:
            row = run.reader.newest()
            assert row is not None
            return tuple(float(v) for v in run.layout.value(row, name))

        def sent() -> tuple[float, ...]:
            return value("finger.position_command.sent")

        run.until(lambda: run.header("state") == State.ACTIVE, "motion")
        until(lambda: np.isfinite(sent()).all(), what="the first command")
        begin = sent()
        session = seen.manager.session
        session.put(key, message((1.0, (9.0, 9.0))), attachment=ATTACHMENT)  # beyond the limits
        session.put(key, b"\0\1\0\0nonsense", attachment=ATTACHMENT)
        seen_at: list[tuple[float, ...]] = []

        def moves() -> bool:
            seen_at.append(sent())
            return bool(np.allclose(seen_at[-1], (0.2, 0.4), atol=2e-3))

        # One that comes before the node has read that the limb moves is refused.
        until(
            lambda: np.abs(np.subtract(sent(), begin)).max() > 0.01,
            lambda: session.put(key, message((0.5, (0.2, 0.1)), (2.0, (0.4, 0.2))), attachment=ATTACHMENT),
            pause=0.5, what="the first step",
        )  # fmt: skip
        until(moves, what="the end of the trajectory")
        assert np.linalg.norm(np.array(begin) - (0.2, 0.4)) > 0.1
        assert np.max(seen_at) < 0.42
        # It is held, beyond the setpoint's max_age.
        stamp = run.header("now")
        until(lambda: run.header("now") > stamp + 4_500_000_000, what="time")
        assert run.header("state") == State.ACTIVE
        session.put(key, message((20.0, (0.0, 0.0))), attachment=ATTACHMENT)
        until(lambda: sent()[1] < 0.39, what="the way back")
        assert seen.trigger("/servo_jog/stop")[0]
        run.until(lambda: run.header("state") == State.STOPPED, "the stop")
        until(lambda: seen.trigger("/servo_jog/reset")[0], pause=0.3, what="the reset")
        run.until(lambda: run.header("state") == State.ACTIVE, "motion")
        stood, stamp = sent(), run.header("now")
        until(lambda: run.header("now") > stamp + 700_000_000, what="time")
        np.testing.assert_allclose(sent(), stood, atol=5e-3)  # what was asked before the stop isn't gone on with


def test_a_stop_is_heard_in_a_flood_and_undoes_the_resets_before_it(
    tmp_path: Path, port: int, peer: Callable[[], Peer]
) -> None:
    kind = "std_msgs/msg/Float64MultiArray"
    key = f"0/servo_jog/client/position/commands/{dds_type(kind)}/RIHS01_{HASHES[kind]}"
    reset = f"0/servo_jog/reset/{dds_type(TRIGGER)}/RIHS01_{HASHES[TRIGGER]}"
    with router(port), node(tmp_path, port, "servo-jog", commands=True) as run:
        seen = peer()
        until(lambda: len(seen.tokens("SS")) == SERVICES, what="the services")
        run.until(lambda: run.header("state") == State.ACTIVE, "motion")
        layout = STORE.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        payload = bytes(STORE.serialize_cdr(STORE.types[kind](layout=layout, data=np.array([0.1, 0.2])), kind))
        session = seen.manager.session
        over = threading.Event()

        def flood() -> None:
            while not over.is_set():
                session.put(key, payload, attachment=ATTACHMENT)

        flooding = threading.Thread(target=flood)
        flooding.start()
        try:
            waiting = [
                session.get(reset, payload=b"\0\1\0\0\0", attachment=ATTACHMENT, timeout=20.0) for _ in range(50)
            ]
            assert seen.trigger("/servo_jog/stop")[0]  # within its 10 s
        finally:
            over.set()
            flooding.join()
        for answers in waiting:
            list(answers)
        run.until(lambda: run.header("state") == State.STOPPED, "the stop")
        # By wildcard nothing is asked.
        list(session.get("0/**", target=zenoh.QueryTarget.ALL, attachment=ATTACHMENT, timeout=2.0))
        assert run.header("state") == State.STOPPED


def test_a_lost_router_is_found_again_and_the_run_goes_on(tmp_path: Path, port: int, peer: Callable[[], Peer]) -> None:
    with node(tmp_path, port, "servo-jog") as run:  # it begins without one
        run.until(lambda: run.header("state") == State.ACTIVE, "motion")
        for _ in range(2):
            with router(port):
                session = zenoh.open(
                    zenoh.Config.from_json5(
                        json.dumps({"mode": "client", "connect": {"endpoints": [f"tcp/127.0.0.1:{port}"]}})
                    )
                )
                try:
                    until(
                        lambda: any(
                            reply.ok is not None
                            for reply in session.liveliness().get("@ros2_lv/0/*/0/0/NN/**", timeout=0.5)  # noqa: B023
                        ),
                        what="the node",
                    )
                finally:
                    session.close()
        assert run.header("state") == State.ACTIVE


def test_two_runs_have_namespaces_of_their_own(tmp_path: Path, port: int, peer: Callable[[], Peer]) -> None:
    with (
        router(port),
        node(tmp_path, port, "servo-jog", "--instance", "left"),
        node(tmp_path, port, "servo-jog", "--instance", "right", namespace="/worn/right"),
    ):
        seen = peer()
        wanted = {"/left/joint_states", "/worn/right/joint_states"}
        until(lambda: wanted <= set(seen.topics()), what="both")


def test_a_killed_node_comes_back_and_costs_no_cycle(tmp_path: Path, port: int, peer: Callable[[], Peer]) -> None:
    with router(port), node(tmp_path, port, "servo-jog") as run:
        seen = peer()
        until(lambda: "/tf" in seen.topics(), what="the topics")
        os.kill(run.children()["ros2"], signal.SIGKILL)
        until(lambda: "/tf" not in seen.topics(), what="their end")
        until(lambda: "/tf" in seen.topics(), what="their return")
        assert run.header("state") == State.ACTIVE
