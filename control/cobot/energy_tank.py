"""What the hand and the robot exchange at the handle, and the damping that keeps the robot from giving energy.

    E = integral of lambda_h . xdot      lambda_h: of the hand on the robot, xdot: measured, of the same instant

E is energy that the hand has put in and may get back. It is bounded from above: by the energy that the virtual mass in
motion may return, and `size` beyond it. What is above was dissipated, and must not hide an oscillation later. As E
runs out, a damping sets in. A robot that is leaned on a wall doesn't move, so it exchanges nothing: E stays.
Passivity observer and controller: Hannaford and Ryu (2002), doi:10.1109/70.988969; the damping is bounded here.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from operator import mul
from typing import Final

_FULL: Final = 0.5  # of the size: above this level there is no brake
_DEBT: Final = 5.0  # greatest debt, in sizes; any debt beyond it is dropped, and the brake stays on
_RELEASE: Final = 2.0  # s, time constant of the brake's release: an oscillation that filled the tank would restart


class EnergyTank:
    """See the module's docstring.

    The damping is bounded. As measured motion is noisy, an unbounded damping would lock the robot against a hand that
    keeps pushing. Energy that couldn't be held back is a debt, which the hand's next push pays.

    Attributes:
        level: E, J.
        brake: N s/m, the damping of translation now.
        emptied: number of cycles with E <= 0.
    """

    def __init__(self, size: float, brake: float, age: float) -> None:
        """size: J; brake: N s/m, of an empty tank; age: s, by which the hand's force is older than the motion."""
        self._size, self._most, self._age = size, brake, age
        self._past: deque[list[float]] = deque()  # measured twists; the oldest has the age of the force
        self.emptied = 0
        self.reset()

    def reset(self) -> None:
        """Starts full, without a brake."""
        self.level, self.brake = self._size, 0.0
        self._past.clear()

    def step(
        self, force: list[float], measured: list[float], desired: list[float], mass: list[float], dt: float
    ) -> None:
        """Counts dt seconds.

        Args:
            force: lambda_h (6,) N and N m.
            measured, desired: twists (6,) m/s and rad/s.
            mass: M (6,) kg and kg m^2, of the virtual mass.
        """
        if self._age and dt > 0.0:
            self._past.append(measured)
            while len(self._past) > round(self._age / dt) + 1:
                self._past.popleft()
            measured = self._past[0]
        # The robot lags behind the virtual mass: until both have stopped, the hand may get the motion's energy back.
        moving = 0.5 * max(dot(mass, map(mul, measured, measured)), dot(mass, map(mul, desired, desired)))
        level = self.level + dt * dot(force, measured)
        self.level = level = min(max(level, -_DEBT * self._size), self._size + moving)
        wanted = self._most * min(max(1.0 - level / (_FULL * self._size), 0.0), 1.0)
        self.brake = max(wanted, self.brake * _RELEASE / (_RELEASE + dt))
        self.emptied += level <= 0.0


def dot(a: Iterable[float], b: Iterable[float]) -> float:
    """The sum of the products."""
    return sum(map(mul, a, b))
