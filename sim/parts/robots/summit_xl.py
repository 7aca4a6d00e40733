"""A mobile base on mecanum wheels: planar motion driven through its wheels."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from itertools import combinations, product
from math import cos, sin
from typing import Any, ClassVar, Final, cast
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import Field

from srl.runtime.contracts.gravity import GRAVITY
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import PLANAR, PLANAR_TWIST, POINT
from srl.runtime.models.robots import SUMMIT_XL, MecanumBase
from srl.sim.world.mjcf import add
from srl.sim.world.part import Mjcf, Part, PartConfig
from srl.sim.world.robot_mjcf import ROBOT_CONTACT

_CONTROL: Final = 0.002  # s, period of the wheels' control
_WAITING: Final = 64  # most commands stored in transit
_JOINTS: Final = ("x", "y", "yaw")
_CORNERS: Final = tuple(product((-1.0, 1.0), repeat=3))  # of a box
_EDGES: Final = tuple(
    (i, j)
    for i, j in combinations(range(8), 2)
    if sum(a != b for a, b in zip(_CORNERS[i], _CORNERS[j], strict=True)) == 1
)
_ROLLS: Final = 20000.0  # N s/m, resistance of a wheel's rollers for each m/s of slip along their axes


class SummitXlConfig(PartConfig):
    """Options of the base. These numbers aren't published; they are assumptions of a usual size."""

    time_constant: float = Field(default=0.06, gt=0, description="s, of the wheels' speed loops")
    acceleration: float = Field(default=3.0, gt=0, description="m/s^2 at a wheel's rim, the greatest")
    latency: float = Field(default=0.02, ge=0, le=0.1, description="s, from the command to the wheels")
    slip: float = Field(default=0.03, ge=0, lt=1, description="share of the wheels' way that the base doesn't move")
    friction: float = Field(default=0.6, gt=0, description="of the rollers on the ground")


