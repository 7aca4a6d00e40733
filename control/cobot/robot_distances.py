"""Distances of a cobot's arm to its own links, its base, the ground and things that stand in its world.

The shapes are those of the robot's description: capsules round the links, a box for the base. Distances are coal's, by
pinocchio's geometry model. Before something flat the nearest point jumps from one end of a shape to the other while the
shape turns, so corners and long capsules' ends are compared by themselves, too.
"""

from __future__ import annotations

from itertools import product
from typing import Any, Final, NamedTuple

import coal
import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.frames import Placement
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.per_element import Positive
from srl.runtime.contracts.rotation import Vector, matrix
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots import SUMMIT_XL, Capsule, RobotDescription
from srl.runtime.models.robots.pinocchio_model import FLANGE, mobile_model, pinocchio_model

_WORLD: Final = 0  # pinocchio's number of what doesn't move
_BODY: Final = 3  # of the joint that turns the mobile base
_GROUND: Final = "ground"
_ARM_BASE: Final = -1
_NO_LINK: Final = -2  # place in the arm's chain of what isn't in it
OPENING: Final = 0.05
"""m/s: a gap that is already too small opens no faster. Drifting odometry may ask for it, nobody else."""
OVERLAP: Final = 0.12
"""m: what overlaps more isn't a gap that drifting odometry closed. An obstacle isn't where it is said to be, and which
way leads out of it can't be told: the limb stops."""
_NEIGHBOURS: Final = 0.05
"""m: two links that never get farther apart than this are joined by their build, and aren't compared."""
_SAMPLES: Final = 200
_AHEAD: Final = 0.05  # m beyond the kept distance within which a pair always counts
_REACTION: Final = 0.1  # s in which the speed may still grow
_CORNER: Final = 0.02  # m, radius of the base's four vertical edges
_LONG: Final = 0.1  # m: longer capsules have ends of their own


class Thing(Placement):
    """A box or a capsule that stands in the world: `position`, `rpy` or `quaternion`, and its size."""

    size: tuple[Positive, Positive, Positive] | None = Field(None, description="m, edges of a box along its x, y, z")
    radius: Positive | None = Field(None, description="m, of a capsule or a sphere")
    length: float = Field(0.0, ge=0, allow_inf_nan=False, description="m, of the capsule's axis, along z")

    @model_validator(mode="after")
    def _one_shape(self) -> Thing:
        if (self.size is None) == (self.radius is None):
            raise ValueError("give either `size` (a box) or `radius` (a capsule; with `length`)")
        if self.size is not None and self.length > 0.0:
            raise ValueError("`length` is a capsule's; a box has `size`")
        return self


class ToolShape(Options):
    """A capsule round hand and handle, in the flange's frame."""

    start: Vector = Field((0.0, 0.0, 0.0), description="m")
    end: Vector = Field(description="m")
    radius: Positive = Field(description="m")


class DistancesConfig(Options):
    """Options under `limits.distances`."""

    least: float = Field(0.03, ge=0.005, le=0.5, description="m, kept between all pairs")
    braking: float = Field(0.4, gt=0, le=5, description="m/s^2 with which a gap may be approached at most")
    ground: bool = Field(True, description="keep off the ground as well")
    tool: ToolShape | None = Field(None, description="capsule round hand and handle, flange frame; null: not compared")
    obstacles: dict[str, Thing] = Field(default_factory=dict, description="things that stand in the base's world")


class Near(NamedTuple):
    """The pairs that can matter at the present speed.

    Attributes:
        distance: (k,) m; negative where they overlap.
        gradient: (k, 3 + n): the distances' rates, m/s, for the velocities of base (world axes) and joints.
    """

    distance: Array
    gradient: Array

    @property
    def overlaps(self) -> bool:
        """Whether a pair overlaps by more than OVERLAP."""
        return bool((self.distance < -OVERLAP).any())


class _Owner(NamedTuple):
    """Whose shape it is: a part, its place in the arm's chain, and whether it is only an end of another shape."""

    part: str
    place: int
    end: bool


