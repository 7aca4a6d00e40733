"""`srl show`: what it says of a profile is what the runtime has wired, and nothing of it is missing."""

from __future__ import annotations

import json
import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from srl.runtime.cli import main
from srl.runtime.contracts.rotation import Pose, composed, inverted
from srl.runtime.guard.limits import NAMES
from srl.runtime.loop.guards import limits_of
from srl.runtime.overview.overview import overview
from srl.runtime.profile import library, profile, wiring
from srl.runtime.profile.connections import connections
from srl.runtime.profile.graph import Graph

REPORT_EVERY = ("sixth-finger", "ikns-finger", "moca-man", "human-srl", "strap-jog")


@cache
def built(name: str, *overrides: str) -> tuple[Graph, dict[str, Any]]:
    """A profile as it is wired, without a simulation, and what `srl check --all --json` prints of it."""
    checked, source = profile.load(name, overrides)
    graph = wiring.build(checked, source)
    return graph, json.loads(json.dumps(overview(graph, limits_of(graph)), allow_nan=False))


def shown(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    part = {"--devices", "--wiring", "--frames"} & {*arguments}
    assert main(["check", *arguments, *([] if part else ["--all"])]) == 0
    return capsys.readouterr().out


def pose(values: list[float]) -> Pose:
    x, y, z, w, a, b, c = values
    return (x, y, z, w, a, b, c)


# The text


@pytest.mark.parametrize("name", REPORT_EVERY)
def test_the_text_has_each_device_law_frame_and_limit(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    graph, _ = built(name)
    output = shown(capsys, name)
    words = " ".join(output.split())
    for device in graph.devices:
        assert f"\n  {device.name}: {graph.profile.devices[device.name].driver}, " in output
        for signal in (*device.states, *device.commands):
            assert f" {device.name}.{signal.name}: {'x'.join(map(str, signal.shape))} {signal.unit}" in output
            assert ", ".join(signal.names) in words
    for number, (law, entry) in enumerate(zip(graph.laws, graph.profile.controllers, strict=True), 1):
        assert f"\n  {number}. {law.controller.name} ({entry.use}): " in output
        for port, wire in law.inputs.items():
            assert f"reads {port:<14} <- {' + '.join(wire.far)}:" in output
        for port, wire in law.outputs.items():
            assert f"{port} -> {' + '.join(wire.far)}:" in output
        for parameter in law.controller.parameters:
            assert f"live {law.controller.name}.{parameter.name}: {parameter.default:g}" in output
    for frame in graph.profile.frames:
        assert f" {frame}: " in output.partition("\nFRAMES\n")[2]
    for actuator in graph.actuators:
        part = output.partition(f"guard {actuator.name}: ")[2].partition("\n  guard ")[0]
        assert f"stop: {actuator.category}" in part
        rows = {line.split()[0]: line for line in part.splitlines() if line.startswith("    ")}
        for limit in NAMES:
            values = getattr(limits_of(graph)[actuator.name], limit)
            for element, value in zip(actuator.command.names, np.ravel([] if values is None else values), strict=False):
                reported = f" {value:.6g}" if math.isfinite(value) else " none"
                assert reported in rows[element], (actuator.name, limit, element)


@pytest.mark.parametrize("name", library.shipped())
def test_the_text_fits_and_is_plain(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    output = shown(capsys, name)
    assert max(map(len, output.splitlines())) <= 100
    assert "\x1b" not in output


def test_one_part_of_it(capsys: pytest.CaptureFixture[str]) -> None:
    heads = ("\nDEVICES\n", "\nWIRING\n", "\nFRAMES\n")
    for section, own in zip(("devices", "wiring", "frames"), heads, strict=True):
        output = shown(capsys, "sixth-finger", f"--{section}")
        assert [head for head in heads if head in output] == [own]


def test_what_stops_the_limb_and_what_lets_it_move_again(capsys: pytest.CaptureFixture[str]) -> None:
    output = shown(
        capsys, "moca-man", "--wiring", "--set", "emergency=[{signal: panel.buttons, element: P, category: damp}]",
        "--set", "reset.inputs=[{signal: panel.buttons, element: G}]",
    )  # fmt: skip
    assert "emergency panel.buttons[P] at 1: damp" in output
    assert "intent loss, sensor lost, or older than 0.1 s: each command's own stop" in output
    assert "overruns within 1 s: 20 tolerated, 200 stop" in output
    assert "reset by panel.buttons[G] at 1" in output
    assert "no emergency input" in shown(capsys, "moca-man", "--wiring")


def test_what_it_keeps_clear_of_and_joints_that_slide(capsys: pytest.CaptureFixture[str]) -> None:
    output = shown(capsys, "human-srl", "--wiring")
    assert "keeps clear (body-clearance)" in output
    assert "lag 0.03 s, tracking J1 0.02, J2 0.02, J3 0.02, J4 0.02, J5 0.001, J6 0.02, J7 0.02" in output
    assert "    J5  0 m    0.1 m  0.08 m/s  0.4 m/s^2" in output


def test_the_base_is_bound_by_the_drivers_limit_where_that_is_narrower() -> None:
    graph, found = built("moca-man")
    (twist,) = (c for c in found["commands"] if c["name"] == "base.twist_command")
    assert graph.profile.guard["base.twist_command"].acceleration == [1.0, 1.0, 1.0]
    assert twist["limits"]["acceleration"]["values"] == {"vx": 0.6, "vy": 0.6, "wz": 1.0}
    assert twist["limits"]["acceleration"]["units"] == {"vx": "m/s^2", "vy": "m/s^2", "wz": "rad/s^2"}


def test_a_rotation_is_shown_as_the_profile_gives_it(capsys: pytest.CaptureFixture[str]) -> None:
    output = shown(capsys, "moca-man", "--frames", "--set", "frames.tool.rpy=[0, 0, 0.5]")
    assert "tool: in arm/flange, fixed: position 0, 0, 0.1 m, rpy 0, 0, 0.5 rad" in output
    assert "quaternion 0.70711, 0, 0.70711, 0 (rpy 0, 1.5708, 0 rad)" in " ".join(output.split())
    assert "base: in world, measured by base.pose (believed up to 10 m/s)" in output
    assert "arm/flange: moves with the joints of arm" in output


def test_simulated_parts_stand_where_the_profile_says(capsys: pytest.CaptureFixture[str]) -> None:
    output = shown(capsys, "ikns-finger", "--sim", "--frames")
    assert "  room: root\n      simulated part wearer (upper-body) at 0, 0, 1.1 m\n" in output
    assert "    wearer/right_forearm: body of the simulated part wearer\n        simulated part finger" in output
    assert "simulated part" not in shown(capsys, "ikns-finger", "--frames")


# JSON


@pytest.mark.parametrize("name", library.shipped())
def test_json_has_all_that_is_wired(name: str) -> None:
    graph, found = built(name)
    assert [device["name"] for device in found["devices"]] == [device.name for device in graph.devices]
    for device, item in zip(graph.devices, found["devices"], strict=True):
        for signals, key in ((device.states, "states"), (device.commands, "commands")):
            assert [
                (each["name"], tuple(each["shape"]), each["unit"], each["frame"], tuple(each["elements"]))
                for each in item[key]
            ] == [(f"{device.name}.{s.name}", s.shape, s.unit, s.frame, s.names) for s in signals]
        assert item["max_age"] == (device.max_age or None)
    wires = [(" + ".join(w["signals"]), f"{law['name']}.{w['port']}") for law in found["laws"] for w in law["reads"]]
    wires += [(f"{law['name']}.{w['port']}", " + ".join(w["signals"])) for law in found["laws"] for w in law["writes"]]
    wires += [(" + ".join(w["signals"]), f"{c['name']}.clear.{w['port']}") for c in found["commands"] if c["clear"]
              for w in c["clear"]["reads"]]  # fmt: skip
    assert sorted(wires) == sorted((each.start, each.end) for each in connections(graph))
    assert [need["name"] for law in found["laws"] for need in law["needs"]] == [
        f"{law.controller.name}.{each.need.name}" for law in graph.laws for each in law.transforms
    ]
    live = graph.layout.meta["parameters"]
    assert [p for law in found["laws"] for p in law["parameters"]] == live
    assert [c["name"] for c in found["clients"]] == list(graph.profile.setpoints)
    for actuator, item in zip(graph.actuators, found["commands"], strict=True):
        limits = limits_of(graph)[actuator.name]
        assert (item["name"], item["stop"]) == (actuator.name, actuator.category)
        assert list(item["limits"]) == [limit for limit in NAMES if getattr(limits, limit) is not None]
        for limit, values in item["limits"].items():
            wanted = np.ravel(getattr(limits, limit)).tolist()
            assert list(values["values"].values()) == [v if math.isfinite(v) else None for v in wanted]
    names = [frame["name"] for frame in found["frames"]]
    assert len(set(names)) == len(names)
    parents = {entry.parent for entry in graph.profile.frames.values()} - {None}
    assert set(names) >= {*graph.profile.frames, *parents}
    for frame in found["frames"]:
        entry = graph.profile.frames.get(frame["name"])
        assert frame["measured_by"] == (entry.pose if entry else None)
        assert frame["parent"] == entry.parent if entry else frame["pose"] is None
    assert [model["name"] for model in found["models"]] == list(graph.profile.models)


def test_the_commands_json_is_the_overview(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert json.loads(shown(capsys, "sixth-finger", "--json")) == built("sixth-finger")[1]


# Frames


@pytest.mark.parametrize("name", ["sixth-finger", "moca-man", "kairos-man", "moca-finger", "strap-jog"])
def test_frames_agree_with_the_transforms_that_laws_are_given(name: str) -> None:
    graph, found = built(name)
    frames = {frame["name"]: frame for frame in found["frames"]}
    given = [each for law in graph.laws for each in law.transforms]
    assert given
    for each in given:
        target, source = (frames[end] for end in (each.path.target, each.path.source))
        assert target["root"] == source["root"]
        made = composed(inverted(pose(target["pose_in_root"])), pose(source["pose_in_root"]))
        assert made == pytest.approx(each.pose, abs=1e-12)
    for law in graph.laws:
        for each in law.transforms:
            if not each.signals:
                assert list(law.controller.transform[each.need.name]) == pytest.approx(each.pose)


@pytest.mark.parametrize("name", library.shipped())
def test_each_frame_is_its_parents_turned_and_moved_by_its_own_numbers(name: str) -> None:
    _, found = built(name)
    before: dict[str, dict[str, Any]] = {}
    for frame in found["frames"]:
        if frame["pose"] is not None:
            above = before[frame["parent"]]
            assert frame["depth"] == above["depth"] + 1
            made = composed(pose(above["pose_in_root"]), pose(frame["pose"]))
            assert made == pytest.approx(frame["pose_in_root"], abs=1e-12)
            assert frame["pose"][:3] == frame["position"]
        before[frame["name"]] = frame


def test_the_turn_is_in_radians_about_fixed_axes() -> None:
    _, found = built("moca-man", "frames.tool.rpy=[0.1, -0.2, 0.3]")
    (tool,) = (frame for frame in found["frames"] if frame["name"] == "tool")
    assert tool["rpy"] == [0.1, -0.2, 0.3]
    assert tool["turned"] == pytest.approx([0.1, -0.2, 0.3])
    (handle,) = (frame for frame in found["frames"] if frame["name"] == "handle")
    assert handle["turned"] == pytest.approx([0.0, math.pi / 2, 0.0])


def test_a_recorded_arms_flange_is_still_a_link() -> None:
    """A recording stands in the arm's place, and declares no links."""
    graph = wiring.build(*profile.load("moca-man"))
    (arm,) = (device for device in graph.devices if device.name == "arm")
    arm.here, arm.links = False, ()
    kinds = {frame["name"]: frame["kind"] for frame in overview(graph, limits_of(graph))["frames"]}
    assert kinds["arm/flange"] == "link"


# Errors


@pytest.mark.parametrize(
    "arguments",
    [
        ["sixth-finge"],
        ["sixth-finger", "--set", "controllers.0.in.angles=glove.nothing"],
        ["sixth-finger", "--set", "guard.finger.position_command.velocity=-1"],
        ["sixth-finger", "--set", "frames.finger.parent=nowhere"],
        ["sixth-finger", "--sim", "nothing"],
        ["moca-man", "--set", "bus.tls={ca: /nowhere/ca.pem, certificate: /nowhere/a.pem, key: /nowhere/a.key}"],
    ],
)
def test_it_refuses_what_a_check_refuses_in_the_same_words(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    output = []
    for more in ([], ["--all"]):
        assert main(["check", *arguments, *more]) == 2
        output.append(capsys.readouterr().err)
    assert output[0] == output[1]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--figure", "wiring.pdf"], "doesn't end in .png"),
        (["--figure", "no/such/folder.png"], "can't be written"),
        (["--json", "--frames"], "Leave one of the two out"),
    ],
)
def test_options_that_cant_be(
    arguments: list[str],
    words: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["check", "sixth-finger", *arguments]) == 2
    reported = capsys.readouterr()
    assert words in reported.err
    assert reported.out == ""
    assert not list(tmp_path.iterdir())


# What is true


def test_it_says_how_a_run_begins(capsys: pytest.CaptureFixture[str]) -> None:
    """As `srl run` decides it: not the profile's word alone."""
    assert "start manual\n" in shown(capsys, "human-srl")
    assert "start auto\n" in shown(capsys, "human-srl", "--sim")  # of `sim.start`
    output = " ".join(shown(capsys, "sixth-finger").split())
    assert "start auto, but finger.position_command has no position feedback: it waits for `srl start`" in output
    assert "no position feedback" not in shown(capsys, "sixth-finger", "--sim")
    assert main(["check", "human-srl", "--sim"]) == 0
    assert "start auto\n" in capsys.readouterr().out


def test_bounds_of_motors_are_shown_before_the_device_is_open(capsys: pytest.CaptureFixture[str]) -> None:
    for simulated in ([], ["--sim"]):
        output = shown(capsys, "servo-jog", "--wiring", *simulated)
        assert "    proximal  -1.2   1.2    1         5\n" in output
        assert "no bound of the position" not in output
    output = shown(capsys, "servo-jog", "--set", "devices.finger.motors.distal={id: 2, model: MX-28, upper: 0.5}")
    assert "    distal    none   0.5    1         5\n" in output
    output = shown(capsys, "servo-jog", "--set", "devices.finger.motors={proximal: {id: 1, model: MX-28}, "
                 "distal: {id: 2, model: MX-28}}")  # fmt: skip
    assert "no bound of the position before the device is open" in output


def test_what_a_text_hides_from_a_terminal_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    output = shown(capsys, "servo-jog", "--set", 'summary="bring-up\\e[2K\\e[1A\\x07 of \\u202ea finger"')
    assert output.startswith("servo-jog: bring-up\\x1b[2K\\x1b[1A\\x07 of \\u202ea finger\n")
    assert "sechster Finger für Zoë" in shown(capsys, "servo-jog", "--set", "summary=sechster Finger für Zoë")


def test_a_deep_tree_and_long_names_stay_readable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    text, device = profile.find("servo-jog")[1], "d" * 110
    chain = "".join(f"  f{i}: {{parent: {f'f{i - 1}' if i else 'null'}}}\n" for i in range(60))
    for old in ("finger:\n    driver", "finger.", "{finger:"):
        text = text.replace(old, old.replace("finger", device))
    before, _, after = text.partition("sim:")
    choices = "choices:" + after.partition("choices:")[2]
    (tmp_path / "deep.yaml").write_text(f"{before}{choices}frames:\n{chain}")
    output = shown(capsys, "deep.yaml")
    assert max(map(len, output.splitlines())) <= 100
    assert f"\n{' ' * 42}f59: in f58, fixed: position 0, 0, 0 m, not turned\n" in output
