"""The law `arm-reach`: an arm goes to goals of its joints or its tool, round itself and what stands in its world."""

from __future__ import annotations

from math import inf
from typing import Any, Final

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from srl.control.arm.options import joints
from srl.control.arm.tool_target import ToolTarget
from srl.control.cobot.robot_distances import RobotDistances
from srl.control.reach.arm_options import ArmReachConfig
from srl.control.reach.goal_search import GoalSearch
from srl.control.reach.mode import Mode
from srl.control.reach.static import Way
from srl.runtime.contracts import rotation
from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT, POSE
from srl.runtime.contracts.transforms import Transform, coordinates, device, frame
from srl.runtime.models.robots.pinocchio_model import FLANGE, pinocchio_model

NEAR: Final = 1e-3  # of a second's way at full speed: the goal, or a corner, is reached
_GAIN: Final = 4.0  # 1/s, at which a velocity-commanded arm comes to a goal, and any arm back to its way
_UNKNOWN: Final = 1.0  # rad/s or m/s, of a joint whose greatest speed nobody says
_FASTEST: Final = 10.0  # rad/s or m/s: no joint goes faster
_FAR: Final = 9.99  # m, that is shown at most
_OUT: Final = 0.02  # m more than is kept, up to which the arm goes out of what is too near
_PACE: Final = 0.2  # of the greatest speed, on the way out
_BESIDE: Final = 0.005  # m by which a point of the arm may be beside the way that was judged
_TRIES: Final = 3.0  # s of going out, or of being held, after which the arm waits


