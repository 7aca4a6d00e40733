"""The acceleration of gravity that control laws, robot models and the simulated world share."""

from __future__ import annotations

from typing import Final

GRAVITY: Final = 9.81
"""m/s^2, the value in the references of all sheets."""
DOWN: Final = (0.0, 0.0, -GRAVITY)
"""(3,) m/s^2, as a vector in a frame with z up."""
