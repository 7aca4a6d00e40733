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

from collections.abc import Mapping
from math import isfinite, nan, sqrt
from typing import Annotated, Final, Literal

from pydantic import Field

from srl.control.cobot.admittance import beyond
from srl.control.cobot.axes import DeadBand, ForceTorque, OnTwist
from srl.control.cobot.contact_wrench import ContactWrench, FlangeWrenchOptions, square
from srl.runtime.contracts import rotation
from srl.runtime.contracts.gravity import GRAVITY
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.transforms import Transform

_LATELY: Final = 0.1  # s of contact


class ComplianceConfig(FlangeWrenchOptions):
    """Options under `force_feedback` of `kairos-clik`."""

    mass: OnTwist = Field((10.0, 10.0, 10.0, 0.5, 0.5, 0.5), description="M_c, kg and kg m^2, world axes")
    damping: OnTwist = Field((600.0, 600.0, 600.0, 20.0, 20.0, 20.0), description="D_c, N s/m and N m s/rad")
    stiffness: OnTwist = Field((500.0, 500.0, 500.0, 30.0, 30.0, 30.0), description="K_c, N/m and N m/rad")
    load: Annotated[float, Field(ge=0, le=100)] | Literal["identified"] = Field(
        14.0,
        description="kg, the heaviest that the closed gripper may carry: what pulls down up to its "
        "weight isn't contact then; or `identified`, by the law `payload`: input `outside` instead of the wrenches",
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


class ContactCompliance:
    """Computes the deviation from the contact force; see the module's docstring.

    Attributes:
        deviation: e (6,) m and rad (a rotation vector), world axes.
        velocity: its rate (6,), including the part that it takes over of the desired motion.
        contact: f (6,) N and N m of the surroundings on the tool, at the control point, world axes.
    """

    def __init__(self, config: ComplianceConfig) -> None:
        self._config = config
        self._sensor = ContactWrench(config)
        self._share = 0.0  # 1 while the gripper may hold something
        self._quiet = 0.0  # s during which the sensor has measured nothing
        self._against = (_Against(config.firm[0], config.release), _Against(config.firm[1], config.release))
        self._yielding = [0.0] * 6
        self.deviation, self.velocity, self.contact = [0.0] * 6, [0.0] * 6, [0.0] * 6

    @property
    def identified(self) -> bool:
        """Whether the law `payload` says what the contact is."""
        return self._config.load == "identified"

    @property
    def hand(self) -> bool:
        """Whether it takes the hand's wrench off by itself."""
        return self._config.hand and not self.identified

    def transforms(self) -> tuple[Transform, ...]:
        """What it needs of the tree of frames, with the inputs `q`, `base_pose`, `pose` and `flange_wrench`."""
        return () if self.identified else self._sensor.transforms()

    def place(self, transform: Mapping[str, Array]) -> None:
        """Takes the transforms."""
        if not self.identified:
            self._sensor.place(transform)

    def reset(self, closed: bool) -> None:
        """Starts without a deviation."""
        self._share, self._quiet = float(closed), 0.0
        for against in self._against:
            against.reset()
        self._sensor.reset()
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
            wrench: (6,) N, N m, the measured wrench on the tool; where the load is identified, `outside` of `payload`.
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
        whole = wrench if self.identified else self._sensor.take(wrench, hand, orientation, yaw, dt)
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
        felt = square(whole[:3]) > least * least or square(whole[3:]) > most * most
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
        if c.load != "identified":
            # The load leaves the table gradually, and its weight is not known.
            fz += min(max(-fz, 0.0), share * c.load * GRAVITY)
        return [*beyond((fx, fy, fz), bands[0]), *beyond((whole[3], whole[4], whole[5]), bands[1])]


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
        size = square(p)
        if size == 0.0:
            return [0.0, 0.0, 0.0]
        inward = self._firmness * min(p[0] * motion[0] + p[1] * motion[1] + p[2] * motion[2], 0.0) / size
        return [-inward * p[0], -inward * p[1], -inward * p[2]]
