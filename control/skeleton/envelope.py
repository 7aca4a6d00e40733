"""The envelope: capsules round the segments of a person and of supernumerary arms, and the pairs that matter.

A person's radii are the circumferences of large men over 2 pi (the circle of the same girth: flat segments reach less
far in one direction and are wider in the other), and clothing. Girths: the 95th percentile of the 4082 men of ANSUR II
(NATICK/TR-15/007, 2014), computed from its public data set and rounded up to whole centimetres (hand and buttock
to the one after). They are a beginning: measure the wearer, and give `radii`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from math import pi
from typing import Final, NamedTuple

import numpy as np

from srl.runtime.contracts.errors import OptionError, nearest
from srl.runtime.contracts.signals import Array
from srl.runtime.models.skeleton.arms import Arms, Side
from srl.runtime.models.skeleton.tree import Tree

# a_e, m/s^2, ours: how fast the ends of segments change their velocity in the frame of the lower spine
FREE: Final = 4.0  # hands, elbows, knees, feet, head
JOINED: Final = 1.0  # what the trunk carries: hips, shoulders, its own vertebrae


class Part(NamedTuple):
    """A segment of the body.

    Attributes:
        start, end: its nodes.
        girth: m.
        of: the measure.
        acceleration: m/s^2, of both ends.
    """

    start: str
    end: str
    girth: float
    of: str
    acceleration: tuple[float, float] = (FREE, FREE)


_TRUNK: Final = {
    "pelvis": Part("Hips", "Spine", 1.16, "buttock circumference", (JOINED, JOINED)),
    "abdomen": Part("Spine", "Spine2", 1.14, "waist circumference (omphalion)", (JOINED, JOINED)),
    "chest": Part("Spine2", "Neck", 1.21, "chest circumference", (JOINED, JOINED)),
    "neck": Part("Neck", "Head", 0.45, "neck circumference", (JOINED, FREE)),
    "head": Part("Head", "Head_End", 0.61, "head circumference"),
}
_LIMBS: Final = {
    "shoulder": Part("Shoulder", "Arm", 0.42, "biceps circumference, flexed", (JOINED, JOINED)),
    "upper_arm": Part("Arm", "ForeArm", 0.42, "biceps circumference, flexed", (JOINED, FREE)),
    "forearm": Part("ForeArm", "Hand", 0.35, "forearm circumference, flexed"),
    "hand": Part("Hand", "HandMiddle1", 0.24, "hand circumference"),
    "thumb": Part("HandThumb1", "HandThumb3_End", 0.09, "ours: 14 mm of radius"),
    # One finger may point while the others are bent: no other one's end is near its tip.
    "index": Part("HandIndex1", "HandIndex3_End", 0.09, "ours: 14 mm of radius"),
    "middle": Part("HandMiddle1", "HandMiddle3_End", 0.09, "ours: 14 mm of radius"),
    "ring": Part("HandRing1", "HandRing3_End", 0.09, "ours: 14 mm of radius"),
    "little": Part("HandPinky1", "HandPinky3_End", 0.09, "ours: 14 mm of radius"),
    "thigh": Part("UpLeg", "Leg", 0.73, "thigh circumference", (JOINED, FREE)),
    "shank": Part("Leg", "Foot", 0.45, "calf circumference"),
    "foot": Part("Foot", "Foot_End", 0.28, "ball of foot circumference"),
}
PARTS: Final = _TRUNK | {
    f"{side}_{name}": part._replace(start=side.capitalize() + part.start, end=side.capitalize() + part.end)
    for side in ("right", "left")
    for name, part in _LIMBS.items()
}
CLOTHING: Final = 0.01  # m, ours: a jacket's sleeve
LINK_RADIUS: Final = 0.037  # m: half the diagonal of a servo's side, 61.1 mm x 41 mm (ROBOTIS MX-64)
NEIGHBOURS: Final = ("pelvis", "abdomen", "chest")  # what the base is strapped to
SHOULDER: Final = 3  # joints whose links are the arm's shoulder, beside the base


@dataclass(frozen=True)
class Pair:
    """A link of an arm and a segment of the body.

    Attributes:
        link: index of the link: from node i of the arm (Base, J1 on) to the next.
        segment: index of the body's segment.
        name: "RJ4-RJ5/right_forearm".
    """

    link: int
    segment: int
    name: str


class Envelope:
    """Capsules of a body and of one arm.

    Attributes:
        segments: the body's names.
        ends: (s, 2) indices of their nodes in the body's tree.
        radii: (s,) m.
        acceleration: (s, 2) m/s^2, of their ends.
        links: the arm's names, "RBase-RJ1" and on.
        link_radius: m, of each.
        pairs: those that are compared.
        left_out: names of the others, by the reason.
    """

    def __init__(
        self, body: Tree, arms: Arms, side: Side, radii: Mapping[str, float], clothing: float, link_radius: float,
        leave_out: Sequence[tuple[str, str]],
    ) -> None:  # fmt: skip
        """
        Args:
            body: whose nodes the segments join.
            arms, side: the arm.
            radii: m, by segment, or by its name without the side: as measured, clothes included.
            clothing: m, on all others.
            link_radius: m.
            leave_out: further pairs (link, segment) that aren't compared.
        Raises:
            OptionError: a name is unknown, or the body lacks a node.
        """
        self.segments = tuple(PARTS)
        for part in PARTS.values():
            for node in (part.start, part.end):
                if node not in body.names:
                    raise OptionError(f"the body has no node '{node}'", "Take a body with fingers, feet and a head")
        self.ends = np.array([[body.index(part.start), body.index(part.end)] for part in PARTS.values()])
        known = {*PARTS, *_LIMBS}
        for name in radii:
            if name not in known:
                raise OptionError(f"radii: the body has no segment '{name}'", nearest(name, known))
        self.radii = np.array(
            [
                radii.get(name, radii.get(name.partition("_")[2], part.girth / (2 * pi) + clothing))
                for name, part in PARTS.items()
            ]
        )
        self.acceleration = np.array([part.acceleration for part in PARTS.values()])
        nodes = arms.names(side)
        self.links = tuple(f"{a}-{b}" for a, b in pairwise(nodes))
        self.link_radius = link_radius
        for link, segment in leave_out:
            for name, valid in ((link, self.links), (segment, self.segments)):
                if name not in valid:
                    raise OptionError(f"leave_out: nothing is called '{name}'", nearest(name, valid))
        self.left_out: dict[str, list[str]] = {}
        self.pairs = tuple(self._chosen(set(leave_out)))
        for link in self.links[1:]:  # the first one can't approach
            if not any(self.links[pair.link] == link for pair in self.pairs):
                problem = f"leave_out: nothing of the body would be compared with {link}"
                raise OptionError(problem, "Leave out only pairs that touch as they are worn")

    def _chosen(self, more: set[tuple[str, str]]) -> list[Pair]:
        chosen = []
        for i, link in enumerate(self.links):
            for j, segment in enumerate(self.segments):
                name = f"{link}/{segment}"
                reason = ""
                if i == 0:
                    reason = "no joint of the arm moves this link: it can't approach"
                elif i < SHOULDER and segment in NEIGHBOURS:
                    reason = "the arm's shoulder stays beside the trunk that carries it"
                elif (link, segment) in more:
                    reason = "the profile leaves it out"
                if reason:
                    self.left_out.setdefault(reason, []).append(name)
                else:
                    chosen.append(Pair(i, j, name))
        return chosen

    def remarks(self) -> list[str]:
        """Returns lines for people: radii with their sources, pairs, and those left out."""
        lines = [f"{len(self.pairs)} pairs of {len(self.links)} links (radius {self.link_radius:g} m) and segments:"]
        for name, part, radius in zip(self.segments, PARTS.values(), self.radii.tolist(), strict=True):
            near, far = part.acceleration
            lines.append(f"  {name}: radius {radius:.3f} m, {part.of}, a_e {near:g} and {far:g} m/s^2")
        for reason, names in self.left_out.items():
            lines.append(f"left out, {reason}: {', '.join(names)}")
        return lines


class _Chain:
    """What is fixed about one arm's steps from node to node."""

    def __init__(self, arms: Arms, side: Side) -> None:
        offsets, axes = arms.offsets(side), arms.axes(side)
        slides = np.array([[joint.slides] for joint in arms.joints])
        self.base, self.first, self.steps = offsets[0], offsets[1], offsets[2:, None]
        self.axes = axes[..., None]
        self.strokes = np.where(slides, axes, 0.0)[:, None]
        # About an axis e: R = e e^T + cos (1 - e e^T) + sin [e]x (Rodrigues). What slides doesn't turn.
        along, across = axes[:, :, None] * axes[:, None], np.cross(axes[:, None], np.eye(3)).transpose(0, 2, 1)
        along, across = np.where(slides[..., None], np.eye(3), along), np.where(slides[..., None], 0.0, across)
        self.turns = np.stack([along, np.eye(3) - along, across], axis=1).reshape(-1, 3, 9)


