"""Muscles of a simulated person's arm: which are active for a force of the hand, and how they get tired."""

from __future__ import annotations

from math import cos, exp, sin, sqrt
from typing import Final

from srl.runtime.contracts.rotation import Vector

# For each muscle, the direction of the hand's force, in the person's axes (forward, left, up), that uses it most. The
# upper arm hangs or is half raised, the elbow is bent. Ours: a static map, not a model of the bones.
PULLS: Final[dict[str, Vector]] = {
    "anterior_deltoid": (0.5, 0.0, 0.866),  # raises the arm forward
    "posterior_deltoid": (-0.866, 0.0, -0.5),  # pulls it back and down
    "biceps": (-0.5, 0.0, 0.866),  # bends the elbow
    "triceps": (0.5, 0.0, -0.866),  # extends it
}
_TONE: Final = 0.02  # share of the greatest contraction, at rest; ours
_STIFFENING: Final = 0.1  # share of the force with which every muscle contracts, too; ours
_TIRING: Final = 1 / 60  # 1/s, k of Ma et al., Int. J. Ind. Ergonomics 39 (2009): 1 per minute
_RECOVERY: Final = 2.4 / 60  # 1/s, R of Ma et al. 2010: 2.4 per minute, from memory
_LIGHT: Final = 0.15  # share of the strength; below it muscles recover (Rohmert's endurance limit)


class Muscles:
    """Muscle activation as a function of force, and fatigue."""

    def __init__(self, strength: float, facing: float, arm: float) -> None:
        """
        Args:
            strength: N, the hand's greatest force when fresh.
            facing: rad, the person's forward direction about the world's z.
            arm: N, the weight of the arm itself as a force at the hand.
        """
        self._strength, self._arm = strength, arm
        self._cos, self._sin = cos(facing), sin(facing)

    def activations(self, force: Vector, capacity: float) -> tuple[float, ...]:
        """Activations, 0..1, in the order of PULLS.

        A tired muscle must be activated more for the same force.

        Args:
            force: N, force that the hand exerts, world axes.
            capacity: remaining share of the strength.
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
        """The remaining share of the strength after `dt` seconds of a force.

        d capacity / dt = -k capacity load, where load is the share of the fresh strength; with light loads it recovers.
        A steady load f can be held for -ln(f) / (k f).
        """
        x, y, z = force
        z += self._arm
        load = sqrt(x * x + y * y + z * z) / self._strength
        if load < _LIGHT:
            return 1.0 - (1.0 - capacity) * exp(-_RECOVERY * dt)
        return capacity * exp(-_TIRING * min(load, 1.0) * dt)
