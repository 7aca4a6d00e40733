"""How far a motion capture system can see."""

from __future__ import annotations

from typing import Final

FARTHEST: Final = 100.0  # m from its origin; no volume is larger, so what is beyond isn't seen
