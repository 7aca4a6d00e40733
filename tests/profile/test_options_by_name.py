"""Options by name in profiles: the order doesn't matter, a misspelt name is refused, and lists are shown as pairs."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from srl.runtime.cli import main
from srl.runtime.loop.guards import limits_of
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.graph import Graph

HOME = ("shoulder_pan 0", "shoulder_lift -1", "elbow 1", "wrist_1 -0.5", "wrist_2 -1.5", "wrist_3 0.2")
# What profiles give as lists, and what each value is for.
GIVEN = {
    "base-jog": {"devices.base.speed": ("vx 0.4", "vy 0.3", "wz 0.6")},
    "kairos-man": {"controllers.4.base_speed": ("vx 0.4", "vy 0.3", "wz 0.2")},
    "ur-jog": {"sim.parts.arm.home": HOME},
}


def forms(pairs: tuple[str, ...]) -> tuple[str, str]:
    """An option's value as a list, and by name in the opposite order."""
    split = [pair.split() for pair in pairs]
    return f"[{', '.join(v for _, v in split)}]", "{" + ", ".join(f"{n}: {v}" for n, v in reversed(split)) + "}"


def build(name: str, *changes: str) -> Graph:
    return wiring.build(*profile.load(name, changes), [])


Capture = pytest.CaptureFixture[str]


def check(capsys: Capture, *arguments: str, code: int = 0) -> tuple[str, str]:
    """What `srl check` prints, and its errors."""
    assert main(["check", *arguments]) == code
    return capsys.readouterr()


@pytest.mark.parametrize(("name", "option"), [(name, option) for name, found in GIVEN.items() for option in found])
def test_the_same_by_name_in_another_order(name: str, option: str) -> None:
    """Down to what the guard, the law and the world make of it."""
    one, other = (build(name, f"{option}={form}") for form in forms(GIVEN[name][option]))
    for a, b in zip(one.controllers, other.controllers, strict=True):
        assert a.config == b.config
    for command, limits in limits_of(one).items():
        for a, b in zip(vars(limits).values(), vars(limits_of(other)[command]).values(), strict=True):
            assert np.array_equal(a, b) if a is not None else b is None
    assert one.world is not None
    assert other.world is not None
    one.world.advance(20_000_000)
    other.world.advance(20_000_000)
    assert np.array_equal(one.world.save(), other.world.save())


@pytest.mark.parametrize(("name", "option"), [(name, option) for name, found in GIVEN.items() for option in found])
def test_srl_check_refuses_a_misspelt_name(capsys: Capture, name: str, option: str) -> None:
    first = GIVEN[name][option][0].split()[0]
    wrong = forms(GIVEN[name][option])[1].replace(first, f"{first}x")
    output = check(capsys, name, "--sim", "--set", f"{option}={wrong}", code=2)[1]
    assert f"--set {option}: no element is called '{first}x'. Did you mean '{first}'? Known: " in output
    assert "Traceback" not in output


def test_srl_check_prints_lists_as_pairs(capsys: Capture) -> None:
    pairs = GIVEN["ur-jog"]["sim.parts.arm.home"]
    listed, named = (f"sim.parts.arm.home={form}" for form in forms(pairs))
    assert f"  option sim.parts.arm.home: {', '.join(pairs)}\n" in check(capsys, "ur-jog", "--sim", "--set", listed)[0]
    assert "sim.parts.arm.home" not in check(capsys, "ur-jog", "--sim", "--set", named)[0]
    found = json.loads(check(capsys, "kairos-man", "--json")[0])
    assert found["listed_options"]["controllers.4.base_speed"] == {"vx": 0.6, "vy": 0.5, "wz": 0.7}
    assert found["listed_options"]["controllers.2.calibration.tool_com"] == {"x": 0.0, "y": 0.0, "z": 0.045}


def test_a_list_in_an_order_of_nobodys_is_refused(capsys: Capture) -> None:
    output = check(capsys, "moca-man", "--set", "devices.arm.load.inertia=[1,2,3,4,5,6]", code=2)[1]
    assert "devices.arm.load.inertia: a list goes by place" in output
    assert "Name them: {xx: 1, yy: 2, zz: 3, xy: 4, xz: 5, yz: 6}" in output


def test_limits_of_a_finger_are_given_by_name() -> None:
    lower: dict[str, Any] = {"flexion_3": -1.4, "flexion_1": -1.2, "abduction": -1.0, "flexion_2": -1.3}
    text = ", ".join(f"{name}: {value}" for name, value in lower.items())
    checked, _ = profile.load("sixth-finger", [f"models={{finger: {{kind: finger, lower: {{{text}}}, upper: 1.5}}}}"])
    finger: Any = checked.models["finger"]
    assert (finger.lower, finger.upper) == ((-1.0, -1.2, -1.3, -1.4), (1.5,) * 4)


@pytest.mark.parametrize(
    ("name", "option", "values"),
    [
        ("moca-man", "controllers.2.calibration.tool_com", (0.0, 0.0, 0.045)),
        ("moca-man", "controllers.3.base_acceleration", (1.0, 1.0, 1.0)),
        ("moca-man", "devices.arm.load.centre", (0.05, 0.003, 0.065)),
        ("moca-man", "devices.arm.collision.torque", (60.0,) * 7),
        ("moca-man", "devices.arm.collision.force", (60.0,) * 6),
        ("panda-jog", "devices.arm.collision.force", (20.0,) * 6),
        ("kairos-man", "devices.arm.payload_cog", (0.05, 0.003, 0.065)),
        ("kairos-man", "controllers.4.base_speed", (0.6, 0.5, 0.7)),
        ("kairos-man", "controllers.4.base_acceleration", (1.0, 1.0, 1.0)),
    ],
)
def test_shipped_profiles_keep_their_values(name: str, option: str, values: tuple[float, ...]) -> None:
    graph = build(name)
    owner, key, *rest = option.split(".")
    part: Any = graph.controllers[int(key)] if owner == "controllers" else {d.name: d for d in graph.devices}[key]
    found = part.config
    for name_ in rest:
        found = getattr(found, name_)
    assert found == values
