"""CubeMars AK models: what servo mode needs to convert its units. Source: protocol sheet can_actuators, section 3."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Model:
    """gear: reduction. pole_pairs: of the rotor; the drive's speed is that of the electrical field."""

    gear: float
    pole_pairs: int

    @property
    def erpm(self) -> float:
        """Electrical rpm per rad/s of the output shaft."""
        return 60 / 6.283185307179586 * self.gear * self.pole_pairs


# The name says the gear. The sheet: 21 pole pairs on most AK, 14 on AK60-6.
MODELS: Final = {
    "AK10-9": Model(9, 21),
    "AK60-6": Model(6, 14),
    "AK70-10": Model(10, 21),
    "AK80-6": Model(6, 21),
    "AK80-8": Model(8, 21),
    "AK80-9": Model(9, 21),
    "AK80-64": Model(64, 21),
}
