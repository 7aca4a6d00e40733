"""What RTDE clients and programs share: registers, digital outputs, the speed slider, watchdogs on inputs."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from math import nan
from typing import Any, Final

import numpy as np

from srl.drivers.ur.recipe import register
from srl.drivers.ur.status import RobotMode, SafetyMode
from srl.runtime.contracts.gravity import DOWN
from srl.runtime.contracts.signals import Array
from srl.sim.devices.ur import fake
from srl.sim.devices.ur.controller import UrController

_KEPT: Final = 500  # cycles whose registers are stored, for samples that are sent late
_OUTPUTS: Final = {"standard_digital_output": 0, "configurable_digital_output": 8, "tool_digital_output": 16}
_AMPERES: Final = 0.1  # A per N m: invented, because the motors' constants aren't public
_VOLTS, _LOWEST, _HIGHEST = 10.0, 0.004, 0.02  # V; A, A: ranges of an analog output
_CONSTANT: Final = {
    "actual_main_voltage": 48.0, "actual_robot_voltage": 48.0, "joint_temperatures": (30.0,) * 6,
    "actual_joint_voltage": (48.0,) * 6,
}  # fmt: skip
_SLICES: Final = {
    "target_q": fake.TARGET_Q, "target_qd": fake.TARGET_QD, "target_qdd": fake.TARGET_QDD, "actual_q": fake.Q,
    "actual_qd": fake.QD, "target_moment": fake.EFFORT, "actual_current_as_torque": fake.TORQUE,
    "actual_TCP_force": fake.WRENCH, "ft_raw_wrench": fake.WRENCH, "actual_TCP_pose": fake.TOOL,
    "target_TCP_pose": fake.TOOL, "actual_TCP_speed": fake.TWIST, "target_TCP_speed": fake.TWIST,
}  # fmt: skip
_CURRENTS: Final = {"target_current": fake.EFFORT, "actual_current": fake.TORQUE, "joint_control_output": fake.TORQUE}


class Bank:
    """Registers of one direction."""

    def __init__(self) -> None:
        self.ints = [0] * 48
        self.doubles = [0.0] * 48
        self.bits = [False] * 128

    def of(self, kind: str) -> list[Any]:
        """The registers of a kind: int, double or bit."""
        banks: dict[str, list[Any]] = {"int": self.ints, "double": self.doubles, "bit": self.bits}
        return banks[kind]


class Registers:
    """The shared registers; see the module's text.

    Attributes:
        inputs, outputs: registers that clients write, and registers that programs write.
        analog: the two standard analog outputs, V or A.
    """

    def __init__(self, controller: UrController) -> None:
        self.inputs, self.outputs = Bank(), Bank()
        self.analog = [0.0, 0.0]
        self._controller = controller
        self._written: dict[str, int] = {}  # cycle in which each input was last written, by name
        self._watchdogs: dict[str, tuple[int, str]] = {}
        self._past: deque[tuple[int, list[int], list[float], int]] = deque(maxlen=_KEPT)

    # -- from clients

    def write(self, values: dict[str, Any]) -> None:
        """Takes one data message of a client."""
        for name, value in values.items():
            self._written[name] = self._controller.cycles
            known = register(name)
            if known is not None:
                self.inputs.of(known[1])[known[2]] = value
        for name, shift in _OUTPUTS.items():
            mask = int(values.get(f"{name}_mask", 0)) << shift
            bits = int(values.get(name, 0)) << shift
            self._controller.outputs = self._controller.outputs & ~mask | bits & mask
        for number in range(2):
            if int(values.get("standard_analog_output_mask", 0)) >> number & 1:
                volts = int(values.get("standard_analog_output_type", 0)) >> number & 1
                share = min(max(values[f"standard_analog_output_{number}"], 0.0), 1.0)
                self.analog[number] = share * _VOLTS if volts else _LOWEST + share * (_HIGHEST - _LOWEST)
        fraction = values.get("speed_slider_fraction", nan)
        if values.get("speed_slider_mask") and 0 <= fraction <= 1:
            self._controller.slider = max(fraction, 0.01)

    # -- from programs

    def write_int(self, number: int, value: float) -> None:
        """write_output_integer_register; the value has 32 bits, as on a controller."""
        self.outputs.ints[number] = (int(value) + 2**31) % 2**32 - 2**31

    def watch(self, name: str, frequency: float, action: str = "pause") -> None:
        """rtde_set_watchdog: sets the action for an input that isn't written for 1 / frequency."""
        if action == "ignore" or frequency <= 0:
            self._watchdogs.pop(name, None)
        else:
            self._written[name] = self._controller.cycles
            self._watchdogs[name] = (round(500 / frequency), action)

    def forget_watchdogs(self) -> None:
        """Removes the watchdogs of a program that has ended."""
        self._watchdogs.clear()

    def bites(self) -> str:
        """The name of an overdue input; "" if there is none."""
        for name, (cycles, _) in self._watchdogs.items():
            if self._controller.cycles - self._written[name] > cycles:
                return name
        return ""

    def remember(self) -> None:
        """Stores what RTDE reports of a control cycle, at its end."""
        bank = self.outputs
        self._past.append((self._controller.cycles, bank.ints.copy(), bank.doubles.copy(), self._controller.outputs))

    # -- to clients

    def reader(self, names: Sequence[str]) -> Callable[[int, Array], list[Any]]:
        """Returns a function that reads these variables of cycle `number`, whose sample is `values`."""
        readers = [self._reader(name) for name in names]

        def read(number: int, values: Array) -> list[Any]:
            self._at = self._of(number)
            self._number = number
            return [one(values) for one in readers]

        return read

    def _of(self, number: int) -> tuple[int, list[int], list[float], int]:
        for entry in reversed(self._past):
            if entry[0] <= number:
                return entry
        bank = self.outputs
        return self._past[0] if self._past else (number, bank.ints, bank.doubles, 0)

    def _reader(self, name: str) -> Callable[[Array], Any]:
        known = register(name)
        if known is not None:
            return self._register(*known)
        if name in _SLICES:
            part = _SLICES[name]
            return lambda values: values[part].tolist()
        if name in _CURRENTS:
            part = _CURRENTS[name]
            return lambda values: (values[part] * _AMPERES).tolist()
        if name in _CONSTANT:
            constant = _CONSTANT[name]
            return lambda values: constant
        controller = self._controller
        readers: dict[str, Callable[[Array], Any]] = {
            "timestamp": lambda values: self._number * 0.002,
            "robot_mode": lambda values: int(values[fake.ROBOT]),
            "safety_mode": lambda values: int(values[fake.SAFETY]),
            "safety_status": lambda values: int(values[fake.SAFETY]),
            "safety_status_bits": lambda values: int(controller.bits_of(SafetyMode(int(values[fake.SAFETY])))),
            "robot_status_bits": lambda values: int(values[fake.BITS]),
            "runtime_state": lambda values: int(values[fake.RUNTIME]),
            "speed_scaling": lambda values: float(values[fake.SCALING]),
            "target_speed_fraction": lambda values: controller.slider,
            "actual_digital_input_bits": lambda values: int(values[fake.INPUTS]),
            "actual_digital_output_bits": lambda values: self._at[3],
            "joint_mode": lambda values: (_JOINT_MODE.get(RobotMode(int(values[fake.ROBOT])), 239),) * 6,
            "standard_analog_output0": lambda values: self.analog[0],
            "standard_analog_output1": lambda values: self.analog[1],
            "payload": lambda values: controller.payload[0],
            "payload_cog": lambda values: controller.payload[1],
            "actual_tool_accelerometer": lambda values: (controller.arm.flange()[0].T @ -np.array(DOWN)).tolist(),
            "payload_inertia": lambda values: (0.0,) * 6,
        }
        return readers.get(name, lambda values: 0)

    def _register(self, way: str, kind: str, number: int) -> Callable[[Array], Any]:
        if way == "input" or kind == "bit":
            bank = (self.inputs if way == "input" else self.outputs).of(kind)
            return lambda values: bank[number]
        column = 1 if kind == "int" else 2
        return lambda values: self._at[column][number]  # type: ignore[index]


_JOINT_MODE: Final = {RobotMode.RUNNING: 253, RobotMode.IDLE: 255, RobotMode.POWER_ON: 247}
