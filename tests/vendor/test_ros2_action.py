"""A client of ROS 2 that isn't ours: the action FollowJointTrajectory, parameters, and a router that knows roles."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh
from helpers import ros2_types
from helpers.ros2_peer import ATTACHMENT, STORE, Peer, node, peer, port, router
from helpers.run import Running
from helpers.wait import until
from zenoh import ext

from srl.runtime.bus.certificates import authority, sign
from srl.runtime.ipc.header import State
from srl.runtime.messages import messages
from srl.runtime.ros2.names import (
    CANCEL_GOAL,
    FEEDBACK,
    GET_RESULT,
    GOAL_STATUS,
    HASHES,
    PARAMETERS,
    SEND_GOAL,
    TRIGGER,
    dds_type,
)

__all__ = ["peer", "port"]  # fixtures
pytestmark = pytest.mark.slow
ACTION = "/servo_jog/client/position/follow_joint_trajectory/_action"
# A busy machine may let the node stand still for longer than the profile's 0.5 s.
PATIENT = ("--set", "setpoints={client.position: {shape: [2], unit: rad, labels: [proximal, distal], max_age: 4}}")
TYPES = STORE.types


def header(frame: str = "") -> Any:
    stamp = TYPES["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    return TYPES["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def duration(seconds: float) -> Any:
    return TYPES["builtin_interfaces/msg/Duration"](sec=int(seconds), nanosec=round(seconds % 1 * 1e9))


def uuid(number: int) -> Any:
    return TYPES["unique_identifier_msgs/msg/UUID"](uuid=np.full(16, number, np.uint8))


def goal(number: int, seconds: float, positions: dict[str, float], tolerance: float = 0.0) -> Any:
    empty = np.empty(0)
    point = TYPES["trajectory_msgs/msg/JointTrajectoryPoint"](
        positions=np.array(list(positions.values())), velocities=empty, accelerations=empty, effort=empty,
        time_from_start=duration(seconds),
    )  # fmt: skip
    joints = TYPES["trajectory_msgs/msg/JointTrajectory"](
        header=header(), joint_names=list(positions), points=[point]
    )  # fmt: skip
    none = TYPES["trajectory_msgs/msg/MultiDOFJointTrajectory"](header=header(), joint_names=[], points=[])
    bounds = [
        TYPES["control_msgs/msg/JointTolerance"](name=name, position=tolerance, velocity=0.0, acceleration=0.0)
        for name in positions
    ]
    content = TYPES[f"{ros2_types.FOLLOW}_Goal"](
        trajectory=joints, multi_dof_trajectory=none, path_tolerance=[], component_path_tolerance=[],
        goal_tolerance=bounds, component_goal_tolerance=[], goal_time_tolerance=duration(10.0),
    )  # fmt: skip
    return TYPES[f"{SEND_GOAL}_Request"](goal_id=uuid(number), goal=content)


def test_a_goal_moves_the_joints_and_a_cancelled_one_stands_still(
    tmp_path: Path, port: int, peer: Callable[[], Peer]
) -> None:
    with router(port), node(tmp_path, port, "servo-jog", *PATIENT, commands=True) as run:
        seen = peer()
        until(lambda: any("get_result" in token for token in seen.tokens("SS")), what="the action")
        run.until(lambda: run.header("state") == State.ACTIVE, "motion")
        told: list[Any] = []
        key = seen.key(f"{ACTION}/feedback", FEEDBACK)
        listening = seen.manager.session.declare_subscriber(key, lambda s: told.append(s.payload.to_bytes()))

        def accepted(number: int, *given: Any, **more: Any) -> bool:
            return bool(seen.call(f"{ACTION}/send_goal", SEND_GOAL, goal(number, *given, **more)).accepted)

        def result(number: int) -> Any:
            wanted = TYPES[f"{GET_RESULT}_Request"](goal_id=uuid(number))
            return seen.call(f"{ACTION}/get_result", GET_RESULT, wanted, timeout=60.0)

        assert not accepted(99, 1.0, {"proximal": 9.0, "distal": 9.0}), "beyond the limits"
        assert not accepted(98, 1.0, {"distal": 0.1}), "a subset, where the profile doesn't allow it"
        numbers = iter(range(1, 50))
        first = 0

        def begins() -> bool:
            nonlocal first
            first = next(numbers)
            return accepted(first, 1.5, {"distal": 0.2, "proximal": 0.4}, tolerance=0.05)

        until(begins, pause=0.3, what="a goal that is accepted")
        reached = result(first)
        assert (reached.status, reached.result.error_code) == (4, 0), reached.result.error_string
        row = run.reader.newest()
        assert row is not None
        np.testing.assert_allclose(run.layout.value(row, "finger.position"), [0.4, 0.2], atol=0.05)
        feedback = STORE.deserialize_cdr(told[-1], FEEDBACK).feedback
        assert feedback.joint_names == ["proximal", "distal"]
        assert len(feedback.actual.positions) == 2
        until(lambda: seen.echo(f"{ACTION}/status", GOAL_STATUS, latched=True).status_list[-1].status == 4, what="it")
        second = next(numbers)
        assert accepted(second, 30.0, {"proximal": -0.4, "distal": -0.2})
        info = TYPES["action_msgs/msg/GoalInfo"](goal_id=uuid(second), stamp=duration(0.0))
        answer = seen.call(f"{ACTION}/cancel_goal", CANCEL_GOAL, TYPES[f"{CANCEL_GOAL}_Request"](goal_info=info))
        assert answer.return_code == 0
        assert result(second).status == 5
        assert run.header("state") == State.ACTIVE, "a cancelled goal is no fault"
        third = next(numbers)
        assert accepted(third, 30.0, {"proximal": -0.4, "distal": -0.2})
        assert seen.trigger("/servo_jog/stop")[0]
        assert result(third).status == 6
        listening.undeclare()


def test_a_subset_moves_where_the_profile_allows_it(tmp_path: Path, port: int, peer: Callable[[], Peer]) -> None:
    more = {"commands": True, "allow_partial_joints_goal": True}
    with router(port), node(tmp_path, port, "servo-jog", *PATIENT, **more) as run:
        seen = peer()
        until(lambda: any("send_goal" in token for token in seen.tokens("SS")), what="the action")
        numbers = iter(range(1, 50))

        def begins() -> bool:
            request = goal(next(numbers), 0.5, {"distal": 0.3})
            return bool(seen.call(f"{ACTION}/send_goal", SEND_GOAL, request).accepted)

        until(begins, pause=0.3, what="a goal that is accepted")
        row = run.reader.newest()
        assert row is not None
        proximal = run.layout.value(row, "finger.position_command.sent")[0]

        def arrived() -> bool:
            row = run.reader.newest()
            return row is not None and abs(run.layout.value(row, "finger.position_command.sent")[1] - 0.3) < 2e-3

        until(arrived, what="the joint")
        row = run.reader.newest()
        assert row is not None
        assert abs(run.layout.value(row, "finger.position_command.sent")[0] - proximal) < 0.01


def test_parameters_are_read_and_set(tmp_path: Path, port: int, peer: Callable[[], Peer]) -> None:
    name, place = "mapping.drift_pull", "/sixth_finger/sixth_finger"
    with router(port), node(tmp_path, port, "sixth-finger", commands=True) as run:
        seen = peer()
        until(lambda: any("set_parameters" in token for token in seen.tokens("SS")), what="the services")
        kind = f"{PARAMETERS}ListParameters"
        listed = seen.call(f"{place}/list_parameters", kind, TYPES[f"{kind}_Request"](prefixes=[], depth=0))
        assert name in listed.result.names
        empty: dict[str, Any] = {
            "bool_value": False, "integer_value": 0, "string_value": "", "byte_array_value": np.empty(0, np.uint8),
            "bool_array_value": np.empty(0, bool), "integer_array_value": np.empty(0, np.int64),
            "double_array_value": np.empty(0), "string_array_value": [],
        }  # fmt: skip
        value = TYPES["rcl_interfaces/msg/ParameterValue"](type=3, double_value=1.75, **empty)
        given = [TYPES["rcl_interfaces/msg/Parameter"](name=name, value=value)]
        kind = f"{PARAMETERS}SetParameters"
        request = TYPES[f"{kind}_Request"](parameters=given)
        (answer,) = seen.call(f"{place}/set_parameters", kind, request).results
        assert (answer.successful, answer.reason) == (True, "")
        row = run.reader.newest()
        assert row is not None
        kind = f"{PARAMETERS}GetParameters"
        request = TYPES[f"{kind}_Request"](names=[name])

        def read() -> float:
            return float(seen.call(f"{place}/get_parameters", kind, request).values[0].double_value)

        until(lambda: read() == 1.75, what="the value")


class Lab:
    """A run and its router over TLS, and certificates of people."""

    def __init__(self, folder: Path, port: int) -> None:
        self.folder, self.port = folder, port
        authority(folder)
        for person in ("otto", "anna", "eva", "nobody"):
            sign(folder, person, [], 1)
        for host in ("robot", "router"):
            sign(folder, host, ["localhost", "127.0.0.1"], 1)
        tls = {"ca": f"{folder}/ca.pem", "certificate": f"{folder}/robot.pem", "key": f"{folder}/robot.key"}
        roles = {"observer": ["otto"], "operator": ["anna"], "engineer": ["eva"]}
        bus = {"ros2": {"router": f"tls/localhost:{port}", "commands": True}, "tls": tls, "roles": roles}
        self.bus = f"bus={json.dumps(bus)}"

    @contextmanager
    def router(self) -> Iterator[None]:
        """A router with the configuration that `srl show --router` writes."""
        command = [sys.executable, "-m", "srl", "check", "servo-jog", "--sim", "--set", self.bus, "--router", "r.json5"]
        subprocess.run(command, cwd=self.folder, check=True, capture_output=True)
        there = os.getcwd()
        os.chdir(self.folder)  # its files are named as beside it
        try:
            session = zenoh.open(zenoh.Config.from_file("r.json5"))
        finally:
            os.chdir(there)
        try:
            yield
        finally:
            session.close()

    @contextmanager
    def join(self, person: str) -> Iterator[zenoh.Session]:
        """A person's session."""
        tls = {
            "root_ca_certificate": f"{self.folder}/ca.pem", "connect_certificate": f"{self.folder}/{person}.pem",
            "connect_private_key": f"{self.folder}/{person}.key", "enable_mtls": True,
        }  # fmt: skip
        content = {
            "mode": "client", "connect": {"endpoints": [f"tls/localhost:{self.port}"], "timeout_ms": 10000},
            "scouting": {"multicast": {"enabled": False}}, "transport": {"link": {"tls": tls}},
        }  # fmt: skip
        session = zenoh.open(zenoh.Config.from_json5(json.dumps(content)))
        try:
            yield session
        finally:
            session.close()


