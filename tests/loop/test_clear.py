"""A guard with a clearance in a running loop: flags, margins, events, ages, stops, and the same bits in a replay."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.planar import PlanarClearance
from helpers.toy import JOINTS, PROFILE, Bench, Law, Toy, ToyConfig

from srl.runtime.contracts import registry
from srl.runtime.contracts.controller import ControllerConfig
from srl.runtime.contracts.errors import ProfileError, WiringError
from srl.runtime.contracts.signals import Kind, Signal
from srl.runtime.ipc.header import FLAG_HELD, State
from srl.runtime.loop import device as device_module
from srl.runtime.loop.replay import replay

XY = ("x", "y")
CLEAR = (
    "clear: {use: planar, lag: 0.01, tracking: {shoulder: 0.0, elbow: 0.01}, in: {centre: %s, velocity: disc.velocity}}"
)


class Things(Toy):
    """The toy devices, and a disc that is seen."""

    def __init__(self, name: str, config: ToyConfig) -> None:
        super().__init__(name, config)
        if config.part == "disc":
            self.states = (
                Signal(name="centre", shape=(2,), unit="m", labels=XY),
                Signal(name="velocity", shape=(2,), unit="m/s", labels=XY),
            )
            self.values = {"centre": np.array([9.0, 9.0]), "velocity": np.zeros(2)}


class Copies(Law):
    """The toy's law, or one that copies the disc's centre."""

    def __init__(self, name: str, config: ControllerConfig) -> None:
        super().__init__(name, config)
        if name == "copy":
            self.inputs = (Signal(name="x", shape=(2,), unit="m", labels=XY),)
            self.outputs = (Signal(name="q", shape=(2,), unit="m", labels=XY),)


def _load(group: str, name: str, place: str) -> Any:
    return {"drivers": Things, "controllers": Copies, "clearances": PlanarClearance}[group]


@pytest.fixture(autouse=True)
def _registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("helpers.toy._load", _load)
    monkeypatch.setattr(registry, "load", _load)
    _profile(monkeypatch)


def _profile(monkeypatch: pytest.MonkeyPatch, centre: str = "disc.centre", clear: str = "", category: str = "") -> None:
    text = PROFILE.replace("controllers:", "  disc: {{driver: toy, part: disc}}\ncontrollers:")
    wanted = (clear or CLEAR % centre).replace("{", "{{").replace("}", "}}")
    text = text.replace("acceleration: 10}}", f"acceleration: 10, {wanted}}}}}")
    if centre != "disc.centre":
        text = text.replace("guard:", "  - {{use: law, name: copy, in: {{x: disc.centre}}}}\nguard:")
    if category:
        text += f"stop: {{{{arm: {category}}}}}\n"
    monkeypatch.setattr("helpers.toy.PROFILE", text)


def bench(folder: Path) -> tuple[Bench, Any]:
    b = Bench(folder)
    (disc,) = b.others
    return b, disc


def forward(b: Bench, more: Callable[[int], None] = lambda k: None) -> Callable[[int], None]:
    """The hand asks the arm to turn, from -1 to 1 rad; `more` is called, too."""

    def script(k: int) -> None:
        b.hand.values["position"][:] = 1.0, 0.0
        if k == 0:
            b.arm.values["position"][:] = -1.0, 0.0
        more(k)

    return script


def rows_of(b: Bench, name: str) -> Any:
    return b.graph.layout.value(b.rows(), name)


def test_the_row_and_an_event_say_that_the_arm_is_held_and_by_what(tmp_path: Path) -> None:
    b, disc = bench(tmp_path)

    def script(k: int) -> None:
        disc.values["centre"][:] = (0.5, 0.0) if k < 250 else (9.0, 9.0)

    b.run(600, forward(b, script))
    held = (b.header("flags") & FLAG_HELD) > 0
    margin = rows_of(b, "arm.command.margin")[:, 0]
    assert held[200:250].all()
    assert not held[251:].any()
    assert (margin[200:250] < 0).all()
    assert (margin[300:600] > 1).all()
    assert np.isnan(margin[0]), "nothing was judged before the start"
    assert any("'arm.command' is held: link 2 and the disc" in event for event in b.events)
    assert any("'arm.command' is held no longer" in event for event in b.events)
    assert sum("held" in event for event in b.events) == 2
    assert b.cycle.machine.state is State.ENDED
    assert b.arm.sent[-1][0] == pytest.approx(1.0)
    assert abs(np.diff(np.array(b.arm.sent)[:, 0])).max() <= 0.01 * (1 + 1e-6)


@pytest.mark.parametrize("lost", ["silent", "gone"])
def test_a_body_that_isn_t_seen_any_more_brings_the_arm_to_rest_and_is_no_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lost: str
) -> None:
    """It feeds no law, so the loss stops nothing else; the arm goes on when it is seen again."""
    b, disc = bench(tmp_path)

    def script(k: int) -> None:
        if k == 100:
            setattr(disc, lost, True)
        if k == 200:
            disc.silent = disc.gone = False
            if lost == "gone":
                b.until_back(disc)

    monkeypatch.setattr(device_module, "RETRY", 0.01)
    b.run(500, forward(b, script))
    sent = np.array(b.arm.sent)[:, 0]
    assert (b.header("flags")[120:200] & FLAG_HELD).all()
    assert np.ptp(sent[140:199]) == 0
    assert sent[140] < 0.5
    assert (b.header("state")[5:500] == State.ACTIVE).all()
    assert any("the disc isn't seen" in event for event in b.events)
    assert sent[-1] == pytest.approx(1.0)


def test_the_age_is_that_of_the_device_behind_a_law(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _profile(monkeypatch, "copy.q")
    b, disc = bench(tmp_path)
    ages = []

    def script(k: int) -> None:
        disc.silent = 50 <= k < 53
        ages.append(b.graph.clearances["arm.command"].clearance._age)  # type: ignore[attr-defined]

    b.run(100, forward(b, script))
    assert ages[40] == 0.0
    assert ages[53] == pytest.approx(0.03)
    assert ages[60] == 0.0


def test_the_guard_knows_how_old_the_measured_position_is(tmp_path: Path) -> None:
    b, _ = bench(tmp_path)
    verified = b.cycle.guards[0].verified
    assert verified is not None
    ages = []

    def script(k: int) -> None:
        b.arm.silent = 50 <= k < 53
        ages.append(verified.age)

    b.run(100, forward(b, script))
    assert (ages[40], ages[60]) == (0.0, 0.0)
    assert ages[53] == pytest.approx(0.03)


def test_what_a_law_gave_before_a_stop_is_not_believed_in_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Laws don't run in a stop: their outputs stand still while the body moves on. A device's state goes on."""
    moved = {}
    for centre in ("copy.q", "disc.centre"):
        _profile(monkeypatch, centre, category="retract")
        folder = tmp_path / centre
        folder.mkdir()
        b, _ = bench(folder)

        def script(k: int, b: Bench = b) -> None:
            if k == 100:
                b.ask("stop")

        b.run(600, forward(b, script))
        sent = np.array(b.arm.sent)
        moved[centre] = float(abs(sent[-1] - sent[150]).max())
        if centre == "copy.q":
            assert (b.header("flags")[130:500] & FLAG_HELD).all()
        else:
            assert sent[-1] == pytest.approx([0.7, 0.7])
    assert moved["copy.q"] == 0.0


