"""Servos' bytes in SI units, and goals in bytes: each number in its register, with its sign and its unit."""

from __future__ import annotations

import struct
from math import inf, pi
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.dynamixel.config import DynamixelConfig
from srl.drivers.dynamixel.family import Family, family
from srl.drivers.feetech.config import FeetechConfig
from srl.drivers.feetech.units import FeetechUnits
from srl.drivers.servo_bus.units import Units
from srl.runtime.contracts.servo_record import Line
from srl.runtime.contracts.signals import Array

COUNT = 2 * pi / 4096  # rad
UNITS = {1: 0.114 * 2 * pi / 60, 2: 0.229 * 2 * pi / 60}  # rad/s of a Dynamixel's velocity, by protocol
PAIR: dict[str, dict[str, Any]] = {
    "turned": {"id": 3, "reversed": True, "zero": 0.25},
    "slide": {"id": 7, "m_per_rad": 0.01},
}
SCALE, ZERO = np.array([-1.0, 0.01]), np.array([0.25, 0.0])


def dynamixel(protocol: int = 2, mode: str = "position", model: str = "MX-106", **options: Any) -> Family:
    motors = {name: motor | {"model": model} | options for name, motor in PAIR.items()}
    return family(
        DynamixelConfig.model_validate({"port": "/dev/null", "motors": motors, "protocol": protocol, "mode": mode})
    )


def feetech(mode: str = "position", **options: Any) -> FeetechUnits:
    motors = {name: motor | {"model": "STS3215"} | options for name, motor in PAIR.items()}
    return FeetechUnits(FeetechConfig.model_validate({"port": "/dev/null", "motors": motors, "mode": mode}))


def decoded(units: Units, *samples: bytes) -> dict[str, Array]:
    out = {name: np.full(2, -1.0) for name in ("position", "velocity", "effort", "temperature", "voltage")}
    units.decode(b"".join(samples), len(samples[0]), out)
    return out


def at(size: int, **fields: tuple[int, str, int]) -> bytes:
    """Bytes of a sample: each field's offset, format and value; what is between them is of no meaning."""
    data = bytearray(b"\xa5" * size)
    for offset, format_, value in fields.values():
        struct.pack_into("<" + format_, data, offset, value)
    return bytes(data)


def placed(counts: list[int]) -> Array:
    """rad and m, of these counts: the shaft is at 0 at 2048."""
    return ((np.array(counts) - 2048) * COUNT - ZERO) * SCALE


def mx(current: int, velocity: int, position: int, size: int = 10) -> bytes:
    """MX(2.0) from address 126 on: current, velocity, position; voltage at 144, temperature at 146."""
    more = {"u": (18, "H", 121), "t": (20, "B", 41)} if size == 21 else {}
    return at(size, i=(0, "h", current), v=(2, "i", velocity), p=(6, "i", position), **more)


@pytest.mark.parametrize("size", [10, 21])
@pytest.mark.parametrize("model", ["MX-28", "MX-106"])
def test_mx_of_protocol_2(size: int, model: str) -> None:
    units = dynamixel(model=model)
    assert size in (units.sample[1], units.extra[1])
    out = decoded(units, mx(-300, 1000, -70_000, size), mx(200, -77_000, 3000, size))
    assert out["position"] == pytest.approx(placed([-70_000, 3000]))
    assert out["velocity"] == pytest.approx(np.array([1000, -77_000]) * UNITS[2] * SCALE)
    facts = units.config.motors["slide"].facts
    one = facts.stall_torque / facts.stall_current * 3.36e-3 if model == "MX-106" else facts.stall_torque * 1e-3
    assert out["effort"] == pytest.approx(np.array([-300, 200]) * one / SCALE)
    assert units.seen is not None
    assert units.seen.tolist() == [-70_000, 3000]
    if size == 21:
        assert out["voltage"] == pytest.approx([12.1, 12.1])
        assert out["temperature"].tolist() == [41, 41]
    else:
        assert out["voltage"].tolist() == out["temperature"].tolist() == [-1, -1]


