"""Who runs into whom: contacts of a worn arm's links with its wearer's body, by MuJoCo's own collision.

The bodies are capsules in MuJoCo's model, thinner than the envelope's. A contact is to be blamed on the arm if the
arm's motion alone, the body held where it is, closes the gap at over `BLAME` in the step in which the contact begins.
That leaves out an arm that goes on into what already touches it: such contacts are counted beside the others.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import pi
from typing import Any, Final

import mujoco
import numpy as np

from srl.control.skeleton.envelope import PARTS, Envelope
from srl.control.skeleton.human_srl import HumanSrl
from srl.control.skeleton.kinematics import Kinematics
from srl.runtime.contracts.signals import Array
from srl.runtime.models.skeleton.arms import Side
from srl.studies.human_srl.wearers import Wearer

BLAME: Final = 0.02  # m/s
LINK_RADIUS: Final = 0.0305  # m: half of a servo's larger side (ROBOTIS MX-64, 61.1 mm); the envelope has its diagonal
_REST: Final = 1e-4  # rad/s or m/s
_FAR: Final = 0.1  # m: gaps beyond are not told apart
_TRUNK: Final = ("pelvis", "abdomen", "chest")
_ENDS: Final = ("neck", "head", "hand", "thumb", "index", "middle", "ring", "little", "foot")


@dataclass(frozen=True)
class Contact:
    """A contact that began.

    Attributes:
        pair: "RJ4-RJ5/right_forearm".
        speed: m/s, by which the arm's motion alone closed the gap.
        rest: the arm didn't move.
        compared: the clearance watches this pair.
    """

    pair: str
    speed: float
    rest: bool
    compared: bool

    @property
    def blamed(self) -> bool:
        """Whether the arm ran into the body."""
        return self.speed > BLAME


class Contacts:
    """Notes what begins to touch, step by step. What touches at the beginning isn't a contact that begins.

    Attributes:
        kinematics: the person's, with capsules.
        found: those that began so far.
        pushed: how many contacts there were into which the arm's motion alone went at over `BLAME` in any step, be it
            the one in which they began, a later one, or that of a contact which was there at the beginning.
    """

    def __init__(self, figure: HumanSrl, side: Side, envelope: Envelope, who: Wearer) -> None:
        """
        Args:
            figure: the person, in the person's size.
            side: the arm.
            envelope: says which pairs are compared.
            who: has the girths.
        """
        radii = girths(who)
        self.kinematics = Kinematics(figure, lambda spec: shapes(spec, figure, side, radii, LINK_RADIUS))
        self.found: list[Contact] = []
        self._side: Side = side
        model, watched = self.kinematics.model, {pair.name for pair in envelope.pairs}
        nodes = figure.arms.names(side)
        self._pairs: dict[tuple[int, int], tuple[str, bool]] = {}
        for a, b in pairwise(nodes):
            for segment in PARTS:
                first, second = sorted((model.geom(f"arm/{a}").id, model.geom(f"body/{segment}").id))
                self._pairs[first, second] = f"{a}-{b}/{segment}", f"{a}-{b}/{segment}" in watched
        self._touching: set[tuple[int, int]] | None = None
        self.pushed = 0
        self._pushing: set[tuple[int, int]] = set()  # of what touches: into which the arm has pushed
        offsets, axes = figure.arms.offsets(side), figure.arms.axes(side)
        # A sliding joint lengthens the link between its node and the next one.
        self._sliding = [
            (i, model.geom(f"arm/{nodes[i + 1]}").id, offsets[i + 2], axes[i])
            for i, joint in enumerate(figure.arms.joints)
            if joint.slides
        ]

    def step(self, rotation: Array, translation: Array, before: Array, after: Array, dt: float) -> None:
        """Takes the next step.

        Args:
            rotation, translation: (59, 4), (59, 3) m of the person now.
            before, after: (n,) rad or m, of the arm a step ago and now.
            dt: s.
        """
        touching = self._touches(rotation, translation, after)
        begun: set[tuple[int, int]] = set() if self._touching is None else touching - self._touching
        rest = bool((np.abs(after - before) <= _REST * dt).all())
        self._pushing &= touching
        looked = begun if rest else touching
        if looked:
            closed = {two: -self._gap(two) for two in looked}
            self._touches(rotation, translation, before)
            speed = {two: (self._gap(two) + gap) / dt for two, gap in closed.items()}
            self._touches(rotation, translation, after)
            for two in sorted(begun):
                name, compared = self._pairs[two]
                self.found.append(Contact(name, speed[two], rest, compared))
            pushing = {two for two in looked if speed[two] > BLAME} - self._pushing
            self.pushed += len(pushing)
            self._pushing |= pushing
        self._touching = touching

    @property
    def blamed(self) -> list[Contact]:
        """Contacts that the arm made."""
        return [contact for contact in self.found if contact.blamed]

    def _touches(self, rotation: Array, translation: Array, q: Array) -> set[tuple[int, int]]:
        model, data = self.kinematics.model, self.kinematics.data
        for i, geom, offset, axis in self._sliding:
            _stretch(model, geom, offset + q[i] * axis)
        self.kinematics.nodes(rotation, translation, {self._side: q})
        mujoco.mj_collision(model, data)
        found: Array = np.sort(data.contact.geom[data.contact.dist <= 0.0], axis=1)
        return {(int(a), int(b)) for a, b in found}

    def _gap(self, two: tuple[int, int]) -> float:
        return float(mujoco.mj_geomDistance(self.kinematics.model, self.kinematics.data, *two, _FAR, None))


def girths(who: Wearer) -> dict[str, float]:
    """The radii of a person's segments, m, without clothing."""
    return {name: _share(who, name) * part.girth / (2.0 * pi) for name, part in PARTS.items()}


