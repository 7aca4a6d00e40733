"""What ends a motion that nobody leads any more: A or M was switched off, or the hand's force is unknown.

The brake is a damping of the virtual mass, so it only takes energy and turns no motion round. It takes at most a
stated deceleration, sets in gradually, and ends exponentially. Then the desired pose comes back to the robot: one that
lags behind would go on, and one that leans on something, or somebody, would lean for ever.
"""

from __future__ import annotations

from math import exp, sqrt

from pydantic import Field

from srl.runtime.contracts.options import Options


class ReleaseConfig(Options):
    """The brake of a motion that nobody leads. From a speed v it takes `onset` + v/deceleration + 5 `settle` at most.

    Afterwards less than 1 % of the speed is left.
    """

    deceleration: float = Field(4.0, gt=0, description="m/s2 of translation, besides that of the law's own damping")
    angular: float = Field(10.0, gt=0, description="rad/s2 of rotation, likewise")
    settle: float = Field(0.02, gt=0, description="s, time constant at the end")
    onset: float = Field(0.02, gt=0, description="s in which it sets in, and goes when it is switched on again")
    draw_in: float | None = Field(
        0.1,
        gt=0,
        description="s, time constant with which the desired pose comes back to the measured one, but for what gravity "
        "may have caused: upward, and rotation about level axes; null: it stays",
    )


class Release:
    """The brake of one of translation and rotation."""

    def __init__(self, deceleration: float, settle: float, onset: float) -> None:
        """deceleration: m/s2 or rad/s2; settle, onset: s, as in `ReleaseConfig`."""
        self._deceleration, self._settle, self._onset = deceleration, settle, onset
        self._level = 0.0

    def reset(self) -> None:
        """Starts without a brake."""
        self._level = 0.0

    def rate(self, released: bool, velocity: list[float], dt: float) -> float:
        """The damping per mass, 1/s, for the next dt seconds from this velocity (3,), m/s or rad/s."""
        step = dt / self._onset
        self._level = level = min(self._level + step, 1.0) if released else max(self._level - step, 0.0)
        if level == 0.0:
            return 0.0
        x, y, z = velocity
        speed = sqrt(x * x + y * y + z * z)
        return level * self._deceleration / max(speed, self._deceleration * self._settle)


class DrawIn:
    """Brings the desired one of position and orientation back to the measured one, once it is no longer led.

    It goes back by no more than it was ahead when it was let go: what pushes the robot away later stretches its spring.
    """

    def __init__(self, time: float) -> None:
        """time: s, its time constant."""
        self._time, self._left = time, 0.0

    def reset(self) -> None:
        """Starts with nothing to bring back."""
        self._left = 0.0

    def share(self, led: bool, ahead: tuple[float, float, float], dt: float) -> float:
        """The share of `ahead` (3,), m or rad, by which it comes back in the next dt seconds, 0 to 1."""
        x, y, z = ahead
        size = sqrt(x * x + y * y + z * z)
        if led:
            self._left = size
            return 0.0
        way = min((1.0 - exp(-dt / self._time)) * size, self._left)
        self._left -= way
        return way / size if size > 0.0 else 0.0
