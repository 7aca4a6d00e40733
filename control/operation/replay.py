"""The supernumerary arm follows a shown path on a phase that waits, clear of the body: one quadratic program a cycle.

Let s be the phase, seconds of the demonstration; x(s) its place and x'(s) its velocity; p and J the arm's tip and its
Jacobian at the joints q. The variables are the joint velocities v and the phase's rate r = ds/dt:

    minimise   |J v - r x'(s) - c|^2 / V^2  +  a (r - r*)^2  +  b |v/v_max - u|^2                                   (1)
    c = K (x(s) + o - p), at most `catch_up` long:  what is left of the path's place
    subject to 0 <= r <= r*,  r <= r_before + dt/`ease`
               the joints' limits of position, velocity and acceleration
               n_i^T J_i v >= w_i - g (d_i - d_keep)   for the nearest pairs i of body and arm                      (2)

(2) is a barrier on the distance d_i: it may shrink by at most the share g a second of what is above d_keep, w_i being
what the body itself takes from it. The tracking is soft and the distance is hard: where both can't be had, the tip
leaves the path or the phase waits. u goes to a posture that is given; b grows where the arm is nearly singular.

o is by how much the measured tip is beside the path's place, summed up slowly and at most `sag` long: servos give way
under the arm's weight. It stands still while something keeps the arm from its motion.

r* is 1, less for the distance of the measured tip from the path, so a servo that lags, a hand that holds the limb or a
guard that stops it make the phase wait, too. c makes the tip go to the path, or back to it, at a limited speed, so
nothing jumps after a pause.

Where no v is within both the joints' limits and (2), or `around` is "wait", the tip doesn't leave the path: v of (1)
without (2) is scaled down as far as (2) asks, to standstill. Keeping clear of a body that comes nearer still is the
verified stop's task (docs/guard.md).

Sources: Ames et al., Control Barrier Functions: Theory and Applications (2019), for (2); Faverjon and Tournassoud
(1987), its form for velocities; Maciejewski and Klein (1988) for the damping.
"""

from __future__ import annotations

from typing import Final, Literal

import daqp  # type: ignore[import-not-found]
import numpy as np
from pydantic import Field

from srl.control.cobot.whole_body_qp import ITERATIONS, Approach, LimitsConfig
from srl.control.operation.demonstration import PERIOD, TaskPath
from srl.control.operation.worn import Pairs
from srl.control.skeleton.ranges import JointRanges
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array

Around = Literal["bend", "plan", "wait", "ignore"]
_V: Final = 0.1  # m/s, V of (1): what counts as one
_A: Final = 0.05  # a
_B: Final = 1e-3  # b, where the arm isn't singular
_SINGULAR: Final = 1.0  # b where it is
_OPTIMAL: Final = 1


class ReplayOptions(Options):
    """How the path is followed. The defaults are ours."""

    around: Around = Field(
        "bend",
        description="bend around the body; plan: the same, and by a planned way where that leads nowhere; wait on the "
        "path until it is away; ignore: leave it to the guard",
    )
    plan_after: float = Field(4.0, gt=0.0, le=60.0, description="s of coming no nearer before `plan` looks for a way")
    keep: float = Field(0.06, ge=0.0, lt=0.5, description="m, d_keep: kept between the shapes of body and arm")
    rate: float = Field(4.0, gt=0.1, le=20.0, description="1/s, g: how fast a distance may shrink, of what is above")
    look: float = Field(0.25, gt=0.0, lt=1.0, description="m: pairs farther apart don't count")
    pairs: int = Field(12, ge=1, le=64, description="the most pairs that count, the nearest first")
    gain: float = Field(4.0, gt=0.0, le=20.0, description="1/s, K")
    catch_up: float = Field(0.15, gt=0.0, le=1.0, description="m/s at which the tip goes back to the path, at most")
    slow: float = Field(0.01, ge=0.0, lt=0.5, description="m from the path within which the phase runs fully")
    wait: float = Field(0.05, gt=0.0, lt=0.5, description="m from the path beyond which the phase waits")
    sag: float = Field(0.05, ge=0.0, lt=0.2, description="m, the most that o corrects")
    settle: float = Field(1.0, gt=0.05, le=20.0, description="s, time constant of o")
    ease: float = Field(0.3, gt=0.0, le=5.0, description="s in which the phase gets going")
    posture: float = Field(0.5, ge=0.0, le=5.0, description="1/s to the posture, where the task leaves freedom")
    singular: float = Field(
        0.03, gt=0.0, lt=0.5, description="m/s that the weakest direction gives at full joint speed"
    )


