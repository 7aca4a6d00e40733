"""A trajectory goes on only while every row says that the limb moves: none outlives a stop, seen or unseen."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from srl.runtime.ipc.header import CYCLE, State
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.messages import cdr
from srl.runtime.profile import profile, wiring
from srl.runtime.ros2.follower import PERIOD, Follower
from srl.runtime.ros2.names import TRAJECTORY


class Limb:
    """servo-jog, and what its follower sends and says."""

    def __init__(self) -> None:
        graph = wiring.build(*profile.load("servo-jog"), [])
        step = Lockstep(graph)
        for _ in range(20):
            step.step()
        graph.layout.meta["limits"] = {
            "finger.position_command": {"lower": [-1.0, -1.0], "upper": [1.0, 1.0], "velocity": [2.0, 2.0]}
        }
        self.row = graph.row.words.copy()
        self.row[CYCLE.state] = State.ACTIVE
        self.sent: list[list[float]] = []
        self.said: list[str] = []
        self.follower = Follower(
            graph.layout, "client.position", lambda values: self.sent.append(values.tolist()), self.said.append
        )
        self.lost = 0
        self.turn(State.ACTIVE)

    def turn(self, *states: State) -> None:
        rows = np.tile(self.row, (len(states), 1))
        rows[:, CYCLE.state] = states
        newest = rows[-1] if len(rows) else self.row
        self.follower.turn(rows, newest, self.lost, time.monotonic_ns())

    def ask(self, *positions: float, seconds: int = 2, came: int | None = None, stamp: int = 0) -> None:
        point = {
            "positions": np.array(positions), "velocities": np.empty(0), "accelerations": np.empty(0),
            "effort": np.empty(0), "time_from_start": {"sec": seconds, "nanosec": 0},
        }  # fmt: skip
        header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": ""}
        message: dict[str, Any] = {"header": header, "joint_names": ["proximal", "distal"], "points": [point]}
        now = time.monotonic_ns()
        self.follower.take(cdr.encode(TRAJECTORY, message), now if came is None else came, time.time_ns())

    @property
    def moves(self) -> bool:
        before = len(self.sent)
        time.sleep(2 * PERIOD * 1e-9)
        self.turn(State.ACTIVE)
        return len(self.sent) > before


@pytest.fixture
def limb() -> Limb:
    return Limb()


def test_it_goes_along(limb: Limb) -> None:
    limb.ask(0.5, -0.5)
    assert limb.moves
    assert np.abs(limb.sent[0]).max() < 0.1, "from where it is"
    assert limb.said == []


@pytest.mark.parametrize("state", [State.STOPPING, State.STOPPED, State.READY])
def test_a_stop_between_two_looks_ends_it(limb: Limb, state: State) -> None:
    limb.ask(0.5, -0.5)
    assert limb.moves
    limb.turn(State.ACTIVE, state, State.ACTIVE)
    assert not limb.moves
    assert "ends" in limb.said[-1]


def test_rows_that_nobody_read_end_it(limb: Limb) -> None:
    limb.ask(0.5, -0.5)
    limb.lost = 5
    limb.turn(State.ACTIVE)
    assert not limb.moves


def test_one_from_before_a_stop_isn_t_begun_after_it(limb: Limb) -> None:
    came = time.monotonic_ns()
    limb.turn(State.STOPPED)
    limb.turn(State.ACTIVE)
    limb.ask(0.5, -0.5, came=came)
    assert not limb.moves
    assert "wasn't active when it came" in limb.said[-1]


def test_a_stop_while_it_is_checked_ends_it(limb: Limb, monkeypatch: pytest.MonkeyPatch) -> None:
    from srl.runtime.ros2 import trajectory

    checked = trajectory.Trajectory.check

    def slow(self: Any, *given: Any) -> None:
        checked(self, *given)
        limb.turn(State.STOPPED, State.ACTIVE)

    monkeypatch.setattr(trajectory.Trajectory, "check", slow)
    limb.ask(0.5, -0.5)
    assert not limb.moves


@pytest.mark.parametrize(
    ("asked", "text"),
    [({"positions": (2.0, 0.0)}, "its position limits"), ({"positions": (0.9, 0.0), "stamp": 1}, "it begins in")],
)
def test_what_cant_be_followed_is_said(limb: Limb, asked: dict[str, Any], text: str) -> None:
    limb.ask(*asked.pop("positions"), **asked)
    assert not limb.moves
    assert text in limb.said[-1]
