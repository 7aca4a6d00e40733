"""Compliance for a robot that is stiff by itself: the desired motion yields to the measured contact force.

This is not in the paper, whose Kairos fails at the peg-in-hole. A deviation e (6,) of the desired pose follows

    M_c e_dd + D_c e_d + K_c e = f

with the contact's wrench f on the tool. The force of the tool on a rigid object has two parts: K_c times the depth of
the desired pose inside the object, and D_c times the speed of arrival. M_c and D_c are larger than feels light: with
the delay T of a velocity-controlled arm, a contact of stiffness k stays stable while D_c is well above k T.

A person who keeps pushing must not push with D_c times the speed that the admittance makes of the push. So e takes
over the part of the desired motion that goes against the contact, as far as the contact is firm. It does so at once
when the contact becomes firm, and releases it slowly after the contact is lost: with a delay, contact comes and goes.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from math import isfinite, nan, sqrt
from operator import sub
from typing import Any, ClassVar, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator

from runtime.contracts import rotation
from runtime.contracts.errors import OptionError
from runtime.contracts.options import Options
from runtime.contracts.signals import Array
from runtime.contracts.transforms import Transform, coordinates, device, measured
from runtime.control.cobot.admittance import GRAVITY, beyond
from runtime.control.cobot.axes import DeadBand, ForceTorque, OnTwist, Point
from runtime.control.cobot.whole_body import mount_of_the_arm
from runtime.control.robots.pinocchio_model import FLANGE

_LATELY: Final = 0.1  # s of contact


class WeightConfig(BaseModel):
    """An object whose weight the sensor measures."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    mass: float = Field(ge=0, le=50, description="kg")
    com: Point = Field((0.0, 0.0, 0.0), description="m, its centre of mass in the control point's frame")


class ComplianceConfig(Options):
    """Options under `force_feedback` of `kairos-clik`."""

    gone: ClassVar[Mapping[str, str]] = {
        "position": "where the wrench is measured follows from `frames:`",
        "quaternion": "write `axes: sensor`, and the sensor's frame under `frames:`",
        "mount_quaternion": "where the arm stands follows from `frames:`",
    }

    @field_validator("axes", mode="before")
    @classmethod
    def _not_tool(cls, value: Any) -> Any:
        if value == "tool":
            raise OptionError("`axes: tool` is gone", "Write `axes: sensor`, and the sensor's frame under `frames:`")
        return value

    mass: OnTwist = Field((10.0, 10.0, 10.0, 0.5, 0.5, 0.5), description="M_c, kg and kg m^2, world axes")
    damping: OnTwist = Field((600.0, 600.0, 600.0, 20.0, 20.0, 20.0), description="D_c, N s/m and N m s/rad")
    stiffness: OnTwist = Field((500.0, 500.0, 500.0, 30.0, 30.0, 30.0), description="K_c, N/m and N m/rad")
    axes: Literal["arm", "sensor", "world"] = Field(
        "arm",
        description="whose axes the wrench has: the arm's base (UR) or the world's, measured at the flange; or those "
        "of the frame that its device names, measured at that frame's origin",
    )
    tool: WeightConfig | None = Field(None, description="what hangs on the sensor, if it doesn't take it off itself")
    load: float = Field(
        14.0,
        ge=0,
        le=100,
        description="kg, the heaviest that the closed gripper may carry: what pulls down up to its "
        "weight isn't contact then",
    )
    carrying: DeadBand = Field(
        (60.0, 40.0), description="N, N m: dead band while the gripper is closed, for the load's inertia and lever"
    )
    load_time: float = Field(
        0.5,
        gt=0,
        description="s in which these come in as the gripper closes; opened, they go after nothing has been "
        "felt for so long",
    )
    firm: ForceTorque = Field(
        (10.0, 1.0), description="N, N m: against this and more the desired motion isn't followed any further"
    )
    release: float = Field(1.0, gt=0, le=60, description="s, time constant with which it is followed again")
    dead_band: DeadBand = Field((10.0, 1.0), description="N, N m: what is less doesn't count")
    hand: bool = Field(True, description="the hand's force goes through the sensor too: take it off (input `hand`)")
    hand_lead: float = Field(
        0.02,
        ge=0,
        le=0.2,
        description="s by which `hand` may be newer than `flange_wrench`: a push mustn't look like contact",
    )


