"""A wrench is wired by its elements to forces and torques, whose units are parts of its own."""

from __future__ import annotations

import pytest

from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.terms import WRENCH
from srl.runtime.profile.names import link

WRENCH_SENSOR = Signal(name="wrench", shape=(6,), unit="N, N m", labels=WRENCH)


def part(unit: str, *labels: str) -> Signal:
    return Signal(name="x", shape=(len(labels),), unit=unit, labels=labels)


@pytest.mark.parametrize(
    ("near", "renamed", "rows"),
    [
        (part("N", "fx", "fy", "fz"), {}, [0, 1, 2]),
        (part("N", "fz"), {}, [2]),
        (part("N m", "tz", "tx"), {}, [5, 3]),
        (part("N", "x", "y"), {"x": "fx", "y": "fy"}, [0, 1]),
    ],
)
def test_a_wrenchs_forces_are_wired_as_forces_and_its_torques_as_torques(
    near: Signal, renamed: dict[str, str], rows: list[int]
) -> None:
    found = link(near, "law.x", {"sensor.wrench": WRENCH_SENSOR}, renamed, "profile.yaml")
    assert found.rows == tuple(("sensor.wrench", row) for row in rows)


def test_a_wrench_is_wired_from_forces_and_torques() -> None:
    far = {"a.force": part("N", *WRENCH[:3]), "a.torque": part("N m", *WRENCH[3:])}
    rows = link(WRENCH_SENSOR, "law.wrench", far, {}, "profile.yaml").rows
    assert rows == tuple((name, row) for name in far for row in range(3))


@pytest.mark.parametrize(
    ("near", "renamed", "problem"),
    [
        (part("N", "fx", "tx"), {}, r"sensor.wrench\[tx\] has 'N m', law.x\[tx\] has 'N'"),
        (part("N m", "fx"), {}, r"sensor.wrench\[fx\] has 'N', law.x\[fx\] has 'N m'"),
        (part("N", "a"), {"a": "tz"}, r"sensor.wrench\[tz\] has 'N m', law.x\[a\] has 'N'"),
        (part("rad", "fx"), {}, "sensor.wrench has 'N, N m', law.x has 'rad'"),
        (Signal(name="x", shape=(3,), unit="N", slots=True), {}, "shapes differ"),
        (Signal(name="x", shape=(6,), unit="N", slots=True), {}, "units differ"),
    ],
)
def test_a_torque_is_no_force(near: Signal, renamed: dict[str, str], problem: str) -> None:
    with pytest.raises(WiringError, match=problem):
        link(near, "law.x", {"sensor.wrench": WRENCH_SENSOR}, renamed, "profile.yaml")


def test_one_number_of_newtons_isnt_one_of_a_wrench() -> None:
    one = Signal(name="x", shape=(1,), unit="N, N m", labels=("tx",))
    with pytest.raises(WiringError, match="names differ"):
        link(Signal(name="y", shape=(1,), unit="N"), "law.y", {"a.x": one}, {}, "profile.yaml")
