"""The action server control_msgs/action/FollowJointTrajectory of one setpoint: three services and two topics.

Sources: ROS 2 design, "Actions"; ros2_controllers, joint_trajectory_controller.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.errors import RequestError, SrlError
from srl.runtime.contracts.signals import Array
from srl.runtime.messages import cdr, messages
from srl.runtime.ros2.follower import Follower
from srl.runtime.ros2.inbox import Inbox, Item, Lane
from srl.runtime.ros2.names import CANCEL_GOAL, FEEDBACK, GET_RESULT, GOAL_STATUS, SEND_GOAL, Qos
from srl.runtime.ros2.node import Call, Node
from srl.runtime.ros2.tolerances import Tolerances, exceeded

PERIOD: Final = 0.05  # s between two messages of feedback
KEPT: Final = 32  # goals whose result can be asked for
WAITING: Final = 16  # requests for one goal's result


class Status(IntEnum):
    """action_msgs/msg/GoalStatus."""

    UNKNOWN = 0
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6


class Code(IntEnum):
    """The result's error_code."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


class Goal:
    """A goal, from its acceptance on.

    Attributes:
        identity: the 16 bytes of its UUID.
        stamp: Unix ns, when it was accepted.
        status, code, text: how it goes, and its result.
    """

    def __init__(self, identity: bytes, tolerances: Tolerances, names: Sequence[str], server: Goals) -> None:
        self.identity, self.stamp = identity, time.time_ns()
        self.status, self.code, self.text = Status.EXECUTING, Code.SUCCESSFUL, ""
        self.waiting: list[Call] = []
        self._tolerances, self._names, self._server = tolerances, names, server
        self._told = 0.0

    def judge(self, at: float, end: float, index: int, desired: Array, actual: Array) -> bool:
        """Looks at a sample on the way; returns whether the motion is to go on.

        Args:
            at: s since the trajectory's beginning, when the sample was taken.
            end: s, of the trajectory.
            index: of the point that it goes to, from 0.
            desired, actual: (2, n) position and velocity; NaN where nothing is measured.
        """
        error = desired - actual
        if self.status == Status.EXECUTING:
            if time.monotonic() >= self._told:
                self._told = time.monotonic() + PERIOD
                self._server.tell(self, at, index, desired, actual)
            if at < end:
                if beyond := exceeded(self._tolerances.path, error, self._names):
                    self.end(Status.ABORTED, Code.PATH_TOLERANCE_VIOLATED, beyond)
                    return False
            elif not (beyond := exceeded(self._tolerances.goal, error, self._names)):
                self.end(Status.SUCCEEDED, Code.SUCCESSFUL, "")
            elif at > end + self._tolerances.time:
                self.end(Status.ABORTED, Code.GOAL_TOLERANCE_VIOLATED, beyond)
        return True

    def cancelled(self) -> None:
        """The joints stand still after a cancellation."""
        self.end(Status.CANCELED, Code.SUCCESSFUL, "cancelled by a peer")

    def aborted(self, why: str) -> None:
        """Something else has ended it."""
        self.end(Status.ABORTED, Code.INVALID_GOAL, why)

    def end(self, status: Status, code: Code, text: str) -> None:
        """Sets the result, once, and answers who waits for it."""
        self._server.finish(self, status, code, text)


