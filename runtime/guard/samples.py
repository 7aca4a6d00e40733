"""Judges each sample of a device before anything uses it: a value that can't be true is no sample.

A value must lie in its signal's plausible range (`srl.runtime.contracts.plausible`). The measured position of a joint
that is commanded must moreover be where the joint can have moved to since the sample before, and its measured velocity
must be that of its position (`srl.runtime.guard.rates`). So one wrong sample never becomes a command, nor a law's
state: the sample before stays, and grows old.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from srl.runtime.contracts.compiled import bind_or_python
from srl.runtime.contracts.plausible import plausible
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.guard.rates import LASTS, RateCheck

# What a step of two samples may be beside the motion: noise, backlash, a sample that came late.
SLACK: Final = {"rad": 0.02, "m": 0.005, "m, rad": 0.05, "1": 0.02}
LONGEST: Final = 0.5  # s: after a longer pause no more motion is accepted than in this time
HAND: Final = 15.0  # rad/s or m/s, as fast as a hand or a load moves a joint: smooth motion up to this is believed
SPEED: Final = 2.0  # of a joint's greatest commanded speed: a hand or a load may move it faster
JUMP: Final = 8.0  # of a force sensor's range, the largest step that one sample may make
AGREE: Final = 3  # samples that must agree: the first ones, and those after a jump
PAUSE: Final = 3  # usual times between two samples: after a longer pause one sample shows no more motion than in this
_FORCES: Final = ("N", "N m", "N, N m")
_WIDE: Final = 4  # low, high, slack, speed
# The newest finite one taken, the newest two finite ones that came, the newest taken, s that the first was old when the
# newest was taken, how many have agreed.
_LAST, _BEFORE, _EARLIER, _TAKEN, _AGE, _COUNT = range(6)
_USED: Final = [_LAST, _TAKEN, _AGE, _COUNT]


class Odd(NamedTuple):
    """An element whose value can't be true. `why`, for people."""

    signal: str
    element: str
    value: float
    why: str


