"""Admittance: the force of a person's hand becomes a desired motion (Giammarino et al. 2022, eq. 1).

    M_adm x_dd + D_adm x_d = lambda_h

The orientation moves on SO(3): its velocity is integrated by the exponential map, without Euler angles.
Two things go beyond the paper. Both are forces on the same virtual mass, so that nothing in the desired motion
jumps. The leash keeps the desired pose near the measured one when the robot is blocked. The tank damps the
oscillation that the loop's delay would otherwise cause when a stiff arm holds the handle.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from math import isfinite, nan, sqrt
from operator import mul, sub
from typing import Any, ClassVar, Final

from pydantic import BaseModel, ConfigDict, Field

from runtime.contracts import rotation
from runtime.contracts.controller import Controller, ControllerConfig, Parameter
from runtime.contracts.gravity import GRAVITY
from runtime.contracts.signals import Signal
from runtime.contracts.terms import POSE, TWIST, WRENCH
from runtime.contracts.transforms import Transform, coordinates, measured
from runtime.control.cobot.axes import DeadBand, OnTwist, Point, Wrench
from runtime.control.cobot.guide_buttons import MODES

_FULL: Final = 0.25  # of the tank: above this level there is no brake
_DEBT: Final = 5.0  # greatest debt, in tank sizes; any debt beyond it is dropped, and the brake stays on
_RELEASE: Final = 2.0  # s, time constant of the brake's release: an oscillation that filled the tank would restart
_ZEROS: Final = [0.0] * 6  # read only


class LeashConfig(BaseModel):
    """How far the desired pose may run ahead of the measured one. It is free within `distance` and `angle`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    distance: float = Field(0.03, gt=0, description="m, free")
    stiffness: float = Field(1000.0, gt=0, description="N/m beyond it, on the virtual mass")
    angle: float = Field(0.2, gt=0, lt=3, description="rad, free")
    rotational_stiffness: float = Field(30.0, gt=0, description="N m/rad beyond it")


class AdmittanceConfig(ControllerConfig):
    """Options of `admittance`. The control point's frame is that of the input `pose`."""

    gone: ClassVar[Mapping[str, str]] = {
        "sensor_position": "write under `frames:` where the sensor is, and give its device that `frame:`",
        "sensor_quaternion": "write under `frames:` where the sensor is, and give its device that `frame:`",
    }

    mass: OnTwist = Field((6.0, 6.0, 6.0, 1.0, 1.0, 1.0), description="M_adm, kg and kg m^2")
    damping: OnTwist = Field((40.0, 40.0, 40.0, 1.8, 1.8, 1.8), description="D_adm, N s/m and N m s/rad")
    tool_mass: float = Field(0.0, ge=0, description="kg, of what hangs on the sensor's measuring side (the handle)")
    tool_com: Point = Field((0.0, 0.0, 0.0), description="m, its centre of mass in the sensor's frame")
    bias: Wrench = Field((0.0,) * 6, description="N, N m: what the unloaded sensor shows; subtracted first")
    dead_band: DeadBand = Field((0.3, 0.03), description="N, N m: what is less doesn't count")
    leash: LeashConfig | None = LeashConfig()
    tank: float | None = Field(
        0.1, gt=0, description="J, what may be given back to the hand before damping is added; null: the bare law"
    )
    brake: float = Field(150.0, gt=0, description="N s/m, damping of an empty tank")
    force_age: float = Field(
        0.0, ge=0, le=0.2, description="s, by which `wrench` is older than `twist`; without it the tank can't see that"
    )


