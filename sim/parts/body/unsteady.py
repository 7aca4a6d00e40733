"""What goes wrong while a hand is held: it drifts, and joints that should leave it still move it."""

from __future__ import annotations

import zlib
from math import sqrt, tan

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.sim.parts.body.wearer_config import UpperBodyConfig
from srl.sim.parts.person.noise import Wander

_JOINTS = 9
_QUICK, _SLOW = 0.1, 0.5  # s, correlation times of the joints' noise and of the drift
_SWAY = 3.0  # s, of the torso
_FADE = 1.0  # s, in which a DoF's own error is felt and goes


class Unsteadiness:
    """The hand's error, and the errors of DoFs and torso. All random numbers follow from seed, name and time.

    The joints' velocity is off by an angle, always in the same direction of joint space, and each joint's by a share of
    its speed. What of that moves the hand adds up, is felt with a delay and corrected.

    Attributes:
        hand: (6,) m and rad, in the chest's axes: where the hand is, less where it is meant to be.
        dofs: (3,) rad, the same for swivel, shrug and protraction.
        torso: (3,) rad of yaw, lean and side.
    """

    def __init__(self, config: UpperBodyConfig, seed: int, name: str, dt: float) -> None:
        self._config, self._dt = config, dt
        constants = (_QUICK,) * (_JOINTS + 3) + (_SLOW,) * 6 + (_SWAY,) * 3
        self._noise = Wander(seed, name, dt, constants)
        self._count = len(constants)
        off = np.random.default_rng([seed, zlib.crc32(name.encode()), 5]).normal(size=_JOINTS)
        self._off = off * (tan(config.direction_error) / float(np.linalg.norm(off)))
        K = max(config.feedback, 1.0)
        # So that the drift alone has the wanted size, the feedback's delay left aside.
        self._drift = np.repeat([config.wander, config.wander_turn], 3) * sqrt(K * (1.0 + K * _SLOW) / _SLOW)
        self._rows = max(1, round(config.feel / dt))
        self.begin()

    def begin(self) -> None:
        """Starts without error."""
        self._values: tuple[float, ...] = (0.0,) * self._count
        self._past = np.zeros((self._rows, 6))
        self.hand, self.dofs, self.torso = np.zeros(6), np.zeros(3), np.zeros(3)

    def next(self, number: int, J: Array, speed: Array, rates: Array) -> None:
        """Goes on to update `number`.

        Args:
            J: (6, 9) of the hand.
            speed: (9,) rad/s of the joints, as meant.
            rates: (3,) rad/s of the DoFs, as meant.
        """
        config, dt = self._config, self._dt
        self._values = self._noise.next(self._values, number)
        values = np.array(self._values)
        wrong = sqrt(float(speed @ speed)) * self._off + config.noise * values[:_JOINTS] * speed
        row = number % self._rows
        felt = self._past[row].copy()
        self.hand = self.hand + dt * (
            J @ wrong + self._drift * values[_JOINTS + 3 : _JOINTS + 9] - config.feedback * felt
        )
        self._past[row] = self.hand
        own = config.noise * values[_JOINTS : _JOINTS + 3] * rates
        self.dofs = self.dofs + dt * (own - self.dofs / _FADE)
        self.torso = config.sway * values[_JOINTS + 9 :]

    def save(self) -> Array:
        """Its state."""
        return np.concatenate([self._values, self._past.ravel(), self.hand, self.dofs, self.torso])

    def restore(self, state: Array) -> None:
        """Restores a state returned by `save`."""
        values, past, self.hand, self.dofs, self.torso = (
            part.copy() for part in np.split(state, np.cumsum([self._count, self._past.size, 6, 3]))
        )
        self._values = tuple(values.tolist())
        self._past = past.reshape(self._past.shape)