@cache
def _chain(arms: Arms, side: Side) -> _Chain:
    return _Chain(arms, side)


def posture(arms: Arms, side: Side, path: Array) -> tuple[Array, Array]:
    """The nodes of one arm, Base to End, and the axes of its joints, for many configurations at once.

    Args:
        arms, side: the arm.
        path: (m, n) rad or m.

    Returns:
        (m, n + 2, 3) m and (m, n, 3), in the frame of the arms' parent. Joint i sits at node i + 1.
    """
    chain, m, n = _chain(arms, side), len(path), arms.n
    q = path.T
    shares = np.ones((n, m, 3))
    np.cos(q, out=shares[..., 1])
    np.sin(q, out=shares[..., 2])
    R = (shares @ chain.turns).reshape(n, m, 3, 3)
    for before, after in pairwise(R):
        np.matmul(before, after, out=after)  # now from the frame behind the joint to the parent's
    made = np.empty((n + 2, m, 3))
    made[0], made[1] = chain.base, chain.first
    np.matmul(R, (chain.steps + q[..., None] * chain.strokes)[..., None], out=made[2:, ..., None])
    nodes: Array = np.add.accumulate(made, axis=0).transpose(1, 0, 2)
    axes: Array = (R @ chain.axes[:, None])[..., 0].transpose(1, 0, 2)
    return nodes, axes


