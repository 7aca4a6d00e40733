"""Whether a motor's velocity is that of its position. A wrong range, so a wrong model, shows itself here alone."""

from __future__ import annotations

from typing import Final

FROM: Final = 1.0  # rad of travel after which it is judged
LOW, HIGH = 0.8, 1.25  # share of its motion that its velocity may say
SLOW: Final = 0.2  # rad/s, below which steps of the wire count for too much


class Plausible:
    """One motor's travel by its positions, and by its velocities."""

    def __init__(self) -> None:
        self._moved = self._integrated = 0.0
        self._at = -1

    def take(self, by: float, velocity: float, now: int) -> None:
        """Takes a reply: rad since the one before, rad/s, ns."""
        dt, self._at = (now - self._at) * 1e-9 if self._at >= 0 else 0.0, now
        if 0 < dt < 0.05 and abs(velocity) > SLOW:
            self._moved += abs(by)
            self._integrated += abs(velocity) * dt

    @property
    def implausible(self) -> str:
        """In words; "" if nothing is wrong, or not enough was seen."""
        if max(self._moved, self._integrated) < FROM:
            return ""
        share = self._integrated / max(self._moved, 1e-6)
        if LOW <= share <= HIGH:
            return ""
        return f"its velocity says {share:.2f} times its motion: check 'model', 'firmware' and 'range'"
