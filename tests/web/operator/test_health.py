"""The words of the panel: for each state, cause and condition of a device there are some, with what to do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.body_run import body_layout
from helpers.operated import JOINTS, OperatedLoop

from srl.runtime.ipc.header import (
    CYCLE,
    DEVICE,
    LINK_ACTIVE,
    LINK_CONNECTED,
    LINK_ERROR,
    LINK_FAULT,
    LINK_STALE,
    Cause,
    Latch,
    State,
)
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.web.operator import health, jogging
from srl.runtime.web.operator.parameters import Parameters


@pytest.fixture
def layout(tmp_path: Path) -> Layout:
    return OperatedLoop(tmp_path / "run").layout


def row(layout: Layout, **words: int) -> Words:
    made = np.zeros(layout.width, np.int64)
    for name, value in words.items():
        made[getattr(CYCLE, name)] = value
    return made


@pytest.mark.parametrize("state", list(State))
def test_each_state_has_words(layout: Layout, state: State) -> None:
    output = health.state(layout, row(layout, state=state))
    assert output["now"] == state.name.lower()
    assert output["means"].endswith(".")


@pytest.mark.parametrize("cause", [cause for cause in Cause if cause])
def test_each_cause_has_a_reason_and_a_remedy(layout: Layout, cause: Cause) -> None:
    layout.meta |= {"emergency": ["panel.buttons[red]"]}
    output = health.state(layout, row(layout, state=State.STOPPED, cause=cause, fault_source=0))
    assert output["why"]
    assert output["todo"].endswith(".")
    assert "{" not in output["todo"]


def test_a_culprit_that_the_layout_lacks_is_left_out(layout: Layout) -> None:
    output = health.state(layout, row(layout, state=State.STOPPED, cause=Cause.DEVICE_LOSS, fault_source=99))
    assert "power of it" in output["todo"]


def test_each_latch_has_words(layout: Layout) -> None:
    every = sum(Latch)
    output = health.state(layout, row(layout, state=State.STOPPED, cause=Cause.REQUEST, latches=every))
    assert output["stands"].count(";") == len(Latch) - 1


def test_a_run_that_waits_says_what_to_do(layout: Layout) -> None:
    output = health.state(layout, row(layout, state=State.READY, latches=Latch.START))
    assert "start" in output["todo"]
    assert not output["why"]


@pytest.mark.parametrize(
    ("link", "stamp", "level", "words"),
    [
        (LINK_CONNECTED, 0, "well", "well"), (LINK_CONNECTED | LINK_ACTIVE, 0, "well", "takes commands"),
        (LINK_CONNECTED | LINK_STALE, 0, "bad", "silent for 2.0 s"), (0, 0, "bad", "lost"),
        (LINK_CONNECTED | LINK_FAULT, 0, "bad", "refuses to move"), (LINK_CONNECTED, -1, "bad", "silent"),
        (LINK_CONNECTED | LINK_ERROR, 0, "bad", "driver failed"),
    ],
)  # fmt: skip
def test_each_condition_of_a_device(layout: Layout, link: int, stamp: int, level: str, words: str) -> None:
    made = row(layout, now=2_000_000_000)
    made[layout.device(0)][DEVICE.link], made[layout.device(0)][DEVICE.stamp] = link, stamp
    (device, _) = health.devices(layout, made)
    assert device["level"] == level
    assert words in device["words"]
    assert bool(device["remedy"]) == (level != "well")


@pytest.mark.parametrize(
    ("link", "stamp", "level"),
    [(LINK_CONNECTED, -1, "waits"), (LINK_CONNECTED, 0, "well"), (LINK_CONNECTED | LINK_STALE, 0, "bad")],
)
def test_who_sends_setpoints_is_no_device(layout: Layout, link: int, stamp: int, level: str) -> None:
    made = row(layout)
    made[layout.device(1)][DEVICE.link], made[layout.device(1)][DEVICE.stamp] = link, stamp
    (_, client) = health.devices(layout, made)
    assert client["level"] == level
    assert "sends" in client["words"] + client["remedy"] or level == "well"


def test_joints_and_parameters_are_told_with_their_bounds(layout: Layout) -> None:
    joints = jogging.joints(layout)
    assert [joint["name"] for joint in joints] == list(JOINTS)
    assert [(joint["lower"], joint["upper"]) for joint in joints] == [(-1.0, 1.0), (None, None)]
    assert not joints[0]["measured"]
    made = row(layout)
    made[layout.ints :] = np.full(layout.floats, np.nan).view(np.int64)
    assert jogging.places(layout, made) == [None, None]
    assert Parameters.values(layout, made) == [None]
    layout.meta["parameters"][0]["upper"] = float("inf")
    assert Parameters.described(layout)[0]["upper"] is None


def test_a_guided_calibration_of_servos_is_a_jog_too(layout: Layout) -> None:
    laws = layout.meta["controllers"]
    laws.append({"use": "servo-marks"})
    assert [joint["name"] for joint in jogging.joints(layout)] == list(JOINTS)
    laws.append({"use": "joint-setpoint"})
    assert jogging.joints(layout) == []


def test_a_run_that_is_no_jog_has_no_joints() -> None:
    assert jogging.joints(body_layout()) == []
