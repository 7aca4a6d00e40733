"""How a wearer makes pointers follow displayed curves with the motion of its own body.

It doesn't know the law between its motion and the pointer. It believes in a straight line, c = a x + b over the share x
of the DoF's range, begins with a wrong gain and corrects line and pointer from what it sees, with a delay. With
`preview` it reads the curve ahead, so that a short lag remains; in `pursuit` it reacts to the error alone, as a human
operator near crossover does (McRuer and Jex 1967).
"""

from __future__ import annotations

import zlib
from math import exp, isfinite, isnan

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.sim.parts.body.wearer_config import Tracking

DOFS = 3
_MUSCLES = 50.0  # rad/s, of a second-order lag: 0.04 s of the delays below
_STEEP = 0.3  # least slope that is believed
_UNLIKE = 0.15  # of the pointer, how far a sample may be from the line
_END = 0.99  # a pointer beyond it (below 0.01) is at its end
_UNSURE = 0.5  # of slope and offset, at the beginning
_FAR = (0.1, 0.04, 0.04)  # rad, to which a goal is drawn in: DoFs move at 1.8 and 0.7 rad/s at most


class Tracker:
    """Where each DoF is meant to be.

    Attributes:
        x: (3,) rad, the DoFs as meant.
        v: (3,) rad/s.
        lines: (3, 2), slope and offset that the wearer believes in.
    """

    def __init__(self, config: Tracking, seed: int, name: str, dt: float) -> None:
        self._config, self._dt = config, dt
        rng = np.random.default_rng([seed, zlib.crc32(name.encode()), 6])
        self._first = 1.0 + config.gain_error * rng.normal(size=DOFS)
        self._rows = max(1, round(config.delay / dt))
        self._sooner = max(1, self._rows - round(2.0 / _MUSCLES / dt))  # the muscles' lag is part of the delay
        self._forget = exp(-dt / config.learning)
        self.lines = np.column_stack([self._first, np.full(DOFS, 0.5)])
        self._trust = np.tile((_UNSURE / _UNLIKE) ** 2 * np.eye(2), (DOFS, 1, 1))
        self.x, self.v = np.zeros(DOFS), np.zeros(DOFS)
        self._start, self._low, self._high = np.zeros(DOFS), np.zeros(DOFS), np.ones(DOFS)
        self._shift = np.zeros(DOFS)
        self._past = np.full((self._rows, 3, DOFS), np.nan)  # what was wanted, where the DoF was, what was seen

    def begin(self, x: Array, v: Array, low: Array, high: Array) -> None:
        """A new curve begins while the DoFs are at x (3,) rad, with their velocity v, and have these ranges."""
        self.x, self.v = x.copy(), v.copy()
        self._start = x.copy()
        self._low, self._high = low.copy(), high.copy()
        self._shift = (x - low) / (high - low) - 0.5 if self._config.model == "pursuit" else np.zeros(DOFS)
        self._past[:] = np.nan

    @property
    def reads(self) -> float:
        """s by which the point of the curve that is in mind is behind the displayed one; negative: ahead of it."""
        return self._config.lag - 2.0 / _MUSCLES if self._config.model == "preview" else 0.0

    def follow(self, number: int, dof: int, wanted: float, actual: float, pointer: float, ease: float) -> None:
        """Moves a DoF on to update `number`.

        Args:
            wanted: the pointer that the wearer has in mind.
            actual: rad, where the DoF is.
            pointer: what the screen shows; NaN: nothing.
            ease: 0 to 1, how far the motion from the DoF's start to the curve has come.
        """
        config, dt, row = self._config, self._dt, number % self._rows
        low, high = float(self._low[dof]), float(self._high[dof])
        span = high - low
        share = (actual - low) / span - 0.5
        late = self._past[(number - self._sooner) % self._rows, :, dof]
        was_wanted, was_share, was_seen = late.tolist()
        if isfinite(was_seen):
            self._learn(dof, was_share, was_seen)
        slope, offset = self.lines[dof].tolist()
        # Cautious: who isn't sure how the pointer moves, or which way, moves less.
        unsure = _UNLIKE**2 * float(self._trust[dof, 0, 0])
        per = slope / max(slope * slope + unsure, _STEEP**2)
        accepted = slope * was_share + offset if isnan(was_seen) else was_seen
        error = was_wanted - accepted if isfinite(accepted) else 0.0
        if config.model == "preview":
            self._shift[dof] = min(max(self._shift[dof] + dt * config.correction * error, -0.5), 0.5)
            aim = wanted + self._shift[dof]
            goal = low + span * ((aim - offset) * per + 0.5)
        else:  # the shift is the motion itself, as a share of the range from where it began
            self._shift[dof] += dt * config.crossover * error * per
            self._shift[dof] = min(max(self._shift[dof], -1.0), 1.0)
            goal = low + span * (0.5 + self._shift[dof])
        self._past[row, :, dof] = wanted, share, pointer
        start = float(self._start[dof])
        self._pull(dof, start + ease * (min(max(goal, low), high) - start))

    def rest(self, dof: int, goal: float) -> None:
        """Moves a DoF that drives no pointer on."""
        self._pull(dof, goal)

    def _pull(self, dof: int, goal: float) -> None:
        """The muscles: a critically damped lag of second order, exact over one update for a constant goal."""
        w, dt = _MUSCLES, self._dt
        off, v = min(max(self.x[dof] - goal, -_FAR[dof]), _FAR[dof]), self.v[dof]
        goal = self.x[dof] - off
        fade, rate = exp(-w * dt), v + w * off
        self.x[dof] = goal + (off + rate * dt) * fade
        self.v[dof] = (v - w * rate * dt) * fade

    def _learn(self, dof: int, share: float, seen: float) -> None:
        """Recursive least squares with forgetting. A pointer at its end only says that the line isn't inside."""
        P, line = self._trust[dof], self.lines[dof]
        row = np.array([share, 1.0])
        expected = float(line @ row)
        if (seen > _END and expected > _END) or (seen < 1.0 - _END and expected < 1.0 - _END):
            return
        gain = P @ row
        gain /= self._forget + float(row @ gain)
        line += gain * (seen - expected)
        P -= np.outer(gain, row @ P)
        if np.trace(P) < 2.0 * (_UNSURE / _UNLIKE) ** 2:
            P /= self._forget

    def save(self) -> Array:
        """Its state."""
        return np.concatenate([array.ravel() for array in self._state()])

    def restore(self, state: Array) -> None:
        """Restores a state returned by `save`."""
        for array in self._state():
            array[...] = state[: array.size].reshape(array.shape)
            state = state[array.size :]

    def _state(self) -> tuple[Array, ...]:
        return (
            self.lines, self._trust, self.x, self.v, self._start, self._low, self._high, self._shift, self._past
        )  # fmt: skip
