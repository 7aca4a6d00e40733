"""A trajectory goes on only while every row says that the limb moves: none outlives a stop, seen or unseen."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from helpers.ros2_limb import Limb

from srl.runtime.ipc.header import State
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile, wiring
from srl.runtime.ros2.follower import LONGEST_STEP, Follower


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
    [
        ({"positions": (2.0, 0.0)}, "its position limits"),
        ({"positions": (0.9, 0.0), "stamp": 1}, "it begins in"),
        ({"positions": (0.5, 0.0), "ago": 1.0}, "it begins in -1."),
    ],
)
def test_what_cant_be_followed_is_said(limb: Limb, asked: dict[str, Any], text: str) -> None:
    if ago := asked.pop("ago", 0.0):
        asked["stamp"] = time.time_ns() - round(ago * 1e9)
    limb.ask(*asked.pop("positions"), **asked)
    assert not limb.moves
    assert text in limb.said[-1]


def test_a_node_that_was_held_up_goes_on_where_it_was(limb: Limb) -> None:
    limb.ask(0.5, -0.5, seconds=2)
    assert limb.moves
    time.sleep(0.3)
    limb.turn(State.ACTIVE)
    limb.turn(State.ACTIVE)
    steps = np.abs(np.diff(limb.sent, axis=0)).max()
    assert steps < 0.5 / 2 * 2 * LONGEST_STEP, "no leap along the way"


def test_of_two_limbs_with_joints_of_one_name_each_follows_its_own() -> None:
    graph = wiring.build(*profile.load("human-srl-two", ["motion=setpoint"]), [])
    Lockstep(graph).step()
    limits = {"lower": [-1.0] * 7, "upper": [1.0] * 7, "velocity": [1.0] * 7}
    graph.layout.meta["limits"] = {"right.position_command": limits, "left.position_command": limits}
    for side in ("left", "right"):
        follower = Follower(graph.layout, f"client.{side}", lambda _: None, lambda _: None)
        assert follower.able
        assert follower._sent is not None
        assert follower._sent[0].name == f"{side}.position_command.sent"
        assert all(own is None or own[0].name.startswith(f"{side}.") for own in follower._actual)


def test_what_isn_t_passed_on_as_it_is_is_not_followed() -> None:
    graph = wiring.build(*profile.load("panda-jog"), [])
    graph.layout.meta["limits"] = {}
    assert not Follower(graph.layout, "client.velocity", lambda _: None, lambda _: None).able
