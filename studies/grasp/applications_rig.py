"""The profile's own hand and finger on a carried wrist, over a stand: law, guard and servos run in lockstep."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import mujoco
import numpy as np

from srl.runtime.contracts.rotation import Pose, Quaternion, conjugate, product, turned
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.requests import RequestKind
from srl.sim.parts.body.carrier import CarrierPart
from srl.sim.parts.hand.human_hand import HumanHandPart
from srl.studies.grasp.closing_person import ClosingPerson
from srl.studies.simulated import cell, lockstep

ARMS: Final[dict[str, dict[str, Any]]] = {
    "bare": {},
    "mapping": {},
    "as-published": {"controllers.1.as_published": True},
    "splint": {},
    "scaling": {"controllers.1.deformation": "scaling"},
    "concentric": {"controllers.1.deformation": "concentric"},
    "partial": {"controllers.1.points": ["middle", "ring", "little"]},
}
"""The hand alone, with the profile's law, with the finger frozen where it begins; and by name what is set besides."""
SERVOS: Final = ("abduction", "flexion_1", "flexion_2", "flexion_3")
STAND: Final = 0.30  # m, its top above the world's origin
POST: Final = 0.03  # m, its sides: so small that hand and finger pass beside it
LIFT: Final = 0.10  # m, the specification's
ROOT: Final = "finger/flexion_1"
"""The finger's first link, which a stub on the wrist would be as well."""
LEANING: Final = 0.5
"""Greatest share of the finger's force on its first link. What leans there is held by the mount, which every arm has,
and says nothing about the finger's law. Ours."""
_ABOVE: Final = 0.17  # m that the hand comes from: more than the straight finger is long
_LOST: Final = 0.03  # m below its stand, an object is lost
_FREEZE: Final = 10  # cycle in which the splint's user stops the limb
NOSLIP: Final = 5
"""Iterations of MuJoCo's noslip solver: without it a held object creeps by more than a millimetre a second."""


def _stand(sides: float) -> dict[str, Any]:
    if not sides:
        return {}
    place, middle = {"position": [0.0, 0.0, STAND]}, [0.0, 0.0]
    return {
        "sim.parts.stand": {"part": "table", "size": [sides, sides], "start": middle, "goal": middle, "at": place}
    }  # fmt: skip


class LostError(Exception):
    """The object fell."""