class Admittance(Controller):
    """Converts the force of a person's hand to a desired motion.

    Inputs: `wrench` (6,) of the hand on the sensor, in the sensor's frame; `pose` (7,) m and w x y z and
    `twist` (6,) of the control point, measured, world; `modes` (4,): admittance on, rotation too, -, -.

    Outputs: `pose` (7,) and `twist` (6,), desired, world axes; `hand` (6,), the hand's wrench at the control point in
    world axes, without gravity and bias; `force` (6,), the part of it that acts on the virtual mass: zero while
    switched off, no torque without rotation, without the dead band; `tank` (1,) J.

    Switched off, or without rotation, the hand's part is zero and the motion fades out by the law's own
    damping (M/D: 0.15 s), so no switch makes a step.
    """

    Config = AdmittanceConfig
    summary = "hand force to desired motion, on SO(3), leashed and passive (SUPER-MAN eq. 1)"

    def __init__(self, name: str, config: AdmittanceConfig) -> None:
        super().__init__(name, config)
        self.inputs = (
            Signal(name="wrench", shape=(6,), unit="N, N m", labels=WRENCH),
            Signal(name="pose", shape=(7,), unit="m", labels=POSE),
            Signal(name="twist", shape=(6,), unit="m/s, rad/s", frame="=pose", of="=pose", labels=TWIST),
            Signal(name="modes", shape=(4,), unit="1", labels=MODES),
        )
        self.outputs = (
            Signal(name="pose", shape=(7,), unit="m", frame="=pose", of="=pose", labels=POSE, visual="path"),
            Signal(name="twist", shape=(6,), unit="m/s, rad/s", frame="=pose", of="=pose", labels=TWIST),
            Signal(name="hand", shape=(6,), unit="N, N m", frame="=pose", of="=pose", labels=WRENCH),
            Signal(name="force", shape=(6,), unit="N, N m", frame="=pose", of="=pose", labels=WRENCH),
            Signal(name="tank", shape=(1,), unit="J"),
        )
        self.parameters = (
            Parameter(name="scale", default=1.0, lower=0.2, upper=5.0, unit="1", text="multiplies the virtual mass"),
            Parameter(name="damping", default=1.0, lower=0.3, upper=5.0, unit="1", text="multiplies the damping"),
        )
        need = "the sensor in the control point's frame"
        self.transforms = (Transform("sensor", coordinates("wrench"), measured("pose"), need),)
        self._config = config
        self._M, self._D = list(config.mass), list(config.damping)
        self._velocity = [0.0] * 6
        self._position: list[float] = [0.0, 0.0, 0.0]
        self._orientation: rotation.Quaternion = (1.0, 0.0, 0.0, 0.0)
        self._tank = self._brake = 0.0
        self._shares = [m / config.mass[0] for m in config.mass]  # of the brake, by axis
        self._past: deque[list[float]] = deque()  # measured twists; the oldest has the age of the wrench
        self._emptied = self._leashed = 0

    def bind(self, *arrays: Any) -> None:
        super().bind(*arrays)
        x, y, z, qw, qx, qy, qz = self.transform["sensor"].tolist()
        self._at, self._mount = (x, y, z), (qw, qx, qy, qz)

    def reset(self) -> None:
        x, y, z, *q = self.input["pose"].tolist()
        self._position, self._orientation = [x, y, z], rotation.normalised((q[0], q[1], q[2], q[3]))
        self._velocity = [0.0] * 6
        self._tank, self._brake = self._config.tank or 0.0, 0.0
        self._past.clear()
        self._hand(self._orientation)
        self._write([0.0] * 6)

    def update(self, dt: float) -> None:
        on, rotates, *_ = self.input["modes"].tolist()
        M, D = self.param["scale"].item(), self.param["damping"].item()
        force, pull, drag = [0.0] * 6, _ZEROS, _ZEROS
        x, y, z, qw, qx, qy, qz = self.input["pose"].tolist()
        F, T, r = self._hand((qw, qx, qy, qz))
        measured = x + y + z + qw + qx + qy + qz + sum(self.input["twist"].tolist())
        if not isfinite(measured + sum(F) + sum(T) if on > 0.5 else measured):
            self._refuse(dt, M, D)
            return
        if on > 0.5:
            force = self._felt(F, T, r, rotates > 0.5)
            # Switched off, the desired pose stays: a person who pushes the robot away stretches its spring, not the
            # leash.
            pull, drag = self._held((x, y, z), (qw, qx, qy, qz))
        brake = self._passive(force, dt, D)
        # Semi-implicit: the force with the old velocity, then the pose with the new velocity.
        self._velocity = v = [
            v + dt / (M * m) * (f + p - (D * d + b) * v)
            for v, m, d, f, p, b in zip(self._velocity, self._M, self._D, force, pull, drag, strict=True)
        ]
        if brake > 0.0:
            slow = 1.0 + dt * brake / (M * self._M[0])  # the same for all axes, by their shares of the mass
            v[:] = [x / slow for x in v]
        x, y, z = self._position
        self._position = [x + dt * v[0], y + dt * v[1], z + dt * v[2]]
        turn = rotation.exp(dt * v[3], dt * v[4], dt * v[5])
        self._orientation = rotation.normalised(rotation.product(turn, self._orientation))
        self._write(force)

    def figures(self) -> dict[str, object]:
        """Returns the numbers of cycles in which the leash pulled and in which the tank was empty."""
        return {"leashed_cycles": self._leashed, "damped_cycles": self._emptied}

    # -- forces on the virtual mass

    def _hand(self, actual: rotation.Quaternion) -> tuple[rotation.Vector, rotation.Vector, rotation.Vector]:
        """The hand's force and torque at the sensor, and the sensor's position from the control point; world axes."""
        c = self._config
        turn = rotation.product(actual, self._mount)  # sensor to world
        fx, fy, fz, tx, ty, tz = map(sub, self.input["wrench"].tolist(), c.bias)
        if c.tool_mass:
            gx, gy, gz = rotation.turned(rotation.conjugate(turn), (0.0, 0.0, -GRAVITY * c.tool_mass))
            cx, cy, cz = c.tool_com
            fx, fy, fz = fx - gx, fy - gy, fz - gz
            tx, ty, tz = tx - (cy * gz - cz * gy), ty - (cz * gx - cx * gz), tz - (cx * gy - cy * gx)
        F, T = rotation.turned(turn, (fx, fy, fz)), rotation.turned(turn, (tx, ty, tz))
        r = rotation.turned(actual, self._at)
        self.output["hand"][:] = _about(F, T, r)
        return F, T, r

    def _felt(self, F: rotation.Vector, T: rotation.Vector, r: rotation.Vector, rotates: bool) -> list[float]:
        """lambda_h: the part of the hand's wrench that acts on the virtual mass."""
        F = beyond(F, self._config.dead_band[0])
        return _about(F, beyond(T, self._config.dead_band[1]), r) if rotates else [*F, 0.0, 0.0, 0.0]

    def _held(self, place: rotation.Vector, actual: rotation.Quaternion) -> tuple[list[float], list[float]]:
        """The leash's pull, and its damping about the stretched direction; zeros while it is slack."""
        leash = self._config.leash
        if leash is None:
            return _ZEROS, _ZEROS
        X, Y, Z = self._position
        ahead = (X - place[0], Y - place[1], Z - place[2])
        turned = rotation.error(self._orientation, actual)
        pulls, brakes = _stretched(ahead, leash.distance, leash.stiffness, self._M[0])
        self._leashed += brakes > 0.0
        twists, slows = _stretched(turned, leash.angle, leash.rotational_stiffness, self._M[3])
        if brakes == slows == 0.0:
            return _ZEROS, _ZEROS
        return [*pulls, *twists], [brakes, brakes, brakes, slows, slows, slows]

    def _passive(self, force: list[float], dt: float, scale: float) -> float:
        """The damping, N s/m, which grows as the tank runs empty.

        The port gives the hand lambda (x_d - xdot_measured). The tank is fed by what all damping dissipates. With a
        perfect robot the first is zero; delay and compliance make it cost energy. Power is the force times the
        motion at the same instant: a late sensor's force belongs to the motion at that earlier instant.

        The damping is bounded. As measured motion is noisy, an unbounded damping would lock the robot against a hand
        that keeps pushing. Energy that couldn't be held back is a debt; it is paid before the damping fades again.
        """
        size = self._config.tank
        if size is None:
            return 0.0
        v = self._velocity
        paid = scale * _dot(self._D, map(mul, v, v))
        if self._brake:
            paid += self._brake * _dot(self._shares, map(mul, v, v))
        moved = self.input["twist"].tolist()
        if self._config.force_age:
            self._past.append(moved)
            while len(self._past) > round(self._config.force_age / dt) + 1:
                self._past.popleft()
            moved = self._past[0]
        given = _dot(force, map(sub, v, moved))
        self._tank = level = min(max(self._tank + dt * (paid - given), -_DEBT * size), size)
        wanted = self._config.brake * min(max(1.0 - level / (_FULL * size), 0.0), 1.0)
        self._brake = max(wanted, self._brake * _RELEASE / (_RELEASE + dt))
        self._emptied += level <= 0.0
        return self._brake

    def _refuse(self, dt: float, M: float, D: float) -> None:
        """Handles a measurement that isn't finite: outputs NaN, so that the guard refuses it; the motion fades out."""
        velocity = zip(self._velocity, self._M, self._D, strict=True)
        self._velocity = [v / (1.0 + dt * D * d / (M * m)) for v, m, d in velocity]
        for name in ("pose", "twist", "force"):
            self.output[name][:] = nan

    def _write(self, force: list[float]) -> None:
        out = self.output
        out["pose"][:] = [*self._position, *self._orientation]
        out["twist"][:] = self._velocity
        out["force"][:] = force
        out["tank"][0] = self._tank


