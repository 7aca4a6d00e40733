"""`cartesian-follow`: an arm's tool follows a pose or a point, within joint limits and off what it may hit."""

from __future__ import annotations

from math import pi
from typing import Any, ClassVar, Final, Literal

import numpy as np
import pinocchio as pin
from pydantic import Field, ValidationInfo, field_validator

from srl.control.arm.options import each, joints
from srl.control.arm.tool_target import ToolTarget
from srl.control.cobot.robot_distances import OPENING, DistancesConfig, RobotDistances
from srl.control.cobot.whole_body_qp import Approach, ArmLimitsConfig, Nearest, braking_curve
from srl.control.shared.ramp import Ramps, factor
from srl.runtime.contracts import rotation
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.per_element import Positive
from srl.runtime.contracts.rotation import Vector
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT, POSE
from srl.runtime.contracts.transforms import Transform, coordinates, device, frame
from srl.runtime.models.robot_model import RobotOption
from srl.runtime.models.robots import RobotDescription
from srl.runtime.models.robots.pinocchio_model import FLANGE, pinocchio_model

_SAME: Final = 1e-9  # rad or m, by which a command that was let through may differ
_ROUND: Final = 0.3  # rad beyond a half turn, up to which the tool keeps the way round that it has taken
_UNKNOWN: Final = 1.0  # rad/s or m/s, of a joint whose greatest speed nobody says


class ArmDistancesConfig(DistancesConfig):
    """Options under `limits.distances`: obstacles and ground are in the arm's base frame, and move with it."""

    ground: bool = Field(False, description="keep off the plane z = 0 of the arm's base frame as well")


class FollowLimitsConfig(ArmLimitsConfig):
    """Options under `limits`."""

    distances: ArmDistancesConfig | None = Field(
        None, description="keeps the arm off itself and what stands in its base frame; null: doesn't look"
    )


class CartesianFollowConfig(ControllerConfig):
    """Options of `cartesian-follow`."""

    renamed: ClassVar[dict[str, str]] = {
        "leash": "max_following_error", "patience": "timeout", "lever": "rotation_weight", "spared": "joint_weight",
    }  # fmt: skip

    robot: RobotOption = Field(description="the arm: a robot of `models:`, or one of the runtime's")
    tool: str | None = Field(None, description="frame of the control point, on the arm's flange; null: the flange")
    target: Literal["pose", "point"] = Field("pose", description="what is followed; a point leaves the rotation free")
    offset: Vector = Field((0.0, 0.0, 0.0), description="m, added to the target in its signal's coordinates")
    command: Literal["position", "velocity"] = Field("position", description="what the device takes")
    gain: float = Field(4.0, gt=0, le=50, description="1/s, at which what is missing is made up for")
    speed: float = Field(0.3, gt=0, le=3, description="m/s of the tool, the most")
    turning: float = Field(1.0, gt=0, le=10, description="rad/s of the tool, the most")
    ahead: float = Field(0.05, ge=0, le=1, description="s, low-pass on the target's velocity that is led; 0: none")
    rotation_weight: Positive = Field(0.2, description="m: a rad of rotation counts as much as this")
    farthest: Positive = Field(1.5, description="m: a target that is farther from the tool isn't followed")
    timeout: float = Field(1.0, gt=0, le=10, description="s without a target after which the limb stops")
    damping: Positive = Field(0.03, description="m/rad, of the least squares near singular postures")
    posture: float = Field(0.2, ge=0, le=5, description="1/s, pull to the posture of the reset, where there is room")
    joint_weight: dict[str, Positive] | Positive = Field(
        1.0, description="by joint: how much it is spared beside the others"
    )
    joint_speed: float = Field(0.5, gt=0, le=1, description="share of the robot's greatest joint speeds")
    max_following_error: Positive = Field(
        0.3, description="rad or m: a joint so far ahead of the measured isn't commanded further"
    )
    limits: FollowLimitsConfig = FollowLimitsConfig()

    @field_validator("joint_weight")
    @classmethod
    def _of_joints(cls, given: Any, info: ValidationInfo) -> Any:
        if (robot := info.data.get("robot")) is not None:
            each(given, robot, "joint_weight")
        return given