class ArmReach(Controller):
    """Searches a way that is free of the arm itself and of obstacles, goes it, and says what it does.

    Inputs: `q` (n,) rad, measured; `target`, by the option: (n,) rad of the joints, (3,) m of the tool, or its pose
    (7,) m and w x y z, in any frame that the tree connects with the arm's base. Where a joint slides, m.

    Outputs: `q` (n,) and `q_velocity` (n,), or `velocity` (n,) with `command: velocity`; `state` (1,), a
    `srl.control.reach.mode.Mode`; `margin` (2,) m, by which the arm is farther than `distances.least` from the nearest
    thing, here and at its goal; 0 where it has no goal.

    - SEARCHING: it stands, and looks at some postures a cycle: for those that put the tool at the goal, and for a way.
    - DIRECT, AROUND: it goes, all joints together, straight or by corners, at which it stops.
    - LEAVING: it is nearer to something than it should be, and goes out.
    - WAITING: the goal isn't free, or no way was found yet; it searches on.
    - UNREACHABLE: no posture within the joints' limits was found that puts the tool there.

    Obstacles stand: what moves is the guard's, or `reach`'s (a wearer). A new goal is one that differs from the last;
    a target that isn't there changes nothing. After a reset the arm stays until a target comes that differs from the
    one then. A joint that the guard holds back holds back all. Where the arm is more than 5 mm beside its way, it stops
    and searches anew.
    """

    Config = ArmReachConfig
    summary = "an arm goes to goals of joints or tool, round itself and obstacles that stand"

    def __init__(self, name: str, config: ArmReachConfig) -> None:
        super().__init__(name, config)
        self.options = o = config
        robot = o.robot
        self._kind = o.target
        target = {
            "joints": Signal(name="target", shape=(robot.n,), unit="rad", labels=robot.labels, slides=robot.slides),
            "point": Signal(name="target", shape=(3,), unit="m", labels=POINT),
            "pose": Signal(name="target", shape=(7,), unit="m", labels=POSE),
        }[o.target]
        self.inputs = (joints(robot, "q", "rad"), target)
        moved = (
            (joints(robot, "q", "rad"), joints(robot, "q_velocity", "rad/s"))
            if o.command == "position"
            else (joints(robot, "velocity", "rad/s"),)
        )
        self.outputs = (
            *moved,
            Signal(name="state", shape=(1,), unit="1"),
            Signal(name="margin", shape=(2,), unit="m", labels=("here", "goal")),
        )
        if o.target != "joints":
            need = "the target's frame in the arm's base"
            self.transforms = (Transform("target", coordinates("target"), device("q"), need, moves=True),)
            if o.tool is not None:
                need = "the control point in the flange's frame"
                self.transforms += (Transform("tool", frame(o.tool), device("q", FLANGE), need),)
        self._model: Any = pinocchio_model(robot)
        self._data: Any = self._model.createData()
        self._frame = self._model.getFrameId(FLANGE)
        self._distances = RobotDistances(robot, None, o.distances)
        if o.distances.obstacles and not self._distances.pairs:
            raise OptionError(
                "no link of the robot has a shape: nothing would be kept off the obstacles", "Give it `capsules`"
            )
        self._lower, self._upper = robot.q_lower, robot.q_upper
        self._scale = o.joint_speed * np.clip(
            np.where(np.isfinite(robot.dq_max), robot.dq_max, _UNKNOWN), 1e-3, _FASTEST
        )
        self._levers = self._distances.levers * self._scale
        moves = o.command == "velocity"
        # Scaled, of each joint: within this a corner is reached; and what a point of the arm moves by it, m.
        self._close = o.near / self._scale if moves else np.full(robot.n, NEAR)
        self._allowed = o.near * float(self._distances.levers.sum()) if moves else 0.0
        self._rate = np.minimum(np.where(np.isfinite(robot.ddq_max), robot.ddq_max, inf), o.acceleration) / self._scale
        self._place = ToolTarget(0.0, (0.0, 0.0, 0.0))
        self._old = np.full(target.size, np.nan)
        self._unseen, self._seed = 0.0, 0
        self._speed = 0.0  # of 1 of the joints' speeds
        self._was, self._along = np.zeros(robot.n), np.zeros(robot.n)  # where it was, and where it went
        self._last, self._from = 0.0, np.zeros(robot.n)  # s of the cycle before, and where the piece of the way began
        self._tried = 0.0  # s of going out, or of being held
        self._way: list[Array] = []  # scaled corners that are still to be passed; the goal is the last
        self._stops = False  # it brakes for a new goal
        self._begin(None)

    def bind(self, *arrays: Any) -> None:
        super().bind(*arrays)
        if self.options.tool is not None and self._kind != "joints":
            flange = self._model.frames[self._model.getFrameId(FLANGE)]
            place = flange.placement * pin.SE3(rotation.homogeneous(self.transform["tool"]))
            self._frame = self._model.addFrame(
                pin.Frame("control_point", flange.parentJoint, 0, place, pin.FrameType.OP_FRAME)
            )
            self._data = self._model.createData()

    def reset(self) -> None:
        self._old[:] = self.input["target"]
        self._speed = 0.0
        self._begin(None)
        self._unseen, self._seed, self.lost = 0.0, 0, False
        q = self.applied.get("q", self.input["q"]) if self.options.command == "position" else self.input["q"]
        self._command(np.array(q), np.zeros_like(q))
        self._tell(Mode.NO_GOAL)

    def update(self, dt: float) -> None:
        measured = self.input["q"]
        good = bool(np.isfinite(measured).all())
        self._unseen = 0.0 if good else self._unseen + dt
        self.lost = self._unseen > self.options.timeout
        q = np.array(self.applied.get("q", self.output.get("q", measured)))
        if self.options.command == "velocity":
            q = np.array(measured)
        if not (good and np.isfinite(q).all()):
            self._speed = 0.0  # where it goes on from isn't known
            self._forget()
            self._command(np.full_like(q, np.nan), np.full_like(q, np.nan))
            return
        if (goal := self._new_goal()) is not None:
            self._begin(goal)
        here = q / self._scale
        if self._speed > 0.0:
            self._pass(here)
        self._was, self._last = here, dt
        if self._stops and self._speed > 0.0:
            self._go(q, here, here + self._along, dt, 0.0)
            return
        self._stops = False
        if self._wanted is None:
            self._command(q, np.zeros_like(q))
            self._tell(Mode.NO_GOAL)
            return
        self._towards(q, here, dt)

    def _pass(self, here: Array) -> None:
        """What the guard let through of the last step: the slowest joint says how fast all go on."""
        velocity = self.applied.get("velocity")
        passed = (here - self._was) / max(self._last, 1e-9) if velocity is None else velocity / self._scale
        wanted = self._along * self._speed
        moving = np.abs(wanted) > 1e-6
        ratio = float(np.clip(passed[moving] / wanted[moving], 0.0, 1.0).min()) if moving.any() else 1.0
        self._speed *= ratio if ratio > 1.0 - 1e-6 else 0.9 * ratio

    # -- goals

    def _new_goal(self) -> Array | None:
        """The newest target in the arm's base, if it differs from the last: joints, a place, or place and rotation."""
        target = self.input["target"]
        if not np.isfinite(target).all():
            return None
        sign = -1.0 if self._kind == "pose" and float(target[3:] @ self._old[3:]) < 0.0 else 1.0
        change = target - self._old
        change[3:] = target[3:] - sign * self._old[3:] if self._kind == "pose" else change[3:]
        if bool((np.abs(change) <= self.options.tolerance).all()):
            return None
        if self._kind == "joints":
            self._old[:] = target
            return target.copy()
        if not self._place.update(target, self.transform["target"], 0.0):
            return None
        self._old[:] = target
        return self._place.position.copy()

    def _begin(self, wanted: Array | None) -> None:
        """A new goal. What moves brakes first."""
        self._wanted, self._turn = wanted, self._place.turn
        self._goals: list[Array] = []  # scaled postures, the nearest first
        self._corners = 0
        self._failed = False
        self._margin = 0.0
        self._tried = 0.0
        self._forget()
        self._stops = self._speed > 0.0

    def _forget(self) -> None:
        """What was searched from elsewhere counts no more."""
        self._goal_search: GoalSearch | None = None
        self._search: Way | None = None
        self._way = []

    # -- all below in seconds of the way: positions over the joints' speeds

    def _towards(self, q: Array, here: Array, dt: float) -> None:
        if self._way:
            if (np.abs(self._way[0] - here) < self._close).all() and self._speed <= 3 * NEAR:
                self._from, self._speed = self._way.pop(0), 0.0
            if self._way and self._beside(here) > _BESIDE + self._allowed:
                self._stops = self._speed > 0.0
                self._forget()
                self._go(q, here, here + self._along, dt, 0.0)
                return
            if self._way:
                self._go(q, here, self._way[0], dt, 1.0)
                return
        if self._goals and self._search is None and (np.abs(self._goals[0] - here) < 2 * self._close).all():
            rest = (self._goals[0] - here) * _GAIN if self.options.command == "velocity" else np.zeros_like(q)
            self._speed = 0.0
            self._command(self._goals[0] * self._scale, np.clip(rest, -0.05, 0.05) * self._scale)
            self._tell(Mode.ARRIVED, self._room(here))
            return
        margin = self._room(here)
        if not margin >= 0.0:
            self._leave(q, here, dt)
            return
        self._tried = 0.0
        self._command(q, np.zeros_like(q))
        if self._goals:
            self._look(here, margin)
        else:
            self._postures(here, margin)

    def _beside(self, here: Array) -> float:
        """m that a point of the arm may be beside the straight way that was judged."""
        piece = self._way[0] - self._from
        t = float(np.clip((here - self._from) @ piece / max(float(piece @ piece), 1e-12), 0.0, 1.0))
        return float(np.abs(here - self._from - t * piece) @ self._levers)

    def _bounds(self, here: Array) -> tuple[Array, Array]:
        """(n,) scaled each; a joint that turns without an end is searched half a turn to either side."""
        robot, q = self.options.robot, here * self._scale
        low = np.where(np.isfinite(robot.q_lower), robot.q_lower, q - np.pi)
        high = np.where(np.isfinite(robot.q_upper), robot.q_upper, q + np.pi)
        return low / self._scale, high / self._scale

    def _postures(self, here: Array, margin: float) -> None:
        """Looks for postures at the goal, one iteration in a cycle."""
        assert self._wanted is not None
        if self._kind == "joints":
            if bool(((self._wanted < self._lower) | (self._wanted > self._upper)).any()):
                self._tell(Mode.UNREACHABLE, margin)
                return
            self._goals = [self._wanted / self._scale]
            self._margin = self._room(self._goals[0]) - self._allowed
            self._tell(Mode.SEARCHING, margin)
            return
        if self._goal_search is None:
            self._goal_search = GoalSearch(self._residual, self._free, self._scale)
        low, high = self._bounds(here)
        found = self._goal_search.step(here * self._scale, low * self._scale, high * self._scale)
        if found:
            self._goals = [q / self._scale for q in found]
            self._margin = self._room(self._goals[0]) - self._allowed
        self._tell(self._goal_search.mode, margin)

    def _free(self, path: Array) -> NDArray[np.bool_]:
        return np.array([self._distances.margin(q) >= self._allowed for q in path])

    def _look(self, here: Array, margin: float) -> None:
        """Looks for a way, some postures in a cycle."""
        if self._search is not None and float(np.abs(here - self._search.start) @ self._levers) > _BESIDE / 2:
            self._search = None  # the arm isn't where it was
        if self._margin >= 0.0:
            if self._search is None:
                self._seed += 1
                self._search = Way(here, self._goals[0], *self._bounds(here), self._levers, self._seed)
            way = self._search.look(lambda point: self._room(point) - self._allowed, self.options.postures)
            if way is not None:
                self._way, self._corners, self._search, self._from = way[1:], len(way) - 2, None, way[0]
            elif self._search.looked >= self.options.max_postures:
                self._failed, self._search = True, None
                if len(self._goals) > 1:
                    self._goals.append(self._goals.pop(0))
                    self._margin = self._room(self._goals[0]) - self._allowed
        self._tell(Mode.WAITING if self._failed or not self._margin >= 0.0 else Mode.SEARCHING, margin)

    def _residual(self, path: Array) -> tuple[Array, Array]:
        """What is missing of the tool's goal, (m, r) m, and the tool's Jacobians (m, r, n)."""
        rows = 3 if self._turn is None else 6
        missing, J = np.empty((len(path), rows)), np.empty((len(path), rows, path.shape[1]))
        weight = self.options.rotation_weight
        goal = None if self._turn is None else np.array(rotation.matrix(self._turn))
        for k, q in enumerate(path):
            full = pin.computeFrameJacobian(self._model, self._data, q, self._frame, pin.LOCAL_WORLD_ALIGNED)
            place = pin.updateFramePlacement(self._model, self._data, self._frame)
            missing[k, :3], J[k, :3] = self._wanted - place.translation, full[:3]
            if goal is not None:
                missing[k, 3:], J[k, 3:] = weight * pin.log3(goal @ place.rotation.T), weight * full[3:]
        return missing, J

    def _room(self, point: Array) -> float:
        """m that a scaled posture keeps more than it must."""
        return self._distances.margin(point * self._scale)

    # -- motion

    def _acceleration(self, way: Array) -> float:
        """Of the scaled way, so that no joint accelerates more than it may."""
        u = np.abs(way) / max(float(np.abs(way).max()), 1e-12)
        return float((self._rate / np.maximum(u, 1e-9)).min())

    def _go(self, q: Array, here: Array, end: Array, dt: float, most: float) -> None:
        """One step on the straight way to `end`, at which it stops; `most` 0: it brakes on it."""
        way = end - here
        far = float(np.abs(way).max())
        u = way / max(far, 1e-12)
        turned = np.abs(u - self._along) * self._speed
        if most > 0.0 and bool((turned > 3.0 * self._rate * dt).any()):
            u, most = self._along, 0.0  # its end is elsewhere now, or behind it: it brakes first
        a = self._acceleration(u)
        # In steps of dt it stops in time where v dt + v^2 / 2 b is no more than what is left.
        b = 0.9 * a
        speed = min(self._speed + a * dt, most * (((b * dt) ** 2 + 2.0 * b * far) ** 0.5 - b * dt), most)
        if self.options.command == "velocity":
            speed = min(speed, _GAIN * far)
        self._speed, self._along = max(speed, self._speed - a * dt, 0.0), u
        # A joint that the guard keeps holding goes on to be tried, and the arm says that it waits.
        self._tried = self._tried + dt if most > 0.0 and self._speed < 2.0 * a * dt and far > 10 * NEAR else 0.0
        v = u * self._speed * self._scale
        self._command(q + v * dt, v)
        mode = Mode.AROUND if self._corners else Mode.DIRECT
        self._tell(Mode.WAITING if self._tried > _TRIES else mode, self._room(here))

    def _leave(self, q: Array, here: Array, dt: float) -> None:
        """Out of what is too near, by the distances' own gradients. After `_TRIES` s without getting out it waits."""
        near = self._distances(q, np.zeros_like(q))
        short = np.maximum(self.options.distances.least + _OUT - near.distance, 0.0)
        way = (short @ near.gradient) / self._scale
        way = np.where(((q <= self._lower) & (way < 0.0)) | ((q >= self._upper) & (way > 0.0)), 0.0, way)
        size = float(np.abs(way).max(initial=0.0))
        self._tried += dt
        if near.overlaps or size < 1e-9 or self._tried > _TRIES:  # which way leads out isn't known
            self._speed = 0.0
            self._command(q, np.zeros_like(q))
            self._tell(Mode.WAITING, self._room(here))
            return
        u = way / size
        if self._speed > 0.0 and float(u @ self._along) < 0.5 * float(self._along @ self._along):
            u, pace = self._along, 0.0  # it turns round: it brakes first
        else:
            pace = min(_PACE, _GAIN * float(short.max()) / max(float(np.abs(u) @ self._levers), 1e-9))
        a = self._acceleration(u)
        self._speed, self._along = max(min(self._speed + a * dt, pace), self._speed - a * dt, 0.0), u
        v = u * self._speed * self._scale
        self._command(q + v * dt, v)
        self._tell(Mode.LEAVING, self._room(here))

    def _command(self, q: Array, v: Array) -> None:
        if self.options.command == "velocity":
            self.output["velocity"][:] = v
            return
        self.output["q"][:], self.output["q_velocity"][:] = q, v

    def _tell(self, mode: Mode, here: float = 0.0) -> None:
        self.output["state"][0] = mode
        self.output["margin"][:] = min(here, _FAR), min(self._margin, _FAR)

    def metrics(self) -> dict[str, object]:
        """The least distance that was seen, its pair, and the pairs that aren't compared."""
        return self._distances.metrics()
