"""The action FollowJointTrajectory: a goal is judged by what the device measures, and every one has a result."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from helpers.ros2_limb import Limb

from srl.runtime.ipc.header import State
from srl.runtime.messages import cdr
from srl.runtime.ros2.follower import PERIOD
from srl.runtime.ros2.goals import KEPT, Code, Goals, Status
from srl.runtime.ros2.inbox import Inbox
from srl.runtime.ros2.names import CANCEL_GOAL, FEEDBACK, GET_RESULT, SEND_GOAL

NAMES = ["proximal", "distal"]
HERE = (0.0, 0.0)


class Call:
    def __init__(self, payload: bytes) -> None:
        self.payload = payload
        self.answered: list[bytes] = []

    def answer(self, payload: bytes) -> None:
        self.answered.append(payload)


class Publisher:
    heard = True

    def __init__(self) -> None:
        self.sent: list[bytes] = []

    def put(self, payload: bytes) -> None:
        self.sent.append(payload)


class Node:
    """What the server declares, without a router."""

    def __init__(self) -> None:
        self.services: dict[str, Callable[[Any], None]] = {}
        self.publishers: dict[str, Publisher] = {}

    def service(self, name: str, _: str, take: Callable[[Any], None]) -> None:
        self.services[name.rpartition("/")[2]] = take

    def publisher(self, topic: str, _: str, __: Any = None) -> Publisher:
        return self.publishers.setdefault(topic.rpartition("/")[2], Publisher())

    @staticmethod
    def definition(kind: str) -> str:
        return kind


class Server:
    """servo-jog with the action; the device measures what `measured` says."""

    def __init__(self) -> None:
        self.limb, self.node, self.inbox = Limb(), Node(), Inbox()
        follower: Any = self.limb.follower
        self.goals = Goals(self.node, self.inbox, follower, "client/position", self.limb.said.append)  # type: ignore[arg-type]
        self._ids = itertools.count(1)
        self.measured = self.limb.follower._layout.fields["finger.position"]
        self.where = self.limb.follower.where()
        assert self.where is not None

    def ask(self, service: str, kind: str, message: dict[str, Any]) -> Call:
        call = Call(cdr.encode(f"{kind}_Request", message))
        self.node.services[service](call)
        return call

    def call(self, service: str, kind: str, message: dict[str, Any]) -> dict[str, Any]:
        call = self.ask(service, kind, message)
        until = time.monotonic() + 10.0
        while not call.answered and time.monotonic() < until:
            time.sleep(0.001)
        return cdr.decode(f"{kind}_Response", call.answered[0])

    def send(self, by: tuple[float, float], seconds: float = 0.05, **more: Any) -> tuple[bytes, bool]:
        """Asks to move the joints by so much from where they are."""
        assert self.where is not None
        identity = next(self._ids).to_bytes(16, "little")
        when = {"sec": int(seconds), "nanosec": round(seconds % 1 * 1e9)}
        positions = self.where + by
        point = {
            "positions": positions, "velocities": (), "accelerations": (), "effort": (), "time_from_start": when,
        }  # fmt: skip
        header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
        goal = {
            "trajectory": {"header": header, "joint_names": NAMES, "points": [point]},
            "multi_dof_trajectory": {"header": header, "joint_names": [], "points": []},
            "path_tolerance": [], "component_path_tolerance": [], "goal_tolerance": [],
            "component_goal_tolerance": [], "goal_time_tolerance": {"sec": 0, "nanosec": 0},
        } | more  # fmt: skip
        answer = self.call("send_goal", SEND_GOAL, {"goal_id": {"uuid": list(identity)}, "goal": goal})
        return identity, answer["accepted"]

    def result(self, identity: bytes) -> Call:
        return self.ask("get_result", GET_RESULT, {"goal_id": {"uuid": list(identity)}})

    def cancel(self, identity: bytes = bytes(16), stamp: int = 0) -> dict[str, Any]:
        when = {"sec": stamp // 10**9, "nanosec": stamp % 10**9}
        return self.call(
            "cancel_goal", CANCEL_GOAL, {"goal_info": {"goal_id": {"uuid": list(identity)}, "stamp": when}}
        )

    def turns(self, call: Call, state: State = State.ACTIVE) -> tuple[Status, Code, str]:
        """Turns until the call is answered; returns the result."""
        until = time.monotonic() + 10.0
        while not call.answered and time.monotonic() < until:
            self.limb.turn(state)
            time.sleep(PERIOD * 1e-9)
        answer = cdr.decode(f"{GET_RESULT}_Response", call.answered[0])
        return Status(answer["status"]), Code(answer["result"]["error_code"]), answer["result"]["error_string"]

    def more_turns(self, count: int) -> None:
        for _ in range(count):
            time.sleep(PERIOD * 1e-9)
            self.limb.turn(State.ACTIVE)


@pytest.fixture
def server() -> Iterator[Server]:
    made = Server()
    yield made
    made.inbox.close()


def bound(name: str, position: float) -> list[dict[str, Any]]:
    return [{"name": name, "position": position, "velocity": 0.0, "acceleration": 0.0}]


def test_a_goal_that_is_reached_succeeds_and_tells_how_it_goes(server: Server) -> None:
    identity, accepted = server.send(HERE, goal_tolerance=bound("distal", 0.01))
    assert accepted
    assert server.turns(server.result(identity)) == (Status.SUCCEEDED, Code.SUCCESSFUL, "")
    told = cdr.decode(FEEDBACK, server.node.publishers["feedback"].sent[0])
    assert bytes(told["goal_id"]["uuid"]) == identity
    np.testing.assert_allclose(told["feedback"]["actual"]["positions"], server.where, atol=0.01)
    # Who asks later gets it at once.
    assert server.turns(server.result(identity))[0] == Status.SUCCEEDED


def test_a_goal_whose_joints_do_not_follow_is_aborted_and_nothing_is_pressed_on(server: Server) -> None:
    # The device of this test stays where it is.
    identity, _ = server.send((0.5, 0.0), 1.0, path_tolerance=bound("proximal", 0.02))
    status, code, text = server.turns(server.result(identity))
    assert (status, code) == (Status.ABORTED, Code.PATH_TOLERANCE_VIOLATED)
    assert "'proximal'" in text
    server.more_turns(5)
    measured = server.limb.follower._layout.value(server.limb.row, "finger.position")
    np.testing.assert_array_equal(server.limb.sent[-1], measured)
    assert server.limb.sent[-1] == server.limb.sent[-3], "held where the joints are"


def test_a_goal_that_is_not_reached_in_time_is_aborted(server: Server) -> None:
    late = {"sec": 0, "nanosec": 50_000_000}
    identity, _ = server.send((0.3, 0.0), 0.05 * 5, goal_tolerance=bound("proximal", 0.01), goal_time_tolerance=late)
    status, code, _ = server.turns(server.result(identity))
    assert (status, code) == (Status.ABORTED, Code.GOAL_TOLERANCE_VIOLATED)


def test_a_cancelled_goal_slows_down_on_its_way_and_is_held_there(server: Server) -> None:
    identity, _ = server.send((0.5, -0.5), 2.0)
    call = server.result(identity)
    server.more_turns(20)
    answer = server.cancel(identity)
    assert server.cancel(identity)["return_code"] == 3, "it is being cancelled"
    assert answer["return_code"] == 0
    assert [bytes(each["goal_id"]["uuid"]) for each in answer["goals_canceling"]] == [identity]
    assert server.turns(call)[0] == Status.CANCELED
    way = np.array(server.limb.sent) - server.where
    np.testing.assert_allclose(way[:, 1], -way[:, 0], atol=1e-9, err_msg="on the way that was asked for")
    assert np.all(np.diff(way[:, 0]) >= 0.0)
    count = len(server.limb.sent)
    time.sleep(2 * PERIOD * 1e-9)
    server.limb.turn(State.ACTIVE)
    assert server.limb.sent[count:] == server.limb.sent[count - 1 : count], "held, not dropped"
    assert server.cancel(identity)["return_code"] == 3, "it has ended"
    assert server.cancel(b"x" * 16)["return_code"] == 2, "unknown"
    assert server.cancel()["return_code"] == 0, "all of none"


def test_goals_until_a_time_are_cancelled(server: Server) -> None:
    server.send((0.5, -0.5), 2.0)
    assert server.cancel(stamp=1)["goals_canceling"] == []
    assert len(server.cancel(stamp=time.time_ns())["goals_canceling"]) == 1


@pytest.mark.parametrize("state", [State.STOPPING, State.STOPPED])
def test_a_stop_aborts_a_goal(server: Server, state: State) -> None:
    identity, _ = server.send((0.5, 0.0), 2.0)
    status, code, text = server.turns(server.result(identity), state)
    assert (status, code) == (Status.ABORTED, Code.INVALID_GOAL)
    assert "the limb is" in text
    assert not server.send(HERE)[1], "the limb isn't active"


def test_a_new_goal_or_another_command_aborts_the_one_before(server: Server) -> None:
    first, _ = server.send((0.5, 0.0), 2.0)
    second, _ = server.send((0.4, 0.0), 2.0)
    assert server.turns(server.result(first))[2] == "another trajectory came"
    server.limb.follower.cancel("another command came")
    assert server.turns(server.result(second))[0] == Status.ABORTED


@pytest.mark.parametrize("by", [(9.0, 0.0), (float("nan"), 0.0)])
def test_a_goal_beyond_the_limits_is_rejected(server: Server, by: tuple[float, float]) -> None:
    identity, accepted = server.send(by)
    assert not accepted
    assert server.limb.said
    assert server.turns(server.result(identity))[0] == Status.UNKNOWN


def test_old_results_go_and_the_running_goal_stays(server: Server) -> None:
    first, _ = server.send((0.5, 0.0), 9.0)
    for _ in range(KEPT + 5):
        last, accepted = server.send((0.5, 0.0), 9.0)
        assert accepted
    assert server.turns(server.result(first))[0] == Status.UNKNOWN
    assert len(server.goals._goals) <= KEPT + 1
    assert server.cancel(last)["return_code"] == 0


def test_a_malformed_request_is_not_answered_and_the_next_one_is(server: Server) -> None:
    for name in ("send_goal", "cancel_goal", "get_result"):
        server.node.services[name](Call(b"\0\1\0\0nonsense"))
    assert server.send(HERE)[1]
