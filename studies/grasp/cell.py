"""The hand's world as geometry: an object before the palm, postures without time, and where they touch.

It is the cell of the profile, so hand, finger, mounting and law are the profile's; nothing is stepped in it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final, cast

import mujoco
import numpy as np

from srl.control.hand.extra_finger import FingerKinematics
from srl.control.hand.object_mapping import ObjectMapping
from srl.runtime.contracts.rotation import Quaternion, matrix
from srl.runtime.contracts.signals import Array
from srl.runtime.models.human_hand import FINGERS
from srl.runtime.models.models import FingerModel, HandModel
from srl.runtime.profile import profile, wiring
from srl.sim.parts.hand.human_hand import HumanHandPart
from srl.sim.world.cell import Cell
from srl.studies.grasp.measures import Contacts
from srl.studies.grasp.things import Thing

THING: Final = "thing"
PARTIAL: Final = ["middle", "ring", "little"]
TOUCH: Final = 0.001  # m from the surface that counts as a contact; more than a step of the closing
_SEEN: Final = 0.015  # m, distance from which they are listed
_DAMPING: Final = 0.01  # m/rad, of the human fingers' inverse kinematics, as the law's


class GraspCell:
    """The profile's cell with an object held in place, moved posture by posture.

    Attributes:
        laws: the profile's object mapping `whole`, of all extra fingers, and the same from fewer fingertips,
            `partial`; nobody runs them but you.
        extra: names of the extra fingers.
        digits: joints of each digit by name, as indices of a posture: the five fingers, then the extra ones.
        n: joints of a posture: 24 with one extra finger.
        limits: (n, 2) rad, of the joints.
        home: rad, of the extra fingers' joints, the profile's.
        chains: the five fingers' kinematics.
        centre, axes: (3,) m and (3, 3), of the object in the hand's frame, which is the world's.
        model, data: MuJoCo's.
    """

    def __init__(
        self, text: str, thing: Thing, place: tuple[Array, Quaternion], overrides: Mapping[str, Any] | None = None
    ) -> None:
        """Args:
        text: a profile's, with a hand, an extra finger and its mapping from all five fingertips. More fingers
            that `overrides` adds are like the first.
        place: of the object in the hand's frame: its centre, m, and w x y z.
        overrides: what else is set, by key path.
        """
        given = {**(overrides or {}), f"sim.parts.{THING}": thing.part(*place)}
        words = [f"{key}={json.dumps(value)}" for key, value in given.items()]
        plain, source = profile.tree("study.yaml", text, words)
        parts = {name: part for name, part in plain["sim"]["parts"].items() if part["part"] == "robotic-finger"}
        self.extra = list(parts)
        own = next(law for law in plain["controllers"] if law["use"] == "object-mapping")
        kept = {key: value for key, value in own.items() if key not in ("name", "out")}
        kept["fingers"] = [{"model": part.get("model", "finger"), "name": name} for name, part in parts.items()]
        plain["controllers"] += [kept | {"name": "whole"}, kept | {"name": "partial", "points": PARTIAL}]
        checked = profile.Profile.model_validate(plain)
        graph = wiring.build(checked, source, [])
        world = cast(Cell, graph.world)
        self.model, self.data = world.model, world.data
        laws = {law.name: law for law in graph.controllers if isinstance(law, ObjectMapping)}
        self.laws = {name: laws[name] for name in ("whole", "partial")}
        (hand,) = (name for name, part in world.parts.items() if isinstance(part, HumanHandPart))
        model = next((m for m in checked.models.values() if isinstance(m, HandModel)), HandModel())
        finger = next((m for m in checked.models.values() if isinstance(m, FingerModel)), FingerModel())
        self.chains = _chains(model)
        self.limits = np.vstack([model.ranges, *[np.column_stack([finger.lower, finger.upper]) for _ in self.extra]])
        (board,) = (device for device in graph.devices if "position_command" in getattr(device, "home", {}))
        self.home: Array = np.tile(board.home["position_command"], len(self.extra))

        joints = [f"{hand}/{joint}" for joint in model.names]
        joints += [f"{extra}/{joint}" for extra in self.extra for joint in finger.names]
        self._at = np.array([self.model.joint(joint).qposadr[0] for joint in joints])
        self.digits = {name: list(range(4 * i, 4 * i + 4)) for i, name in enumerate(FINGERS)}
        each = len(finger.names)
        self.digits |= {name: list(range(20 + i * each, 20 + (i + 1) * each)) for i, name in enumerate(self.extra)}
        # A link's geom has the name of the joint that moves it.
        self._joint = np.full(self.model.ngeom, -1)
        for number, joint in enumerate(joints):
            if (geom := mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_GEOM, joint)) >= 0:
                self._joint[geom] = number
        self._thing = int(self.model.geom(f"{THING}/geom").id)
        self.model.geom_margin[self._thing] = _SEEN
        site = int(self.model.site(f"{hand}/{FINGERS[0]}").id)
        self._tips, self._tip = self.data.site_xpos[site : site + 5], self.data.site_xpos[self._site(self.extra[0])]
        self.n = len(joints)
        self.centre, self.axes = place[0], matrix(place[1])

    def _site(self, extra: str) -> int:
        return int(self.model.site(f"{extra}/tip").id)

    def pose(self, q: Array) -> None:
        """Takes hand and fingers to a posture (n,), rad."""
        self.data.qpos[self._at] = q
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)

    def tips(self) -> Array:
        """(5, 3) m, the human fingertips in the hand's frame."""
        return self._tips.copy()

    def tip(self) -> Array:
        """(3,) m, the first extra finger's tip in the hand's frame."""
        return self._tip.copy()

    def gaps(self) -> Array:
        """(n,) m, the distance of each joint's link from the object; inf if it isn't near."""
        return self._least((self.data.contact.geom == self._thing).any(axis=1))

    def apart(self) -> Array:
        """(n,) m, the distance of each joint's link from whatever it may touch; inf if it isn't near."""
        return self._least(np.ones(self.data.ncon, dtype=bool))

    def _least(self, counts: Any) -> Array:
        contact = self.data.contact
        found = np.full(self.n + 1, np.inf)  # the last one is no joint
        for geoms in contact.geom[counts].T:
            np.minimum.at(found, self._joint[geoms], contact.dist[counts])
        return found[: self.n]

    def contacts(self, digits: Sequence[str]) -> Contacts:
        """The contacts of these digits with the object, one a link: the middle of where it touches. Its own axes."""
        points: dict[int, list[Array]] = {}
        normals: dict[int, list[Array]] = {}
        wanted = {joint for digit in digits for joint in self.digits[digit]}
        for contact in self.data.contact:
            one, other = int(contact.geom1), int(contact.geom2)
            if self._thing not in (one, other) or contact.dist > TOUCH:
                continue
            joint = int(self._joint[one if other == self._thing else other])
            if joint in wanted:
                # A contact's first axis points from the first geom to the second.
                into = contact.frame[:3] * (1.0 if other == self._thing else -1.0)
                points.setdefault(joint, []).append(contact.pos - self.centre)
                normals.setdefault(joint, []).append(into.copy())
        order = sorted(points)
        p = np.array([np.mean(points[joint], axis=0) for joint in order]).reshape(-1, 3)
        n = np.array([np.mean(normals[joint], axis=0) for joint in order]).reshape(-1, 3)
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        return Contacts(p @ self.axes, n @ self.axes)


def _chains(model: HandModel) -> list[FingerKinematics]:
    """The fingers' own kinematics, for motions that are given by their tips."""
    found = []
    for i, (base, rows) in enumerate(zip(*model.geometry(), strict=True)):
        lower, upper = model.ranges[4 * i : 4 * i + 4].T.tolist()
        chain = FingerModel(rows=tuple(map(tuple, rows.tolist())), lower=tuple(lower), upper=tuple(upper))
        found.append(FingerKinematics(chain, base, _DAMPING))
    return found