@pytest.mark.parametrize("model", ["MX-28", "MX-64", "MX-106"])
def test_mx_of_protocol_1(model: str) -> None:
    """From address 36 on. Bit 10 is the sign of speed and load; a current is 2048 at zero, at address 68."""
    units, senses = dynamixel(1, model=model), model != "MX-28"

    def sample(position: int, speed: int, load: int, current: int) -> bytes:
        fields = {"p": (0, "h", position), "v": (2, "H", speed), "l": (4, "H", load), "u": (6, "B", 119),
                  "t": (7, "B", 39)}  # fmt: skip
        return at(34, **fields, i=(32, "H", current)) if senses else at(8, **fields)

    out = decoded(units, sample(-500, 0x400 | 300, 0x400 | 200, 2048 - 90), sample(4000, 0x3FF, 150, 2048 + 60))
    assert len(sample(0, 0, 0, 0)) == units.sample[1] == units.extra[1]
    assert out["position"] == pytest.approx(placed([-500, 4000]))
    assert out["velocity"] == pytest.approx(np.array([-300, 1023]) * UNITS[1] * SCALE)
    facts = units.config.motors["slide"].facts
    torque = np.array([-90, 60]) * 4.5e-3 * facts.stall_torque / facts.stall_current
    assert out["effort"] == pytest.approx(
        (torque if senses else np.array([-200, 150]) * 1e-3 * facts.stall_torque) / SCALE
    )
    assert out["voltage"] == pytest.approx([11.9, 11.9])
    assert out["temperature"].tolist() == [39, 39]


def sts(position: int, velocity: int = 0, current: int = 0) -> bytes:
    """STS from address 56 on; bit 15 is each number's sign."""
    words = [abs(value) | (0x8000 if value < 0 else 0) for value in (position, velocity, current)]
    return at(15, p=(0, "H", words[0]), v=(2, "H", words[1]), u=(6, "B", 118), t=(7, "B", 44), i=(13, "H", words[2]))


def test_sts() -> None:
    units = feetech()
    out = decoded(units, sts(-700, 900, -40), sts(4095, -32_767, 55))
    assert out["position"] == pytest.approx(placed([-700, 4095]))
    assert out["velocity"] == pytest.approx(np.array([900, -32_767]) * COUNT * SCALE)
    facts = units.config.motors["slide"].facts
    assert out["effort"] == pytest.approx(
        np.array([-40, 55]) * 6.5e-3 * facts.stall_torque / facts.stall_current / SCALE
    )
    assert out["voltage"] == pytest.approx([11.8, 11.8])
    assert out["temperature"].tolist() == [44, 44]
    assert units.seen is not None
    assert units.seen.tolist() == [-700, 4095]


def test_a_servo_that_has_lost_its_count_is_told_from_one_that_has_turned() -> None:
    units = feetech()
    assert units.turned(sts(100) + sts(200)).tolist() == [0, 0]
    decoded(units, sts(-3000), sts(4090))
    assert units.turned(sts(-3000 + 2000) + sts(4090 - 2000)).tolist() == [0, 0]
    assert units.turned(sts(-3000 + 4096) + sts(4090 - 8192)).tolist() == [1, -2]


def memory(**words: tuple[int, str, int]) -> bytes:
    return at(80, **words)


@pytest.mark.parametrize("mode", ["position", "extended", "velocity", "effort"])
def test_limits_of_mx_of_protocol_2(mode: str) -> None:
    units = dynamixel(mode=mode)
    facts = units.config.motors["slide"].facts
    fast = int(facts.no_load_speed / UNITS[2]) + 50
    limits = units.set_limits(
        [
            memory(i=(38, "H", 900), v=(44, "I", 100), high=(48, "I", 3000), low=(52, "I", 500)),
            memory(i=(38, "H", 1500), v=(44, "I", fast), high=(48, "I", 4000), low=(52, "I", 0)),
        ]
    )
    assert limits.velocity == pytest.approx([100 * UNITS[2], facts.no_load_speed * 0.01])
    one = facts.stall_torque / facts.stall_current * 3.36e-3
    if mode == "effort":
        assert limits.effort == pytest.approx([900 * one, 1500 * one / 0.01])
        assert (units.low.tolist(), units.high.tolist()) == ([-900, -1500], [900, 1500])
    else:
        assert limits.effort is None
    if mode == "velocity":
        assert (units.low.tolist(), units.high.tolist()) == ([-100, -fast], [100, fast])
    if mode in ("velocity", "effort"):
        assert limits.lower is None
        assert limits.upper is None
        return
    low, high = ([500, 0], [3000, 4000]) if mode == "position" else ([-1_048_575] * 2, [1_048_575] * 2)
    assert (units.low.tolist(), units.high.tolist()) == (low, high)
    assert units.own_range(0, memory(high=(48, "I", 3000), low=(52, "I", 500))) == (low[0], high[0])
    ends = np.sort([placed(low), placed(high)], axis=0)
    assert limits.lower == pytest.approx(ends[0])
    assert limits.upper == pytest.approx(ends[1])


