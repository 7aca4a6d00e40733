"""Frames of MIT mode: the command of all makers, its special frames, and the replies (sheet can_actuators, section 1).

Nothing here knows a bus or a clock. Every number is at the motor's output shaft, in its own sense.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum
from math import isfinite, isnan, pi
from typing import Final

from srl.drivers.mit_can.models import Model, Range

KP_MAX, KD_MAX = 500.0, 5.0  # N m/rad, N m s/rad
WORD, FIELD = 0xFFFF, 0xFFF  # largest position, and largest of any other field
ENABLE, DISABLE, SET_ZERO, CLEAR = (bytes([0xFF] * 7 + [last]) for last in (0xFC, 0xFD, 0xFE, 0xFB))
SPECIAL: Final = frozenset((ENABLE, DISABLE, SET_ZERO, CLEAR))
_ALL: Final = ENABLE[:7]
V3_COMMAND, V3_STATUS = 0x800, 0x2900  # extended identifiers, plus the motor's id
REGISTERS: Final = 0x7FF
READ, WRITE, STATE = 0x33, 0x55, 0xCC


@dataclass(frozen=True)
class Impedance:
    """One command: torque = kp (position - p) + kd (velocity - v) + torque, done by the drive.

    Attributes:
        position: rad.
        velocity: rad/s.
        kp: N m/rad.
        kd: N m s/rad.
        torque: N m.
    """

    position: float = 0.0
    velocity: float = 0.0
    kp: float = 0.0
    kd: float = 0.0
    torque: float = 0.0


@dataclass(frozen=True)
class State:
    """A motor's reply, as it left.

    Attributes:
        position, velocity, torque: rad, rad/s, N m.
        temperature: degC: of the winding of a Damiao; of the drive of an AK, with an offset that sources dispute.
        stage: degC, of a Damiao's power stage; NaN where it isn't told.
        code: the error; of a Damiao 0 is disabled and 1 enabled.
    """

    position: float
    velocity: float
    torque: float
    temperature: float
    stage: float
    code: int

    @property
    def hottest(self) -> float:
        """degC, the higher temperature that is told; NaN if none is."""
        return self.temperature if isnan(self.stage) else max(self.temperature, self.stage)


def to_field(value: float, most: float, full: int, least: float | None = None) -> int:
    """Scales a value to a field, clamped: without a clamp it would spill into its neighbour (section 1.2)."""
    low = -most if least is None else least
    value = min(max(value, low), most)
    return int((value - low) * full / (most - low))


def from_field(field: int, most: float, full: int) -> float:
    """The value of a symmetric field."""
    return field * 2 * most / full - most


def dead(value: float, most: float) -> float:
    """0 for the two fields beside zero, which no field is: half a step is no motion and no torque."""
    return 0.0 if abs(value) <= most / FIELD * 1.001 else value


def command(wanted: Impedance, span: Range, v3: bool = False) -> bytes:
    """Returns a command's bytes, clamped to the ranges. It never equals a special frame.

    kp ends one step below its maximum: with every field at its maximum, the bytes are those of clear, enable, disable
    or set zero.

    Raises:
        ValueError: a number isn't finite.
    """
    numbers = wanted.position, wanted.velocity, wanted.kp, wanted.kd, wanted.torque
    if not all(map(isfinite, numbers)):
        raise ValueError(f"a command must be finite, not {numbers}")
    p = to_field(wanted.position, span.position, WORD)
    v = to_field(wanted.velocity, span.velocity, FIELD)
    kp = min(to_field(wanted.kp, KP_MAX, FIELD, 0.0), FIELD - 1)
    kd = to_field(wanted.kd, KD_MAX, FIELD, 0.0)
    t = to_field(wanted.torque, span.torque, FIELD)
    bits = kp << 52 | kd << 40 | p << 24 | v << 12 | t if v3 else p << 48 | v << 36 | kp << 24 | kd << 12 | t
    data = bits.to_bytes(8, "big")
    assert not data.startswith(_ALL), "a command equals a special frame"
    return data


def parse_command(data: bytes, span: Range, v3: bool = False) -> Impedance:
    """What a drive makes of a command."""
    bits = int.from_bytes(data, "big")
    if v3:
        kp, kd, p, v, t = bits >> 52, bits >> 40, bits >> 24 & WORD, bits >> 12, bits
    else:
        p, v, kp, kd, t = bits >> 48, bits >> 36, bits >> 24, bits >> 12, bits
    return Impedance(
        from_field(p & WORD, span.position, WORD),
        from_field(v & FIELD, span.velocity, FIELD),
        (kp & FIELD) * KP_MAX / FIELD,
        (kd & FIELD) * KD_MAX / FIELD,
        from_field(t & FIELD, span.torque, FIELD),
    )


def parse_reply(data: bytes, span: Range) -> State:
    """Reads the reply of a Damiao, or of an AK V1 or V2, of 6 to 8 bytes; the id in byte 0 is the caller's.

    Of 7 bytes the last is the supply's voltage, so no temperature is told.
    """
    bits = int.from_bytes(data[1:6], "big")
    return State(
        from_field(bits >> 24, span.position, WORD),
        from_field(bits >> 12 & FIELD, span.velocity, FIELD),
        from_field(bits & FIELD, span.torque, FIELD),
        float(data[6]) if len(data) > 7 else float("nan"),
        float(data[7]) if len(data) > 7 else float("nan"),
        data[7] if len(data) > 7 else 0,
    )


def damiao_reply(data: bytes, span: Range) -> State:
    """A Damiao's reply: its state in the high half of byte 0, then both temperatures."""
    found = parse_reply(data, span)
    return State(found.position, found.velocity, found.torque, float(data[7]), float(data[6]), data[0] >> 4)