class Rig:
    """A hand before an object on a stand.

    Attributes:
        lockstep: the profile.
        cell: its world.
        person: who moves the hand.
        watch: called after each cycle.
    """

    def __init__(
        self,
        text: str,
        arm: str,
        things: Mapping[str, Any],
        hand: Pose,
        posture: Array,
        home: Sequence[float],
        lead: float,
        seed: int,
        changes: Mapping[str, Any] | None = None,
        stand: float = POST,
        watch: Callable[[Rig], None] = lambda rig: None,
    ) -> None:
        """Args:
        text: the profile's.
        arm: of ARMS.
        things: parts of the cell besides hand, finger and stand; the object is `thing`.
        hand: of its frame in the world where it grasps: x y z (m), w x y z. It comes there along its own z.
        posture: (20,) rad, of the hand at the start.
        home: (4,) rad, of the finger at the start.
        lead: rad, as of `ClosingPerson`.
        seed: of the world's noise.
        changes: of the profile besides, by key path.
        stand: m, its sides; 0: there is none.
        """
        turn = hand[3:]
        back = turned(turn, (0.0, 0.0, _ABOVE))
        begin = [a + b for a, b in zip(hand[:3], back, strict=True)]
        given: dict[str, Any] = {
            "seed": seed, "sim.noslip": NOSLIP,
            "sim.parts.wrist": {"part": "carrier"},
            "frames.wrist": {"position": begin, "quaternion": list(turn)}, "frames.hand.parent": "wrist",
            **_stand(stand),
            **{f"sim.parts.{name}": part for name, part in things.items()},
            **{f"devices.finger.servos.{name}.home": float(q) for name, q in zip(SERVOS, home, strict=True)},
            **(changes or {}),
            **ARMS[arm],
        }  # fmt: skip
        self.lockstep = lockstep(text, given)
        world = cell(self.lockstep)
        self.cell, self.hand, self.watch, self._arm = world, hand, watch, arm
        self._wrist = world.part(CarrierPart, "wrist")
        self.person = ClosingPerson(world.part(HumanHandPart, "hand"), posture, lead)
        if arm == "bare":  # a finger that is parked is a shelf
            model = world.model
            for geom in range(model.ngeom):
                if model.geom(geom).name.startswith("finger/"):
                    model.geom_contype[geom] = model.geom_conaffinity[geom] = 0
        self._thing, self._hand = world.truth_arrays["thing_pose"], world.truth_arrays["hand_pose"]
        self._contact = world.truth_arrays["finger_contact"]
        self.force, self._floor = 0.0, float(self._thing[2]) - _LOST
        self._root = int(world.model.geom(ROOT).id)
        self._pressed, self._leaned = 0.0, 0.0

    @property
    def time(self) -> float:
        """s of the world."""
        return self.cell.time * 1e-9

    @property
    def height(self) -> float:
        """m, of the object."""
        return float(self._thing[2])

    def inside(self) -> Array:
        """(3,) m, the object in the hand's frame."""
        x, y, z = (self._thing[:3] - self._hand[:3]).tolist()
        w, i, j, k = self._hand[3:].tolist()
        return np.array(turned(conjugate((w, i, j, k)), (x, y, z)))

    def turn(self) -> Quaternion:
        """w x y z, of the object in the hand's frame."""
        w, i, j, k = self._hand[3:].tolist()
        a, b, c, d = self._thing[3:].tolist()
        return product(conjugate((w, i, j, k)), (a, b, c, d))

    @property
    def leaning(self) -> float:
        """Share of the finger's contact forces since `take` that are on its first link, 0 to 1."""
        return self._leaned / self._pressed if self._pressed else 0.0

    def take(self, path: Array, seconds: float) -> float:
        """Comes down, closes along a path (k, 20), rad, in so many s, squeezes and lifts by LIFT.

        Returns:
            m, by which the closing hand pushed the object.
        Raises:
            LostError: the object has fallen.
        """
        self.run(0.2)
        self.go(0.0, 0.8)
        self.run(1.0)
        before = self.inside()
        self.person.go(path, self.time, seconds)
        self.run(seconds + 0.4)
        self.person.hold(self.time)
        pushed = float(np.linalg.norm(self.inside() - before))
        self._pressed, self._leaned = 0.0, 0.0
        self.go(LIFT, 0.8)
        self.run(1.0)
        return pushed

    def go(self, up: float, seconds: float) -> None:
        """Begins to take the wrist to so far above where it grasps, m."""
        x, y, z = self.hand[:3]
        self._wrist.go((x, y, z + up, *self.hand[3:]), seconds)

    def run(self, seconds: float) -> None:
        """Goes on for some time. Raises LostError: the object has fallen."""
        for _ in range(round(seconds * 1e9 / self.lockstep.period)):
            frozen = self._arm == "splint" and self.lockstep.count == _FREEZE
            self.lockstep.step(RequestKind.STOP if frozen else RequestKind.NONE)
            if self._contact[0]:
                self.force = max(self.force, float(self._contact[0]))
                self._pressed += float(self._contact[0])
                self._leaned += self._root_force()
            self.watch(self)
            if self._thing[2] < self._floor:
                raise LostError

    def _root_force(self) -> float:
        """N, the sum of the normal forces on the finger's first link."""
        data, total, force = self.cell.data, 0.0, np.empty(6)
        for number in np.flatnonzero((data.contact.geom == self._root).any(axis=1)).tolist():
            mujoco.mj_contactForce(self.cell.model, data, number, force)
            total += float(force[0])
        return total
