"""What the devices on a shared line take of it is added up before anything is opened."""

from __future__ import annotations

from typing import Any

import pytest
from helpers.toy import PROFILE, Law, Toy, ToyConfig

from drivers.canbus import frame_bits
from runtime.contracts import registry
from runtime.contracts.driver import Traffic
from runtime.contracts.errors import WiringError
from runtime.profile import profile, wiring
from runtime.profile.graph import Graph

SEVEN = 7 * 2 * frame_bits(8)  # seven motors: a command and a reply each


def build(monkeypatch: pytest.MonkeyPatch, rate: int, **traffic: Traffic) -> Graph:
    class Device(Toy):
        def __init__(self, name: str, config: ToyConfig) -> None:
            super().__init__(name, config)
            self.traffic = traffic.get(name)

    monkeypatch.setattr(registry, "load", lambda group, name, place: {"drivers": Device, "controllers": Law}[group])
    text = PROFILE.format(arm="arm", speed=1.0, emergency="", more="")
    return wiring.build(*profile.parse("toy.yaml", text, [f"rate={rate}"]))


@pytest.mark.parametrize(("size", "extended", "bits"), [(8, False, 135), (8, True, 160), (0, False, 55)])
def test_a_frame_s_bits_are_those_of_the_worst_case(size: int, extended: bool, bits: int) -> None:
    assert frame_bits(size, extended) == bits


def test_seven_motors_fit_at_500_hz(monkeypatch: pytest.MonkeyPatch) -> None:
    graph = build(monkeypatch, 500, arm=Traffic("can://socketcan/can0", 1e6, SEVEN))
    assert "can://socketcan/can0: arm take up to 94 % of 1 Mbit/s at 500 Hz, 529 Hz at most" in graph.remarks


@pytest.mark.parametrize(
    ("traffic", "said"),
    [
        ({"arm": Traffic("a", 1e6, SEVEN)}, "can't carry arm at 1000 Hz.*189 %.*Set 'rate' to 529 or less"),
        (
            {"arm": Traffic("a", 1e6, 600), "hand": Traffic("a", 1e6, 0, 540_000)},
            "can't carry hand and arm at 1000 Hz.*114 %.*Set 'rate' to 766 or less",
        ),
        ({"arm": Traffic("a", 1e6, 0, 2e6)}, "Use a second bus"),
        ({"arm": Traffic("a", 1e6, 9), "hand": Traffic("a", 5e5, 9)}, "different bit rates"),
    ],
)
def test_a_bus_that_is_asked_for_more_is_refused(
    monkeypatch: pytest.MonkeyPatch, traffic: dict[str, Any], said: str
) -> None:
    with pytest.raises(WiringError, match=said):
        build(monkeypatch, 1000, **traffic)


def test_what_is_on_two_buses_is_counted_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    graph = build(monkeypatch, 1000, arm=Traffic("a", 1e6, 600), hand=Traffic("b", 1e6, 600))
    assert len([line for line in graph.remarks if "60 %" in line]) == 2
