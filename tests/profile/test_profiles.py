"""Every profile that is shipped: its wiring holds, on the real devices and in simulation."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from srl.runtime.cli import main
from srl.runtime.profile import profile, wiring

PROFILES = sorted(path.stem for path in (Path(__file__).parents[2] / "profiles").glob("*.yaml"))
WORDS = [
    (path.stem, f"{choice}={word}")
    for path in sorted((Path(__file__).parents[2] / "profiles").glob("*.yaml"))
    for choice, branches in YAML(typ="safe", pure=True).load(path.read_text()).get("choices", {}).items()
    for word in branches
]


@pytest.mark.parametrize("name", PROFILES)
def test_its_wiring_holds(name: str) -> None:
    checked, source = profile.load(name)
    real = wiring.build(checked, source)
    assert not real.simulated
    simulated = wiring.build(checked, source, [])
    assert simulated.world is not None
    assert set(simulated.simulated) == set(checked.devices)
    simulated.world.close()


@pytest.mark.parametrize(("name", "word"), WORDS)
def test_the_wiring_of_each_choice_holds(name: str, word: str) -> None:
    checked, source = profile.load(name, [word])
    wiring.build(checked, source)
    simulated = wiring.build(checked, source, [])
    assert set(simulated.simulated) == set(checked.devices)
    assert simulated.world is not None
    simulated.world.close()


def test_ikns_finger_takes_its_control_value_from_six_sources() -> None:
    words = {word for name, word in WORDS if name == "ikns-finger"}
    markers = {"input=ikns", "input=ikns-optitrack", "input=ikns-xsens"}
    assert words == {*markers, "input=gamepad", "input=gamepad-rate", "input=ring"}


@pytest.mark.parametrize("name", PROFILES)
def test_srl_check_accepts_it(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", name]) == 0
    assert name in capsys.readouterr().out


def test_srl_check_prints_what_goes_by_name_and_what_nothing_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = profile.find("moca-man")[1].replace(
        "{A: {pin: 2}, M: {pin: 3},", "{M: {pin: 3}, A: {pin: 2}, more: {pin: 6},"
    )
    turned = tmp_path / "turned.yaml"
    turned.write_text(text)
    assert main(["check", str(turned)]) == 0
    output = capsys.readouterr().out
    for line in (
        r"panel.buttons +-> keys.buttons +4 1, by name",
        r"    panel.buttons\[A\] +-> keys.buttons\[A\]",
        r"  nothing takes panel.buttons\[more\], arm.effort, ",
        r"    lower: joint1 -2.847, joint2 -1.712, ",
        r"    velocity: vx 0.6, vy 0.5, wz 0.7",
    ):
        assert re.search(line, output), f"{line} isn't in {output}"
    assert main(["check", str(turned), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    wires = {wire["end"]: wire for wire in found["wiring"]}
    assert wires["keys.buttons"]["elements"][0] == ["panel.buttons[A]", "keys.buttons[A]"]
    assert wires["tool.q"]["elements"] == []
    assert found["untaken"][0] == "panel.buttons[more]"
    assert found["listed_limits"]["arm.torque_command"]["effort"]["joint5"] == 11.0


def test_the_schema_takes_both_forms_of_a_wire(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "--schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    wire = schema["$defs"]["ControllerEntry"]["properties"]["in"]["additionalProperties"]
    assert {"type": "string"} in wire["anyOf"]
    assert {"from", "map"} == set(schema["$defs"]["From"]["properties"])
