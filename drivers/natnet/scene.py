"""From Motive's numbers to the profile's rows, in m, z up, w first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import dist, isfinite
from typing import Final

from srl.drivers.capture.axes import z_up_point, z_up_quaternion
from srl.drivers.capture.names import Point, Subject
from srl.drivers.capture.reach import FARTHEST
from srl.drivers.capture.selection import select
from srl.drivers.capture.upright import Upright
from srl.drivers.natnet.config import NatNetConfig
from srl.drivers.natnet.frame import FILLED, OCCLUDED, UNLABELLED, Body, MotiveFrame
from srl.drivers.natnet.model import KIND, BodyModel, Model
from srl.runtime.contracts.rotation import Quaternion, normalised

_UNIT: Final = 1e-2  # by which a quaternion's length may differ from 1
_FLOOR: Final = -0.3  # m; what is lower is beneath the floor, or another axis is up
_BONE: Final = 0.05  # m, by which a bone's length may differ from the description's


@dataclass(slots=True)
class Shown:
    """What a frame shows of what is wanted: rows and poses."""

    segments: list[tuple[int, Point, Quaternion]] = field(default_factory=list)
    markers: list[tuple[int, Point]] = field(default_factory=list)
    unlabelled: list[Point] = field(default_factory=list)


@dataclass
class _Skeleton:
    """A wanted skeleton: row by bone, and what tells whether its frames can be used."""

    name: str
    rows: dict[int, int]
    bones: dict[int, BodyModel]
    root: int
    head: int | None
    upright: Upright


class Scene:
    """Selects what the profile names from Motive's frames.

    Attributes:
        missing: names of the profile that Motive doesn't have at present. remark: for people; "" if all is well.
    """

    def __init__(self, config: NatNetConfig) -> None:
        self.missing: list[str] = []
        self.remark = ""
        self._config = config
        self._up_is_y = config.up == "y"
        self._bodies: dict[int, int] = {}
        self._skeletons: dict[int, _Skeleton] = {}
        self._markers: dict[tuple[int, int], int] = {}
        self._proven: dict[str, Upright] = {}

    def forget(self) -> None:
        """Forgets which persons were seen upright."""
        for upright in self._proven.values():
            upright.restart()

    def take(self, model: Model) -> list[Subject]:
        """Takes new definitions; returns the subjects. Raises ValueError: two have one number, or one wanted name."""
        subjects = list(model.subjects())
        numbers: dict[int, str] = {}
        for subject in subjects:
            number = subject.id % KIND
            if number in numbers:
                raise ValueError(f"'{numbers[number]}' and '{subject.name}' both have the streaming id {number}")
            numbers[number] = subject.name
        found = select(self._config, subjects)
        targets = self._config.segments | self._config.markers
        for name in found.missing:
            same = [s for s in subjects if s.name == targets[name].partition("/")[0]]
            if len(same) > 1:
                which = " and ".join(f"{'skeleton' if s.id >= KIND else 'rigid body'} {s.id % KIND}" for s in same)
                raise ValueError(f"two assets are called '{same[0].name}': {which}")
        self.missing = found.missing
        self._bodies = {body.id: rows[body.id] for body in model.bodies if (rows := found.segments.get(body.id))}
        self._skeletons = {}
        for name, number, bones in model.skeletons:
            if (rows := found.segments.get(KIND + number)) is not None:
                self._skeletons[number] = self._skeleton(name, bones, rows)
        self._markers = {(owner % KIND, member): row for (owner, member), row in found.markers.items()}
        return subjects

    def _skeleton(self, name: str, bones: Sequence[BodyModel], rows: dict[int, int]) -> _Skeleton:
        by_number = {bone.id: bone for bone in bones}
        root = next((bone.id for bone in bones if bone.parent <= 0), bones[0].id)
        head = next((bone.id for bone in bones if bone.name.lower().endswith("head")), None)
        upright = self._proven.setdefault(name, Upright())
        return _Skeleton(name, rows, by_number, root, head, upright)

    def show(self, frame: MotiveFrame) -> Shown:
        """Returns what the frame shows."""
        shown = Shown()
        self.remark = f"Motive has no {', '.join(self.missing)} any more" if self.missing else ""
        for body in frame.bodies:
            self._add(shown, body, self._bodies.get(body.id))
        for number, skeleton in self._skeletons.items():
            self._bones(shown, skeleton, frame.skeletons.get(number, []))
        for marker in frame.markers:
            if marker.flags & UNLABELLED:
                if len(shown.unlabelled) < self._config.unlabelled and (p := self._place(marker.position)):
                    shown.unlabelled.append(p)
            elif not marker.flags & (OCCLUDED | FILLED):
                row = self._markers.get((marker.owner, marker.member))
                if row is not None and (p := self._place(marker.position)):
                    shown.markers.append((row, p))
        if not shown.unlabelled and self._config.unlabelled:
            places = (self._place(other) for other in frame.others)
            shown.unlabelled = [p for p in places if p][: self._config.unlabelled]
        if not self.remark and any(p[2] < _FLOOR for _, p, _ in shown.segments):
            self.remark = f"something lies beneath the floor: is 'up: {self._config.up}' right?"
        return shown

    def _bones(self, shown: Shown, skeleton: _Skeleton, bones: list[Body]) -> None:
        # The upper half of a bone's number is the skeleton's.
        by_number = {bone.id & 0xFFFF: bone for bone in bones if bone.tracked}
        if not skeleton.upright.proven:
            if _relative(skeleton.bones, by_number):
                self.remark = (
                    f"the bones of '{skeleton.name}' are relative to their parents: "
                    "set Skeleton Coordinates to Global in Motive's streaming settings"
                )
                return
            root, head = by_number.get(skeleton.root), by_number.get(skeleton.head or -1)
            if skeleton.head is not None:
                if root is None or head is None:
                    return  # nothing counts before it was seen upright
                hips, top = self._place(root.position), self._place(head.position)
                if not hips or not top or not skeleton.upright.judge(hips, top, f"up: {self._config.up}"):
                    self.remark = f"'{skeleton.name}': {skeleton.upright.why or 'its pose is none'}"
                    return
        for number, row in skeleton.rows.items():
            if (bone := by_number.get(number)) is not None:
                self._add(shown, bone, row)

    def _add(self, shown: Shown, body: Body, row: int | None) -> None:
        if row is None or not body.tracked:
            return
        w, x, y, z = body.rotation
        size = w * w + x * x + y * y + z * z
        p = self._place(body.position)
        if p is None or not abs(size - 1.0) < _UNIT:  # also for NaN
            return
        q = normalised(body.rotation)
        q = z_up_quaternion(q) if self._up_is_y else q
        shown.segments.append((row, p, q))

    def _place(self, p: Point) -> Point | None:
        if not all(isfinite(v) and abs(v) < FARTHEST for v in p):
            return None
        return z_up_point(p) if self._up_is_y else p


def _relative(model: dict[int, BodyModel], bones: dict[int, Body]) -> bool:
    """Whether the bones' places are those in their parents: then each is the description's own offset."""
    judged = wrong = 0
    for number, bone in bones.items():
        described = model.get(number)
        parent = bones.get(described.parent) if described else None
        if described is None or parent is None:
            continue
        length = dist(described.offset, (0.0, 0.0, 0.0))
        if length < 2 * _BONE:
            continue
        judged += 1
        apart = dist(bone.position, parent.position)
        own = dist(bone.position, (0.0, 0.0, 0.0))
        wrong += abs(own - length) < _BONE <= abs(apart - length)
    return judged > 1 and wrong > judged / 2
