"""The behaviour of a simulated wearer: from instructions to the joints of its arm, tick by tick.

What is meant (where the hand is held, what its DoFs do) and what goes wrong (`Unsteadiness`) give the hand's pose and
the DoFs; the joints follow in closed form (`ArmPosture`). Everything depends on the seed, the instructions and time.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate
from math import exp, pi, sin
from typing import Final

import numpy as np

from srl.runtime.contracts import rotation
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Explore, Follow, Hold, Instruction, Rest
from srl.sim.parts.body.arm_posture import ArmPosture
from srl.sim.parts.body.arm_posture import Hold as Held
from srl.sim.parts.body.tracking import DOFS, Tracker
from srl.sim.parts.body.unsteady import Unsteadiness
from srl.sim.parts.body.wearer_config import UpperBodyConfig
from srl.sim.wearer.motion import quintic

NAMES: Final = ("swivel", "shrug", "protraction")
# The workspace from the shoulder, shares of the arm's reach: forwards, inwards, up. A box in front of the chest.
_MIDDLE, _HALF = np.array([0.49, 0.045, -0.18]), np.array([0.15, 0.19, 0.165])
_RESTING: Final = np.array([0.45, 0.045, -0.34])
_PERIODS: Final = (5.3, 7.7, 9.7)  # s, of the exploration's axes
_MARGIN: Final = 0.05  # rad, that is left to the end of a joint's range
_STEP: Final = 0.02  # rad, of the search for a DoF's ends
_COAST: Final = 0.15  # s, in which a motion dies away when something else is wanted
_NEAR: Final = 0.015  # m from a point: there
_CLAVICLE: Final = 0.5  # pace of the clavicle, which moves the whole arm, as a share of the elbow's
_LEAST: Final = 0.6  # s, that a motion takes
_TURNING: Final = 1.0  # rad/s, mean of the hand that turns
_EASE: Final = 1.0  # s, from what was before to a curve
_STATE: Final = (
    "_place", "_axes", "_x", "_velocity", "_posture", "_from_place", "_from_turn", "_from_x", "_from_velocity",
    "_to_place", "_to_axes", "_at_rest", "_low", "_high", "_pointers", "q", "place", "dofs", "torso",
)  # fmt: skip
"""Arrays that a saved wearer consists of, besides what its parts save."""


def workspace(arm: ArmPosture) -> tuple[Array, Array, Array]:
    """The middle of the box in which a hand works, its half lengths, and where the hand rests; (3,) m each."""
    inwards = np.array([1.0, -np.sign(arm.shoulder[1]), 1.0])
    return (
        arm.shoulder + arm.reach * _MIDDLE * inwards,
        arm.reach * _HALF,
        arm.shoulder + arm.reach * _RESTING * inwards,
    )


class BodyWearer:
    """See the module's docstring, and `srl.runtime.contracts.wearer.Wearer`.

    Attributes:
        q: (9,) rad, protraction, elevation and the arm's joints, at the last update.
        place: (3,) m, where the hand is meant to be, in the chest's frame.
        dofs: (3,) rad, where swivel, shrug and protraction are.
        torso: (3,) rad, yaw, lean and side.
    """

    def __init__(self, config: UpperBodyConfig, arm: ArmPosture, seed: int, name: str, dt: float) -> None:
        self._config, self._arm, self._dt = config, arm, dt
        self._middle, self._half, self._resting = workspace(arm)
        self._unsteady = Unsteadiness(config, seed, name, dt)
        self._tracker = Tracker(config.tracking, seed, name, dt)
        # Instructions by number: the plan's first, then those that come from outside.
        self._given: list[Instruction] = [Rest(), *(step.instruction() for step in config.plan)]
        self._changes = [round(end / dt) for end in accumulate(step.seconds for step in config.plan)]
        self._instructed = False  # by somebody: the plan is over
        self._pointers = np.full(DOFS, np.nan)
        rest = arm.natural(self._resting, config.elbow)
        self._place, self._axes = rest
        self._x = np.array([config.elbow, 0.0, 0.0])
        self._posture = arm.solve(rest, config.elbow)
        self.q, self.place, self.dofs = self._posture.copy(), rest.place, self._x.copy()
        self.torso = np.zeros(3)
        self._velocity = np.zeros((2, 3))  # of the hand, m/s, and of the DoFs, rad/s
        self._begin(0, 0)

    # -- what somebody tells it

    @property
    def done(self) -> bool:
        """Whether the last instruction is reached."""
        given, since = self._given[-1] if self._instructed else self._given[self._number], self._since
        if self._instructed and self._number != len(self._given) - 1:
            return False  # it hasn't begun
        if since < self._config.reaction + self._takes:
            return False
        if isinstance(given, Follow):
            return since >= given.times[-1]
        if isinstance(given, Explore):
            return since >= self._config.reaction + self._takes + given.seconds
        there = np.array(given.point) if isinstance(given, Hold) else self._resting
        return bool(np.linalg.norm(self._arm.place(self.q) - there) < _NEAR)

    def instruct(self, instruction: Instruction) -> None:
        """Begins this at the next update. Raises ValueError: its numbers don't fit."""
        if isinstance(instruction, Follow):
            shape = np.shape(instruction.values)
            if shape != (len(instruction.times), len(instruction.dofs)) or len(set(instruction.dofs)) < shape[1]:
                raise ValueError(f"values {shape} for {len(instruction.times)} times and {len(instruction.dofs)} DoFs")
        self._given.append(instruction)
        self._instructed = True

    def see(self, pointers: Sequence[float]) -> None:
        """Shows it the pointers (k,), in the order of the instruction's DoFs."""
        given = self._given[self._number]
        names = given.dofs if isinstance(given, Follow) else ("swivel",)
        for name, value in zip(names, pointers, strict=False):
            self._pointers[NAMES.index(name)] = value

    def watch(self, dof: int, pointer: float) -> None:
        """Shows it the pointer of one DoF, by its number."""
        self._pointers[dof] = pointer

    # -- updates

    def next(self, number: int) -> None:
        """Goes on to update `number`; they come one after another."""
        self._choose(number)
        before, posture, place = self._x, self._posture, self._place
        self._mean(number)
        x, dt, hold = self._x, self._dt, Held(self._place, self._axes)
        self._posture = self._arm.solve(hold, float(x[0]), (float(x[2]), float(x[1])))
        speed = (self._posture - posture) / dt
        if self._config.carried < 1.0 and (self._place != place).any():
            # What the DoFs do to the joints; the rest carries the hand, which is seen and more exact.
            alone = self._arm.solve(hold, float(before[0]), (float(before[2]), float(before[1])))
            own = (self._posture - alone) / dt
            speed = own + self._config.carried * (speed - own)
        self._unsteady.next(number, self._arm.jacobian(posture), speed, (x - before) / dt)
        off = self._unsteady.hand
        turn = rotation.matrix(rotation.exp(*off[3:].tolist()))
        actual = Held(hold.place + off[:3], turn @ hold.axes)
        self.dofs = x + self._unsteady.dofs
        swivel, shrug, protraction = self.dofs.tolist()
        q = self._arm.solve(actual, swivel, (protraction, shrug))
        self.q = np.minimum(np.maximum(q, self._arm.lower), self._arm.upper)
        self.place, self.torso = hold.place, self._unsteady.torso

    def _choose(self, number: int) -> None:
        """Begins what is due."""
        if self._instructed:
            if self._number != len(self._given) - 1:
                self._begin(len(self._given) - 1, number)
        elif self._changes:
            *inner, end = self._changes
            at = number % end if self._config.again else number
            step = 1 + bisect_right(inner, at)
            if step != self._number or (at == 0 and number > self._started):
                self._begin(step, number)
        self._since = (number - self._started) * self._dt

    def _begin(self, which: int, number: int) -> None:
        """From here on instruction `which` holds."""
        given = self._given[which]
        self._number, self._started, self._since = which, number, 0.0
        self._from_place, self._from_turn = self._place, np.array(rotation.from_matrix(self._axes))
        self._from_x, self._from_velocity = self._x.copy(), self._velocity.copy()
        if isinstance(given, Hold | Follow) and given.point is not None:
            to = self._arm.natural(np.array(given.point), self._config.elbow)
            if isinstance(given, Hold) and given.turn is not None:
                to = Held(to.place, rotation.matrix(rotation.normalised(given.turn)))
        elif isinstance(given, Follow):
            to = Held(self._place, self._axes)
        else:
            to = self._arm.natural(self._middle if isinstance(given, Explore) else self._resting, self._config.elbow)
        self._to_place, self._to_axes = to
        self._aim()
        self._takes = max(
            float(np.linalg.norm(to.place - self._place)) / self._config.speed,
            float(np.linalg.norm(self._way)) / _TURNING,
            _LEAST,
        )
        self._at_rest = np.array([self._elbow(to), 0.0, 0.0])
        self._low, self._high = self._ends(to)
        if isinstance(given, Hold) and given.swivel is not None:
            low, high = float(self._low[0]), float(self._high[0])
            self._at_rest[0] = low + given.swivel * (high - low)
            self._takes = max(self._takes, abs(float(self._at_rest[0] - self._x[0])) / self._config.pace)
        if isinstance(given, Follow):
            self._tracker.begin(self._x, self._velocity[1], self._low, self._high)

    def _aim(self) -> None:
        """The way of the hand's axes through an instruction, from the arrays that are its state."""
        w, i, j, k = self._from_turn.tolist()
        self._from = (w, i, j, k)
        self._way = rotation.error(rotation.from_matrix(self._to_axes), self._from)

    def _elbow(self, hold: Held) -> float:
        """rad: the swivel angle that the joints' ranges allow there, nearest to that of rest."""
        config, arm = self._config, self._arm
        angles = np.arange(*config.swing, _STEP).tolist()
        for angle in sorted([config.elbow, *angles], key=lambda angle: abs(angle - config.elbow)):
            if arm.fits(arm.solve(hold, angle), _MARGIN):
                return float(angle)
        return config.elbow

    def _ends(self, hold: Held) -> tuple[Array, Array]:
        """(3,), (3,) rad: the range of each DoF that is used while the hand is held there."""
        config, arm = self._config, self._arm
        low, high = np.empty(DOFS), np.empty(DOFS)
        for dof, (least, middle, most) in enumerate(
            ((config.swing[0], float(self._at_rest[0]), config.swing[1]), (-pi, 0.0, pi), (-pi, 0.0, pi))
        ):
            ends = []
            for sense, end in ((-1.0, least), (1.0, most)):
                x, there = self._at_rest.copy(), middle
                while sense * (end - there) > 0.0:
                    x[dof] = there + sense * _STEP
                    q = arm.solve(hold, float(x[0]), (float(x[2]), float(x[1])))
                    if not arm.fits(q, _MARGIN):
                        break
                    there = float(x[dof])
                ends.append(there)
            centre, half = 0.5 * (ends[0] + ends[1]), 0.5 * max(ends[1] - ends[0], _STEP)
            low[dof], high[dof] = centre - config.effort * half, centre + config.effort * half
        return low, high

    def _mean(self, number: int) -> None:
        """What is meant at update `number`: the hand's pose and the DoFs."""
        config, given = self._config, self._given[self._number]
        since = self._since
        t = since - config.reaction
        share = quintic(t / self._takes) if 0.0 < t < self._takes else float(t >= self._takes)
        coast = since * exp(-since / _COAST)
        x = self._from_x + share * (self._at_rest - self._from_x) + coast * self._from_velocity[1]
        place = self._from_place + share * (self._to_place - self._from_place) + coast * self._from_velocity[0]
        late = t - self._takes
        if isinstance(given, Explore) and late > 0.0:
            fade = 1.0 - exp(-late)
            swing = fade * np.array([sin(2.0 * pi * late / period) for period in _PERIODS])
            place = place + self._half * swing
            x[0] += 0.3 * fade * sin(2.0 * pi * late / 3.1)
            axes = self._arm.natural(place, config.elbow).axes
        else:
            x_way, y_way, z_way = self._way
            turn = rotation.exp(share * x_way, share * y_way, share * z_way)
            axes = rotation.matrix(rotation.product(turn, self._from))
        if isinstance(given, Hold) and given.move is not None and late > 0.0:
            dof = NAMES.index(given.move)
            x[dof] += self._swung(dof, late, float(x[dof]))
        if isinstance(given, Follow):
            self._follow(given, number, x)
        before = np.array([self._place, self._x])
        self._place, self._axes, self._x = place, axes, x
        self._velocity = (np.array([place, x]) - before) / self._dt

    def _swung(self, dof: int, t: float, middle: float) -> float:
        """How far a DoF is from `middle`, t s after it began to swing: to its upper end, then there and back."""
        low, high = float(self._low[dof]), float(self._high[dof])
        pace = self._config.pace if dof == 0 else _CLAVICLE * self._config.pace
        first, whole = (high - middle) / pace, (high - low) / pace
        if t < first:
            return quintic(t / first) * (high - middle)
        count, rest = divmod((t - first) / whole, 1.0)
        share = quintic(rest)
        return high - middle - (share if int(count) % 2 == 0 else 1.0 - share) * (high - low)

    def _follow(self, given: Follow, number: int, x: Array) -> None:
        """Moves the DoFs that drive pointers; the others stay."""
        tracker, since = self._tracker, self._since
        times = np.asarray(given.times, dtype=float)
        ease = quintic(min(since / _EASE, 1.0))
        values = np.asarray(given.values, dtype=float)
        for dof, name in enumerate(NAMES):
            if name in given.dofs:
                wanted = float(np.interp(since - tracker.reads, times, values[:, given.dofs.index(name)]))
                tracker.follow(number, dof, wanted, float(self.dofs[dof]), float(self._pointers[dof]), ease)
            else:
                tracker.rest(dof, float(x[dof]))
        x[:] = tracker.x

    # -- the state

    def save(self) -> Array:
        """Its state. Instructions are meant by their numbers: it can only be restored where they were given, too."""
        head = [self._number, self._started, self._since, self._takes, self._instructed, len(self._given)]
        own = [getattr(self, name).ravel() for name in _STATE]
        return np.concatenate([head, *own, self._unsteady.save(), self._tracker.save()])

    def restore(self, state: Array) -> None:
        """Restores a state returned by `save`."""
        number, started, since, takes, instructed, count = state[:6].tolist()
        self._number, self._started, self._since, self._takes = int(number), int(started), since, takes
        self._instructed = bool(instructed)
        if count > len(self._given):
            raise ValueError("this wearer wasn't given all the instructions of the saved one")
        del self._given[int(count) :]
        rest = state[6:]
        for name in _STATE:
            old: Array = getattr(self, name)
            setattr(self, name, rest[: old.size].reshape(old.shape).copy())
            rest = rest[old.size :]
        self._aim()
        size = self._unsteady.save().size
        self._unsteady.restore(rest[:size])
        self._tracker.restore(rest[size:])