def _share(who: Wearer, segment: str) -> float:
    kind = segment.removeprefix("right_").removeprefix("left_")
    return who.trunk if kind in _TRUNK else who.ends if kind in _ENDS else who.limbs


def shapes(spec: Any, figure: HumanSrl, side: Side, radii: Mapping[str, float], link_radius: float) -> None:
    """Capsules "body/SEGMENT" and "arm/NODE", which fit the T-pose; each link with each segment is compared.

    Args:
        spec: `mujoco.MjSpec` of the figure.
        figure, side: the person and the arm.
        radii: m, of the segments.
        link_radius: m.
    """
    tree, nodes = figure.tree, figure.arms.names(side)
    at: dict[str, Array] = {}
    for node, up in zip(tree.nodes, tree.parents, strict=True):
        at[node.name] = np.array(node.offset) + (at[tree.names[up]] if up >= 0 else 0.0)
    bodies: Mapping[str, Any] = {body.name: body for body in spec.bodies}
    for name, part in PARTS.items():
        _capsule(bodies[part.start], f"body/{name}", at[part.end] - at[part.start], radii[name])
    for a, b in pairwise(nodes):
        _capsule(bodies[a], f"arm/{a}", at[b] - at[a], link_radius)
        for name in PARTS:
            spec.add_pair(geomname1=f"arm/{a}", geomname2=f"body/{name}")


def _stretch(model: Any, geom: int, way: Array) -> None:
    """Gives a capsule another length; its direction must be as before."""
    half = 0.5 * float(np.linalg.norm(way))
    radius = float(model.geom_size[geom, 0])
    model.geom_pos[geom], model.geom_size[geom, 1] = 0.5 * way, half
    model.geom_rbound[geom] = model.geom_aabb[geom, 5] = half + radius


def _capsule(body: Any, name: str, way: Array, radius: float) -> None:
    length = float(np.linalg.norm(way))
    ends = [0.0, 0.0, 0.0, *(way if length > 1e-6 else [0.0, 1e-6, 0.0])]  # two joints may be in one place
    body.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=ends, size=[radius, 0, 0], contype=0, conaffinity=0
    )