class RobotDistances:
    """Distances and their gradients at a configuration.

    The arm's coordinates follow those of its mobile base; an arm that stands alone has its own only, in its base frame.

    Attributes:
        pairs: the pairs' names, such as `elbow/base`.
        left_out: pairs of links that the robot's build joins.
        least: m, the least distance since the start; inf before the first.
        nearest: the pair that had it.
        levers: (n,) m that no point of the arm's shapes moves more than for 1 of each joint; of an arm alone.
    """

    def __init__(self, robot: RobotDescription, mount: Array | None, config: DistancesConfig) -> None:
        """Args:
        mount: (4, 4), the arm's base frame in the mobile base's frame, which is on the ground; None: it stands alone.

        Raises:
            OptionError: an obstacle has the name of a part of the robot.
        """
        # The joint that carries the arm, and the coordinates before its own.
        self._body = _WORLD if mount is None else _BODY
        self._model = pinocchio_model(robot) if mount is None else mobile_model(SUMMIT_XL, robot, mount)
        self._data: Any = self._model.createData()
        self._config = config
        self._owners: list[_Owner] = []
        self._shapes = pin.GeometryModel()
        self._build(robot, mount, config)
        self.left_out = self._pair_up(robot)
        self._results = self._shapes.createData()
        pairs = self._shapes.collisionPairs
        self.pairs = tuple(f"{self._owners[p.first].part}/{self._owners[p.second].part}" for p in pairs)
        self._joints = [(self._joint(p.first), self._joint(p.second)) for p in pairs]
        self._reaches = self._longest(robot)
        self.levers = self._bounds(robot)
        self._fastest = 2.0 * self._reaches
        own = self._fastest[-robot.n :]
        # What hangs on a joint beside the flange (a jaw, a wide tool) isn't sampled.
        own[:] = np.where(self.levers > 2.0 * own, self.levers, own)
        self.least, self.nearest = np.inf, ""

    def __call__(self, q: Array, v: Array) -> Near:
        """The pairs that are near enough to matter.

        Args:
            q: (3 + n,) x, y m, yaw rad of the base in the world, then the joints, rad; (n,) of an arm alone.
            v: its velocity; the base's axes don't matter.
        """
        model, data = self._model, self._data
        pin.computeDistances(model, data, self._shapes, self._results, q)
        found = self._results.distanceResults
        if not len(found):  # an arm whose links have no shapes, and nothing to hit
            return Near(np.zeros(0), np.zeros((0, len(q))))
        distance = np.array([r.min_distance for r in found])
        nearest = int(distance.argmin())
        if distance[nearest] < self.least:
            self.least, self.nearest = float(distance[nearest]), self.pairs[nearest]
        # No two points part faster than this: by what was sampled, twice, and by what the links' lengths allow.
        fastest = float(np.abs(v).dot(self._fastest))
        sight = _AHEAD + fastest * (_REACTION + fastest / (2.0 * self._config.braking))
        seen = np.flatnonzero(distance < self._config.least + sight).tolist()
        if not seen:
            return Near(np.zeros(0), np.zeros((0, len(q))))
        pin.computeJointJacobians(model, data, q)
        rows = []
        for i in seen:
            result, (first, second) = found[i], self._joints[i]
            n = result.normal  # from the first to the second shape
            row = self._along(second, result.getNearestPoint2(), n) - self._along(first, result.getNearestPoint1(), n)
            rows.append(row)
        return Near(distance[seen], np.array(rows))

    def margin(self, q: Array) -> float:
        """By how much a posture keeps more than `least`, m, of the nearest pair; infinite where nothing is compared."""
        pin.computeDistances(self._model, self._data, self._shapes, self._results, q)
        found = min((r.min_distance for r in self._results.distanceResults), default=np.inf)
        return float(found) - self._config.least

    def metrics(self) -> dict[str, object]:
        """The least distance of the run, its pair, and the pairs that aren't compared."""
        seen = {"least_distance_m": self.least, "nearest": self.nearest} if self.nearest else {}
        return {**seen, "not_compared": ", ".join(self.left_out)}

    def _longest(self, robot: RobotDescription) -> Array:
        """(3 + n,) or (n,) m for 1: how far from each axis the robot reaches at most, found by sampling."""
        frame, tool = self._model.getFrameId(FLANGE), self._config.tool
        reach = 0.0 if tool is None else float(np.linalg.norm(tool.end)) + tool.radius
        rng = np.random.default_rng(1)
        lower, upper = np.maximum(robot.q_lower, -np.pi), np.minimum(robot.q_upper, np.pi)
        longest = np.zeros(robot.n + 1)
        for _ in range(_SAMPLES):
            q = np.concatenate([np.zeros(self._body), rng.uniform(lower, upper)])
            pin.forwardKinematics(self._model, self._data, q)
            end = pin.updateFramePlacement(self._model, self._data, frame).translation
            joints = np.array([self._data.oMi[self._body + i].translation for i in range(robot.n + 1)])
            longest = np.maximum(longest, np.linalg.norm(joints - end, axis=1))
        slides = [joint.slides for joint in robot.joints]
        longest[1:][slides] = 1.0 - reach
        if self._body == _WORLD:
            found: Array = longest[1:] + reach
            return found
        half = float(np.hypot(*SUMMIT_XL.size[:2])) / 2
        yaw = max(half, longest[0])  # its height is in it, too
        return np.concatenate([[1.0, 1.0, yaw + reach], longest[1:] + reach])

    def _bounds(self, robot: RobotDescription) -> Array:
        """(n,) m for 1 of each joint: all steps from it to the farthest point of each shape, added up."""
        found = np.zeros(robot.n)
        for shape in self._shapes.geometryObjects:
            at = int(shape.parentJoint)
            if at <= self._body:
                continue
            geometry = shape.geometry
            size = float(geometry.radius) + float(getattr(geometry, "halfLength", 0.0))
            length = float(np.linalg.norm(shape.placement.translation)) + size
            for joint in range(at, self._body, -1):  # of the chain, from the shape inwards
                i = joint - self._body - 1
                slides = robot.joints[i].slides
                found[i] = max(found[i], 1.0 if slides else length)
                length += float(np.linalg.norm(self._model.jointPlacements[joint].translation))
                if slides:
                    length += float(np.abs([robot.q_lower[i], robot.q_upper[i]]).max())
        return found

    def _along(self, joint: int, point: Array, normal: Array) -> Array:
        """(3 + n,): the speed along `normal` of what is at `point` and moves with a joint."""
        if joint == _WORLD:
            return np.zeros(self._model.nv)
        J = pin.getJointJacobian(self._model, self._data, joint, pin.LOCAL_WORLD_ALIGNED)
        x, y, z = (point - self._data.oMi[joint].translation).tolist()
        u, v, w = normal.tolist()
        speed: Array = np.array((u, v, w, y * w - z * v, z * u - x * w, x * v - y * u)).dot(J)
        return speed

    def _joint(self, shape: int) -> int:
        return int(self._shapes.geometryObjects[shape].parentJoint)

    def _build(self, robot: RobotDescription, mount: Array | None, config: DistancesConfig) -> None:
        if mount is not None:
            self._build_base()
        standing = pin.SE3.Identity() if mount is None else pin.SE3(np.array(mount))
        for shape in robot.base_shape:
            self._add_capsule("arm's base", _ARM_BASE, self._body, standing, shape)
        for i, joint in enumerate(robot.joints):
            for shape in joint.shape:
                self._add_capsule(joint.name, i, self._body + 1 + i, pin.SE3.Identity(), shape)
        if config.tool is not None:
            flange = self._model.frames[self._model.getFrameId(FLANGE)]
            tool = Capsule(config.tool.start, config.tool.end, config.tool.radius)
            self._add_capsule("tool", robot.n, flange.parentJoint, flange.placement, tool)
        if config.ground:
            self._add(_GROUND, _NO_LINK, _WORLD, pin.SE3.Identity(), coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0))
        taken = {owner.part for owner in self._owners}
        for name, thing in config.obstacles.items():
            if name in taken or "/" in name:
                raise OptionError(f"'{name}' is a part of the robot, or has a '/'", "Give the obstacle another name")
            x, y, z, *turn = thing.placed()
            place = pin.SE3(np.array(matrix((turn[0], turn[1], turn[2], turn[3]))), np.array([x, y, z]))
            shape = coal.Box(*thing.size) if thing.size else coal.Capsule(thing.radius, thing.length)
            self._add(name, _NO_LINK, _WORLD, place, shape)

    def _build_base(self) -> None:
        length, width, height = SUMMIT_XL.size
        middle = pin.SE3(np.eye(3), np.array([0.0, 0.0, SUMMIT_XL.clearance + height / 2]))
        self._add("base", _NO_LINK, _BODY, middle, coal.Box(length, width, height))
        for x, y in product((-1.0, 1.0), repeat=2):
            corner = np.array([x * (length / 2 - _CORNER), y * (width / 2 - _CORNER), 0.0])
            edge = coal.Capsule(_CORNER, height - 2 * _CORNER)
            self._add("base", _NO_LINK, _BODY, middle * pin.SE3(np.eye(3), corner), edge, end=True)

    def _add(self, part: str, place: int, joint: int, placement: Any, shape: Any, *, end: bool = False) -> None:
        name = f"{part}.{len(self._owners)}"
        self._shapes.addGeometryObject(pin.GeometryObject(name, joint, placement, shape))
        self._owners.append(_Owner(part, place, end))

    def _add_capsule(self, part: str, place: int, joint: int, placement: Any, capsule: Capsule) -> None:
        start, end = np.array(capsule.start), np.array(capsule.end)
        length = float(np.linalg.norm(end - start))
        turn = np.eye(3)
        if length > 0.0:
            z = np.array([0.0, 0.0, 1.0])
            turn = pin.Quaternion.FromTwoVectors(z, (end - start) / length).toRotationMatrix()
        here = pin.SE3(turn, (start + end) / 2)
        self._add(part, place, joint, placement * here, coal.Capsule(capsule.radius, length))
        for point in (start, end) if length > _LONG else ():
            there = placement * pin.SE3(np.eye(3), point)
            self._add(part, place, joint, there, coal.Sphere(capsule.radius), end=True)

    def _pair_up(self, robot: RobotDescription) -> tuple[str, ...]:
        """Compares every link with what isn't its neighbour; returns what the build joins all the same."""
        shapes, owners = self._shapes, self._owners
        candidates = []
        for a, first in enumerate(owners):
            for b in range(a + 1, len(owners)):
                second, joints = owners[b], (self._joint(a), self._joint(b))
                if joints[0] == joints[1] or (joints == (self._body, _WORLD) and second.part == _GROUND):
                    continue  # nothing moves the one against the other
                chained = min(first.place, second.place) >= _ARM_BASE
                if chained and abs(first.place - second.place) <= 1:
                    continue
                if (first.end or second.end) and (chained or (first.end and second.end)):
                    continue  # an end matters only before something flat
                candidates.append(pin.CollisionPair(a, b))
        for pair in candidates:
            shapes.addCollisionPair(pair)
        results = shapes.createData()
        rng = np.random.default_rng(0)
        farthest = np.zeros(len(candidates))
        lower, upper = np.maximum(robot.q_lower, -np.pi), np.minimum(robot.q_upper, np.pi)
        for _ in range(_SAMPLES):
            q = np.concatenate([np.zeros(self._body), rng.uniform(lower, upper)])
            pin.computeDistances(self._model, self._data, shapes, results, q)
            farthest = np.maximum(farthest, [r.min_distance for r in results.distanceResults])
        joined = []
        for pair, distance in zip(candidates, farthest.tolist(), strict=True):
            ends = pair.first, pair.second
            standing = any(self._joint(end) == _WORLD and owners[end].place == _NO_LINK for end in ends)
            if distance < _NEIGHBOURS and not standing:
                shapes.removeCollisionPair(pair)
                joined.append(f"{owners[pair.first].part}/{owners[pair.second].part}")
        return tuple(dict.fromkeys(joined))
