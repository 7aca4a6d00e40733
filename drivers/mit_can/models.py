"""The ranges that MIT mode scales by, model by model (sheet can_actuators, sections 2.1 and 2.2).

A wrong range scales torque and velocity silently. A Damiao tells its own, so the table is only a cross-check there; a
CubeMars doesn't, and its firmware generations differ.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Final, Literal

Maker = Literal["cubemars", "damiao"]
Generation = Literal["v1", "v2", "v3", "damiao"]


@dataclass(frozen=True)
class Range:
    """The symmetric ranges of a motor's wire, at its output shaft.

    Attributes:
        position: rad.
        velocity: rad/s.
        torque: N m.
    """

    position: float
    velocity: float
    torque: float


@dataclass(frozen=True)
class Model:
    """One model.

    Attributes:
        name: the maker's name.
        maker: who makes it.
        ranges: by firmware generation; several where sources differ on what is delivered. The first is the default.
        gear: reduction; None where no source is at hand.
        pole_pairs: of the rotor, where the status counts electrical turns.
        kt: N m/A at the rotor, where the status counts current; None: not known.
    """

    name: str
    maker: Maker
    ranges: dict[Generation, tuple[Range, ...]]
    gear: float | None = None
    pole_pairs: int = 21
    kt: float | None = None

    @property
    def rotor_turn(self) -> float | None:
        """rad of the output shaft for a turn of the rotor."""
        return None if self.gear is None else 2 * pi / self.gear


def _ak(name: str, old: Range | None, new: Range | None, gear: float, kt: float, pole_pairs: int = 21) -> Model:
    ranges: dict[Generation, tuple[Range, ...]] = {}
    if old is not None:
        ranges |= {"v1": (old,), "v2": (old,)}
    if new is not None:
        ranges["v3"] = (new,)
    return Model(name, "cubemars", ranges, gear, pole_pairs, kt)


def _dm(name: str, gear: float | None, *ranges: Range) -> Model:
    return Model(name, "damiao", {"damiao": ranges}, gear)


_P: Final = 12.5  # rad
_P3: Final = 12.56  # rad, of V3

MODELS: Final = {
    model.name: model
    for model in (
        _ak("AK10-9", Range(_P, 50, 65), Range(_P3, 28, 54), 9, 0.160),
        _ak("AK60-6", Range(_P, 45, 15), Range(_P3, 60, 12), 6, 0.113, 14),
        _ak("AK70-9", None, Range(_P3, 30, 32), 9, 0.095),
        _ak("AK70-10", Range(_P, 50, 25), None, 10, 0.095),
        _ak("AK80-6", Range(_P, 76, 12), None, 6, 0.091),
        _ak("AK80-8", Range(_P, 37.5, 32), None, 8, 0.136),
        _ak("AK80-9", Range(_P, 50, 18), Range(_P3, 65, 18), 9, 0.091),
        _ak("AK80-64", Range(_P, 8, 144), None, 64, 0.119),
        _dm("DM3507", None, Range(_P, 50, 5)),
        _dm("DM4310", 10, Range(_P, 30, 10)),
        _dm("DM4310-48V", 10, Range(_P, 50, 10)),
        _dm("DM4340", 40, Range(_P, 8, 28), Range(_P, 10, 28)),
        _dm("DM4340-48V", 40, Range(_P, 10, 28), Range(_P, 10, 20)),
        _dm("DM6006", 6, Range(_P, 45, 20)),
        _dm("DM8006", 6, Range(_P, 45, 40), Range(_P, 45, 20)),
        _dm("DM8009", 9, Range(_P, 45, 54)),
        _dm("DM10010", 10, Range(_P, 20, 200)),
        _dm("DM10010L", 10, Range(_P, 25, 200)),
        _dm("DMH3510", None, Range(_P, 280, 1)),
        _dm("DMH6215", None, Range(_P, 45, 10)),
        _dm("DMG6220", None, Range(_P, 45, 10)),
    )
}
