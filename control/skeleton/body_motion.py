"""Where the segments of a body are and how fast, in the frame of the node that carries the arms.

In that frame walking isn't an approach: what carries the arm moves with it.
"""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from srl.control.skeleton.human_srl import HumanSrl
from srl.control.skeleton.kinematics import Kinematics
from srl.runtime.contracts.signals import Array

UNIT_WITHIN: Final = 0.1  # a quaternion whose squared length is off by more is none
SHORTEST, LONGEST = 0.5, 2.0  # of the figure's bones: outside of it nobody is, and a unit is wrong
SMALL: Final = 0.01  # m: no bone, two joints in one place


class BodyMotion:
    """Follows the ends of segments from sample to sample.

    Attributes:
        kinematics: of body and arms.
        ends: (s, 2, 3) m, of the newest sample.
        velocity: (s, 2, 3) m/s, the mean over `window`.
        window: s; infinite before there are two samples `span` apart. A point whose acceleration is a_H at most has
            at the end of a window of D a velocity within a_H D / 2 of its mean.
    """

    def __init__(self, figure: HumanSrl, ends: Array, span: float) -> None:
        """
        Args:
            figure: the skeleton.
            ends: (s, 2) indices of nodes in its tree.
            span: s, the least time over which velocities are means. Differences of single frames are noise: a suit's
                bones stretch from frame to frame.
        """
        self.kinematics = Kinematics(figure)
        self.kinematics.rest()
        self._carrier = self.kinematics.body(figure.arms.parent)
        human = figure.human
        lengths = np.linalg.norm(human.offsets[list(human.joints)], axis=1)
        root = np.array([human.parents[i] < 0 for i in human.joints])
        self._bones = np.flatnonzero(~root & (lengths > SMALL))
        self._lengths = lengths[self._bones]
        self._indices, self._span = ends, round(span * 1e9)
        self._past: deque[tuple[int, Array]] = deque()  # of the last `span`
        self.ends: Array = np.zeros((len(ends), 2, 3))
        self.velocity: Array = np.zeros((len(ends), 2, 3))
        self.window = float("inf")

    def trouble(self, rotation: Array, translation: Array) -> str:
        """What makes it no pose of this body, for people; empty if nothing does. Arguments as `take`."""
        if not (np.isfinite(rotation).all() and np.isfinite(translation).all()):
            return "the body's pose has numbers that aren't finite"
        if (np.abs((rotation * rotation).sum(axis=1) - 1.0) > UNIT_WITHIN).any():
            return "the body's pose has rotations that are none"
        share = np.linalg.norm(translation[self._bones], axis=1) / self._lengths
        wrong = np.flatnonzero((share < SHORTEST) | (share > LONGEST))
        if wrong.size:
            name, factor = self.kinematics.figure.labels[int(self._bones[wrong[0]])], float(share[wrong[0]])
            return f"the body's pose has a bone to {name} that is {factor:.3g} times as long as the figure's"
        return ""

    def forget(self) -> None:
        """Begins anew: what was seen is from before a pause."""
        self._past.clear()
        self.window = float("inf")

    def take(self, stamp: int, rotation: Array, translation: Array) -> None:
        """Takes a sample.

        Args:
            stamp: ns; one that isn't newer than the last replaces it.
            rotation, translation: as `Kinematics.nodes`.
        """
        nodes = self.kinematics.nodes(rotation, translation, {})
        data = self.kinematics.data
        R, p = data.xmat[self._carrier].reshape(3, 3), data.xpos[self._carrier]
        self.ends = (nodes[self._indices] - p) @ R
        past = self._past
        while past and past[-1][0] >= stamp:
            past.pop()
        past.append((stamp, self.ends))
        while len(past) > 2 and stamp - past[1][0] >= self._span:
            past.popleft()
        first, before = past[0]
        if stamp - first >= self._span:
            self.window = (stamp - first) * 1e-9
            self.velocity = (self.ends - before) / self.window
        else:
            self.window = float("inf")
