"""Judges each sample of a device before anything uses it: a value that can't be true is no sample.

A value must lie in its signal's plausible range (`runtime.contracts.plausible`). The measured position of a joint that
is commanded must moreover be where the joint can have moved to since the sample before. So one wrong sample never
becomes a command, nor a law's state: the sample before stays, and grows old.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from runtime.contracts.compiled import bind_or_python
from runtime.contracts.plausible import plausible
from runtime.contracts.signals import Array, Signal

# What a step of two samples may be beside the motion: noise, backlash, a sample that came late.
SLACK: Final = {"rad": 0.02, "m": 0.005, "m, rad": 0.05, "1": 0.02}
LONGEST: Final = 0.5  # s: after a longer pause no more motion is believed than in this time
HAND: Final = 15.0  # rad/s or m/s, as fast as a hand or a load moves a joint: smooth motion up to this is believed
SPEED: Final = 2.0  # of a joint's greatest commanded speed: a hand or a load may move it faster
JUMP: Final = 8.0  # of a force sensor's range, the largest step that one sample is believed
AGREE: Final = 3  # samples that must agree: the first ones, and those after a jump
_WIDE: Final = 4  # low, high, slack, speed
_LAST, _BEFORE, _EARLIER, _TAKEN = range(4)  # the newest finite one taken, the newest two that came, the newest taken


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
        refused: number of samples that weren't taken.
        last: what was last said of an odd sample.
    """

    def __init__(self, signals: Sequence[Signal], arrays: Mapping[str, Array]) -> None:
        """
        Args:
            signals: the device's states.
            arrays: by name, those that its driver fills.
        """
        self._signals = [s for s in signals if s.size and s.name in arrays]
        self._pieces = _contiguous([arrays[s.name] for s in self._signals])
        size = sum(s.size for s in self._signals)
        self._limits = np.empty((size, _WIDE))
        at = 0
        for s in self._signals:
            low, high = plausible(s)
            self._limits[at : at + s.size] = np.stack([low, high, np.zeros(s.size), np.full(s.size, np.inf)], axis=1)
            at += s.size
        self._state = np.full((size, 4), np.nan)
        self._moves: list[int] = []  # elements whose steps are judged
        self._joints = np.zeros(size, bool)  # of those, the commanded ones
        self.odd: Odd | None = None
        self.last = ""
        self.jumped, self.refused, self._agreed = False, 0, 0
        self._stamp = self._seen = self._now = -1  # of the newest one taken, of the newest one that came
        self._newest = -1  # ns, the cycle in which the newest one came that was taken
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
        """From now on this state's values lie within what its very device can give, and jump by an eighth of that.

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
                self._limits[rows, 2], self._limits[rows, 3] = (high - low) / JUMP, 0.0
                self._moves += range(at, at + s.size)
            at += s.size

    @property
    def settled(self) -> bool:
        """See the class's docstring."""
        return not self._moves or self._agreed >= AGREE

    def forget(self) -> None:
        """The device was lost: what it measured says nothing of where it is after its return."""
        self._state[:] = np.nan
        self._stamp = self._seen = self._now = self._newest = -1
        self._agreed, self.odd, self.jumped = 0, None, False

    def take(self, stamp: int, now: int) -> bool:
        """Judges the sample that the arrays hold. Where it can't be true, they hold the one before again.

        Args:
            stamp: when it was taken, ns.
            now: of this cycle, ns.
        Returns:
            Whether the arrays are the newest sample.
        """
        new, self._seen = stamp != self._seen, stamp
        if self.odd is not None and not new:
            self._restore()
            return False
        past = 0
        if self._now >= 0:
            past = now - self._newest  # a stamp that is ahead lets a joint move for one cycle more, at most
            past = max(past, min(stamp - self._stamp, past + now - self._now))
        dt = min(past * 1e-9, LONGEST)
        self.odd, self.jumped = None, False
        for step, piece, rows in self._steps:
            if step(dt, new) < 0 and not self._judge(piece.ravel(), rows, dt, new):
                break
        if self.odd is not None:
            self.refused += 1
            self._restore()
            return False
        if new:
            self._agreed = min(self._agreed + 1, AGREE)
            self._newest = now
        self._stamp, self._now = stamp, now
        return True

    def _judge(self, values: Array, rows: slice, dt: float, new: bool) -> bool:
        """What C doesn't: says what is odd, and takes a step that enough samples agree on."""
        limits, state = self._limits[rows], self._state[rows]
        low, high, slack, speed = limits.T
        with np.errstate(invalid="ignore", over="ignore"):
            known = np.isfinite(values)
            outside = known & ((values < low) | (values > high))
            reach = slack + speed * dt
            far = known & (np.abs(values - state[:, _LAST]) > reach)
            bent = np.abs(values - 2 * state[:, _BEFORE] + state[:, _EARLIER])
            near = np.abs(values - state[:, _BEFORE]) <= reach
            moving = (state[:, _BEFORE] == state[:, _LAST]) & (np.abs(values - state[:, _LAST]) <= reach + HAND * dt)
            # Smooth motion goes on from the sample before; a jump is taken once three agree on its place. Of the first
            # samples nothing is refused: what is to agree begins anew.
            smooth = ((bent <= reach) & (moving | near)) | (self._agreed < AGREE)
        moved = far & ~smooth
        if far.any() and self._agreed < AGREE:
            self._agreed = 0
        if outside.any() or moved.any():
            i = int(np.argmax(outside if outside.any() else moved))
            self._name(rows.start + i, values, i, limits[i], state[i], bool(outside.any()), dt)
        elif self.settled and (far & self._joints[rows] & (state[:, _BEFORE] != state[:, _LAST])).any():
            self.jumped = True
        changed = new | (values != state[:, _BEFORE])
        state[changed, _EARLIER] = state[changed, _BEFORE]
        state[changed, _BEFORE] = values[changed]
        if self.odd is None:
            state[known, _LAST] = values[known]
            state[:, _TAKEN] = values
        return self.odd is None

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
                row = at // (s.size // s.shape[0]) if s.shape else 0
                return s, s.names[row] if s.names else str(row) if s.size > 1 else ""
            at -= s.size
        raise IndexError(at)

    def _restore(self) -> None:
        for _, piece, rows in self._steps:
            piece.reshape(-1)[:] = self._state[rows, _TAKEN]


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