class SummitXlPart(Part):
    """Robotnik's base. It moves in the plane only: it neither tips over nor bounces.

    Bodies: `<name>/base`, the frame of the twist, at the height of the axles; `<name>/deck`, on top of the box.
    The part's own position is that of the ground under it at the start. Pose and odometry are relative to it.

    A twist is converted to speeds of the four wheels. If one wheel can't turn so fast, all are slowed down by the same
    factor. The wheels follow after a latency, with a lag and a greatest acceleration. They push the base as far as
    friction allows. Part of their motion is lost in slip; the odometry comes from the wheels and doesn't measure it.

    Attributes:
        robot: its description.
    """

    Config: ClassVar[type[PartConfig]] = SummitXlConfig
    summary = "Robotnik SUMMIT-XL STEEL, omnidirectional mobile base"
    robot: ClassVar[MecanumBase] = SUMMIT_XL

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = cast(SummitXlConfig, config)
        self.truth = (
            Signal(name=f"{name}_pose", shape=(3,), unit="m, rad", labels=PLANAR),
            Signal(name=f"{name}_twist", shape=(3,), unit="m/s, rad/s", labels=PLANAR_TWIST),
            Signal(name=f"{name}_odometry", shape=(3,), unit="m, rad", labels=PLANAR),
            Signal(
                name=f"{name}_wheels",
                shape=(4,),
                unit="rad/s",
                labels=("front_left", "front_right", "back_left", "back_right"),
            ),
            Signal(
                name=f"{name}_outline",
                shape=(8, 3),
                unit="m",
                slots=True,
                components=(POINT,),
                visual="robot",
                links=_EDGES,
            ),
        )
        self._waiting: deque[tuple[float, float, float, float]] = deque(maxlen=_WAITING)  # step, vx, vy, wz
        # Plain numbers: arrays of three or four take longer.
        self._wanted, self._wheels = [0.0] * 4, [0.0] * 4  # rad/s
        self._odometry = [0.0] * 3
        # Four wheels resist motion along their rollers' axes; their sum is the same for x and y.
        self._drag = 2 * _ROLLS * np.array([1.0, 1.0, self.robot.lever**2])
        self._rolls: bool | None = None  # whether the wheels roll, for which the drives are set; None: they aren't yet

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        robot, name = self.robot, self.name
        ground = add(parent, "body", name=f"{name}/ground", **self.at())
        base = mjcf.body(ground, f"{name}/base", pos=(0.0, 0.0, robot.wheel_radius))
        upright = (robot.inertia, robot.inertia, robot.inertia)  # it turns about z only
        add(base, "inertial", pos=(0, 0, 0), mass=robot.mass, diaginertia=upright)
        axes = ("slide", (1, 0, 0)), ("slide", (0, 1, 0)), ("hinge", (0, 0, 1))
        for joint, (kind, axis), grip in zip(_JOINTS, axes, self._drag.tolist(), strict=True):
            called = f"{name}/{joint}"
            add(base, "joint", name=called, type=kind, axis=axis)
            drag = {"gainprm": grip, "biastype": "affine", "biasprm": (0.0, 0.0, -grip)}
            add(mjcf.actuator, "general", name=called, joint=called, **drag)
        length, width, height = robot.size
        middle = robot.clearance - robot.wheel_radius + height / 2
        half = (length / 2, width / 2, height / 2)
        add(
            base,
            "geom",
            name=f"{name}/body",
            type="box",
            pos=(0, 0, middle),
            size=half,
            mass=0,
            rgba="0.3 0.3 0.35 1",
            **ROBOT_CONTACT,
        )
        mjcf.carried[name] = base, (0.0, 0.0, -robot.wheel_radius, 1.0, 0.0, 0.0, 0.0)  # its frame is on the ground
        mjcf.body(base, f"{name}/deck", pos=(0.0, 0.0, middle + height / 2))
        self._corners = np.array(_CORNERS) * half + (0.0, 0.0, middle)

    def bind(self, model: Any, data: Any) -> None:
        self._data = data
        body = int(model.body(f"{self.name}/base").id)
        self._axes, self._place = data.xmat[body].reshape(3, 3), data.xpos[body]
        first, drive = model.joint(f"{self.name}/x"), int(model.actuator(f"{self.name}/x").id)
        start, dof = int(first.qposadr[0]), int(first.dofadr[0])
        self._q, self._dq = data.qpos[start : start + 3], data.qvel[dof : dof + 3]
        self._ctrl = data.ctrl[drive : drive + 3]
        self._gain, self._bias = (
            model.actuator_gainprm[drive : drive + 3, 0],
            model.actuator_biasprm[drive : drive + 3, 2],
        )
        self._timestep = float(model.opt.timestep)
        self.every = max(1, round(_CONTROL / self._timestep))
        mass = float(model.body_subtreemass[model.body(f"{self.name}/base").id])
        # A roller pushes along its axis, at 45 degrees; all four carry the same weight.
        self._grip = self._config.friction * mass * GRAVITY / 4
        self._per_slip = _ROLLS * self.robot.wheel_radius / 2**0.5

    def drive(self, step: int) -> None:
        config, robot, dt = self._config, self.robot, self.every * self._timestep
        while self._waiting and self._waiting[0][0] <= step:
            self._wanted = self._reachable(*self._waiting.popleft()[1:])
        share, most = min(1.0, dt / config.time_constant), config.acceleration / robot.wheel_radius * dt
        self._wheels = wheels = [
            speed + max(min((wanted - speed) * share, most), -most)
            for speed, wanted in zip(self._wheels, self._wanted, strict=True)
        ]
        rolled = robot.twist(*wheels)
        self._integrate(*rolled, dt)
        x, y, turn = (way * (1.0 - config.slip) for way in rolled)
        vx, vy, wz = self._twist()
        missing = (x - vx, y - vy, turn - wz)
        slip = max(map(abs, robot.wheels(*missing))) * self._per_slip
        rolls = slip <= self._grip
        if rolls != self._rolls:
            self._rolls = rolls
            self._gain[:], self._bias[:] = (self._drag, -self._drag) if rolls else (1.0, 0.0)
        if not rolls:  # the wheels spin: a force limited by friction, instead of a drag
            share = self._grip / slip
            x, y, turn = (drag * way * share for drag, way in zip(self._drag.tolist(), missing, strict=True))
        yaw = self._q.item(2)
        c, s = cos(yaw), sin(yaw)
        self._ctrl[:] = c * x - s * y, s * x + c * y, turn

    def command(self, vx: float, vy: float, wz: float) -> None:
        """Commands a twist in the base's own frame, m/s, m/s, rad/s; it stays until the next command."""
        at = (float(self._data.time) + self._config.latency) / self._timestep
        due = -(-round(at) // self.every) * self.every
        if self._waiting and self._waiting[-1][0] >= due:  # the last command of a period counts
            self._waiting.pop()
        self._waiting.append((float(due), float(vx), float(vy), float(wz)))

    def pose(self) -> Array:
        """(3,) x, y (m), yaw (rad, counted beyond full turns): the true pose."""
        return cast(Array, self._q.copy())

    def twist(self) -> Array:
        """(3,) vx, vy (m/s), wz (rad/s) in its own frame: the true twist."""
        return np.array(self._twist())

    def _twist(self) -> tuple[float, float, float]:
        x, y, wz = self._dq.tolist()
        yaw = self._q.item(2)
        c, s = cos(yaw), sin(yaw)
        return c * x + s * y, c * y - s * x, wz

    def wheels(self) -> Array:
        """(4,) rad/s: front left, front right, back left, back right."""
        return np.array(self._wheels)

    def odometry(self) -> tuple[Array, Array]:
        """Pose and twist, each (3,), as the base computes them from its wheels."""
        return np.array(self._odometry), np.array(self.robot.twist(*self._wheels))

    def fill(self, truth: Mapping[str, Array]) -> None:
        pose, twist, odometry, wheels, _ = self.setters(truth)
        pose(*self._q.tolist())
        twist(*self._twist())
        odometry(*self._odometry)
        wheels(*self._wheels)
        outline = truth[f"{self.name}_outline"]
        np.dot(self._corners, self._axes.T, outline)
        outline += self._place

    def save(self) -> Array:
        waiting = np.full((_WAITING, 4), -1.0)
        if self._waiting:
            waiting[: len(self._waiting)] = list(self._waiting)
        return np.concatenate([self._gain, self._bias, self._wanted, self._wheels, self._odometry, waiting.ravel()])

    def restore(self, state: Array) -> None:
        sizes = (3, 3, 4, 4, 3)
        gain, bias, wanted, wheels, odometry, waiting = np.split(state, np.cumsum(sizes))
        self._gain[:], self._bias[:], self._rolls = gain, bias, None
        self._wanted, self._wheels, self._odometry = wanted.tolist(), wheels.tolist(), odometry.tolist()
        rows = waiting.reshape(_WAITING, 4)
        self._waiting.clear()
        self._waiting.extend((step, vx, vy, wz) for step, vx, vy, wz in rows.tolist() if step >= 0)

    def _reachable(self, vx: float, vy: float, wz: float) -> list[float]:
        """Wheel speeds (4,), rad/s, all scaled by the same factor to stay within the greatest."""
        wheels, greatest = self.robot.wheels(vx, vy, wz), self.robot.wheel_speed
        most = max(map(abs, wheels))
        return [wheel * (greatest / most) for wheel in wheels] if most > greatest else list(wheels)

    def _integrate(self, vx: float, vy: float, wz: float, dt: float) -> None:
        x, y, yaw = self._odometry
        middle = yaw + wz * dt / 2
        c, s = cos(middle), sin(middle)
        self._odometry = [x + dt * (c * vx - s * vy), y + dt * (s * vx + c * vy), yaw + dt * wz]
