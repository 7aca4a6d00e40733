"""The items of an MTData2 message: SI units, the number formats, and which local frame the orientation is in. No I/O.

Of the protocol sheet `imu_serial`, section 3.2. An item's id says what it is (bits 15 to 4), the local frame (3 to 2)
and the number format (1 to 0).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt
from struct import Struct
from typing import Final

from srl.runtime.contracts.rotation import Quaternion, Vector, product

COUNTER, FINE, QUATERNION, ACCELERATION, TURN, STATUS = 0x1020, 0x1060, 0x2010, 0x4020, 0x8020, 0xE020
TICK: Final = 100_000  # ns of the sample time
TICK_BITS: Final = 32
FILTER_VALID: Final = 1 << 1
CLIPPED: Final = 1 << 19

_KIND: Final = 0xFFF0
_ENU, _NED, _NWU = 0x0, 0x4, 0x8
_HALF: Final = sqrt(0.5)
# Rotation of each local frame in ENU: x east, y north, z up. NED's x is north, y east, z down; NWU's x north, y west.
_FRAMES: Final[dict[int, Quaternion]] = {
    _ENU: (1.0, 0.0, 0.0, 0.0), _NED: (0.0, _HALF, _HALF, 0.0), _NWU: (_HALF, 0.0, 0.0, _HALF)
}  # fmt: skip
_FRACTION: Final = float(1 << 32)
_F12_20: Final = float(1 << 20)
_SIZES: Final = (4, 4, 6, 8)  # bytes of a number, by format
_LENGTHS: Final = {QUATERNION: 4, ACCELERATION: 3, TURN: 3}


@dataclass(frozen=True)
class Sample:
    """What one message says; None where it says nothing of it.

    Attributes:
        counter: of packets, 0 to 65535.
        fine: ticks of 0.1 ms, 32 bits.
        orientation: w x y z, of the sensor in a frame with z up (ENU; its x is east only if a magnetometer is used).
        acceleration: m/s^2, the specific force in the sensor's axes: at rest it points up.
        turn: rad/s, in the sensor's axes.
        status: the status word.
    """

    counter: int | None = None
    fine: int | None = None
    orientation: Quaternion | None = None
    acceleration: Vector | None = None
    turn: Vector | None = None
    status: int | None = None


def decode(data: bytes) -> Sample | None:
    """The sample of an MTData2 message. None: its items don't fill it, or one has another length than its format says.

    Items of other kinds are skipped.
    """
    found: dict[str, object] = {}
    at = 0
    while at < len(data):
        if at + 3 > len(data):
            return None
        item, size = int.from_bytes(data[at : at + 2], "big"), data[at + 2]
        value = data[at + 3 : at + 3 + size]
        if len(value) < size:
            return None
        at += 3 + size
        if item in (COUNTER, FINE, STATUS):
            if size != (2 if item == COUNTER else 4):
                return None
            found[{COUNTER: "counter", FINE: "fine", STATUS: "status"}[item]] = int.from_bytes(value, "big")
        elif (kind := item & _KIND) in _LENGTHS:
            numbers = _numbers(value, item & 3)
            if len(numbers) != _LENGTHS[kind] or size != len(numbers) * _SIZES[item & 3]:
                return None
            if kind == QUATERNION:
                frame = _FRAMES.get(item & 0xC)
                if frame is None:
                    return None
                w, x, y, z = numbers
                found["orientation"] = product(frame, (w, x, y, z))
            else:
                a, b, c = numbers
                found["acceleration" if kind == ACCELERATION else "turn"] = (a, b, c)
    return Sample(**found)  # type: ignore[arg-type]


def encode(items: Mapping[int, float | tuple[float, ...]]) -> bytes:
    """The bytes of items by their ids: whole numbers, and float32 in ENU. For the twin and for tests."""
    made = bytearray()
    for item, value in items.items():
        if isinstance(value, tuple):
            body = Struct(f">{len(value)}f").pack(*value)
        else:
            body = int(value).to_bytes(2 if item == COUNTER else 4, "big")
        made += item.to_bytes(2, "big") + bytes((len(body),)) + body
    return bytes(made)


def _numbers(value: bytes, form: int) -> list[float]:
    """The numbers of an item by its format; what is left over is left out."""
    n = len(value) // _SIZES[form]
    if form == 0:
        return list(Struct(f">{n}f").unpack_from(value))
    if form == 1:
        return [raw / _F12_20 for raw in Struct(f">{n}i").unpack_from(value)]
    if form == 2:  # the fraction comes first
        pairs = Struct(">Ih").iter_unpack(value[: 6 * n])
        return [whole + fraction / _FRACTION for fraction, whole in pairs]
    return list(Struct(f">{n}d").unpack_from(value))
