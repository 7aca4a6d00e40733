"""Measured frames in a running loop: in order, as inputs whose loss is a loss, the same bits in a replay."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.toy import PROFILE, Bench, Law, Toy, ToyConfig, _load

from srl.runtime.contracts import registry
from srl.runtime.contracts.controller import ControllerConfig
from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.terms import POSE
from srl.runtime.contracts.transforms import Transform, frame
from srl.runtime.ipc.header import Cause, State
from srl.runtime.loop.replay import replay

FRAMES = "frames: {room: {}, seen: {parent: room, pose: panel.pose}, tip: {parent: seen, position: [0.1, 0.0, 0.0]}}"


class Follower(Law):
    """Goes to where the frame `tip` is in the room, x and y."""

    def __init__(self, name: str, config: ControllerConfig) -> None:
        super().__init__(name, config)
        self.transforms = (Transform("tip", frame("tip"), frame("room"), "the tip in the room", moves=True),)
        self.began = np.zeros(2)

    def reset(self) -> None:
        self.began = self.transform["tip"][:2].copy()

    def update(self, dt: float) -> None:
        self.output["q"][:] = self.transform["tip"][:2]


class MonitoredPose(Toy):
    """Its panel sees a body in the room."""

    def __init__(self, name: str, config: ToyConfig) -> None:
        super().__init__(name, config)
        if config.part == "panel":
            self.states = (*self.states, Signal(name="pose", shape=(7,), unit="m", frame="room", labels=POSE))
            self.values["pose"] = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


@pytest.fixture
def sight(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("helpers.toy.Law", Follower)
    monkeypatch.setattr("helpers.toy.Toy", MonitoredPose)
    monkeypatch.setattr(registry, "load", _load)


def seeing(folder: Path) -> Bench:
    return Bench(folder, emergency="", more=FRAMES)


@pytest.mark.usefixtures("sight")
def test_a_law_gets_the_pose_of_its_own_cycle_and_a_replay_the_same(tmp_path: Path) -> None:
    b = seeing(tmp_path)

    def move(k: int) -> None:
        b.panel.values["pose"][:3] = 0.3 * np.sin(k / 40), 0.2, 0.0

    b.run(300, move)
    rows = b.rows()[:-1]
    layout = b.graph.layout
    asked, pose = layout.value(rows, "arm.command"), layout.value(rows, "panel.pose")
    started = int(np.argmax(asked.any(axis=1)))
    np.testing.assert_array_equal(asked[started:], pose[started:, :2] + [0.1, 0.0])
    assert b.graph.controllers[0].began == pytest.approx(asked[started])  # type: ignore[attr-defined]
    assert b.graph.intent[b.graph.layout.devices.index("panel")]
    assert replay(layout, rows, "toy").identical
    rows = rows.copy()
    rows[started + 50].view(np.float64)[layout.ints + layout.fields["panel.pose"].offset] += 1e-9
    assert not replay(layout, rows, "toy").identical


@pytest.mark.usefixtures("sight")
@pytest.mark.parametrize("lost", ["silent", "no pose", "NaN"])
def test_a_frame_that_isnt_seen_stops_the_law_that_uses_it(tmp_path: Path, lost: str) -> None:
    b = seeing(tmp_path)

    def move(k: int) -> None:
        if k == 100:
            if lost == "silent":
                b.panel.silent = True
            else:
                b.panel.values["pose"][3:] = 0.0 if lost == "no pose" else np.nan

    b.run(200, move)
    faults = [s for s in b.states if s[0] in (State.STOPPING, State.STOPPED)]
    assert faults[0][1] is Cause.INTENT_LOSS
    assert b.header("fault_source")[-1] == b.graph.layout.devices.index("panel")
    stopped = [s for s, _ in b.states].index(faults[0][0])
    assert stopped <= (108 if lost == "silent" else 102)
    rows = b.rows()
    assert np.isfinite(b.graph.layout.value(rows, "arm.command")).all()
    assert np.isfinite(b.graph.layout.value(rows, "arm.command.applied")).all()


@pytest.mark.usefixtures("sight")
@pytest.mark.parametrize("away", [0, 3])
def test_a_pose_that_jumps_is_lost(tmp_path: Path, away: int) -> None:
    """A system that was calibrated anew, or took one body for another; `away`: cycles without a sample before it."""
    b = seeing(tmp_path)

    def move(k: int) -> None:
        b.panel.values["pose"][0] = 0.002 * min(k, 99) if k < 100 + away else 0.9  # 0.2 m/s; then 0.7 m at once
        b.panel.silent = 100 <= k < 100 + away

    b.run(200, move)
    stopped = next(k for k, (state, _) in enumerate(b.states) if state in (State.STOPPING, State.STOPPED))
    assert stopped <= 103 + away
    assert b.states[stopped][1] is Cause.INTENT_LOSS
    assert b.graph.layout.value(b.rows(), "arm.command.applied").max() < 0.35


@pytest.mark.usefixtures("sight")
@pytest.mark.parametrize(("turn", "still"), [([0.0, 1.0, 0.0, 0.0], False), ([0.995, 0.0998, 0.0, 0.0], True)])
def test_a_pose_that_turns_at_once_is_lost(tmp_path: Path, turn: list[float], still: bool) -> None:
    b = seeing(tmp_path)
    b.run(200, lambda k: b.panel.values["pose"].__setitem__(slice(3, 7), [1, 0, 0, 0] if k < 100 else turn))
    assert (b.states[-1][0] is State.ACTIVE) == still


@pytest.mark.usefixtures("sight")
def test_noise_and_a_quick_hand_are_no_jumps(tmp_path: Path) -> None:
    b, rng = seeing(tmp_path), np.random.default_rng(4)

    def move(k: int) -> None:
        b.panel.values["pose"][:2] = 0.5 * np.sin(k / 10), 0.3 * np.cos(k / 10)  # 5 m/s
        b.panel.values["pose"][:3] += rng.normal(0, 0.003, 3)

    b.run(400, move)
    assert b.states[-1][0] is State.ACTIVE


@pytest.mark.usefixtures("sight")
def test_nothing_moves_before_a_pose_was_seen(tmp_path: Path) -> None:
    b = seeing(tmp_path)
    b.panel.values["pose"][:] = np.nan
    b.run(100, lambda k: None)
    assert State.ACTIVE not in {state for state, _ in b.states}


@pytest.mark.usefixtures("sight")
def test_the_greatest_speed_is_the_profiles(tmp_path: Path) -> None:
    b = Bench(tmp_path, emergency="", more=FRAMES.replace("pose: panel.pose", "pose: panel.pose, speed: 100"))
    b.run(200, lambda k: b.panel.values["pose"].__setitem__(0, 0.0 if k < 100 else 0.7))
    assert b.states[-1][0] is State.ACTIVE


class Watcher(Law):
    """Reads a pose as an input."""

    def __init__(self, name: str, config: ControllerConfig) -> None:
        super().__init__(name, config)
        self.inputs = (Signal(name="x", shape=(7,), unit="m", labels=POSE),)

    def update(self, dt: float) -> None:
        self.output["q"][:] = 0.0


@pytest.mark.usefixtures("sight")
def test_a_pose_that_a_law_reads_is_watched_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its device goes on: it sees other bodies."""
    monkeypatch.setattr("helpers.toy.Law", Watcher)
    monkeypatch.setattr("helpers.toy.PROFILE", PROFILE.replace("x: hand.position", "x: panel.pose"))
    b = Bench(tmp_path, emergency="")

    def move(k: int) -> None:
        if k == 100:
            b.panel.values["pose"][:] = np.nan

    b.run(200, move)
    assert Cause.INTENT_LOSS in {cause for _, cause in b.states}