class Replay:
    """One task on its way.

    Attributes:
        path: what is followed.
        s: s, the phase.
        r: its rate, 1 at the demonstration's own speed.
        error: m, of the tip's commanded place from where (1) wants it.
        blocked: a distance let the arm go neither along the path nor around in this cycle.
        failures: of the solver, or nothing within all limits.
    """

    def __init__(self, path: TaskPath, ranges: JointRanges, options: ReplayOptions) -> None:
        self.path, self.options = path, options
        self._n, self._speed = ranges.n, ranges.dq_max
        self._approach = Approach(ranges, LimitsConfig(margin=0.0), 1.0)
        self._posture = ranges.posture
        self.s = self.r = self.error = 0.0
        self.blocked, self.failures = False, 0
        self._offset = np.zeros(3)  # o

    @property
    def done(self) -> bool:
        """Whether the end of the path is reached, within `slow` and a millimetre."""
        return self.s >= self.path.duration and self.error <= max(self.options.slow, 1e-3)

    @property
    def place(self) -> Array:
        """(3,) m, where the commanded tip should be now."""
        place: Array = self.path.at(self.s)[0] + self._offset
        return place

    def rest(self, seconds: float) -> TaskPath:
        """What comes next, as it is commanded: so many seconds of it, or what is left."""
        times = np.arange(self.s, min(self.s + seconds, self.path.duration) + PERIOD, PERIOD)
        return TaskPath(np.array([self.path.at(s)[0] for s in times]) + self._offset)

    def hold(self, tip: Array) -> None:
        """The phase stands in this cycle, and the tip (3,) m goes another way."""
        self.r, self.blocked, self.error = 0.0, False, float(np.linalg.norm(self.place - tip))

    def again(self) -> None:
        """Goes back to the beginning."""
        self.s = self.r = self.error = 0.0

    def correct(self, measured: Array, dt: float) -> None:
        """Sums up by how much the measured tip (3,) m is beside the path's place. For cycles without hindrance."""
        if self.error > self.options.slow:
            return
        o, most = self._offset, self.options.sag
        o += (self.path.at(self.s)[0] - measured) * (dt / self.options.settle)
        if (size := float(np.linalg.norm(o))) > most:
            o *= most / size

    def step(self, q: Array, before: Array, tip: Array, J: Array, measured: Array, pairs: Pairs, dt: float) -> Array:
        """The joints' velocity (n,) for the next dt seconds; moves the phase on.

        Args:
            q: (n,) where the joints are commanded.
            before: (n,) the velocity of the cycle before.
            tip, J: the tip (3,) m at q, and its Jacobian (3, n).
            measured: (3,) m, where the tip is measured.
            pairs: those of body and arm at q.
        """
        o = self.options
        place, velocity = self.path.at(self.s)
        away = self.place - tip
        self.error = float(np.linalg.norm(away))
        c = o.gain * away
        if (size := float(np.linalg.norm(c))) > o.catch_up:
            c *= o.catch_up / size
        behind = max(self.error, float(np.linalg.norm(place - measured)))
        most = min(max((o.wait - behind) / max(o.wait - o.slow, 1e-9), 0.0), 1.0)
        if self.s == 0.0 and self.error > o.slow:
            most = 0.0  # the task begins where it began
        most = min(most, self.r + dt / o.ease) if self.s < self.path.duration else 0.0
        least, greatest = self._approach.speeds(q, before, dt)
        H, f = self._cost(q, J, velocity, c, most)
        asked = pairs.approach - o.rate * (pairs.distance - o.keep)
        rows = pairs.rows
        if o.around == "ignore":
            rows, asked = rows[:0], asked[:0]
        found = self._solved(H, f, least, greatest, most, rows, asked) if o.around != "wait" else None
        self.blocked = found is None
        if found is None:
            found = self._on_path(H, f, least, greatest, most, rows, asked)
        v, r = found[: self._n], float(found[self._n])
        self.r = r
        self.s = min(self.s + r * dt, self.path.duration)
        return v

    def _cost(self, q: Array, J: Array, velocity: Array, c: Array, most: float) -> tuple[Array, Array]:
        """H (n + 1, n + 1) and f (n + 1,) of (1), in v/v_max and r."""
        n, scale = self._n, self._speed
        A = np.empty((3, n + 1))
        A[:, :n], A[:, n] = J * scale, -velocity
        weakest = float(np.linalg.svd(A[:, :n], compute_uv=False)[-1])
        near = max(1.0 - weakest / self.options.singular, 0.0)
        damping = _B + _SINGULAR * near * near
        u = np.clip(self.options.posture * (self._posture - q) / scale, -0.5, 0.5)
        H = A.T @ A / _V**2
        f = -A.T @ c / _V**2
        H[range(n), range(n)] += damping
        f[:n] -= _B * u
        H[n, n] += _A
        f[n] -= _A * most
        return H, f

    def _solved(
        self, H: Array, f: Array, least: Array, greatest: Array, most: float, rows: Array, asked: Array
    ) -> Array | None:
        """v and r (n + 1,); None if there is no solution."""
        n, k = self._n, len(rows)
        lower, upper = np.empty(n + 1 + k), np.full(n + 1 + k, np.inf)
        lower[:n], upper[:n] = least / self._speed, greatest / self._speed
        lower[n], upper[n] = 0.0, max(most, 0.0)
        lower[n + 1 :] = asked
        A = np.zeros((k, n + 1))
        A[:, :n] = rows * self._speed
        x, _, flag, _ = daqp.solve(H, f, A, upper, lower, primal_tol=1e-9, eps_prox=0.0, iter_limit=ITERATIONS)
        if flag != _OPTIMAL or not np.isfinite(x).all():
            self.failures += 1
            return None
        x = np.asarray(x, dtype=float).copy()
        x[:n] = np.clip(x[:n] * self._speed, least, greatest)
        return x

    def _on_path(
        self, H: Array, f: Array, least: Array, greatest: Array, most: float, rows: Array, asked: Array
    ) -> Array:
        """What (1) alone would do, slowed down as far as the distances ask."""
        found = self._solved(H, f, least, greatest, most, rows[:0], asked[:0])
        if found is None:
            return np.zeros(self._n + 1)
        gains = rows @ found[: self._n]
        share = 1.0
        for gain, need in zip(gains.tolist(), asked.tolist(), strict=True):
            if gain < need:  # at less than this speed it is kept, or it can't be
                share = min(share, need / gain) if gain < 0.0 and need < 0.0 else 0.0
        self.blocked = share < 1.0
        found *= share
        found[: self._n] = np.clip(found[: self._n], least, greatest)
        return found