def _about(F: rotation.Vector, T: rotation.Vector, r: rotation.Vector) -> list[float]:
    """Converts the wrench F, T that acts at r to a wrench about the origin of r."""
    return [*F, T[0] + r[1] * F[2] - r[2] * F[1], T[1] + r[2] * F[0] - r[0] * F[2], T[2] + r[0] * F[1] - r[1] * F[0]]


def beyond(v: tuple[float, float, float], band: float) -> tuple[float, float, float]:
    """Shortens a vector by `band`: continuous, and zero for a length below `band`."""
    size = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if size <= band:
        return (0.0, 0.0, 0.0)
    k = 1.0 - band / size
    return (k * v[0], k * v[1], k * v[2])


def _stretched(
    away: tuple[float, float, float], free: float, stiffness: float, mass: float
) -> tuple[tuple[float, float, float], float]:
    """A leash's pull for a distance `away` longer than `free`, and its damping, which grows gradually."""
    x, y, z = away
    size = sqrt(x * x + y * y + z * z)
    if size <= free:
        return (0.0, 0.0, 0.0), 0.0
    stretch = (size - free) / size
    k = -stiffness * stretch
    return (k * x, k * y, k * z), 2 * sqrt(stiffness * mass) * min(1.0, 10 * stretch)  # critical


def _dot(a: Iterable[float], b: Iterable[float]) -> float:
    return sum(map(mul, a, b))
