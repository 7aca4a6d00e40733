"""Units as streams of LSL state them, in SI. Source: protocol sheet lsl, section 2 (XDF's meta-data pages)."""

from __future__ import annotations

import math
from typing import Final

_SAME: Final = {
    "V": ("v", "volt", "volts"),
    "m": ("m", "meter", "meters", "metre", "metres"),
    "rad": ("rad", "radian", "radians"),
    "rad/s": ("rad/s", "radians/s"),
    "m/s": ("m/s",),
    "m/s2": ("m/s2", "m/s^2", "m/s²"),
    "N": ("n", "newton", "newtons"),
    "N m": ("n m", "nm", "n·m", "newton meters"),
    "s": ("s", "second", "seconds"),
    "1": ("1", "normalized", "normalised", "unitless", "quaternion", "none", "a.u.", "count", "counts"),
}
_SCALED: Final = {
    "V": {"millivolts": 1e-3, "millivolt": 1e-3, "mv": 1e-3, "microvolts": 1e-6, "microvolt": 1e-6, "uv": 1e-6,
          "µv": 1e-6, "μv": 1e-6, "nanovolts": 1e-9, "nv": 1e-9},
    "m": {"centimeters": 1e-2, "cm": 1e-2, "millimeters": 1e-3, "millimetres": 1e-3, "mm": 1e-3},
    "rad": {"degrees": math.pi / 180, "degree": math.pi / 180, "deg": math.pi / 180, "°": math.pi / 180},
    "rad/s": {"degrees/s": math.pi / 180, "deg/s": math.pi / 180, "°/s": math.pi / 180, "dps": math.pi / 180},
    "m/s": {"mm/s": 1e-3},
    "m/s2": {"g": 9.80665},
    "s": {"milliseconds": 1e-3, "ms": 1e-3},
    "1": {"percent": 1e-2, "%": 1e-2},
}  # fmt: skip
KNOWN: Final = {word: (unit, 1.0) for unit, words in _SAME.items() for word in words} | {
    word: (unit, factor) for unit, words in _SCALED.items() for word, factor in words.items()
}
"""Word in small letters: (SI unit, factor to it)."""


def factor(word: str, unit: str) -> float | None:
    """By what a value in the stated unit is multiplied to be in `unit` (SI); None: it isn't a known unit of that kind.

    A lone "mm" is millimetres and "m" metres; letters' case doesn't count, as authors write "uV" and "UV".
    """
    there, by = KNOWN.get(word.strip().lower(), ("", 0.0))
    return by if there == unit else None