class ContactCompliance:
    """Computes the deviation from the contact force; see the module's docstring.

    Attributes:
        deviation: e (6,) m and rad (a rotation vector), world axes.
        velocity: its rate (6,), including the part that it takes over of the desired motion.
        contact: f (6,) N and N m of the surroundings on the tool, at the control point, world axes.
    """

    def __init__(self, config: ComplianceConfig) -> None:
        self._config = config
        self._turn: rotation.Quaternion = (1.0, 0.0, 0.0, 0.0)
        self._at: rotation.Vector = (0.0, 0.0, 0.0)
        self._share = 0.0  # 1 while the gripper may hold something
        self._quiet = 0.0  # s during which the sensor has measured nothing
        self._against = (_Against(config.firm[0], config.release), _Against(config.firm[1], config.release))
        self._hands: deque[list[float]] = deque()  # the hand's wrenches of the last `hand_lead`
        self._yielding = [0.0] * 6
        self.deviation, self.velocity, self.contact = [0.0] * 6, [0.0] * 6, [0.0] * 6

    def transforms(self) -> tuple[Transform, ...]:
        """What it needs of the tree of frames, with the inputs `q`, `base_pose`, `pose` and `flange_wrench`."""
        place = coordinates("flange_wrench") if self._config.axes == "sensor" else device("q", FLANGE)
        found = (Transform("sensor", place, measured("pose"), "where the contact is measured, from the control point"),)
        return (*found, mount_of_the_arm()) if self._config.axes == "arm" else found

    def place(self, transform: Mapping[str, Array]) -> None:
        """Takes the transforms."""
        x, y, z, *turn = transform["sensor"].tolist()
        self._at = (x, y, z)
        if self._config.axes == "arm":
            turn = transform["mount"].tolist()[3:]
        self._turn = (1.0, 0.0, 0.0, 0.0) if self._config.axes == "world" else (turn[0], turn[1], turn[2], turn[3])

    def reset(self, closed: bool) -> None:
        """Starts without a deviation."""
        self._share, self._quiet = float(closed), 0.0
        for against in self._against:
            against.reset()
        self._hands.clear()
        self._yielding = [0.0] * 6
        self.deviation, self.velocity, self.contact = [0.0] * 6, [0.0] * 6, [0.0] * 6

    def update(
        self,
        wrench: list[float],
        hand: list[float],
        desired: list[float],
        orientation: rotation.Quaternion,
        yaw: float,
        closed: bool,
        dt: float,
    ) -> None:
        """Computes one step of dt seconds.

        Args:
            desired: (6,) m/s and rad/s, the desired twist, world axes.
            wrench: (6,) N, N m, the measured wrench on the tool.
            hand: (6,) N, N m, the hand's wrench at the control point, world axes.
            orientation: orientation of the control point, world.
            yaw: yaw of the mobile base, rad.
            closed: whether the gripper is closed.
        """
        c = self._config
        if not isfinite(sum(wrench) + sum(hand) + sum(desired) + sum(orientation) + yaw):
            # The outputs are not finite either, so that the guard refuses them. The earlier state is kept.
            self.velocity, self.contact = [nan] * 6, [nan] * 6
            return
        if c.hand:
            self._hands.append(hand)
            while dt > 0.0 and len(self._hands) > round(c.hand_lead / dt) + 1:
                self._hands.popleft()
        whole = self._felt(wrench, orientation, yaw)
        self._settle(whole, closed, dt)
        self.contact = f = self._contact(whole)
        e, v = self.deviation, self._yielding
        taken = [*self._against[0].take(f[:3], desired[:3], dt), *self._against[1].take(f[3:], desired[3:], dt)]
        for i in range(6):
            M, D, K = c.mass[i], c.damping[i], c.stiffness[i]
            v[i] = (v[i] + dt / M * (f[i] - K * e[i])) / (1.0 + dt / M * (D + dt * K))  # implicit
            self.velocity[i] = v[i] + taken[i]
            e[i] += dt * self.velocity[i]

    def _settle(self, whole: list[float], closed: bool, dt: float) -> None:
        """Updates whether something may be held: from closing until the gripper is open and nothing is measured."""
        least, most = self._config.dead_band
        felt = _square(whole[:3]) > least * least or _square(whole[3:]) > most * most
        self._quiet = 0.0 if felt else self._quiet + dt
        step = dt / self._config.load_time
        if closed:
            self._share = min(self._share + step, 1.0)
        elif self._share < 1.0 or self._quiet >= self._config.load_time:  # otherwise the fingers are still opening
            self._share = max(self._share - step, 0.0)

    def _contact(self, whole: list[float]) -> list[float]:
        """The contact wrench, without the possible load in the gripper and without the dead band."""
        c, share = self._config, self._share
        fx, fy, fz = whole[:3]
        bands = [open_ + share * (closed - open_) for open_, closed in zip(c.dead_band, c.carrying, strict=True)]
        # The load leaves the table gradually, and its weight is not known.
        fz += min(max(-fz, 0.0), share * c.load * GRAVITY)
        return [*beyond((fx, fy, fz), bands[0]), *beyond((whole[3], whole[4], whole[5]), bands[1])]

    def _felt(self, wrench: list[float], orientation: rotation.Quaternion, yaw: float) -> list[float]:
        """The measured wrench (6,) N, N m at the control point, world axes, without tool and hand."""
        c = self._config
        turn = self._turn
        if c.axes == "sensor":
            turn = rotation.product(orientation, turn)
        elif c.axes == "arm":
            turn = rotation.product(rotation.exp(0.0, 0.0, yaw), turn)
        force = rotation.turned(turn, (wrench[0], wrench[1], wrench[2]))
        torque = rotation.turned(turn, (wrench[3], wrench[4], wrench[5]))
        at = rotation.turned(orientation, self._at)
        f = [*force, *(t + r for t, r in zip(torque, _cross(at, force), strict=True))]
        if c.tool is not None:
            weight = (0.0, 0.0, -c.tool.mass * GRAVITY)
            lever = _cross(rotation.turned(orientation, c.tool.com), weight)
            f = list(map(sub, f, (*weight, *lever)))
        if c.hand:
            # It isn't known which of the hand's forces the flange measures now. The one that leaves the smallest rest
            # is used: what it explains is no contact.
            hands = self._hands
            left = [list(map(sub, f, hands[k])) for k in {0, len(hands) // 2, len(hands) - 1}]
            f = [*min((v[:3] for v in left), key=_square), *min((v[3:] for v in left), key=_square)]
        return f


class _Against:
    """The part of a desired motion that goes against a contact."""

    def __init__(self, firm: float, release: float) -> None:
        self._firm, self._release = firm, release
        self.reset()

    def reset(self) -> None:
        self._firmness = 0.0  # 0 to 1
        self._pushed = [0.0, 0.0, 0.0]  # recent contact force: single forces of an impact have wrong directions

    def take(self, f: list[float], motion: list[float], dt: float) -> list[float]:
        """The velocity (3,) that keeps `motion` (3,) from continuing against the contact's force f (3,)."""
        size = sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2])
        keep = self._release / (self._release + dt)
        self._firmness = max(keep * self._firmness, min(size / self._firm, 1.0))
        if size > 0.0:
            fade = _LATELY / (_LATELY + dt)
            self._pushed = [fade * p + dt * v for p, v in zip(self._pushed, f, strict=True)]
        p = self._pushed
        square = _square(p)
        if square == 0.0:
            return [0.0, 0.0, 0.0]
        inward = self._firmness * min(p[0] * motion[0] + p[1] * motion[1] + p[2] * motion[2], 0.0) / square
        return [-inward * p[0], -inward * p[1], -inward * p[2]]


def _square(v: list[float]) -> float:
    return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]


def _cross(a: rotation.Vector, b: rotation.Vector) -> rotation.Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
