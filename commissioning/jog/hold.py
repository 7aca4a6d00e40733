"""What the terminal, or the panel, tells the law `jog`: a key's press, for as long as it is fresh."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Final

import numpy as np

from srl.runtime.contracts.signals import Array

PAUSE: Final = 0.8  # s without a key that end a step: consoles repeat a held key after 0.25 to 0.7 s by default
FINE: Final = 0.2  # of the speed
_WAYS: Final = {"left": -1.0, "right": 1.0, ",": -FINE, ".": FINE}


class Hold:
    """The joint that is chosen, and the presses.

    A terminal tells of presses and repeats, not of releases. So each press has a number and is told for a short while
    only; the law moves a little at each, and brakes by itself.

    Attributes:
        joint: index of the chosen joint.
        moving: the sense in which it was told to move last: -1, 1 (less for a fine motion), or 0.
    """

    def __init__(self, joints: Sequence[str], fresh: float, step: bool = False) -> None:
        """
        Args:
            joints: their names.
            fresh: s after which a press that the loop hasn't taken is told no more.
            step: a held key moves once, until it was let go.
        """
        self._count, self._fresh, self._step = len(joints), fresh, step
        self.joint = 0
        self.moving = 0.0
        self._guided = self._locked = self._rests = False
        self._number = 0
        self._until = self._last = -inf  # s: until when the press is told; the newest key that moves

    def guide(self, joint: int | None, now: float) -> None:
        """A guide chooses: from now on this joint alone moves; None: none does.

        The joint brakes. A key that is held moves nothing until it was let go for `PAUSE`: it was meant for the joint
        before.
        """
        self._guided, self._locked, self._rests = True, joint is None, True
        self.joint = self.joint if joint is None else joint
        self.moving = 0.0
        self._number += 1
        self._until = now + self._fresh

    def rest(self) -> None:
        """A key that is held now, or again within `PAUSE`, moves nothing until it was let go."""
        self._rests = True

    def key(self, key: str, now: float) -> None:
        """Takes a key. Every key but those that move lets the joint brake."""
        way = _WAYS.get(key, 0.0)
        if way:
            held = now - self._last < PAUSE
            self._last = now
            self._rests = self._rests and held
            if self._locked or self._rests:
                way = 0.0
            elif self._step and held:
                return
        elif self._guided:
            pass
        elif key in ("up", "down"):
            self.joint = (self.joint + (1 if key == "down" else -1)) % self._count
        elif key.isdecimal() and (int(key) - 1) % 10 < self._count:
            self.joint = (int(key) - 1) % 10
        self.moving = way
        self._number += 1
        self._until = now + self._fresh

    def press(self, joint: int, way: float, until: float, now: float) -> None:
        """Takes a press on the panel that is worth something until `until`, s. Way 0 lets the joint brake."""
        if self._guided:
            if way:
                self._rests = self._rests and now - self._last < PAUSE
                self._last = now
            if self._locked or self._rests or joint != self.joint:
                joint, way = self.joint, 0.0
        self.joint, self.moving, self._until = joint, way, until
        self._number += 1

    def at(self, now: float) -> tuple[Array, Array]:
        """`way` (n,) and `press` (1,) of the law at `now`, s: the newest press as long as it is fresh, then 0."""
        way = np.zeros(self._count)
        way[self.joint] = self.moving
        return way, np.array([float(self._number) if now <= self._until else 0.0])

    def expires(self, now: float) -> float:
        """s until when what is told now may be taken."""
        return self._until if now <= self._until else now + self._fresh
