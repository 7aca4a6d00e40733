"""What a driver declares of its commands is checked before anything moves, whoever wrote the driver."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.run import refused
from helpers.toy import PROFILE, Law, Toy, ToyConfig

from srl.runtime.contracts import registry
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.errors import OptionError, WiringError
from srl.runtime.contracts.signals import Limits, Signal
from srl.runtime.loop.guards import limits_of
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.graph import Graph

ALIKE = "no two joints may have one gain"


def build(monkeypatch: pytest.MonkeyPatch, **declared: Any) -> Graph:
    """The toy profile; the arm's command is declared with these attributes, or limited by these limits."""

    class Arm(Toy):
        def __init__(self, name: str, config: ToyConfig) -> None:
            super().__init__(name, config)
            if name == "arm":
                self.states += (Signal(name="motor", shape=(1,), unit="1"),)
                self.limits = declared.get("limits", {})
                self.commands = tuple(
                    replace(c, **{k: v for k, v in declared.items() if k != "limits"}) for c in self.commands
                )

    monkeypatch.setattr(registry, "load", lambda group, name, place: {"drivers": Arm, "controllers": Law}[group])
    text = PROFILE.format(arm="arm", speed=1.0, emergency="", more="")
    return wiring.build(*profile.parse("toy.yaml", text))


@pytest.mark.parametrize(
    ("declared", "output"),
    [
        ({"feedback": "positon"}, "which is no state of it"),
        ({"feedback": "motor"}, r"shapes differ: 'arm.motor' has \[1\], 'arm.command' has \[2\]"),
    ],
)
def test_feedback_must_be_a_state_of_the_same_shape(
    monkeypatch: pytest.MonkeyPatch, declared: dict[str, Any], output: str
) -> None:
    with pytest.raises(WiringError, match=output) as caught:
        build(monkeypatch, **declared)
    assert "devices.arm" in str(caught.value)


@pytest.mark.parametrize(
    ("limits", "output"),
    [
        (
            {"comand": Limits(upper=np.ones(2))},
            "limits 'comand', which is none of its commands. Did you mean 'command'",
        ),
        ({"command": Limits(upper=np.ones(3))}, r"'upper' of 'command' has shape \(3,\)"),
        ({"command": Limits(upper=0.1)}, r"'upper' of 'command' has shape \(\)"),  # type: ignore[arg-type]
    ],
)
def test_a_drivers_limits_must_be_of_its_commands(
    monkeypatch: pytest.MonkeyPatch, limits: dict[str, Limits], output: str
) -> None:
    graph = build(monkeypatch, limits=limits)
    with pytest.raises(WiringError, match=output):
        limits_of(graph)


def test_limits_of_a_command_narrow_the_profiles(monkeypatch: pytest.MonkeyPatch) -> None:
    found = limits_of(build(monkeypatch, limits={"command": Limits(upper=np.array([1.0, 3.0]))}))
    assert found["arm.command"].upper is not None
    assert found["arm.command"].upper.tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    ("declared", "output"),
    [
        ({"period": None}, r"driver 'toy' doesn't declare how often it sends 'command' \(period: None\)"),
        ({"period": 3.0}, "doesn't declare how often"),
        ({"resolution": (0.1, 0.1, 0.1)}, "no usable resolution"),
        ({"resolution": float("nan")}, "no usable resolution"),
    ],
)
def test_a_driver_must_declare_how_it_sends(
    monkeypatch: pytest.MonkeyPatch, declared: dict[str, Any], output: str
) -> None:
    with pytest.raises(WiringError, match=output) as caught:
        build(monkeypatch, **declared)
    assert "devices.arm" in str(caught.value)
    assert "sent_arrays" in str(caught.value)


@pytest.mark.parametrize(
    "declared",
    [
        {"lag": "0.2"}, {"lag": None}, {"lag": -0.1}, {"lag": 5.0}, {"lag": True}, {"window": "5%"}, {"window": 0.0},
        {"window": (0.1, 0.1, 0.1)}, {"window": {"a": 0.1}}, {"window": float("nan")},
    ],
)  # fmt: skip
def test_a_lag_and_a_window_are_numbers_of_their_joints(
    monkeypatch: pytest.MonkeyPatch, declared: dict[str, Any]
) -> None:
    with pytest.raises(WiringError, match=r"Give a lag of at most 0.25 s, and a window above 0"):
        build(monkeypatch, **declared)


@pytest.mark.parametrize("declared", [{"period": "x"}, {"period": True}, {"resolution": "x"}, {"resolution": None}])
def test_what_is_no_number_is_no_period_and_no_resolution(
    monkeypatch: pytest.MonkeyPatch, declared: dict[str, Any]
) -> None:
    with pytest.raises(WiringError, match="declare"):
        build(monkeypatch, **declared)


@pytest.mark.parametrize("max_age", [0.0, 1e-10, float("inf"), float("nan")])
def test_a_device_whose_silence_nobody_would_notice_is_refused(monkeypatch: pytest.MonkeyPatch, max_age: float) -> None:
    monkeypatch.setattr(Toy, "max_age", max_age)
    with pytest.raises(WiringError, match=r"devices\.hand.*driver 'toy' doesn't say when its samples are stale"):
        build(monkeypatch)


def test_a_sensor_that_declares_commands_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    class Silent(Sensor, Toy):
        """Its commands would never be sent."""

    monkeypatch.setattr(registry, "load", lambda group, name, place: {"drivers": Silent, "controllers": Law}[group])
    text = PROFILE.format(arm="arm", speed=1.0, emergency="", more="")
    with pytest.raises(WiringError, match="a Sensor and declares commands"):
        wiring.build(*profile.parse("toy.yaml", text))


@pytest.mark.parametrize(
    ("group", "name", "words"),
    [
        ("controllers", "object-mapping", "controllers.1: controller 'object-mapping'"),
        ("drivers", "firmata", "devices.finger: driver 'firmata'"),
        ("fakes", "firmata", "devices.finger: the fake of driver 'firmata'"),
        ("parts", "human-hand", "sim.parts.hand: HumanHandPart"),
    ],
)
@pytest.mark.parametrize(
    ("error", "remedy"),
    [
        (ValueError("no two joints\nmay have one gain"), "Correct its options"),
        (OptionError(ALIKE, "Change one"), "Change"),
    ],
)
def test_what_a_constructor_refuses_is_said_in_a_line(
    monkeypatch: pytest.MonkeyPatch, group: str, name: str, words: str, error: ValueError, remedy: str
) -> None:
    def refuses(*_: object) -> None:
        raise error

    monkeypatch.setattr(registry.load(group, name, "test"), "__init__", refuses)
    said = refused("check", "sixth-finger", *(["--sim"] if group != "drivers" else []))
    assert said.count("\n") == 1
    assert f"{words} can't be made: {ALIKE}. {remedy}" in said