@pytest.mark.parametrize("mode", ["position", "extended", "velocity", "effort"])
def test_limits_of_mx_of_protocol_1(mode: str) -> None:
    units = dynamixel(1, mode)
    facts = units.config.motors["slide"].facts
    limits = units.set_limits([memory(low=(6, "H", 400), high=(8, "H", 3500))] * 2)
    fastest = min(1023 * UNITS[1], facts.no_load_speed)
    assert limits.velocity == pytest.approx([fastest, fastest * 0.01])
    if mode in ("velocity", "effort"):
        assert (units.low.tolist(), units.high.tolist()) == ([-1023] * 2, [1023] * 2)
        return
    low, high = ([400] * 2, [3500] * 2) if mode == "position" else ([-28_672] * 2, [28_672] * 2)
    assert (units.low.tolist(), units.high.tolist()) == (low, high)
    ends = np.sort([placed(low), placed(high)], axis=0)
    assert limits.lower == pytest.approx(ends[0])
    assert limits.upper == pytest.approx(ends[1])


@pytest.mark.parametrize("mode", ["position", "extended"])
def test_limits_of_sts(mode: str) -> None:
    units = feetech(mode)
    facts = units.config.motors["slide"].facts
    limits = units.set_limits([memory(low=(9, "H", 300), high=(11, "H", 3800))] * 2)
    assert limits.velocity == pytest.approx([facts.no_load_speed, facts.no_load_speed * 0.01])
    low, high = units.low.tolist(), units.high.tolist()
    if mode == "position":
        assert (low, high) == ([300, 300], [3800, 3800])
    else:
        assert low == [-h for h in high]
        assert high[0] > 4096
    ends = np.sort([placed(low), placed(high)], axis=0)
    assert limits.lower == pytest.approx(ends[0])
    assert limits.upper == pytest.approx(ends[1])


@pytest.mark.parametrize("given", [{"lower": -0.004}, {"upper": 0.005}, {"lower": -0.004, "upper": 0.005}])
@pytest.mark.parametrize("make", [dynamixel, feetech])
def test_the_profile_narrows_what_the_servo_has_and_widens_none_of_it(make: Any, given: dict[str, float]) -> None:
    data = (
        [memory(high=(48, "I", 3000), low=(52, "I", 500), v=(44, "I", 100))] * 2
        if make is dynamixel
        else [memory(low=(9, "H", 500), high=(11, "H", 3000))] * 2
    )
    free, wide = make().set_limits(data), make(lower=-50.0, upper=50.0).set_limits(data)
    assert wide.lower.tolist() == free.lower.tolist()
    assert wide.upper.tolist() == free.upper.tolist()
    narrow = make(**given).set_limits(data)
    assert narrow.lower == pytest.approx(np.maximum(free.lower, given.get("lower", -inf)))
    assert narrow.upper == pytest.approx(np.minimum(free.upper, given.get("upper", inf)))


# -- goals


def goals_in(units: Units, frame: bytes) -> list[bytes]:
    """Each motor's bytes of a goal, at the end of the packet before its checksum."""
    size = units.goal.size
    checksum = 2 if getattr(units, "protocol", 1) == 2 else 1
    body = frame[-checksum - 2 * (size + 1) : -checksum]
    assert (body[0], body[size + 1]) == (3, 7), "the motors' ids"
    return [body[1 : size + 1], body[size + 2 :]]


@pytest.mark.parametrize(
    ("units", "signs"),
    [
        (dynamixel(2, "extended"), lambda v: struct.pack("<i", v)),
        (dynamixel(1, "extended"), lambda v: struct.pack("<h", v)),
        (feetech("extended"), lambda v: struct.pack("<H", -v | 0x8000 if v < 0 else v)),
    ],
)
def test_goals_of_positions(units: Units, signs: Any) -> None:
    units.low[:], units.high[:] = -5000, 6000
    for counts in ([2048, 2048], [-300, 5999], [0, -5000]):
        assert goals_in(units, units.encode(placed(counts))) == [signs(v) for v in counts]
        assert units.last.tolist() == counts
        assert units.bounded(placed(counts)) == pytest.approx(placed(counts))
    assert goals_in(units, units.encode(placed([-5100, 6100]))) == [signs(-5000), signs(6000)]
    assert units.bounded(placed([-5100, 6100])) == pytest.approx(placed([-5000, 6000]))
    far = np.array([1e300, -1e300])
    assert goals_in(units, units.encode(far)) == [signs(-5000), signs(-5000)]
    assert goals_in(units, units.encode(np.array([np.nan, placed([0, 77])[1]]))) == [signs(-5000), signs(77)]
    assert goals_in(units, units.again()) == [signs(-5000), signs(77)]
    only = units.again(np.array([False, True]))
    assert len(only) == len(units.again()) - units.goal.size - 1
    assert bytes([7]) + signs(77) in only