class CartesianFollow(Controller):
    """The joint velocities nearest to gain · (target - tool) + the target's own velocity, within all limits.

    Inputs: `q` (n,) rad, measured; `target` (7,) m and w x y z, or (3,) m with `target: point`, in any frame that the
    tree connects with the arm's base, also through measured frames.

    Outputs: `q` (n,) rad and `q_velocity` (n,) rad/s, or `velocity` (n,) with `command: velocity`; `missing` (1,) m,
    from the tool to the target. Where a joint slides, m and m/s.

    The quadratic program is that of `kairos-qp` for an arm alone (docs/whole-body-qp.md): first the tool, then little
    motion near the posture of the reset; position limits with braking curves, joint speeds and accelerations as
    intervals; distances as soft rows. It works on what was applied, not on the measured joints: what the guard holds
    back isn't wound up.

    It starts at rest where the limb is. A target that isn't there, or is farther than `farthest`, isn't followed: the
    joints brake, and after `timeout` the limb stops; so it does without the measured joints, also at a reset, and goes
    on where the limb is when they are back. A jump of the target is approached at `speed`.
    """

    Config = CartesianFollowConfig
    summary = "an arm's tool follows a pose or a point: quadratic program with joint limits and distances"

    def __init__(self, name: str, config: CartesianFollowConfig) -> None:
        super().__init__(name, config)
        robot = config.robot
        point = config.target == "point"
        target = (
            Signal(name="target", shape=(3,), unit="m", labels=POINT)
            if point
            else Signal(name="target", shape=(7,), unit="m", labels=POSE)
        )
        self.inputs = (joints(robot, "q", "rad"), target)
        moved = (
            (joints(robot, "q", "rad"), joints(robot, "q_velocity", "rad/s"))
            if config.command == "position"
            else (joints(robot, "velocity", "rad/s"),)
        )
        self.outputs = (*moved, Signal(name="missing", shape=(1,), unit="m"))
        speed = factor("speed", 0.0, 1.0, "of the tool's greatest speed")
        self._ramps = Ramps(speed, factor("gain", 0.25, 2.0, "of the gain"))
        self.parameters = self._ramps.parameters
        need = "the target's frame in the arm's base"
        self.transforms = (Transform("target", coordinates("target"), device("q"), need, moves=True),)
        if config.tool is not None:
            need = "the control point in the flange's frame"
            self.transforms += (Transform("tool", frame(config.tool), device("q", FLANGE), need),)
        self._config, self._n = config, robot.n
        self._model: Any = pinocchio_model(robot)
        self._data: Any = self._model.createData()
        self._frame = self._model.getFrameId(FLANGE)
        self._approach = Approach(_Bounds(robot), config.limits, config.joint_speed)
        self._nearest = Nearest(config.limits.priority)
        rows = 3 if point else 6
        self._Q = np.array([1.0, 1.0, 1.0, *[config.rotation_weight**2] * 3][:rows])
        self._W = np.diag(config.damping**2 * each(config.joint_weight, robot, "joint_weight"))
        distances = config.limits.distances
        self._distances = None if distances is None else RobotDistances(robot, None, distances)
        self._target = ToolTarget(config.ahead, config.offset)
        self._posture, self._q, self._was, self._v = (np.zeros(robot.n) for _ in range(4))
        self._known = False  # where the joints began
        self._turn: Vector = (0.0, 0.0, 0.0)
        self._cycles = self._limited = self._blind = 0
        self._worst = self._unseen = 0.0

    def bind(self, *arrays: Any) -> None:
        super().bind(*arrays)
        if self._config.tool is not None:
            flange = self._model.frames[self._model.getFrameId(FLANGE)]
            place = flange.placement * pin.SE3(rotation.homogeneous(self.transform["tool"]))
            point = pin.Frame("control_point", flange.parentJoint, 0, place, pin.FrameType.OP_FRAME)
            self._frame = self._model.addFrame(point)
            self._data = self._model.createData()

    def reset(self) -> None:
        self._start()
        self._turn = (0.0, 0.0, 0.0)
        self._target.reset()
        self._ramps.reset(self.param)
        self._unseen = 0.0
        self.lost = self.contact = False
        self.output["missing"][0] = 0.0
        self._write()

    def update(self, dt: float) -> None:
        self._cycles += 1
        self._ramps.update(self.param, dt)
        if not self._take(dt):
            return
        J = self._jacobian()
        lower, upper = self._approach.speeds(self._q, self._v, dt)
        if self._config.command == "position":
            # A joint that something holds isn't commanded further away from where it is.
            ahead = self._q - self.input["q"]
            upper = np.where(ahead > self._config.max_following_error, np.maximum(lower, np.minimum(upper, 0.0)), upper)
            lower = np.where(
                ahead < -self._config.max_following_error, np.minimum(upper, np.maximum(lower, 0.0)), lower
            )
        rows, least = self._gaps(dt)
        away = self._away(dt)
        metric, A = self._W, J[: len(self._Q)]
        pull = self._ramps.values["speed"] * self._config.posture * (self._posture - self._q)
        if away is None:
            x = np.zeros(self._n)
        else:
            H = A.T.dot(self._Q[:, None] * A) + metric
            x = np.linalg.solve(H, A.T.dot(self._Q * away) + metric.dot(pull))
        if (x < lower).any() or (x > upper).any() or (rows.dot(x) < least).any():
            self._limited += 1
            step = self._nearest(
                A, self._Q, metric, np.concatenate([lower - x, least - rows.dot(x)]),
                np.concatenate([upper - x, np.full(len(rows), np.inf)]), rows, soft=len(rows),
            )  # fmt: skip
            # Without a solution: brake, which is always within the limits.
            x = np.clip(0.0 if step is None else x + step, lower, upper)
        if self._config.command == "position":
            self._was[:] = self._q
            self._q += dt * (self._v + x) / 2
        self._v[:] = x
        self._write()

    def metrics(self) -> dict[str, object]:
        """Shares of cycles with an active limit and without a target, the greatest distance missed, solver failures."""
        cycles = max(self._cycles, 1)
        return {
            "limited": self._limited / cycles,
            "blind": self._blind / cycles,
            "missing_m": self._worst,
            "solver_failures": self._nearest.failures,
            **({} if self._distances is None else self._distances.metrics()),
        }

    # -- parts of a cycle

    def _start(self) -> None:
        """Takes the joints and their posture from where the limb is, if that is known."""
        position = self._config.command == "position"
        q = self.applied.get("q", self.input["q"]) if position else self.input["q"]
        v = 0.0 if position else self.applied.get("velocity", 0.0)
        self._q[:], self._posture[:], self._was[:], self._v[:] = q, q, q, v
        self._known = bool(np.isfinite(self._q).all() and np.isfinite(self._v).all())

    def _take(self, dt: float) -> bool:
        """Where the joints are, as far as the guard let them; False: they aren't known."""
        measured = self.input["q"]
        if np.isfinite(measured).all() and not self._known:
            self._start()
        if not (np.isfinite(measured).all() and self._known):
            for name in ("q", "velocity"):
                if name in self.output:
                    self.output[name][:] = np.nan  # the guard brakes; nothing of it stays
            self._unseen += dt
            self.lost = self._unseen > self._config.timeout
            return False
        if self._config.command == "velocity":
            self._q[:] = measured
            self._v[:] = self.applied.get("velocity", self._v)
            return True
        applied = self.applied.get("q")
        if applied is None:
            q = np.clip(
                self._q, measured - self._config.max_following_error, measured + self._config.max_following_error
            )
            self._v[q != self._q] = 0.0
            self._q[:] = q
            return True
        held = np.abs(applied - self._q) > _SAME
        if held.any():  # the guard let less of the last step through
            real = (applied - self._was) / max(dt, 1e-9)
            self._v[held] = np.clip(real, np.minimum(self._v, 0.0), np.maximum(self._v, 0.0))[held]
            self._q[:] = applied
        return True

    def _jacobian(self) -> Array:
        """(6, n) of the tool, base axes; the tool's place is in the data."""
        J: Array = pin.computeFrameJacobian(self._model, self._data, self._q, self._frame, pin.LOCAL_WORLD_ALIGNED)
        pin.updateFramePlacement(self._model, self._data, self._frame)
        return J

    def _away(self, dt: float) -> Array | None:
        """The twist (6,) or velocity (3,) that is wanted, m/s and rad/s; None: there is no target."""
        config, target, share = self._config, self._target, self._ramps.values
        place = self._data.oMf[self._frame]
        seen = target.update(self.input["target"], self.transform["target"], dt)
        gap = target.position - place.translation
        far = float(np.linalg.norm(gap))
        seen = seen and far <= config.farthest
        self._unseen = 0.0 if seen else self._unseen + dt
        self.lost = self._unseen > config.timeout
        if not seen:
            self._blind += 1
            self._turn = (0.0, 0.0, 0.0)
            return None
        self.output["missing"][0] = far
        self._worst = max(self._worst, far)
        gain = share["gain"] * config.gain
        lead = target.velocity if config.ahead > 0.0 else np.zeros(3)
        wanted = _bounded(gain * gap + lead, share["speed"] * config.speed)
        if target.turn is None:
            return wanted
        x, y, z, w = pin.Quaternion(place.rotation).coeffs().tolist()
        turn = rotation.product(target.turn, rotation.conjugate((w, x, y, z)))
        self._turn = rotation.log_nearest(turn, self._turn)
        if float(np.linalg.norm(self._turn)) > pi + _ROUND:
            self._turn = rotation.log(turn)  # the target has jumped: it isn't approached the long way round
        return np.concatenate([wanted, _bounded(gain * np.array(self._turn), share["speed"] * config.turning)])

    def _gaps(self, dt: float) -> tuple[Array, Array]:
        """Rows (k, n) on the velocities, and the least rate of each gap (k,), m/s."""
        distances, options = self._distances, self._config.limits.distances
        if distances is None or options is None:
            return np.zeros((0, self._n)), np.zeros(0)
        near = distances(self._q, self._v)
        self.contact = near.overlaps
        speed, _ = braking_curve(near.distance - options.least, options.braking, 0.5 * self._approach.rate(dt))
        return near.gradient, np.minimum(-speed, OPENING)

    def _write(self) -> None:
        if self._config.command == "velocity":
            self.output["velocity"][:] = self._v
            return
        self.output["q"][:] = self._q
        self.output["q_velocity"][:] = self._v


class _Bounds:
    """An arm's limits, with a speed for joints of which nobody says one."""

    def __init__(self, robot: RobotDescription) -> None:
        self.n = robot.n
        self.q_lower, self.q_upper, self.ddq_max = robot.q_lower, robot.q_upper, robot.ddq_max
        self.dq_max: Array = np.where(np.isfinite(robot.dq_max), robot.dq_max, _UNKNOWN)


def _bounded(v: Array, most: float) -> Array:
    """The vector, made shorter where it is longer than `most`."""
    length = float(np.linalg.norm(v))
    return v if length <= most else v * (most / length)
