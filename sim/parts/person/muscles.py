"""Muscles of a simulated person's arm: which are active for a force of the hand, and how they tire."""

from __future__ import annotations

from math import cos, exp, sin, sqrt
from typing import Final

from runtime.contracts.rotation import Vector

# The direction, in the person's axes (forward, left, up), in which the hand's force takes each muscle most, for an
# upper arm that hangs or is half raised and a bent elbow. Ours: a static map, no model of the bones.
PULLS: Final[dict[str, Vector]] = {
    "anterior_deltoid": (0.5, 0.0, 0.866),  # raises the arm forward
    "posterior_deltoid": (-0.866, 0.0, -0.5),  # draws it back and down
    "biceps": (-0.5, 0.0, 0.866),  # bends the elbow
    "triceps": (0.5, 0.0, -0.866),  # stretches it
}
_TONE: Final = 0.02  # of the greatest contraction, at rest; ours
_STIFFENING: Final = 0.1  # share of the force that every muscle joins in with; ours
_TIRING: Final = 1 / 60  # 1/s, k of Ma et al., Int. J. Ind. Ergonomics 39 (2009): 1 a minute
_RECOVERY: Final = 2.4 / 60  # 1/s, R of the same authors: 2.4 a minute
_LIGHT: Final = 0.15  # of the strength: below, muscles recover (Rohmert's limit of endless work)


class Muscles:
    """Activation by force, and fatigue."""

    def __init__(self, strength: float, facing: float, arm: float) -> None:
        """
        Args:
            strength: N, the hand's greatest force when fresh.
            facing: rad, the person's forward direction about the world's z.
            arm: N at the hand that the weight of the arm itself amounts to.
        """
        self._strength, self._arm = strength, arm
        self._cos, self._sin = cos(facing), sin(facing)

    def activations(self, force: Vector, capacity: float) -> tuple[float, ...]:
        """0..1 by muscle, in the order of PULLS.

        A tired muscle has to be driven harder for the same force.

        Args:
            force: N, what the hand exerts, world axes.
            capacity: share of the strength that is left.
        """
        x, y, z = force
        forward, left, up = self._cos * x + self._sin * y, self._cos * y - self._sin * x, z + self._arm
        whole = sqrt(forward * forward + left * left + up * up) * _STIFFENING
        out = []
        for a, b, c in PULLS.values():
            pull = a * forward + b * left + c * up
            level = _TONE + (whole + (pull if pull > 0 else 0.0)) / (self._strength * capacity)
            out.append(level if level < 1.0 else 1.0)
        return tuple(out)

    def tired(self, capacity: float, force: Vector, dt: float) -> float:
        """The share of the strength that is left after `dt` seconds of a force.

        d capacity / dt = -k capacity load, load being the share of the fresh strength; light loads let it recover.
        A steady load f can be held for -ln(f) / (k f).
        """
        x, y, z = force
        z += self._arm
        load = sqrt(x * x + y * y + z * z) / self._strength
        if load < _LIGHT:
            return 1.0 - (1.0 - capacity) * exp(-_RECOVERY * dt)
        return capacity * exp(-_TIRING * min(load, 1.0) * dt)
