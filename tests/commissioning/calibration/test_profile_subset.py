"""The part of a profile that a calibration needs: it works without the file, and nothing in it can move."""

from __future__ import annotations

from math import inf
from pathlib import Path
from typing import Any

import pytest
from helpers.calibration import FEW, PROFILE

from srl.commissioning.calibration.profile_subset import MARKS, _build, build, subset
from srl.runtime.contracts import registry
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.errors import ProfileError, SrlError, WiringError
from srl.runtime.contracts.files import Files
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.terms import POSE
from srl.runtime.loop.guards import limits_of
from srl.runtime.profile import profile
from srl.runtime.profile.profile import Profile


def made(text: str, sim: bool = False, dofs: tuple[str, ...] = ("swivel",)) -> Profile:
    return subset(*profile.parse("worn.yaml", text), "P07", dofs, FEW, sim)[0]


@pytest.mark.parametrize("sim", [False, True])
def test_only_what_the_law_reads_is_left(sim: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # where no p07.json is
    checked, source = subset(*profile.parse("worn.yaml", PROFILE), "P07", ("swivel",), FEW, sim)
    assert list(checked.devices) == ["mocap"]
    assert [entry.use for entry in checked.controllers] == ["arm-angles", MARKS]
    assert checked.bus is None
    assert checked.start == "auto"
    left = checked.guard, checked.stop, checked.emergency, checked.setpoints, checked.record.plots
    assert not any(left)
    assert list(checked.frames) == ["room", "chest"]
    graph = build(checked, source, sim)
    assert graph.actuators == []
    assert limits_of(graph) == {}
    assert not any(device.commands for device in graph.devices)
    # It is text that another process reads as the same.
    assert profile.parse(source.label, source.text)[0] == checked


def test_the_marks_say_where_each_joint_is() -> None:
    options = made(PROFILE).controllers[-1].options
    joints = list(options["angles"])
    assert joints[0] == "right_shoulder_abduction"
    assert len(joints) == 7
    assert options["angles"]["right_elbow_flexion"] == "arm.angles[right_elbow_flexion]"
    assert options["held"]["right_elbow_flexion"] == "arm.held[right_elbow_flexion]"
    assert (options["person"], options["hand"]) == ("P07", "arm.hand")


def test_who_leaves_the_view_meanwhile_is_no_loss() -> None:
    (angles, _) = made(PROFILE).controllers
    assert angles.options["max_hold"] == inf


def test_other_names_of_the_joints_are_kept() -> None:
    text = PROFILE.replace(
        "in: {angles: arm.angles,", "in: {angles: {from: arm.angles, map: {elbow: right_elbow_flexion}},"
    )
    angles = made(text).controllers[-1].options["angles"]
    assert angles["elbow"] == "arm.angles[right_elbow_flexion]"
    assert "right_elbow_flexion" not in angles


def test_which_joints_are_held_is_where_the_law_reads_it() -> None:
    held = "held: {from: other.held, map: {elbow: right_elbow_flexion}}"
    other = (
        "  - use: arm-angles\n    name: other\n    in: {markers: mocap.markers, marker_visible: mocap.marker_visible}\n"
    )
    text = PROFILE.replace("  - use: ikns\n", f"{other}  - use: ikns\n").replace("held: arm.held", held)
    text = text.replace(
        "in: {angles: arm.angles,", "in: {angles: {from: arm.angles, map: {elbow: right_elbow_flexion}},"
    )
    options = made(text).controllers[-1].options
    assert options["angles"]["elbow"] == "arm.angles[right_elbow_flexion]"
    assert options["held"]["elbow"] == "other.held[right_elbow_flexion]"
    assert options["held"].keys() == options["angles"].keys()
    assert made(PROFILE.replace(" held: arm.held,", "")).controllers[-1].options["held"] == {}


def test_a_clock_that_is_left_out_is_replaced() -> None:
    assert made(PROFILE.replace("clock: monotonic", "clock: finger")).clock == "monotonic"
    assert made(PROFILE.replace("clock: monotonic", "clock: mocap")).clock == "mocap"


def test_a_frame_on_what_is_left_out_goes_and_takes_with_it_what_hangs_on_it() -> None:
    more = "  tip: {parent: finger/base, position: [0.1, 0.0, 0.0]}\n  nail: {parent: tip}\nsim:"
    assert list(made(PROFILE.replace("sim:", more, 1)).frames) == ["room", "chest"]


@pytest.mark.parametrize(
    ("old", "new", "error", "words"),
    [
        ("use: ikns\n", "use: joint-setpoint\n", ProfileError, r"the profile has no law 'ikns'"),
        ("angles: arm.angles, ", "", WiringError, r"line 31: .*input 'angles' isn't bound"),
        ("angles: arm.angles", "angles: arn.angles", WiringError, r"no signal 'arn\.angles' is made before"),
        ("hand: arm.hand", "hand: closure.q", WiringError, r"no signal 'closure\.q' is made before"),
        ("hand: arm.hand", "hand: client.hand", WiringError, r"comes from clients of the bus"),
    ],
)
def test_what_cant_be_cut_is_refused(old: str, new: str, error: type[Exception], words: str) -> None:
    text = PROFILE.replace(old, new, 1)
    if "client" in new:
        text += "setpoints: {client.hand: {shape: [7], unit: m, labels: [x, y, z, qw, qx, qy, qz]}}\n"
    with pytest.raises(error, match=words):
        made(text)


def test_a_path_that_was_typed_begins_where_srl_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    typed = "devices.mocap={driver: replay, device: mocap, recording: rel.rrd}"
    checked, source = profile.parse("worn.yaml", PROFILE, [typed], Files(tmp_path / "there"))
    with pytest.raises(SrlError, match=f"{tmp_path}/rel.rrd"):
        subset(checked, source, "P07", ("swivel",), FEW)


def test_what_was_typed_stays_what_it_was() -> None:
    typed = ["devices.mocap.port=tcp://10.0.0.1:801", "devices.mocap.markers.clav='wearer/on #1'"]
    checked, source = subset(*profile.parse("worn.yaml", PROFILE, typed), "P07", ("swivel",), FEW)
    assert checked.devices["mocap"].options["port"] == "tcp://10.0.0.1:801"
    assert checked.devices["mocap"].options["markers"]["clav"] == "wearer/on #1"
    assert profile.parse(source.label, source.text, source.overrides)[0] == checked


def test_an_error_in_the_cut_profile_is_at_its_place_in_the_whole() -> None:
    more = "  - {use: axis-rate, name: first, in: {axis: ring.buttons}}\n  - use: arm-angles"
    text = PROFILE.replace("  - use: arm-angles", more).replace("part: upper-body", "part: upper-body, statur: 2")
    line = text[: text.index("statur: 2")].count("\n") + 1
    checked, source = profile.parse("worn.yaml", text)
    with pytest.raises(SrlError, match=rf"worn\.yaml line {line}: sim\.parts\.wearer"):
        subset(checked, source, "P07", ("swivel",), FEW, sim=True)
    bad = PROFILE.replace("  - use: arm-angles", more).replace("chest: chest", "chst: chest")
    line = bad[: bad.index("chst")].count("\n") + 1
    with pytest.raises(SrlError, match=rf"worn\.yaml line {line}: controllers\.1\.chst"):
        subset(*profile.parse("worn.yaml", bad), "P07", ("swivel",), FEW)


def test_two_laws_are_refused() -> None:
    second = "  - {use: ikns, name: again, calibration: a.json, in: {angles: arm.angles, hand: arm.hand}}\n  - use: fin"
    with pytest.raises(ProfileError, match="has 2 laws 'ikns'"):
        made(PROFILE.replace("  - use: fin", second))


class Exoskeleton(Controller):
    """A law that gives an arm's angles from a device that it also commands."""

    summary = "an exoskeleton"

    def __init__(self, name: str, config: ControllerConfig) -> None:
        super().__init__(name, config)
        joints = tuple(f"joint{i}" for i in range(1, 8))
        self.inputs = (Signal(name="q", shape=(7,), unit="rad", labels=joints),)
        self.outputs = (
            Signal(name="angles", shape=(7,), unit="rad", labels=joints),
            Signal(name="hand", shape=(7,), unit="m", frame="chest", labels=POSE),
            Signal(name="velocity", shape=(7,), unit="rad/s", labels=joints),
        )

    def reset(self) -> None:
        """Has no state."""

    def update(self, dt: float) -> None:
        """Is never run here."""


EXOSKELETON = """
name: exo
rate: 1000
clock: arm
devices:
  arm: {driver: panda, port: tcp://172.16.0.2:1337, interface: velocity, collision: {torque: 20.0, force: 20.0}}
controllers:
  - {use: exoskeleton, name: exo, in: {q: arm.position}, out: {velocity: arm.velocity_command}}
  - {use: ikns, held: false, calibration: p.json, in: {angles: exo.angles, hand: exo.hand}}
guard: {arm.velocity_command: {velocity: 0.1, acceleration: 0.5}}
stop: {arm: hold}
frames: {chest: {}}
sim: {world: cell, parts: {arm: {part: panda}}}
"""


_OUT = ", out: {velocity: arm.velocity_command}"
_IKNS = "  - {use: ikns, held: false, calibration: p.json, in: {angles: exo.angles, hand: exo.hand}}\n"


@pytest.mark.parametrize("sim", [False, True])
@pytest.mark.parametrize(
    ("old", "words"),
    [
        ("", r"line 8: controllers\.0\.out\.velocity: .*also commands 'arm\.velocity_command'\. Split it"),
        (_OUT, r"line 6: devices\.arm: .*takes commands \('arm\.velocity_command'\)"),
    ],
)
def test_what_could_move_is_refused(old: str, words: str, sim: bool, known: None) -> None:
    text = EXOSKELETON
    if old:  # another law commands what this one reads
        other = f"  - {{use: exoskeleton, name: b, in: {{q: arm.position}}{old}}}\n"
        text = text.replace(old, "").replace("guard:", f"{other}guard:")
    with pytest.raises(WiringError, match=words):
        made(text, sim)


def test_a_system_with_an_actuator_is_refused_whatever_the_text_says(known: None) -> None:
    text = EXOSKELETON.replace(_IKNS, "")
    _, source = profile.parse("exo.yaml", text)
    with pytest.raises(WiringError, match=r"exo\.yaml: it would still command 'arm\.velocity_command'"):
        _build(profile.tree(source.label, source.text)[0], source, [0], False)


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch) -> None:
    """The law is registered."""
    load = registry.load

    def registered(group: str, name: str, place: str) -> Any:
        return Exoskeleton if name == "exoskeleton" else load(group, name, place)

    monkeypatch.setattr(registry, "load", registered)
