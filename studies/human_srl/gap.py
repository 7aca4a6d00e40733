"""How far a worn arm is from its wearer, by the envelope."""

from __future__ import annotations

import numpy as np

from srl.control.skeleton.capsules import nearest
from srl.control.skeleton.envelope import link_nodes
from srl.control.skeleton.kinematics import Kinematics
from srl.control.skeleton.options import EnvelopeOptions
from srl.runtime.contracts.signals import Array


class Gap:
    """The least distance, m, of the arm in any posture from the body in the last pose that was given."""

    def __init__(self, options: EnvelopeOptions) -> None:
        envelope = options.envelope
        self._options, self._kinematics = options, Kinematics(options.figure)
        self._links = np.array([pair.link for pair in envelope.pairs])
        self._segments = np.array([pair.segment for pair in envelope.pairs])
        self._radii = envelope.radii[self._segments] + envelope.link_radius
        self._ends: Array = np.zeros((len(envelope.ends), 2, 3))

    def pose(self, rotation: Array, translation: Array) -> None:
        """The body's posture from now on: (59, 4), (59, 3) m."""
        self._kinematics.nodes(rotation, translation, {})
        self._ends = carried(self._kinematics, self._options)

    def __call__(self, q: Array) -> float:
        nodes = link_nodes(self._options.arms.arms, self._options.arm, q[None])
        found = nearest(self._ends, self._segments, nodes, self._links)
        return float((found.distance - self._radii).min())


def carried(kinematics: Kinematics, options: EnvelopeOptions) -> Array:
    """(s, 2, 3) m, the segments' ends in the frame of the node that carries the arms, as `nodes` was called last."""
    body, data = kinematics.body(options.arms.arms.parent), kinematics.data
    R, p = data.xmat[body].reshape(3, 3), data.xpos[body]
    found: Array = (data.xpos[1:][options.envelope.ends] - p) @ R
    return found
