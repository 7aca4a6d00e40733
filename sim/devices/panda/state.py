"""A simulated Franka robot's sensors, and the RobotState made from them and from its controller."""

from __future__ import annotations

from typing import Any, Final, Literal

import numpy as np

from drivers.panda.packets import RobotMode, state_record
from runtime.contracts.gravity import DOWN
from runtime.contracts.signals import Array
from sim.devices.panda.controller import FLIP, PandaController
from sim.devices.panda.motion import DT
from sim.parts.robots.arm import ArmPart

_BLOCK: Final = 128  # number of ticks whose random numbers are drawn together


class Sensors:
    """The arm as its controller measures it: every value is measured once a tick, with noise.

    The noise of tick k depends only on `key` and k.

    Attributes:
        position, velocity, effort, external_effort: (7,), rad, rad/s, N m, N m.
        effort_rate: (7,), N m/s.
    """

    def __init__(self, arm: ArmPart, key: list[int], noise: tuple[float, float, float]) -> None:
        """
        Args:
            arm: the arm with the true values.
            key: seed of the noise.
            noise: standard deviations of position, velocity, effort: rad, rad/s, N m.
        """
        self.arm = arm
        self._key, self._scale = key, np.repeat(noise, 7)
        self._silent = not any(noise)
        self._block = -1
        self._draws = np.zeros((0, 21))
        self._tick = 0
        self.position, self.velocity = arm.position.copy(), arm.velocity.copy()
        self.effort, self.external_effort = arm.effort.copy(), arm.external_effort.copy()
        self.effort_rate = np.zeros(7)
        self.stiffness = arm.robot.stiffness

    def measure(self) -> None:
        """Measures the values of the next tick."""
        arm, last = self.arm, self.effort
        self.position, self.velocity = arm.position, arm.velocity
        self.effort, self.external_effort = arm.effort, arm.external_effort
        if not self._silent:
            block, row = divmod(self._tick, _BLOCK)
            if block != self._block:
                rng = np.random.default_rng([*self._key, block])
                self._draws = rng.normal(0.0, 1.0, (_BLOCK, 21)) * self._scale
                self._block = block
            draw = self._draws[row]
            self.position = self.position + draw[:7]
            self.velocity = self.velocity + draw[7:14]
            self.effort = self.effort + draw[14:]
            self.external_effort = self.external_effort + draw[14:]
        self.effort_rate = (self.effort - last) / DT
        self._tick += 1

    def command(self, mode: Literal["brake", "torque", "position"], values: Array, rates: Array) -> None:
        """See `ArmPart.command`."""
        self.arm.command(mode, values, rates)

    def tell_payload(self, mass: float, com: Array) -> None:
        """See `ArmPart.tell_payload`."""
        self.arm.tell_payload(mass, com)


class StateWriter:
    """Fills one RobotState record in every tick.

    Attributes:
        record: shape (), of `packets.state_dtype(version)`.
    """

    def __init__(self, controller: PandaController, sensors: Sensors, version: int) -> None:
        self.record: Any = state_record(version)
        self._controller, self._sensors = controller, sensors
        self._revision = -1
        self.record["O_ddP_O"] = DOWN

    def write(self, message_id: int) -> None:
        """Copies the controller's present state."""
        control, sensors, record = self._controller, self._sensors, self.record
        if control.revision != self._revision:
            self._settings()
        motion = control.motion
        record["message_id"] = message_id
        record["q"] = record["theta"] = q = sensors.position
        record["dq"] = record["dtheta"] = sensors.velocity
        record["tau_J"] = sensors.effort
        record["dtau_J"] = sensors.effort_rate
        record["q_d"], record["dq_d"], record["ddq_d"] = motion.q, motion.dq, motion.ddq
        record["tau_J_d"] = control.torque
        record["tau_ext_hat_filtered"] = control.external
        record["O_F_ext_hat_K"] = wrench = control.wrench
        turn = (control.pose[:3, :3] @ control.settings.EE_T_K[:3, :3]).T
        record["K_F_ext_hat_K"] = np.concatenate((turn @ wrench[:3], turn @ wrench[3:]))
        record["O_T_EE"] = control.pose.T.ravel()
        record["O_T_EE_d"] = record["O_T_EE_c"] = control.desired_pose.T.ravel()
        record["elbow"] = (q[2], 1.0 if q[3] >= FLIP else -1.0)
        record["elbow_d"] = (motion.q[2], 1.0 if motion.q[3] >= FLIP else -1.0)
        record["joint_contact"], record["joint_collision"] = control.contact, control.collision
        record["cartesian_contact"] = control.cartesian_contact
        record["cartesian_collision"] = control.cartesian_collision
        record["motion_generator_mode"] = control.generator
        record["controller_mode"] = control.controller
        record["errors"], record["reflex_reason"] = control.errors, control.reflex_reason
        record["robot_mode"] = control.mode
        record["control_command_success_rate"] = control.reception.rate if control.mode is RobotMode.MOVE else 0.0

    def _settings(self) -> None:
        control, record = self._controller, self.record
        settings, self._revision = control.settings, control.revision
        for name in ("F_T_NE", "NE_T_EE", "F_T_EE", "EE_T_K"):
            record[name] = getattr(settings, name).T.ravel()
        record["m_ee"], record["F_x_Cee"] = control.tool.mass, control.tool.com
        record["m_load"], record["F_x_Cload"] = settings.load_mass, settings.load_centre
        record["I_load"] = settings.load_inertia.T.ravel()
