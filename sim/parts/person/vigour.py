"""How long a person takes for a reach: what being there is worth, against the effort, both discounted in time.

Shadmehr, Huang and Ahmed, Current Biology 26 (2016): the energy of a reach of d in T with the effective mass m is
a m T + b m d^i / T^(j - 1), as they measured it, and people take the T for which (reward - energy) / (1 + T / s) is
greatest.
The work against a known damping is ours: that of a minimum-jerk motion, at the efficiency of muscles.
"""

from __future__ import annotations

from collections.abc import Callable
from math import exp, log
from typing import Final

_REST: Final = 15.0  # a, W/kg
_MOVE: Final = 77.0  # b, J/kg with m and s
_FAR: Final = 1.1  # i
_FAST: Final = 2.7  # j
_DISCOUNT: Final = 1.0  # 1/s
_EFFICIENCY: Final = 0.25  # mechanical work over metabolic energy (Margaria 1968)
_JERK: Final = 10.0 / 7.0  # mean square speed of a minimum-jerk motion over its squared mean
_SHORTEST: Final = 0.15  # s
_LONGEST: Final = 20.0  # s
_GOLDEN: Final = 0.6180339887498949
_GRID: Final = 50
_STEPS: Final = 24  # of golden sections, to 1e-5 of the duration


def energy(duration: float, distance: float, arm: float, load: float, drag: float) -> float:
    """J, of a reach.

    Args:
        duration, distance: s, m.
        arm: kg, effective mass of the arm, whose upkeep costs too.
        load: kg that the hand moves besides.
        drag: N s/m.
    """
    moving = _MOVE * (arm + load) * distance**_FAR / duration ** (_FAST - 1.0)
    return _REST * arm * duration + moving + _JERK * drag * distance**2 / (_EFFICIENCY * duration)


def duration(distance: float, arm: float, load: float, drag: float, reward: float) -> float:
    """s, of the reach that is worth most: 0.15 to 20.

    Args:
        distance, arm, load, drag: as of `energy`.
        reward: J.
    """

    def worth(t: float) -> float:
        return (reward - energy(t, distance, arm, load, drag)) / (1.0 + _DISCOUNT * t)

    best = _greatest(worth)
    if worth(best) > 0.0:
        return best
    # Nothing is worth this reach, but the plan asks for it: with the least effort.
    return _greatest(lambda t: -energy(t, distance, arm, load, drag))


def _greatest(value: Callable[[float], float]) -> float:
    """Where a function of the duration is greatest: the best of a grid, then golden sections around it."""
    low, span = log(_SHORTEST), log(_LONGEST / _SHORTEST) / _GRID
    best = max(range(_GRID + 1), key=lambda k: value(exp(low + k * span)))
    a, b = low + (best - 1) * span, low + (best + 1) * span
    for _ in range(_STEPS):
        c, d = b - _GOLDEN * (b - a), a + _GOLDEN * (b - a)
        a, b = (a, d) if value(exp(c)) > value(exp(d)) else (c, b)
    return min(max(exp((a + b) / 2.0), _SHORTEST), _LONGEST)