def asked(session: zenoh.Session, name: str, kind: str, payload: bytes, timeout: float = 2.0) -> list[bytes]:
    """The answers of a service."""
    key = f"0/servo_jog/{name}/{dds_type(kind)}/RIHS01_{HASHES[kind]}"
    given = session.get(key, payload=payload, attachment=ATTACHMENT, timeout=timeout)
    return [reply.ok.payload.to_bytes() for reply in given if reply.ok is not None]


def test_over_tls_each_peer_has_the_rights_of_its_role(tmp_path: Path, port: int) -> None:
    lab = Lab(tmp_path, port)
    kind = f"{PARAMETERS}SetParameters"
    nothing = bytes(STORE.serialize_cdr(TYPES[f"{kind}_Request"](parameters=[]), f"{kind}_Request"))
    described = f"0/servo_jog/robot_description/{dds_type(messages.STRING)}/RIHS01_{HASHES[messages.STRING]}"
    with lab.router(), Running(tmp_path, "servo-jog", "--sim", "--set", lab.bus, instance="servo-jog") as run:
        run.started()
        with lab.join("eva") as session:
            # An engineer sees, commands, and sets parameters.
            until(lambda: asked(session, "servo_jog/set_parameters", kind, nothing), what="the node")
            assert asked(session, "stop", TRIGGER, b"\0\1\0\0\0")[0][4] == 1
            run.until(lambda: run.header("state") == State.STOPPED, "the stop")
            until(lambda: asked(session, "reset", TRIGGER, b"\0\1\0\0\0")[0][4], pause=0.3, what="the reset")
        with lab.join("anna") as session:
            # An operator commands.
            assert not asked(session, "servo_jog/set_parameters", kind, nothing)
            assert asked(session, "stop", TRIGGER, b"\0\1\0\0\0")[0][4] == 1
            until(lambda: asked(session, "reset", TRIGGER, b"\0\1\0\0\0")[0][4], pause=0.3, what="the reset")
        run.until(lambda: run.header("state") == State.ACTIVE, "motion")
        with lab.join("otto") as session:
            # An observer sees all, also what was sent before.
            taken: list[Any] = []
            history = ext.HistoryConfig(detect_late_publishers=True)
            listening = ext.declare_advanced_subscriber(session, described, taken.append, history=history)
            until(lambda: taken, what="the description")
            tokens = session.liveliness().get("@ros2_lv/0/**", timeout=2.0)
            assert [reply for reply in tokens if reply.ok is not None]
            listening.undeclare()
            assert not asked(session, "stop", TRIGGER, b"\0\1\0\0\0")
            assert not asked(session, "servo_jog/set_parameters", kind, nothing)
        with lab.join("nobody") as session:
            assert not [r for r in session.liveliness().get("@ros2_lv/0/**", timeout=2.0) if r.ok is not None]
            assert not asked(session, "stop", TRIGGER, b"\0\1\0\0\0")
        assert run.header("state") == State.ACTIVE
