"""Kinematics of an arm on a mobile base for a control point fixed to its flange, and the arm's dynamics.

Coordinates of the body: x, y (m) and yaw (rad) of the base in the world, then the arm's n joints. The base's
velocities are along the world's axes. World frame: z up from the ground, x and y as in the base's pose.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import pinocchio as pin
from pydantic import Field, field_validator

from srl.control.cobot.axes import Point
from srl.runtime.contracts import rotation
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.gravity import DOWN
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import PLANAR, TWIST
from srl.runtime.contracts.transforms import Transform, device
from srl.runtime.models.robot_model import RobotOption, arm_named
from srl.runtime.models.robots import SUMMIT_XL, Payload, RobotDescription
from srl.runtime.models.robots.pinocchio_model import FLANGE, mobile_model, pinocchio_model

BASE: Final = 3  # the base's coordinates


class LoadConfig(Options):
    """The load that the gripper carries while it is closed."""

    mass: float = Field(gt=0, le=50, description="kg")
    com: Point = Field((0.0, 0.0, 0.0), description="m, its centre of mass in the flange frame")

    def payload(self) -> Payload:
        """Converts the load to a Payload, as the models take it."""
        return Payload(self.mass, self.com)


class RobotName(BaseModel):
    """A mix-in for the options of controllers that need to know the arm."""

    robot: RobotOption = arm_named("panda")

    @field_validator("robot")
    @classmethod
    def _turns(cls, robot: RobotDescription) -> RobotDescription:
        if robot.slides:
            problem = f"joint '{robot.slides[0]}' of {robot.name} slides"
            raise OptionError(problem, "The joints of this law's arms turn")
        return robot


def jacobian_signal(robot: RobotDescription, frame: str, of: str) -> Signal:
    """The signal `jacobian` (6, 3 + n): the velocities of x, y (world), yaw and the joints to the twist."""
    columns = (*PLANAR, *robot.labels)
    return Signal(
        name="jacobian", shape=(6, len(columns)), unit="1", frame=frame, of=of, labels=TWIST, components=(columns,)
    )


def mount_of_the_arm() -> Transform:
    """What the laws of an arm on a mobile base need, with the inputs `q` and `base_pose`."""
    return Transform("mount", device("q"), device("base_pose"), "the arm's base in the mobile base's frame")


class WholeBody:
    """Pose and Jacobian of the control point.

    Attributes:
        n: number of the arm's joints.
        position: (3,) m, world.
        orientation: w x y z, world, w not negative.
        jacobian: (6, 3 + n): linear velocity of the control point (m/s, upper rows) and angular velocity (rad/s, lower
            rows), in the world's axes, for the velocities of the body's coordinates.
    """

    def __init__(self, robot: RobotDescription, mount: Array, tool: Array) -> None:
        """Args:
        mount: (4, 4), the arm's base frame in the mobile base's frame, which is on the ground.
        tool: (4, 4), the control point's frame in the flange's frame.
        """
        self.n = robot.n
        self._model = model = mobile_model(SUMMIT_XL, robot, mount)
        flange = model.frames[model.getFrameId(FLANGE)]
        place = flange.placement * pin.SE3(np.array(tool))
        self._frame = model.addFrame(pin.Frame("control_point", flange.parentJoint, 0, place, pin.FrameType.OP_FRAME))
        self._data: Any = model.createData()
        self.position: list[float] = [0.0, 0.0, 0.0]
        self.orientation: rotation.Quaternion = (1.0, 0.0, 0.0, 0.0)
        self.jacobian: Array = np.zeros((6, BASE + self.n))

    def update(self, q: Array) -> None:
        """Takes the body's coordinates (3 + n,), m and rad."""
        self.jacobian = pin.computeFrameJacobian(self._model, self._data, q, self._frame, pin.LOCAL_WORLD_ALIGNED)
        x, y, z, qx, qy, qz, qw = pin.SE3ToXYZQUAT(
            pin.updateFramePlacement(self._model, self._data, self._frame)
        ).tolist()
        self.position = [x, y, z]
        self.orientation = (qw, qx, qy, qz) if qw >= 0.0 else (-qw, -qx, -qy, -qz)


class ArmDynamics:
    """The arm's own dynamics on a base at rest (M_a, C_a, g_a of eq. 3), with a load that may be added and removed.

    Attributes:
        load: share of the load that is included, 0 to 1.
    """

    def __init__(
        self,
        robot: RobotDescription,
        load: Payload | None = None,
        mount: rotation.Quaternion | None = None,
        rotors: bool = False,
    ):
        """Args:
        load: the load; None: never any.
        mount: rotates the arm's base axes into upright ones; None: the arm stands upright.
        rotors: True to include the rotors' inertia in the mass.
        """
        gravity = rotation.turned(rotation.conjugate(rotation.normalised(mount or (1.0, 0.0, 0.0, 0.0))), DOWN)
        self._bare = pinocchio_model(robot, gravity=gravity)
        self._model = pinocchio_model(robot, gravity=gravity, rotors=rotors)
        self._bare_data, self._data = self._bare.createData(), self._model.createData()
        self._still = np.zeros(robot.n)
        flange = self._bare.frames[self._bare.getFrameId(FLANGE)]
        self._last, self._place, self._payload = flange.parentJoint, flange.placement, load
        self._empty = pin.Inertia(self._bare.inertias[self._last])
        self._weightless = pinocchio_model(robot, gravity=(0.0, 0.0, 0.0))
        self._weightless_data = self._weightless.createData()
        self.load, self._hanging = 0.0, False

    def carry(self, share: float) -> None:
        """Sets the share of the load that is included."""
        load = self._payload
        if load is None or share == self.load:
            return
        self.load = share
        self.hang(share * load.mass, load.com)

    def hang(self, mass: float, com: tuple[float, float, float]) -> None:
        """Sets the load that is included: kg, and its centre of mass in the flange frame, m."""
        inertia = self._empty
        if mass > 0.0:
            inertia = inertia + self._place.act(pin.Inertia(mass, np.array(com), np.zeros((3, 3))))
        self._model.inertias[self._last], self._hanging = inertia, mass > 0.0

    def inverse_mass(self, q: Array) -> Array:
        """M_a^-1 (n, n), 1/(kg m^2)."""
        found: Array = pin.computeMinverse(self._model, self._data, q)
        return found

    def bias(self, q: Array, qd: Array, *, gravity: bool, coriolis: bool) -> Array:
        """Returns the torques (n,) N m against weight and Coriolis forces.

        Args:
            gravity: True to include the arm's weight; otherwise only the load's weight is included.
            coriolis: True to include C_a qd.
        """
        qd = qd if coriolis else self._still
        found: Array
        if not gravity and not self._hanging:
            found = pin.nonLinearEffects(self._weightless, self._weightless_data, q, qd)
            return found
        found = pin.nonLinearEffects(self._model, self._data, q, qd)
        if not gravity:
            found = found - pin.computeGeneralizedGravity(self._bare, self._bare_data, q)
        return found


def add_base(A: Array, J: Array, linear: float, turning: float) -> None:
    """Adds J_b diag(linear, linear, turning) J_b^T to the lower triangle of A (6, 6), with J_b of J (6, 3 + n)."""
    u, v = J.item(0, 2), J.item(1, 2)
    A[0, 0] += linear + turning * u * u
    A[1, 0] += turning * u * v
    A[1, 1] += linear + turning * v * v
    A[5, 0] += turning * u
    A[5, 1] += turning * v
    A[5, 5] += turning