class SampleCheck:
    """Judges the samples of one device.

    Attributes:
        odd: what was wrong with the newest sample; None if it was taken.
        jumped: the newest sample was taken, though it is further from the one before than the joint can have moved:
            `AGREE` in a row say so. The joint, or what measures it, isn't what it was.
        settled: enough samples have agreed since the device was opened.
        untrue: a measured velocity hasn't been that of its position for long; "" otherwise. It is replaced meanwhile.
        refused: number of samples that weren't taken.
        last: what was last said of an odd sample.
    """

    def __init__(self, signals: Sequence[Signal], arrays: Mapping[str, Array]) -> None:
        """
        Args:
            signals: the device's states.
            arrays: by name, those that its driver fills.
        """
        self._signals, self._arrays = [s for s in signals if s.size and s.name in arrays], arrays
        self._pieces = _contiguous([arrays[s.name] for s in self._signals])
        size = sum(s.size for s in self._signals)
        self._limits = np.empty((size, _WIDE))
        at = 0
        for s in self._signals:
            low, high = plausible(s)
            self._limits[at : at + s.size] = np.stack([low, high, np.zeros(s.size), np.full(s.size, np.inf)], axis=1)
            at += s.size
        self._state = np.full((size, 6), np.nan)
        self._moves: list[int] = []  # elements whose steps are judged
        self._rates: list[tuple[Signal, slice, RateCheck]] = []
        self._joints = np.zeros(size, bool)  # of those, the commanded ones
        self.odd: Odd | None = None
        self.last = ""
        self.refused = 0
        self.forget()
        self._bind()

    def _bind(self) -> None:
        at, self._steps = 0, []
        for piece in self._pieces:
            rows = slice(at, at + piece.size)
            step = bind_or_python("sample-check", piece, self._limits[rows], self._state[rows])
            self._steps.append((step, piece, rows))
            at += piece.size

    def expect(self, name: str, speed: Array, slides: Collection[str] = ()) -> None:
        """From now on the steps of this signal are judged, too.

        Args:
            name: of a state that measures a commanded position.
            speed: (size,), the greatest that the joints are commanded to; inf: no step of it is judged.
            slides: joints among its labels that slide, and are in m.
        """
        at = 0
        for s in self._signals:
            if s.name == name:
                rows = slice(at, at + s.size)
                usual = SLACK.get(s.unit, SLACK["rad"])
                self._limits[rows, 2] = [SLACK["m"] if n in slides else usual for n in s.names] or usual
                self._limits[rows, 3] = SPEED * np.ravel(speed)
                judged = np.isfinite(self._limits[rows, 3])
                self._joints[rows] |= judged
                self._moves += np.flatnonzero(judged).tolist()
            at += s.size

    def narrow(self, name: str, low: Array, high: Array) -> None:
        """From now on this state's values lie within what its very device can give; a force jumps by an eighth of that.

        Args:
            name: of the state.
            low, high: (size,).
        """
        at = 0
        for s in self._signals:
            if s.name == name:
                rows = slice(at, at + s.size)
                self._limits[rows, 0] = np.maximum(self._limits[rows, 0], low)
                self._limits[rows, 1] = np.minimum(self._limits[rows, 1], high)
                if s.unit in _FORCES:
                    self._limits[rows, 2], self._limits[rows, 3] = (high - low) / JUMP, 0.0
                    self._moves += range(at, at + s.size)
            at += s.size

    def compare(self, position: str, velocity: str) -> None:
        """From now on the velocity of this name must be that of the position of this name; see `RateCheck`."""
        at = 0
        for s in self._signals:
            if s.name == velocity:
                way, speed = (self._arrays[name].reshape(-1) for name in (position, velocity))
                self._rates.append((s, slice(at, at + s.size), RateCheck(way, speed, s.unit)))
            at += s.size

    def _is_settled(self) -> bool:
        counts = self._state[self._moves, _COUNT]
        return not self._moves or (self._taken >= AGREE and bool(((counts == 0) | (counts >= AGREE)).all()))

    def forget(self) -> None:
        """The device was lost: what it measured says nothing of where it is after its return."""
        self._state[:] = np.nan
        self._state[:, _AGE:] = 0.0
        self._stamp = self._seen = -1  # of the newest one taken, of the newest one that came
        self._newest = self._came = self._called = -1  # ns, when those came, and the last call
        self._rated = -1  # ns, when the newest one came whose velocity was judged
        self._usual = 0.0  # s between two samples
        self._taken = 0  # samples, AGREE at most
        self._line = 0  # samples in a row that are a smooth motion
        self.odd, self.jumped, self.settled = None, False, False
        self._counted = True  # what has agreed may have changed
        self.untrue = self._why = ""
        for _, _, rate in self._rates:
            rate.restart()

    def take(self, stamp: int, now: int) -> bool:
        """Judges the sample that the arrays hold. Where it can't be true, they hold the one before again.

        Args:
            stamp: when it was taken, ns.
            now: of this cycle, ns.
        Returns:
            Whether the arrays are the newest sample.
        """
        new, self._seen = stamp != self._seen, stamp
        cycle = now - self._called if self._called >= 0 else 0
        self._called = now
        if self.odd is not None and not new:
            self._restore()
            return False
        past = 0
        if self._newest >= 0:
            past = now - self._newest  # a stamp that is ahead lets a joint move for one cycle more, at most
            past = max(past, min(stamp - self._stamp, past + cycle))
        full = min(past * 1e-9, LONGEST)
        usual, gap = self._intervals(now, new, cycle)
        self.odd, self.jumped = None, False
        before = self._state.copy() if len(self._steps) > 1 else None
        for step, piece, rows in self._steps:
            if step(min(full, usual), new) < 0 and not self._judge(piece.ravel(), rows, full, usual, gap, new):
                break
        if self.odd is not None:
            self.refused += 1
            if before is not None:  # what was right of it isn't taken either
                self._state[:, _USED] = before[:, _USED]
            self._restore()
            return False
        if new:
            self._taken = min(self._taken + 1, AGREE)
            self._newest = now
            if self._counted:
                self.settled = self._is_settled()
                self._counted = not self.settled
        self._stamp = stamp
        if self._rates:
            self._judge_rates(now, new)
        return True

    def _intervals(self, now: int, new: bool, cycle: int) -> tuple[float, float]:
        """The longest time in which one sample shows motion, and that since the sample before, taken or not; s."""
        cycle_s = cycle * 1e-9
        most, gap = PAUSE * max(self._usual, cycle_s), max(self._usual, cycle_s)
        if new:
            if self._came >= 0:
                came = min((now - self._came) * 1e-9, LONGEST)
                most, gap = most or PAUSE * came, max(gap, came)
                self._usual += (min(came, PAUSE * self._usual) - self._usual) / 8 if self._usual else came
            self._came = now
        return most, min(gap, most)

    def _judge(self, values: Array, rows: slice, full: float, usual: float, gap: float, new: bool) -> bool:
        """What C doesn't: says what is odd, and takes a step that enough samples agree on."""
        self._counted = True
        limits, state = self._limits[rows], self._state[rows]
        low, high, slack, speed = limits.T
        judged, count = np.isfinite(speed), state[:, _COUNT]
        longest = np.minimum(full + state[:, _AGE], LONGEST)
        dt = np.minimum(longest, usual)
        with np.errstate(invalid="ignore", over="ignore"):
            known = np.isfinite(values)
            # What isn't finite isn't known; but a joint that is at infinity is wrong.
            outside = (known | (judged & np.isinf(values))) & ((values < low) | (values > high))
            reach = np.where(judged, slack + speed * dt, np.inf)
            far = known & judged & ~(np.abs(values - state[:, _LAST]) <= reach)
            sure = count >= AGREE
            once = slack + speed * gap
            bent = np.abs(values - 2 * state[:, _BEFORE] + state[:, _EARLIER]) <= once
            step = np.abs(values - state[:, _BEFORE])
            by_hand = bent & (step <= once + HAND * gap)
            self._line = self._line + new if by_hand[far & sure].all() else 0
            # Smooth motion goes on from the sample before. A jump is taken once three agree on a place or a motion.
            moving = (state[:, _BEFORE] == state[:, _LAST]) | (self._line >= AGREE - 1)
            smooth = (by_hand & moving) | (bent & (step <= once))
            possible = slack + np.where(step <= once, speed, np.maximum(speed, HAND)) * longest
            jumped = far & sure & self._joints[rows] & ~(np.abs(values - state[:, _LAST]) <= possible)
        moved = far & sure & ~smooth
        if outside.any() or moved.any():
            i = int(np.argmax(outside if outside.any() else moved))
            self._name(rows.start + i, values, i, limits[i], state[i], bool(outside.any()), float(dt[i]))
        elif (jumped & (state[:, _BEFORE] != state[:, _LAST])).any():
            self.jumped = True
        changed = known & (new | (values != state[:, _BEFORE]))
        state[changed, _EARLIER] = state[changed, _BEFORE]
        state[changed, _BEFORE] = values[changed]
        if self.odd is None:
            if new:  # the first samples of an element agree on where it is, or begin anew
                state[judged, _AGE] = np.where(known, 0.0, longest)[judged]
                early = known & judged & ~sure
                state[early, _COUNT] = np.where(far[early], 1, count[early] + 1)
            state[known, _LAST] = values[known]
            state[:, _TAKEN] = values
            unsure = known & judged & (state[:, _COUNT] < AGREE) & (self._taken >= AGREE)
            state[unsure, _TAKEN] = values[unsure] = np.nan
        return self.odd is None

    def _judge_rates(self, now: int, new: bool) -> None:
        dt, self.untrue = (now - self._rated) * 1e-9, ""
        for signal, rows, rate in self._rates:
            if new:
                if self.jumped or dt > LONGEST:  # it is said, or nothing came for long
                    rate.restart()
                i = rate.step(dt)
            if rate.wrong_for > 0.0:
                if new:
                    name, value = element_name(signal, i), float(self._state[rows.start + i, _TAKEN])
                    self._why = f"{signal.name}[{name}] {value:.3g} {signal.unit} isn't how fast its position changes"
                rate.replace()
                self._state[rows, _TAKEN] = self._arrays[signal.name].reshape(-1)
                if rate.wrong_for > LASTS:
                    self.untrue = self._why
        if new:
            self._rated = now

    def _name(self, at: int, values: Array, i: int, limits: Array, state: Array, outside: bool, dt: float) -> None:
        signal, element = self._element(at)
        unit = "" if "," in signal.unit else signal.unit
        if outside:
            why = f"{values[i]:.6g} {unit} can't be: {limits[0]:g} to {limits[1]:g}"
        else:
            most = limits[2] + limits[3] * dt
            why = f"{values[i]:.6g} {unit} after {state[_LAST]:.6g}: it can have moved by {most:.3g} in {dt:.3g} s"
        self.odd = Odd(signal.name, element, float(values[i]), why)
        self.last = f"{signal.name}{f'[{element}]' if element else ''} {why}"

    def _element(self, at: int) -> tuple[Signal, str]:
        for s in self._signals:
            if at < s.size:
                return s, element_name(s, at)
            at -= s.size
        raise IndexError(at)

    def _restore(self) -> None:
        for _, piece, rows in self._steps:
            piece.reshape(-1)[:] = self._state[rows, _TAKEN]


def element_name(signal: Signal, i: int) -> str:
    """What people call element `i` of a signal; "" if it has but one."""
    row = i // (signal.size // signal.shape[0]) if signal.shape else 0
    return signal.names[row] if signal.names else str(row) if signal.size > 1 else ""


def _contiguous(arrays: Sequence[Array]) -> list[Array]:
    """The same memory in as few flat arrays as can be: those that stand one behind the other are one."""
    pieces: list[Array] = []
    end = -1
    for array in arrays:
        start = array.__array_interface__["data"][0]
        flat = array.reshape(-1)
        if start == end and pieces:
            size = pieces[-1].size + flat.size
            pieces[-1] = np.lib.stride_tricks.as_strided(pieces[-1], (size,), (flat.itemsize,))
        else:
            pieces.append(flat)
        end = start + flat.nbytes
    return pieces