def test_a_limb_that_goes_limp_may_be_anywhere_from_that_cycle_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another limb may be judged by where this one is."""
    _profile(monkeypatch, category="limp")
    b, _ = bench(tmp_path)
    (actuator,) = b.graph.actuators
    assert actuator.cleared is not None
    clearance, known = actuator.cleared.clearance, []
    clearance.watched = True

    def script(k: int) -> None:
        known.append(clearance.extent is not None)  # at the end of the cycle before
        if k == 100:
            b.ask("stop")

    b.run(200, forward(b, script))
    active = b.header("state")[:199] == State.ACTIVE
    assert (np.array(known[1:200]) == active)[10:].all()


def test_a_replay_finds_no_difference(tmp_path: Path) -> None:
    b, disc = bench(tmp_path)

    def script(k: int) -> None:
        disc.values["centre"][:] = 0.35 + 0.2 * np.sin(k / 30), 0.3 * np.cos(k / 20)
        disc.silent = 200 < k < 230
        if k == 300:
            b.ask("stop")
        if k == 350:
            b.ask("reset")

    b.run(500, forward(b, script))
    assert 20 < ((b.header("flags") & FLAG_HELD) > 0).sum() < 480
    found = replay(b.graph.layout, b.rows()[:-1], "test")  # the bench ends the last one by itself
    assert found.identical, found.signals


def test_an_error_in_a_clearance_holds_the_arm_and_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    b, _ = bench(tmp_path)

    def script(k: int) -> None:
        if k == 100:
            monkeypatch.setattr(PlanarClearance, "begin", lambda self, now, stamps: int("one"))

    b.run(300, forward(b, script))
    assert (b.header("flags")[101:] & FLAG_HELD)[:-1].all()
    assert np.ptp(np.array(b.arm.sent)[150:], axis=0).max() == 0
    assert any("the clearance failed: ValueError" in event for event in b.events)


@pytest.mark.parametrize(
    ("clear", "match"),
    [
        ("clear: {lag: 0, tracking: 0}", "'use' is missing"),
        ("clear: {use: planar, tracking: 0}", "'lag' is missing"),
        ("clear: {use: planar, lag: 0}", "'tracking' is missing"),
        ("clear: {use: planar, lag: 0, tracking: 0, colour: 1}", "'colour' isn't known"),
        ("clear: {use: planar, lag: 0, tracking: {wrist: 1}}", "no element is called 'wrist'"),
        ("clear: {use: planar, lag: 0, tracking: 0, in: {centre: disc.centre}}", "'velocity'.*isn't bound"),
        ("clear: {use: planar, lag: 0, tracking: 0, in: {middle: disc.centre}}", "no input 'middle'"),
        (CLEAR % "disc.middle", "no signal is called 'disc.middle'"),
        (CLEAR % "hand.position", "units differ"),
        (CLEAR % "client.centre", "no signal"),
    ],
)
def test_a_clear_that_can_t_be_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clear: str, match: str
) -> None:
    _profile(monkeypatch, clear=clear)
    with pytest.raises((ProfileError, WiringError), match=match) as error:
        Bench(tmp_path)
    assert "guard.arm.command.clear" in error.value.place
    assert JOINTS == ("shoulder", "elbow")


@pytest.mark.parametrize(
    ("kind", "device", "profile", "found"),
    [
        (Kind.VELOCITY, None, None, "isn't known to end it by itself"),
        (Kind.VELOCITY, None, 0.2, 0.2),
        (Kind.VELOCITY, 0.1, None, 0.1),
        (Kind.VELOCITY, 0.1, 0.02, 0.1),
        (Kind.POSITION, 0.1, None, None),
        (Kind.POSITION, None, 0.2, "Remove `timeout`"),
    ],
)
def test_a_velocity_needs_a_device_that_ends_it_by_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: Kind, device: float | None, profile: float | None, found: Any
) -> None:
    """In `srl check` already: the wiring refuses it. Of two times that are said the longer counts."""
    make = Things.__init__

    def changed(self: Things, name: str, config: ToyConfig) -> None:
        make(self, name, config)
        self.commands = tuple(replace(c, kind=kind, timeout=device) for c in self.commands)

    monkeypatch.setattr(Things, "__init__", changed)
    more = f"timeout: {profile}, use" if profile else "use"
    _profile(monkeypatch, clear=(CLEAR % "disc.centre").replace("use", more, 1))
    if isinstance(found, str):
        with pytest.raises(WiringError, match=found) as error:
            Bench(tmp_path)
        assert "guard.arm.command.clear" in error.value.place
        return
    b = Bench(tmp_path)
    assert b.graph.clearances["arm.command"].timeout == found
    verified = b.cycle.guards[0].verified
    assert verified is not None
    assert verified.goes_on == (max(found, 0.05) if found else 0.0)
