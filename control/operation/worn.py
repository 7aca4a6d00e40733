"""One arm on a moving body, in the frame of the node that carries it: its tip, Jacobians, and the nearest pairs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np

from srl.control.skeleton.body_motion import BodyMotion
from srl.control.skeleton.capsules import nearest
from srl.control.skeleton.envelope import Envelope
from srl.control.skeleton.human_srl import HumanSrl
from srl.runtime.contracts.signals import Array
from srl.runtime.models.skeleton.arms import Side

SPAN: Final = 0.05  # s over which the body's velocity is a mean, as in `body-clearance`


@dataclass(frozen=True, eq=False, slots=True)
class Pairs:
    """Near pairs of a segment of the body and a link of the arm, the nearest first. k of them, n joints.

    Attributes:
        distance: (k,) m, signed.
        rows: (k, n) m for each rad or m: what each joint adds to the distance.
        approach: (k,) m/s: what the body takes from it; negative where it leaves.
        indices: (k,) of the pairs in the envelope.
    """

    distance: Array
    rows: Array
    approach: Array
    indices: Array


class Worn:
    """Kinematics of body and arm, and their distances. In this frame walking and turning aren't motion.

    Attributes:
        n: number of the arm's joints.
        envelope: the capsules and the pairs that are compared.
    """

    def __init__(self, figure: HumanSrl, side: Side, envelope: Envelope) -> None:
        self.envelope, self.n = envelope, figure.arms.n
        self._motion = BodyMotion(figure, envelope.ends, SPAN)
        self._kinematics = k = self._motion.kinematics
        self._data = k.data
        joints = [int(k.model.joint(f"{side}/{label}").id) for label in figure.arms.labels]
        self._joints, self._angles = joints, k.model.jnt_qposadr[joints]
        nodes = figure.arm[side]
        self._nodes = np.arange(nodes.start, nodes.stop) + 1  # bodies: Base, J1 to Jn, End
        self._carrier = k.body(figure.arms.parent)
        # (n + 2, n): whether a joint moves a node. A turn leaves its own node; a slide moves the one after its own.
        self._moves = np.arange(self.n + 2)[:, None] > np.arange(self.n)[None] + 1
        self._slides = np.array([joint.slides for joint in figure.arms.joints])
        self._links = np.array([pair.link for pair in envelope.pairs])
        self._segments = np.array([pair.segment for pair in envelope.pairs])
        self._radii = envelope.radii[self._segments] + envelope.link_radius
        self._places: Array = np.zeros((self.n + 2, 3))  # of the arm's nodes, m
        self._columns: Array = np.zeros((self.n + 2, 3, self.n))  # their Jacobians
        self._now = 0

    # -- the body

    def see(self, rotation: Array, translation: Array, dt: float) -> None:
        """Takes the suit's sample: (k, 4) unit quaternions and (k, 3) m of the human's joints in their parents.

        dt: s since the sample before; 0 forgets it.
        """
        if dt <= 0.0:
            self._motion.forget()
        self._now += round(dt * 1e9)
        self._motion.take(self._now, rotation, translation)

    def place(self, node: str) -> Array:
        """(3,) m: a node in the carrier's frame."""
        d, carrier = self._data, self._carrier
        found: Array = (d.xpos[self._kinematics.body(node)] - d.xpos[carrier]) @ d.xmat[carrier].reshape(3, 3)
        return found

    def in_world(self, place: Array) -> Array:
        """(3,) m in the suit's world of a place in the carrier's frame."""
        d, carrier = self._data, self._carrier
        found: Array = d.xpos[carrier] + d.xmat[carrier].reshape(3, 3) @ place
        return found

    # -- the arm

    def tip(self, q: Array) -> tuple[Array, Array]:
        """The arm's end (3,) m at q (n,), rad or m, and its Jacobian (3, n)."""
        d = self._data
        d.qpos[self._angles] = q
        mujoco.mj_kinematics(self._kinematics.model, d)
        R, origin = d.xmat[self._carrier].reshape(3, 3), d.xpos[self._carrier]
        self._places = (d.xpos[self._nodes] - origin) @ R
        axes, anchors = d.xaxis[self._joints] @ R, (d.xanchor[self._joints] - origin) @ R
        turns = np.cross(axes[None], self._places[:, None] - anchors[None])
        columns = np.where(self._slides[None, :, None], axes[None], turns) * self._moves[:, :, None]
        self._columns = columns.transpose(0, 2, 1)
        return self._places[-1], self._columns[-1]

    def pairs(self, within: float, most: int) -> Pairs:
        """The pairs nearer than `within`, m, at most so many, at the q of the last `tip`."""
        found = nearest(self._motion.ends, self._segments, self._places, self._links)
        distance = found.distance - self._radii
        near = np.argsort(distance, kind="stable")[:most]
        near = near[distance[near] < within]
        normal = found.normal[:, near].T  # from the body to the arm
        share = found.on_link[near, None, None]
        links = self._links[near]
        columns = (1.0 - share) * self._columns[links] + share * self._columns[links + 1]
        rows = np.einsum("ki,kin->kn", normal, columns)
        speeds = np.einsum("kei,ki->ke", self._motion.velocity[self._segments[near]], normal)
        return Pairs(distance[near], rows, speeds.max(axis=1), near)