@pytest.mark.parametrize("mode", ["velocity", "effort"])
@pytest.mark.parametrize("protocol", [1, 2])
def test_goals_of_velocities_and_torques(mode: str, protocol: int) -> None:
    units = dynamixel(protocol, mode)
    units.low[:], units.high[:] = -1000, 1000
    facts = units.config.motors["slide"].facts
    ampere = {1: 4.5e-3, 2: 3.36e-3}[protocol]
    newton_metres = facts.stall_torque / facts.stall_current * ampere
    one = UNITS[protocol] * SCALE if mode == "velocity" else newton_metres / SCALE

    def signs(value: int) -> bytes:
        if protocol == 1:
            return struct.pack("<H", -value | 0x400 if value < 0 else value)
        return struct.pack("<i" if mode == "velocity" else "<h", value)

    for counts in ([0, 0], [500, -400], [-1, 999]):
        assert goals_in(units, units.encode(np.array(counts) * one)) == [signs(v) for v in counts]
    assert goals_in(units, units.encode(np.array([-1100, 1100]) * one)) == [signs(-1000), signs(1000)]


def test_turns_that_a_servo_has_forgotten_are_taken_up_over_several_turns_only() -> None:
    for mode, turns in (("extended", 3), ("position", 0)):
        units = dynamixel(mode=mode)
        units.take_up_turns(0, 5)  # nothing was seen yet
        before = decoded(units, mx(0, 0, 3 * 4096 + 100), mx(0, 0, 700))["position"]
        units.take_up_turns(0, 100 + 150)
        after = decoded(units, mx(0, 0, 100), mx(0, 0, 700))["position"]
        assert after[0] == pytest.approx(before[0] if turns else placed([100, 700])[0])
        assert after[1] == before[1]


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("trim", [0.0, 0.2, -0.3])
def test_a_calibration_says_where_an_axis_is_at_each_count(direction: Literal[-1, 1], trim: float) -> None:
    """The trim is the profile's angle where the joint is at 0, with the sense of rotation that was found."""
    for turned in (False, True):
        plain = dynamixel(reversed=turned, zero=0.1, m_per_rad=None)
        config = plain.config
        lines = {
            name: Line(trim=trim, direction=direction, scale=1.0, known=False, entry=motor.entry)
            for name, motor in config.motors.items()
        }
        motors = {name: motor.calibrated(lines[name]) for name, motor in config.motors.items()}
        found = family(config.model_copy(update={"motors": motors}))
        samples = mx(0, 100, 900), mx(0, -50, 3000)
        before, after = decoded(plain, *samples), decoded(found, *samples)
        assert after["position"] == pytest.approx(direction * before["position"] - trim)
        assert after["velocity"] == pytest.approx(direction * before["velocity"])


def wide(make: str, lower: float, upper: float, **axis: Any) -> Units:
    motor = {"id": 1, "lower": lower, "upper": upper} | axis
    if make == "feetech":
        motors = {"joint": motor | {"model": "STS3215"}}
        return FeetechUnits(FeetechConfig.model_validate({"port": "/dev/null", "motors": motors, "mode": "extended"}))
    motors = {"joint": motor | {"model": "MX-106"}}
    return family(DynamixelConfig.model_validate({"port": "/dev/null", "motors": motors, "mode": "extended"}))


@pytest.mark.parametrize("make", ["dynamixel", "feetech"])
@given(
    lower=st.floats(-9.0, 5.0), span=st.floats(0.2, 2 * pi - 0.01), share=st.floats(0.0, 1.0), reverse=st.booleans(),
    zero=st.floats(-2.0, 2.0), scale=st.sampled_from([None, 0.01]),
)  # fmt: skip
def test_after_a_power_up_bounds_of_less_than_a_turn_tell_the_turn(
    make: str, lower: float, span: float, share: float, reverse: bool, zero: float, scale: float | None
) -> None:
    """A servo then counts 0 to 4095, wherever the shaft is; the axis is where it was."""
    size = scale or 1.0
    ends = lower * size, (lower + span) * size
    units = wide(make, *ends, reversed=reverse, zero=zero, m_per_rad=scale)
    where = ends[0] + share * (ends[1] - ends[0])
    counts = round((where - units.offset[0]) / units.per_count[0]) % 4096
    before = units.offset.copy()
    units.take_up_turns(0, counts)
    assert counts * units.per_count[0] + units.offset[0] == pytest.approx(where, abs=COUNT * size)
    turns = (units.offset[0] - before[0]) / (2 * pi * size)
    assert turns == pytest.approx(round(turns), abs=1e-9)


@pytest.mark.parametrize("make", ["dynamixel", "feetech"])
def test_wider_bounds_tell_nothing(make: str) -> None:
    units = wide(make, -4.0, 4.0)
    before = units.offset.copy()
    units.take_up_turns(0, 4000)
    assert units.offset == before