@pytest.mark.usefixtures("sight")
def test_a_body_that_nothing_uses_may_be_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("helpers.toy.Law", Law)
    b = seeing(tmp_path)
    b.run(200, lambda k: b.panel.values["pose"].fill(0.0))
    assert b.states[-1][0] is State.ACTIVE


@pytest.mark.usefixtures("sight")
@pytest.mark.parametrize(
    ("more", "problem"),
    [
        (FRAMES.replace("panel.pose", "panel.poes"), "'panel.poes' is no pose signal"),
        (FRAMES.replace("seen: {parent: room", "seen: {parent: tip").replace("tip: {parent: seen, ", "tip: {"), "room"),
        (FRAMES.replace("parent: seen", "parent: arm/hand"), "knows no link 'hand'"),
        (FRAMES.replace("parent: room, ", ""), "given in 'room', and the frame's parent is 'None'"),
        (FRAMES.replace("tip: {parent: seen, ", "tip: {"), "needs the tip in the room: nothing connects 'tip'"),
        ("", "no frame is called 'room'"),
        (FRAMES.replace("pose: panel", "position: [0, 0, 1], pose: panel"), "own place would count again"),
        (FRAMES.replace("panel.pose", "world.pose"), "'world.pose' is the simulation's truth"),
        (FRAMES.replace("tip: {", "tip: {speed: 3, "), "'tip' is fixed"),
        (FRAMES.replace("parent: seen", "parent: hand"), "'hand' is a device that has no frame of its own"),
    ],
)
def test_a_tree_that_doesnt_fit_is_refused(tmp_path: Path, more: str, problem: str) -> None:
    with pytest.raises(WiringError, match=problem):
        Bench(tmp_path, emergency="", more=more)


class Sayer(Law):
    """Says where the body is."""

    def __init__(self, name: str, config: ControllerConfig) -> None:
        super().__init__(name, config)
        self.outputs = (*self.outputs, Signal(name="pose", shape=(7,), unit="m", frame="room", labels=POSE))


@pytest.mark.usefixtures("sight")
def test_a_frame_that_a_later_law_measures_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor may a law's own output be among what it needs: a circle through signals."""

    class Both(Sayer):
        def __init__(self, name: str, config: ControllerConfig) -> None:
            super().__init__(name, config)
            self.transforms = Follower("", config).transforms
            self.outputs = tuple(replace(s) for s in self.outputs)

    monkeypatch.setattr("helpers.toy.Law", Both)
    with pytest.raises(WiringError, match=r"'law\.pose', which measures it, isn't made before"):
        Bench(tmp_path, emergency="", more=FRAMES.replace("panel.pose", "law.pose"))