def link_nodes(arms: Arms, side: Side, path: Array) -> Array:
    """(m, n + 2, 3) m, the nodes of `posture`."""
    return posture(arms, side, path)[0]


def jacobian(arms: Arms, nodes: Array, axes: Array) -> Array:
    """By how much each joint moves each node, (3, m, n + 2, n) m for each rad or m. Arguments: of `posture`."""
    m, count = nodes.shape[:2]
    n = count - 2
    a = axes.transpose(2, 0, 1)[:, :, None]
    r = (nodes[:, :, None] - nodes[:, None, 1:-1]).transpose(3, 0, 1, 2)
    found = np.empty((3, m, count, n))
    for x, y, z in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.subtract(a[y] * r[z], a[z] * r[y], out=found[x])
    slides = np.array([joint.slides for joint in arms.joints])
    if slides.any():
        found[..., slides] = a[..., slides]
    # Joint i moves what lies beyond its own node, and what slides the next one.
    found *= np.arange(count)[:, None] >= np.arange(n) + 2
    return found


def reaches(arms: Arms, side: Side, lower: Array, upper: Array) -> Array:
    """By how much each joint can move each link, (n, n + 1) m for each rad or m.

    No point of link j, from node j to the next, is farther from joint i than the offsets between them are long, with
    sliding joints at whichever end of their range is longer. A sliding joint moves by 1 m for each m.
    """
    offsets = arms.offsets(side)
    length = np.linalg.norm(offsets, axis=1)  # of the step to each node
    axes = arms.axes(side)
    for i, joint in enumerate(arms.joints):
        if joint.slides:
            length[i + 2] = max(np.linalg.norm(offsets[i + 2] + q * axes[i]) for q in (lower[i], upper[i]))
    made = np.zeros((arms.n, arms.n + 1))
    for i, joint in enumerate(arms.joints):  # joint i sits at node i + 1
        for j in range(i + 1, arms.n + 1):
            made[i, j] = 1.0 if joint.slides else length[i + 2 : j + 2].sum()
    return made
