"""A simulated Franka robot's sensors, and the RobotState made from them and from its controller."""

from __future__ import annotations

from typing import Any, Final, Literal

import numpy as np

from srl.drivers.panda.packets import ROOM, RobotMode, state_dtype
from srl.runtime.contracts.compiled import bind_or_python, numbers
from srl.runtime.contracts.gravity import DOWN
from srl.runtime.contracts.signals import Array
from srl.sim.devices.panda.controller import FLIP, PandaController
from srl.sim.devices.panda.motion import DT
from srl.sim.parts.robots.arm import ArmPart

_BLOCK: Final = 128  # number of ticks whose random numbers are drawn together


class Sensors:
    """The arm as its controller measures it: every value is measured once a tick, with noise.

    The noise of tick k depends only on `key` and k.

    Attributes:
        position, velocity, effort, external_effort: (7,), rad, rad/s, N m, N m.
        effort_rate: (7,), N m/s.
        values: (4, 7), the first four.
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
        self.values = np.zeros((4, 7))
        self.position, self.velocity, self.effort, self.external_effort = self.values
        arm.measured(self.values)
        self.effort_rate = np.zeros(7)
        self.stiffness = arm.robot.stiffness

    def measure(self) -> None:
        """Measures the values of the next tick."""
        np.negative(self.effort, out=self.effort_rate)
        self.arm.measured(self.values)
        if not self._silent:
            block, row = divmod(self._tick, _BLOCK)
            if block != self._block:
                rng = np.random.default_rng([*self._key, block])
                draws = (rng.normal(0.0, 1.0, (_BLOCK, 21)) * self._scale).reshape(_BLOCK, 3, 7)
                self._draws = draws.take((0, 1, 2, 2), axis=1)  # both efforts err alike
                self._block = block
            self.values += self._draws[row]
        self.effort_rate += self.effort
        self.effort_rate /= DT
        self._tick += 1

    def command(self, mode: Literal["brake", "torque", "position"], values: Array, rates: Array) -> None:
        self.arm.command(mode, values, rates)

    def tell_payload(self, mass: float, com: Array) -> None:
        self.arm.tell_payload(mass, com)


class StateWriter:
    """Fills one RobotState record in every tick: in C where it can be (native/panda.c), to the same bits.

    Attributes:
        record: shape (), of `packets.state_dtype(version)`.
    """

    def __init__(self, controller: PandaController, sensors: Sensors, version: int) -> None:
        layout, body = state_dtype(version), np.zeros(ROOM[0])
        self.record: Any = np.ndarray((), layout, body)
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
        self._k_turn, self._success = np.eye(3), np.zeros(1)  # of frame K in the end effector's; the success rate
        self._single, self._shown = layout["m_ee"].itemsize == 4, b""
        assert layout.fields is not None
        fields = ("O_T_EE", "elbow", "tau_J", "joint_contact", "theta", "control_command_success_rate")
        places = numbers([layout.fields[name][1] for name in fields], FLIP)
        self._in_c = bind_or_python(
            "panda-record", body, places, sensors.values, sensors.effort_rate, controller.torque,
            controller.motion.state, controller.touching, controller.external, controller.wrench, controller.pose,
            self._k_turn, self._success,
        )  # fmt: skip

    def _view(self, first: str, last: str, kind: Any = None) -> Any:
        """The fields from `first` to `last`, which follow each other, as one array."""
        layout = self.record.dtype
        (of_first, start), (of_last, end) = layout.fields[first][:2], layout.fields[last][:2]
        real = np.dtype(kind or of_first.base)
        return np.ndarray(((end + of_last.itemsize - start) // real.itemsize,), real, self.record, start)

    def write(self, message_id: int) -> None:
        """Copies the controller's present state."""
        control = self._controller
        if control.revision != self._revision:
            self._settings()
        self._success[0] = control.reception.rate if control.mode is RobotMode.MOVE else 0.0
        self._id[0] = message_id
        if self._in_c(0.0, self._single) < 0:
            self._copy()
        if control.desired_pose is not self._desired:
            self._desired = control.desired_pose
            self._poses[16:] = self._commanded[:] = self._desired.T.ravel()
        modes = bytes((control.generator, control.controller))
        modes += control.errors.tobytes() + control.reflex_reason.tobytes() + bytes((control.mode,))
        if modes != self._shown:
            self._shown, self._modes[:] = modes, list(modes)

    def _copy(self) -> None:
        """Copies the numbers that are new in every tick."""
        control, sensors = self._controller, self._sensors
        motion, q, dq, q_d = control.motion, sensors.position, sensors.velocity, control.motion.q
        # The sums are written out, as in C: those of a product of matrices are in an order of their own.
        R, k = control.pose.tolist(), self._k_turn.tolist()
        turn = [[r[0] * k[0][j] + r[1] * k[1][j] + r[2] * k[2][j] for j in range(3)] for r in R[:3]]
        parts = control.wrench.reshape(2, 3).tolist()
        at_k = [v[0] * turn[0][j] + v[1] * turn[1][j] + v[2] * turn[2][j] for v in parts for j in range(3)]
        moved = (sensors.effort, control.torque, sensors.effort_rate, q, q_d, dq, motion.dq, motion.ddq)
        np.concatenate(moved, out=self._moved, casting="same_kind")
        np.concatenate((q, dq), out=self._motors, casting="same_kind")
        felt = (control.touching.ravel(), control.external, control.wrench, at_k)
        np.concatenate(felt, out=self._felt, casting="same_kind")
        self._poses[:16] = control.pose.T.ravel()
        self._elbows[:] = q[2], 1.0 if q[3] >= FLIP else -1.0, q_d[2], 1.0 if q_d[3] >= FLIP else -1.0
        self._rate[:] = self._success

    def _settings(self) -> None:
        control, record = self._controller, self.record
        settings, self._revision = control.settings, control.revision
        self._k_turn[:] = settings.EE_T_K[:3, :3]
        for name in ("F_T_NE", "NE_T_EE", "F_T_EE", "EE_T_K"):
            record[name] = getattr(settings, name).T.ravel()
        record["m_ee"], record["F_x_Cee"] = control.tool.mass, control.tool.com
        record["m_load"], record["F_x_Cload"] = settings.load_mass, settings.load_centre
        record["I_load"] = settings.load_inertia.T.ravel()
