"""Admittance: the force of a person's hand becomes a desired motion (Giammarino et al. 2022, eq. 1).

    M_adm x_dd + D_adm x_d = lambda_h

The orientation moves on SO(3): its velocity is integrated by the exponential map, without Euler angles.
Three things go beyond the paper. All are forces on the same virtual mass, so that nothing in the desired motion
jumps. The leash keeps the desired pose near the measured one when the robot is blocked. The tank damps the
oscillation that the loop's delay would otherwise cause when a stiff arm holds the handle. The release stops a
motion that nobody leads any more.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil, isfinite, nan, sqrt
from operator import add, sub
from typing import Any, ClassVar, Final

from pydantic import Field

from srl.control.cobot.axes import DeadBand, OnTwist
from srl.control.cobot.energy_tank import EnergyTank
from srl.control.cobot.ft_record import FtCalibration, Unloaded, unloaded
from srl.control.cobot.guide_buttons import MODES
from srl.control.cobot.release import DrawIn, Release, ReleaseConfig
from srl.control.cobot.virtual_mass import VirtualMass
from srl.control.shared.ramp import Ramps, factor
from srl.runtime.contracts import rotation
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.gravity import GRAVITY
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.terms import POSE, TWIST, WRENCH
from srl.runtime.contracts.transforms import Transform, coordinates, measured

_LONGEST: Final = 0.01  # s; a longer cycle is computed in parts, for what changes with the motion: leash and release
_QUICKEST: Final = 2.0  # 1/s, of a factor that a client has changed
_ZEROS: Final = [0.0] * 6  # read only


class LeashConfig(Options):
    """How far the desired pose may run ahead of the measured one. It is free within `distance` and `angle`."""

    distance: float = Field(0.03, gt=0, description="m, free")
    stiffness: float = Field(1000.0, gt=0, description="N/m beyond it, on the virtual mass")
    angle: float = Field(0.2, gt=0, lt=3, description="rad, free")
    rotational_stiffness: float = Field(30.0, gt=0, description="N m/rad beyond it")


class AdmittanceConfig(ControllerConfig):
    """Options of `admittance`. The control point's frame is that of the input `pose`."""

    gone: ClassVar[Mapping[str, str]] = {
        "sensor_position": "write under `frames:` where the sensor is, and give its device that `frame:`",
        "sensor_quaternion": "write under `frames:` where the sensor is, and give its device that `frame:`",
        **dict.fromkeys(("bias", "tool_mass", "tool_com"), "write it under `calibration:`, or name a file there"),
    }

    mass: OnTwist = Field((6.0, 6.0, 6.0, 1.0, 1.0, 1.0), description="M_adm, kg and kg m^2")
    damping: OnTwist = Field((40.0, 40.0, 40.0, 1.8, 1.8, 1.8), description="D_adm, N s/m and N m s/rad")
    calibration: FtCalibration = Field(
        Unloaded(),
        description="the sensor's bias and what hangs on it: {bias, tool_mass, tool_com}, or the file that "
        "`srl calibrate PROFILE ft` makes",
    )
    dead_band: DeadBand = Field((0.3, 0.03), description="N, N m: what is less doesn't count")
    leash: LeashConfig | None = LeashConfig()
    release: ReleaseConfig | None = Field(
        ReleaseConfig(), description="the brake after A or M is switched off; null: the law's own damping alone"
    )
    tank: float | None = Field(
        0.1,
        gt=0,
        description="J, what may be given to the hand, beyond what it put in, before damping is added; "
        "null: the bare law",
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
    switched off, no torque without rotation, without the dead band; `tank` (1,) J, what the hand may get back.

    Switched off, or without rotation, the hand's part is zero, and `release` stops the motion, so no switch makes a
    step. Parameters that a client changes go to their new values gradually, the mass not so fast that it would
    add energy: M' <= 2 D (Ferraguti et al. 2019, doi:10.1177/0278364919840415).
    """

    Config = AdmittanceConfig
    c_version = "srl.control.cobot.compiled_admittance:CompiledAdmittance"
    summary = "hand force to desired motion, on SO(3), leashed and passive (SUPER-MAN eq. 1)"

    def __init__(self, name: str, config: AdmittanceConfig) -> None:
        super().__init__(name, config)
        self._unloaded, made = unloaded(config.calibration)
        self.simulated = "calibration" if made is not None and made.simulated else ""
        frame = None if made is None else made.frame
        self.inputs = (
            Signal(name="wrench", shape=(6,), unit="N, N m", frame=frame, labels=WRENCH),
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
        self._ramps = Ramps(
            factor("scale", 0.2, 5.0, "multiplies the virtual mass"),
            factor("damping", 0.3, 5.0, "multiplies the damping"),
            factor("leash", 0.3, 3.0, "multiplies the leash's length"),
            rate=_QUICKEST,
        )
        self.parameters = self._ramps.parameters
        need = "the sensor in the control point's frame"
        self.transforms = (Transform("sensor", coordinates("wrench"), measured("pose"), need),)
        self._config = config
        self._virtual = VirtualMass()
        self._tank = None if config.tank is None else EnergyTank(config.tank, config.brake, config.force_age)
        self._releases: tuple[Release, Release] | None = None
        self._draws: tuple[DrawIn, DrawIn] | None = None
        if (c := config.release) is not None:
            self._releases = (Release(c.deceleration, c.settle, c.onset), Release(c.angular, c.settle, c.onset))
            self._draws = None if c.draw_in is None else (DrawIn(c.draw_in), DrawIn(c.draw_in))
        self._slowest = 2.0 * min(d / m for d, m in zip(config.damping, config.mass, strict=True))  # 1/s, of 2 D/M
        self._ahead: rotation.Vector = (0.0, 0.0, 0.0)  # rad, of the desired orientation, without jumps at pi
        self._leashed = 0
        self._scale()

    def bind(self, *arrays: Any) -> None:
        super().bind(*arrays)
        x, y, z, qw, qx, qy, qz = self.transform["sensor"].tolist()
        self._at, self._mount = (x, y, z), (qw, qx, qy, qz)

    def reset(self) -> None:
        x, y, z, *q = self.input["pose"].tolist()
        self._virtual.reset((x, y, z), (q[0], q[1], q[2], q[3]))
        self._ramps.reset(self.param)
        self._scale()
        if self._tank is not None:
            self._tank.reset()
        for ending in (*(self._releases or ()), *(self._draws or ())):
            ending.reset()
        self._ahead = (0.0, 0.0, 0.0)
        self._hand(self._virtual.orientation)
        self._write([0.0] * 6)

    def update(self, dt: float) -> None:
        on, rotates, *_ = self.input["modes"].tolist()
        leads, turns = on > 0.5, on > 0.5 and rotates > 0.5
        force, virtual = [0.0] * 6, self._virtual
        self._follow_parameters(dt)
        x, y, z, qw, qx, qy, qz = self.input["pose"].tolist()
        F, T, r = self._hand((qw, qx, qy, qz))
        moved = self.input["twist"].tolist()
        measured = x + y + z + qw + qx + qy + qz + sum(moved)
        if not isfinite(measured + sum(F) + sum(T) if leads else measured):
            # The outputs aren't finite, so that the guard refuses them. The motion is braked, as nobody leads it.
            virtual.slow(dt, self._M, self._damping(_ZEROS, False, False, dt))
            for name in ("pose", "twist", "force"):
                self.output[name][:] = nan
            return
        if leads:
            force = self._felt(F, T, r, turns)
        if self._tank is not None:
            self._tank.step(force, moved, virtual.velocity, self._M, dt)
        parts = ceil(dt / _LONGEST)
        for _ in range(parts):
            pull, drag = self._held((x, y, z), (qw, qx, qy, qz), leads)
            damping = self._damping(drag, leads, turns, dt / parts)
            virtual.step(dt / parts, self._M, damping, force if pull is _ZEROS else list(map(add, force, pull)))
        if self._draws is not None:
            self._draw_in((x, y, z), (qw, qx, qy, qz), leads, turns, dt)
        self._write(force)

    def metrics(self) -> dict[str, object]:
        """Returns the numbers of cycles in which the leash pulled and in which the tank was empty."""
        return {"leashed_cycles": self._leashed, "damped_cycles": 0 if self._tank is None else self._tank.emptied}

    # -- mass and damping

    def _follow_parameters(self, dt: float) -> None:
        """Takes the clients' factors gradually. Mass that appears in motion is energy: damping must take as much."""
        damping = min(self._ramps.values["damping"], self.param["damping"].item())
        if self._ramps.update(self.param, dt, rising=self._slowest * damping):
            self._scale()

    def _scale(self) -> None:
        """M_adm and D_adm by their factors."""
        factors = self._ramps.values
        self._M = [factors["scale"] * m for m in self._config.mass]
        self._D = [factors["damping"] * d for d in self._config.damping]

    def _damping(self, drag: list[float], leads: bool, turns: bool, dt: float) -> list[float]:
        """All damping (6,) of the next dt seconds: the law's, the leash's `drag`, the tank's and the release's."""
        slow = turn = 0.0 if self._tank is None else self._tank.brake / self._M[0]  # 1/s, for all axes alike
        if self._releases is not None:
            v = self._virtual.velocity
            slow += self._releases[0].rate(not leads, v[:3], dt)
            turn += self._releases[1].rate(not turns, v[3:], dt)
        if slow == turn == 0.0 and drag is _ZEROS:
            return self._D
        rates = (slow, slow, slow, turn, turn, turn)
        return [d + b + m * s for d, b, m, s in zip(self._D, drag, self._M, rates, strict=True)]

    # -- forces on the virtual mass

    def _hand(self, actual: rotation.Quaternion) -> tuple[rotation.Vector, rotation.Vector, rotation.Vector]:
        """The hand's force and torque at the sensor, and the sensor's position from the control point; world axes."""
        c = self._unloaded
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

    def _held(
        self, place: rotation.Vector, actual: rotation.Quaternion, leads: bool
    ) -> tuple[list[float], list[float]]:
        """The leash's pull, and its damping about the stretched direction; zeros while it is slack or switched off.

        Switched off, the desired pose stays: a person who pushes the robot away stretches its spring, not the leash.
        """
        leash = self._config.leash
        if leash is None:
            return _ZEROS, _ZEROS
        X, Y, Z = self._virtual.position
        ahead, length = (X - place[0], Y - place[1], Z - place[2]), self._ramps.values["leash"]
        turn = rotation.product(self._virtual.orientation, rotation.conjugate(actual))
        self._ahead = rotation.log_nearest(turn, self._ahead)
        if not leads:
            return _ZEROS, _ZEROS
        pulls, brakes = _stretched(ahead, length * leash.distance, leash.stiffness, self._M[0])
        self._leashed += brakes > 0.0
        twists, slows = _stretched(self._ahead, length * leash.angle, leash.rotational_stiffness, self._M[3])
        if brakes == slows == 0.0:
            return _ZEROS, _ZEROS
        return [*pulls, *twists], [brakes, brakes, brakes, slows, slows, slows]

    def _draw_in(
        self, place: rotation.Vector, actual: rotation.Quaternion, leads: bool, turns: bool, dt: float
    ) -> None:
        """Brings the desired pose back to the measured one, where nobody leads it any more.

        A robot sags under a load that nobody declared: its desired pose is above it, or turned about a level axis. That
        stays, or the load would be let down further.
        """
        assert self._draws is not None
        X, Y, Z = self._virtual.position
        ahead = (X - place[0], Y - place[1], min(Z - place[2], 0.0))
        turned = (0.0, 0.0, rotation.error(self._virtual.orientation, actual)[2])
        a, b = -self._draws[0].share(leads, ahead, dt), -self._draws[1].share(turns, turned, dt)
        if a or b:
            self._virtual.shift((a * ahead[0], a * ahead[1], a * ahead[2]), (0.0, 0.0, b * turned[2]))

    def _write(self, force: list[float]) -> None:
        out = self.output
        out["pose"][:] = [*self._virtual.position, *self._virtual.orientation]
        out["twist"][:] = self._virtual.velocity
        out["force"][:] = force
        out["tank"][0] = 0.0 if self._tank is None else self._tank.level


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