AK_OFFSET: Final = 40.0  # K, by the maker's manual; users found other scales, so nothing trips on it alone


def ak_reply(data: bytes, span: Range) -> State:
    """The reply of an AK V1 or V2."""
    found = parse_reply(data, span)
    return State(found.position, found.velocity, found.torque, found.temperature - AK_OFFSET, float("nan"), found.code)


def status_scale(model: Model) -> tuple[int, float, float]:
    """Pole pairs, gear and N m/A at the output shaft, by which an AK V3's status is read."""
    gear = model.gear or 1.0
    return model.pole_pairs, gear, (model.kt or 1.0) * gear


_STATUS: Final = struct.Struct(">hhhbB")


def v3_status(data: bytes, pole_pairs: int, gear: float, torque_constant: float) -> State:
    """The status of an AK V3 (section 3.2): 0.1 deg, 10 electrical rpm, 0.01 A, degC, error."""
    degrees, erpm, amps, temperature, code = _STATUS.unpack(data)
    return State(
        degrees * 0.1 * pi / 180,
        erpm * 10 * 2 * pi / 60 / pole_pairs / gear,
        amps * 0.01 * torque_constant,
        float(temperature),
        float("nan"),
        code,
    )


def pack_reply(id: int, position: float, velocity: float, torque: float, span: Range, tail: bytes) -> bytes:
    """A reply as a drive makes it, `id` being byte 0. The position isn't clamped, it wraps (section 2.7)."""
    p = int((position + span.position) * WORD / (2 * span.position)) & WORD
    v = to_field(velocity, span.velocity, FIELD)
    t = to_field(torque, span.torque, FIELD)
    return bytes([id]) + (p << 24 | v << 12 | t).to_bytes(5, "big") + tail


def pack_status(
    position: float, velocity: float, torque: float, temperature: float, code: int,
    pole_pairs: int, gear: float, torque_constant: float,
) -> bytes:  # fmt: skip
    """The status of an AK V3; see `v3_status`."""
    values = (
        position * 1800 / pi,
        velocity * 30 / pi * pole_pairs * gear / 10,
        torque / torque_constant * 100,
    )
    numbers = [min(max(round(value), -32768), 32767) for value in values]
    return _STATUS.pack(*numbers, min(max(round(temperature), -128), 127), code)


# -- Damiao's registers


class Register(IntEnum):
    """Those that the driver reads or writes (section 2.4)."""

    OVER_TEMPERATURE = 2
    MST_ID = 7
    ESC_ID = 8
    TIMEOUT = 9
    CTRL_MODE = 10
    HARDWARE = 13
    SOFTWARE = 14
    SERIAL = 15
    GEAR = 20
    P_MAX = 21
    V_MAX = 22
    T_MAX = 23


WHOLE: Final = frozenset((7, 8, 9, 10, 13, 14, 15, 16, 35, 36))  # registers that hold a u32; the others an f32
MIT: Final = 1  # the control mode
TICK: Final = 50e-6  # s of the timeout's register


def read_register(id: int, register: int) -> bytes:
    """Asks for a register."""
    return struct.pack("<HBB4x", id, READ, register)


def write_register(id: int, register: int, value: float) -> bytes:
    """Sets a register in the drive's memory; it is forgotten at power-off."""
    return struct.pack("<HBBI" if register in WHOLE else "<HBBf", id, WRITE, register, value_of(register, value))


def value_of(register: int, value: float) -> float | int:
    """A register's value in its own type."""
    return int(value) if register in WHOLE else float(value)


def ask_state(id: int) -> bytes:
    """Asks for the state without a command."""
    return struct.pack("<HBB4x", id, STATE, 0)


def parse_register(data: bytes, id: int) -> tuple[int, float] | None:
    """The register and value of an answer, also of a write's; None if these bytes are none of this motor's.

    A state may look the same by chance: take it for an answer only where one is awaited.
    """
    if len(data) != 8 or data[2] not in (READ, WRITE) or int.from_bytes(data[:2], "little") != id:
        return None
    register = data[3]
    (value,) = struct.unpack("<I" if register in WHOLE else "<f", data[4:])
    return register, float(value)


# -- errors in words

DAMIAO_ERRORS: Final = {
    0x2: "encoder not calibrated",
    0x3: "encoder calibration",
    0x4: "encoder calibration",
    0x8: "over-voltage (a falling or braking limb feeds the supply)",
    0x9: "under-voltage",
    0xA: "over-current",
    0xB: "power stage too hot",
    0xC: "winding too hot",
    0xD: "its watchdog: it heard nothing from this host for too long, and went limp",
    0xE: "overload",
}
AK_ERRORS: Final = {
    1: "winding too hot",
    2: "over-current",
    3: "over-voltage (a falling or braking limb feeds the supply)",
    4: "under-voltage",
    5: "encoder",
    6: "power stage too hot, or a phase is unbalanced",
    7: "stalled",
}


def in_words(code: int, damiao: bool) -> str:
    """An error code in words; "" if it is none."""
    if damiao:
        return "" if code in (0, 1) else DAMIAO_ERRORS.get(code, f"error {code:#x}")
    return "" if code == 0 else AK_ERRORS.get(code, f"error {code}")