class Goals:
    """The server; see the module's docstring."""

    def __init__(
        self, node: Node, inbox: Inbox, follower: Follower, where: str, report: Callable[[str], None]
    ) -> None:  # fmt: skip
        """
        Args:
            where: of the setpoint's topics, below the namespace.
            report: takes why a goal was refused.
        """
        self._inbox, self._follower, self._report = inbox, follower, report
        self._names = follower.names
        self._place = f"goal for '{where}'"
        self._lock = threading.Lock()
        self._goals: dict[bytes, Goal] = {}
        action = f"{where}/follow_joint_trajectory/_action"
        self._feedback = node.publisher(f"{action}/feedback", FEEDBACK)
        self._feedback_kind = node.definition(FEEDBACK)
        self._status = node.publisher(f"{action}/status", GOAL_STATUS, Qos(depth=1, transient_local=True))
        for name, kind, work, lane in (
            ("send_goal", SEND_GOAL, self._send, Lane.COMMANDS),
            ("cancel_goal", CANCEL_GOAL, self._cancel, Lane.CANCELS),
            ("get_result", GET_RESULT, self._result, Lane.RESULTS),
        ):  # fmt: skip
            node.service(f"{action}/{name}", kind, inbox.requests(work, lane))
        self._announce()

    # In the inbox's threads.

    def _send(self, item: Item) -> None:
        call: Call = item.what
        try:
            if self._inbox.overtaken(item):
                raise RequestError(self._place, "a stop came after it", "Send it again")
            request = cdr.decode(f"{SEND_GOAL}_Request", call.payload)
            identity, content = bytes(request["goal_id"]["uuid"]), request["goal"]
            if identity in self._goals:
                raise RequestError(self._place, "there is one of this id", "Give each goal a UUID of its own")
            tolerances = Tolerances.read(content, self._names, self._follower.measured, self._place)
            goal = Goal(identity, tolerances, self._names, self)
            self._follower.begin(content["trajectory"], item.came, goal)
        except SrlError as error:
            self._report(str(error))
            answer = {"accepted": False, "stamp": messages.time_of(time.time_ns())}
        else:
            with self._lock:
                self._goals[identity] = goal
                ended = [each.identity for each in self._goals.values() if each.status > Status.CANCELING]
                for each in ended[: max(len(self._goals) - KEPT, 0)]:
                    del self._goals[each]
            answer = {"accepted": True, "stamp": messages.time_of(goal.stamp)}
        call.answer(cdr.encode(f"{SEND_GOAL}_Response", answer))
        self._announce()
        if self._inbox.overtaken(item):
            self._follower.cancel("a stop came")

    def _cancel(self, item: Item) -> None:
        """By id, by time (all that were accepted until then), or, with neither, all."""
        call: Call = item.what
        try:
            wanted = cdr.decode(f"{CANCEL_GOAL}_Request", call.payload)["goal_info"]
        except SrlError as error:
            self._report(str(error))
            return
        identity, stamp = bytes(wanted["goal_id"]["uuid"]), wanted["stamp"]
        until, named = stamp["sec"] * 1_000_000_000 + stamp["nanosec"], any(identity)
        with self._lock:
            known = [
                goal for goal in self._goals.values()
                if (named and goal.identity == identity) or (goal.stamp <= until if until else not named)
            ]  # fmt: skip
            running = [goal for goal in known if goal.status == Status.EXECUTING]
            for goal in running:
                goal.status = Status.CANCELING
        for goal in running:
            self._follower.hold(goal)
        code = 0 if running or not named else 3 if known else 2  # none, terminated, unknown id
        answer = {"return_code": code, "goals_canceling": [_info(goal) for goal in running]}
        call.answer(cdr.encode(f"{CANCEL_GOAL}_Response", answer))
        self._announce()

    def _result(self, item: Item) -> None:
        call: Call = item.what
        try:
            identity = bytes(cdr.decode(f"{GET_RESULT}_Request", call.payload)["goal_id"]["uuid"])
        except SrlError as error:
            self._report(str(error))
            return
        with self._lock:
            goal = self._goals.get(identity)
            if goal is not None and goal.status <= Status.CANCELING:
                goal.waiting = [*goal.waiting[1 - WAITING :], call]
                return
        call.answer(_answer(goal))

    # In any thread.

    def finish(self, goal: Goal, status: Status, code: Code, text: str) -> None:
        """Sets a goal's result, once, and answers who waits for it."""
        with self._lock:
            if goal.status > Status.CANCELING:
                return
            goal.status, goal.code, goal.text = status, code, text
            waiting, goal.waiting = goal.waiting, []
        for call in waiting:
            call.answer(_answer(goal))
        self._announce()

    def tell(self, goal: Goal, at: float, index: int, desired: Array, actual: Array) -> None:
        """Publishes the feedback of a goal; see `Goal.judge`."""
        if not self._feedback.heard:
            return
        feedback: dict[str, Any] = {
            "header": {"stamp": messages.time_of(time.time_ns()), "frame_id": ""}, "joint_names": list(self._names),
            "desired": _point(desired, at), "actual": _point(actual, at), "error": _point(desired - actual, at),
            "index": index, "multi_dof_joint_names": [], "multi_dof_index": 0,
        }  # fmt: skip
        empty = {"transforms": [], "velocities": [], "accelerations": [], "time_from_start": messages.time_of(0)}
        feedback |= {f"multi_dof_{name}": empty for name in ("desired", "actual", "error")}
        content = {"goal_id": {"uuid": list(goal.identity)}, "feedback": feedback}
        self._feedback.put(cdr.encode(self._feedback_kind, content))

    def _announce(self) -> None:
        with self._lock:
            listed = [{"goal_info": _info(goal), "status": int(goal.status)} for goal in self._goals.values()]
        self._status.put(cdr.encode(GOAL_STATUS, {"status_list": listed}))


def _info(goal: Goal) -> dict[str, Any]:
    return {"goal_id": {"uuid": list(goal.identity)}, "stamp": messages.time_of(goal.stamp)}


def _answer(goal: Goal | None) -> bytes:
    """The answer of get_result."""
    status, code, text = (
        (Status.UNKNOWN, Code.INVALID_GOAL, "") if goal is None else (goal.status, goal.code, goal.text)
    )
    result = {"error_code": int(code), "error_string": text}
    return cdr.encode(f"{GET_RESULT}_Response", {"status": int(status), "result": result})


def _point(values: Array, at: float) -> dict[str, Any]:
    """A trajectory point; what isn't measured is left out."""
    position, velocity = (row if np.isfinite(row).all() else row[:0] for row in values)
    when = messages.time_of(round(max(at, 0.0) * 1e9))
    return {
        "positions": position, "velocities": velocity, "accelerations": (), "effort": (), "time_from_start": when,
    }  # fmt: skip
