"""A simulated Franka robot's sensors, and the RobotState made from them and from its controller."""

from __future__ import annotations

from typing import Any, Final, Literal

import numpy as np

from drivers.panda.packets import ERRORS, RobotMode, state_record
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
        self._draws = np.zeros((0, 4, 7))
        self._tick = 0
        self._values = np.zeros((4, 7))
        self.position, self.velocity, self.effort, self.external_effort = self._values
        arm.measured(self._values)
        self.effort_rate = np.zeros(7)
        self.stiffness = arm.robot.stiffness

    def measure(self) -> None:
        """Measures the values of the next tick."""
        np.negative(self.effort, out=self.effort_rate)
        self.arm.measured(self._values)
        if not self._silent:
            block, row = divmod(self._tick, _BLOCK)
            if block != self._block:
                rng = np.random.default_rng([*self._key, block])
                draws = (rng.normal(0.0, 1.0, (_BLOCK, 21)) * self._scale).reshape(_BLOCK, 3, 7)
                self._draws = draws.take((0, 1, 2, 2), axis=1)  # both efforts err alike
                self._block = block
            self._values += self._draws[row]
        self.effort_rate += self.effort
        self.effort_rate /= DT
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
        # Views of neighbouring fields: each is filled by one call.
        self._desired: Array | None = None  # the pose that the record holds
        self._id = self._view("message_id", "message_id")
        self._poses, self._commanded = self._view("O_T_EE", "O_T_EE_d"), self._view("O_T_EE_c", "O_T_EE_c")
        self._elbows, self._moved = self._view("elbow", "elbow_d"), self._view("tau_J", "ddq_d")
        self._felt, self._motors = self._view("joint_contact", "K_F_ext_hat_K"), self._view("theta", "dtheta")
        self._modes = self._view("motion_generator_mode", "robot_mode", np.uint8)
        self._rate = self._view("control_command_success_rate", "control_command_success_rate")

    def _view(self, first: str, last: str, kind: Any = None) -> Any:
        """The fields from `first` to `last`, which follow each other, as one array."""
        layout = self.record.dtype
        (of_first, start), (of_last, end) = layout.fields[first][:2], layout.fields[last][:2]
        real = np.dtype(kind or of_first.base)
        return np.ndarray(((end + of_last.itemsize - start) // real.itemsize,), real, self.record, start)

    def write(self, message_id: int) -> None:
        """Copies the controller's present state."""
        control, sensors = self._controller, self._sensors
        if control.revision != self._revision:
            self._settings()
        motion, wrench, pose = control.motion, control.wrench, control.pose
        self._id[0] = message_id
        q, dq, q_d = sensors.position, sensors.velocity, motion.q
        moved = (sensors.effort, control.torque, sensors.effort_rate, q, q_d, dq, motion.dq, motion.ddq)
        np.concatenate(moved, out=self._moved, casting="same_kind")
        np.concatenate((q, dq), out=self._motors, casting="same_kind")
        turn = pose[:3, :3] if self._at_ee else pose[:3, :3] @ control.settings.EE_T_K[:3, :3]
        felt = (control.touching.ravel(), control.external, wrench, (wrench.reshape(2, 3) @ turn).ravel())
        np.concatenate(felt, out=self._felt, casting="same_kind")
        self._poses[:16] = pose.T.ravel()
        if control.desired_pose is not self._desired:
            self._desired = control.desired_pose
            self._poses[16:] = self._commanded[:] = self._desired.T.ravel()
        self._elbows[:] = q[2], 1.0 if q[3] >= FLIP else -1.0, q_d[2], 1.0 if q_d[3] >= FLIP else -1.0
        modes = self._modes
        modes[0], modes[1], modes[-1] = control.generator, control.controller, control.mode
        modes[2 : 2 + len(ERRORS)], modes[2 + len(ERRORS) : -1] = control.errors, control.reflex_reason
        self._rate[0] = control.reception.rate if control.mode is RobotMode.MOVE else 0.0

    def _settings(self) -> None:
        control, record = self._controller, self.record
        settings, self._revision = control.settings, control.revision
        self._at_ee = np.array_equal(settings.EE_T_K, np.eye(4))
        for name in ("F_T_NE", "NE_T_EE", "F_T_EE", "EE_T_K"):
            record[name] = getattr(settings, name).T.ravel()
        record["m_ee"], record["F_x_Cee"] = control.tool.mass, control.tool.com
        record["m_load"], record["F_x_Cload"] = settings.load_mass, settings.load_centre
        record["I_load"] = settings.load_inertia.T.ravel()
