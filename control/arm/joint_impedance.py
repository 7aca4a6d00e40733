"""`joint-impedance`: a spring and a damper at each joint, on top of gravity as it is for a base that tilts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property
from math import ceil, sqrt
from typing import Any, ClassVar, Final, Literal, Self

import numpy as np
import pinocchio as pin
from pydantic import Field, FiniteFloat, field_validator, model_validator

from srl.control.arm.accepted import AcceptedPositions
from srl.control.arm.options import each, joints
from srl.control.arm.sampled import GROWTH, cases, growth
from srl.control.arm.uprightness import Uprightness, by_frames, by_sensor
from srl.control.cobot.whole_body import LoadConfig
from srl.control.shared.ramp import Ramps, factor
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.gravity import GRAVITY
from srl.runtime.contracts.per_element import NotNegative, Positive
from srl.runtime.contracts.rotation import Vector
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import QUATERNION
from srl.runtime.contracts.transforms import Transform, device, frame, measured
from srl.runtime.models.robot_model import WeighedRobot
from srl.runtime.models.robots.pinocchio_model import pinocchio_model

_SOFT: Final = 0.25  # of K, below which D goes to zero with K itself, not with its root
_LEAD: Final = 0.03  # s, low-pass on the desired joints' speed: it may jump, the torque not
_SHORTEST: Final = 1e-4  # s: no loop is quicker
_SOURCES: Final = {"imu": "the sensor of 'orientation'", "frames": "the tree of frames", "base": "'up'"}
_HELD_BACK: Final = 0.1  # N m: a larger difference of asked and applied torque counts as held back

_PerJoint = dict[str, NotNegative] | NotNegative


class JointImpedanceConfig(ControllerConfig):
    """Options of `joint-impedance`."""

    renamed: ClassVar[dict[str, str]] = {"leash": "max_following_error", "patience": "timeout"}

    robot: WeighedRobot = Field(description="the arm: a robot of `models:`, or one of the runtime's")
    stiffness: _PerJoint = Field(description="N m/rad (N/m where it slides), by joint or one for all")
    damping_ratio: float = Field(0.7, gt=0, le=2, description="of each joint alone: D = 2 ratio sqrt(K M_ii)")
    rotor_inertia: _PerJoint = Field(
        0.0, description="kg m^2 at the joint, through the gear; it counts in the damping only"
    )
    most: dict[str, Positive] | Positive | None = Field(
        None, description="N m, by joint: the spring's greatest torque; null: half of the robot's effort"
    )
    max_following_error: Positive = Field(
        0.5, description="rad or m, by which the desired joints are ahead of the measured at most"
    )
    speed: dict[str, Positive] | Positive = Field(0.5, description="rad/s, by joint, of the desired joints")
    lead: float = Field(
        0.0,
        ge=0,
        le=1,
        description="share of the desired joints' own speed that isn't damped: less lag behind `wanted`",
    )
    follow: bool = Field(True, description="follow the input `wanted`; false: hold where the limb was at the reset")
    gravity: Literal["here", "robot"] = Field("here", description="who holds the arm's weight; `robot`: its controller")
    upright: Literal["imu", "frames", "base"] = Field(
        "base",
        description="what says where up is: the input `orientation`, the frame `world`, or it is always `up`",
    )
    world: str = Field("world", description="with `upright: frames`: a frame with z up, in which the base is known")
    up: tuple[FiniteFloat, FiniteFloat, FiniteFloat] = Field(
        (0.0, 0.0, 1.0), description="up in the base's axes where the wearer stands; its length doesn't matter"
    )
    tilt_limit: float = Field(
        1.05,
        gt=0,
        le=3.15,
        description="rad, by which a worn base leans from there at most: farther, up is measured wrong",
    )
    smooth: float = Field(0.02, ge=0, le=1, description="s, time constant of the low-pass on where up is")
    timeout: float = Field(
        0.5, gt=0, le=10, description="s without it, beyond `tilt_limit`, or without `q`, after which the limb stops"
    )
    payload: LoadConfig | None = Field(None, description="what the flange always carries, beside the URDF's links")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        for key in ("stiffness", "rotor_inertia", "speed", *(("most",) if self.most is not None else ())):
            each(getattr(self, key), self.robot, key)
        if self.most is None and not np.isfinite(self.robot.tau_max).all():
            problem = f"most: {self.robot.name} has no effort limit of each joint, so nothing bounds the spring"
            raise OptionError(problem, "Give `most`, N m, or the limits in `models:`")
        return self

    @field_validator("up")
    @classmethod
    def _unit(cls, up: Vector) -> Vector:
        x, y, z = up
        length = (x * x + y * y + z * z) ** 0.5
        if length < 1e-6:
            raise OptionError("it has no direction", "Give the axis that points up where the wearer stands")
        return (x / length, y / length, z / length)


class JointImpedance(Controller):
    """tau = sat(K (q_d - q) + lead D v_d) - D qd + g(q, up): compliant, and passive for a desired position that stands.

    Inputs: `q` (n,) rad and `qd` (n,) rad/s, measured; with `follow` also `wanted` (n,) rad; with `upright: imu` also
    `orientation` (4,), w x y z, of the sensor that is fixed to the arm's base.

    Outputs: `torque` (n,) N m; `gravity` (n,) N m, its part that holds the weight, which the guard must know
    (`<device>.torque_command.gravity`); `desired` (n,) rad, q_d. Where a joint slides, the units are m, m/s and N.

    D = 2 ratio sqrt(K M_ii(q)) is never negative, and the spring's torque is bounded, so that the joints give to their
    surroundings no more than the energy that is in M and K (Ortega and Spong 1989; Albu-Schaeffer et al. 2007,
    IJRR 26(1), for joint stiffness). q_d moves at most at `speed` towards `wanted`. A limb that is pushed further than
    the spring's greatest torque or the `max_following_error` takes q_d along: that gives no energy back, and winds
    nothing up; v_d, the speed at which q_d goes towards `wanted`, is zero then. If
    K grows, q_d comes nearer, so that the torque stays: stiffening gives the limb no energy either.

    At a reset q_d is where the limb is. While `wanted` isn't a number, q_d stays. While nothing says where up is, it
    stays as it was, and after `timeout` the limb stops. Where up is farther from `up` than `tilt_limit`, the limb
    stops too, at a reset at once; `Uprightness` says what up is then. A sample of `q` that no motion explains moves
    nothing: the torque is that of the one before. If it lasts, and while `q` isn't a number, there is no torque (NaN:
    the guard damps), after `timeout` the limb stops, and when `q` is back, q_d begins where the limb is then.
    """

    Config = JointImpedanceConfig
    summary = "spring and damper at each joint, with gravity for a base that tilts (torque)"

    def __init__(self, name: str, config: JointImpedanceConfig) -> None:
        super().__init__(name, config)
        robot = config.robot
        self.inputs = (joints(robot, "q", "rad"), joints(robot, "qd", "rad/s"))
        if config.follow:
            self.inputs += (joints(robot, "wanted", "rad"),)
        if config.upright == "imu":
            self.inputs += (Signal(name="orientation", shape=(4,), unit="1", labels=QUATERNION),)
            need = "the sensor in the arm's base"
            self.transforms = (Transform("mount", measured("orientation"), device("q"), need),)
        elif config.upright == "frames":
            need = "the arm's base in a frame with z up"
            self.transforms = (Transform("base", device("q"), frame(config.world), need, moves=True),)
        self.outputs = tuple(
            joints(robot, *what) for what in (("torque", "N m"), ("gravity", "N m"), ("desired", "rad"))
        )
        stiffness = factor("stiffness", 0.0, 1.5, "multiplies K; 0: led by hand")
        self._ramps = Ramps(stiffness, factor("damping", 0.5, 1.5, "multiplies D"))
        self.parameters = self._ramps.parameters
        self._config, self._n = config, robot.n
        self._K = each(config.stiffness, robot, "stiffness")
        self._rotors = each(config.rotor_inertia, robot, "rotor_inertia")
        self._speed = each(config.speed, robot, "speed")
        self._most = 0.5 * robot.tau_max if config.most is None else each(config.most, robot, "most")
        self._lower, self._upper = robot.q_lower, robot.q_upper
        payload = config.payload.payload() if config.payload is not None else None
        self._model: Any = pinocchio_model(robot, payload=payload)
        self._data: Any = self._model.createData()
        self._up = Uprightness(config.smooth, config.up, config.tilt_limit)
        self._joints = AcceptedPositions(robot.dq_max)
        self._q_d, self._v_d = np.zeros(robot.n), np.zeros(robot.n)
        self._D = np.zeros(robot.n)
        self._cycles = self._held_back = self._back_driven = self._rejected = 0

    def reset(self) -> None:
        self._ramps.reset(self.param)
        self._up.reset(self._found())
        self._joints.reset(self.input["q"])
        self._q_d[:] = self._joints.q
        self._v_d[:] = 0.0
        self._judge()
        self._step()

    def update(self, dt: float) -> None:
        self._watch()
        self._up.update(self._found(), dt)
        self._joints.update(self.input["q"], dt)
        self._judge()
        before = self._ramps.values["stiffness"]
        self._ramps.update(self.param, dt)
        self._desire(before, dt)
        self._step()

    def update_gravity(self, dt: float) -> None:
        self._up.update(self._found(), dt)
        self._joints.update(self.input["q"], dt)
        if self._joints.known:
            self._weight()

    def narrow(self, dt: float) -> None:
        touched, (stiffness, damping) = self._touched, self.parameters
        up = _largest(lambda s: self._damps(dt, touched, _part(stiffness.upper, s), _part(damping.upper, s)))
        stiffest = _part(stiffness.upper, up)
        down = _largest(lambda s: self._damps(dt, touched, stiffest, _part(damping.lower, s)))
        self.parameters = (
            replace(stiffness, upper=stiffest),
            replace(damping, lower=_part(damping.lower, down), upper=_part(damping.upper, up)),
        )

    def warnings(self, dt: float) -> Iterator[tuple[str, str]]:
        touched = self._touched
        if self._damps(dt, touched):
            return
        late, enough = dt, dt / 2
        while enough > _SHORTEST and not self._damps(enough, touched):
            late, enough = enough, enough / 2
        remedy = "Lower it, and 'damping_ratio'"
        if enough > _SHORTEST:
            for _ in range(6):
                middle = (late + enough) / 2
                late, enough = (late, middle) if self._damps(middle, touched) else (middle, enough)
            remedy = f"Raise 'rate' to {ceil(0.1 / enough) * 10} Hz"
        yield (
            "stiffness",
            f"at {1 / dt:g} Hz its torques are too late to damp: against something stiff, or by itself, the arm swings "
            f"up unless friction in its joints takes it. {remedy}",
        )

    def metrics(self) -> dict[str, object]:
        """Shares of cycles: torque held back, desired joints taken along (back-driven), `q` rejected."""
        cycles = max(self._cycles, 1)
        return {
            "held_back": self._held_back / cycles, "back_driven": self._back_driven / cycles,
            "rejected": self._rejected / cycles
        }  # fmt: skip

    # -- parts of a cycle

    def _judge(self) -> None:
        """Whether what the law needs has been missing, or beyond belief, for too long."""
        up, timeout = self._up, self._config.timeout
        leans = up.beyond > timeout
        self.lost = leans or max(up.missing, self._joints.missing) > timeout
        self.why = up.why(_SOURCES[self._config.upright]) if leans else ""

    def _found(self) -> tuple[float, float, float] | None:
        """Where up is now in the base."""
        if self._config.upright == "imu":
            return by_sensor(self.input["orientation"], self.transform["mount"])
        if self._config.upright == "frames":
            return by_frames(self.transform["base"])
        return self._config.up

    def _desire(self, before: float, dt: float) -> None:
        """Moves q_d for dt seconds. `before`: the factor of K in the last cycle."""
        q, q_d, joints = self._joints.q, self._q_d, self._joints
        self._rejected += bool((q != self.input["q"]).any())
        if not joints.known:
            return
        if joints.anew:  # the limb may be elsewhere by now
            q_d[:] = q
            self._v_d[:] = 0.0
        k = self._ramps.values["stiffness"]
        if k > before:
            q_d[:] = q + before / k * (q_d - q)
        wanted = self.input["wanted"] if self._config.follow else q_d
        step = np.zeros(self._n)
        if np.isfinite(wanted).all():
            aim = np.clip(wanted, self._lower, self._upper)
            step = np.clip(aim - q_d, -self._speed * dt, self._speed * dt)
            q_d += step
        with np.errstate(divide="ignore"):
            reach = np.minimum(
                np.where(k * self._K > 0.0, self._most / (k * self._K), np.inf), self._config.max_following_error
            )
        taken = np.clip(q_d, q - reach, q + reach)
        self._back_driven += bool((taken != q_d).any())
        if dt > 0.0:
            self._v_d += dt / (dt + _LEAD) * (step / dt - self._v_d)
        self._v_d[taken != q_d] = 0.0
        q_d[:] = taken

    def _step(self) -> None:
        config, q, qd, out = self._config, self._joints.q, self.input["qd"], self.output
        if not self._joints.known:
            for name in ("torque", "gravity", "desired"):
                out[name][:] = np.nan  # the guard damps, with the gravity that it knew last
            return
        k, d = self._ramps.values["stiffness"], self._ramps.values["damping"]
        self._weight()
        inertia: Array = pin.crba(self._model, self._data, q).diagonal() + self._rotors
        K, self._D = self._gains(k, d, np.maximum(inertia, 0.0))
        spring = K * (self._q_d - q) + config.lead * self._D * self._v_d
        np.clip(spring, -self._most, self._most, out=spring)
        out["torque"][:] = out["gravity"] + spring - self._D * qd
        out["desired"][:] = self._q_d

    def _gains(self, k: float, d: float, inertia: Array) -> tuple[Array, Array]:
        """K and D (n,) with the factors k and d, of joints of this inertia."""
        share = sqrt(k) if k > _SOFT else k / sqrt(_SOFT)  # the root has no slope at zero that a ramp could follow
        return k * self._K, 2.0 * self._config.damping_ratio * d * share * np.sqrt(self._K * inertia)

    @cached_property
    def _touched(self) -> list[tuple[Array, Array]]:
        """What the arm may touch, as `cases` has it."""
        return list(cases(self._model, self._config.robot.home, self._lower, self._upper, self._rotors))

    def _damps(self, dt: float, touched: list[tuple[Array, Array]], k: float = 1.0, d: float = 1.0) -> bool:
        """Whether the frictionless arm comes to rest in cycles of dt seconds, in each of these `cases`."""
        return all(growth(M, C, *self._gains(k, d, M.diagonal()), dt) < GROWTH for M, C in touched)

    def _weight(self) -> None:
        out = self.output["gravity"]
        if self._config.gravity == "robot":
            out[:] = 0.0
            return
        x, y, z = (-GRAVITY * self._up.up).tolist()
        self._model.gravity.linear = np.array((x, y, z))
        out[:] = pin.computeGeneralizedGravity(self._model, self._data, self._joints.q)

    def _watch(self) -> None:
        self._cycles += 1
        applied = self.applied.get("torque")
        if applied is not None:
            self._held_back += bool((np.abs(applied - self.output["torque"]) > _HELD_BACK).any())


def _part(bound: float, share: float) -> float:
    """A factor that is this share of the way from 1 to its bound."""
    return 1.0 + share * (bound - 1.0)


def _largest(stands: Callable[[float], bool]) -> float:
    """The largest share, to a sixteenth, that stands; 0 is taken to."""
    if stands(1.0):
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(4):
        middle = (low + high) / 2
        low, high = (middle, high) if stands(middle) else (low, middle)
    return low
