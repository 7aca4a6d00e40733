"""The acceleration of gravity that laws, robots' models and the simulated world share."""

from __future__ import annotations

from typing import Final

GRAVITY: Final = 9.81
"""m/s^2, the value of all sheets' references."""
DOWN: Final = (0.0, 0.0, -GRAVITY)
"""(3,) m/s^2, as a vector where z is up."""
