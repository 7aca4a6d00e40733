"""A simulated servo with protocol 2 firmware."""

from __future__ import annotations

from typing import Final

from srl.drivers.dynamixel import protocol2
from srl.drivers.dynamixel.family import VELOCITY2, Family2
from srl.drivers.dynamixel.models import Gains
from srl.drivers.dynamixel.table import CURRENT, POSITION, PWM
from srl.sim.devices.dynamixel.twin_registers import REVERSE, RPM, Registers
from srl.sim.parts.dynamixel.motors import FULL_PWM

_ACCELERATION: Final = 214.577 * RPM / 60  # rad/s^2 per unit
_GOALS: Final = {
    "goal_pwm",
    "goal_current",
    "goal_velocity",
    "goal_position",
    "profile_velocity",
    "profile_acceleration",
}


class Servo2(Registers):
    """See `Registers`. Not simulated: feed-forward. Slaves and time-based profiles are refused.

    In reverse mode (bit 0 of the drive mode) every register that has a direction counts clockwise, as in the firmware:
    positions and velocities, PWM and current, goals and measured values. The motor itself keeps its direction.
    """

    protocol = 2
    access_error, length_error, range_error = protocol2.ACCESS, protocol2.LENGTH, protocol2.RANGE

    def read(self, address: int, size: int) -> tuple[int, bytes]:
        error, data = super().read(address, size)
        if error or not any(address < at + n and address + size > at for _, at, n in self.model.series.indirect):
            return error, data
        out = bytearray(data)
        for k in range(size):
            out[k] = self.memory[self._target(address + k)]
        return 0, bytes(out)

    def write(self, address: int, data: bytes, volatile_only: bool = False) -> int:
        targets = [self._target(address + k) for k in range(len(data))]
        if targets == list(range(address, address + len(data))):
            return super().write(address, data, volatile_only)
        first = 0
        for k in range(1, len(data) + 1):
            if k == len(data) or targets[k] != targets[k - 1] + 1:
                if error := super().write(targets[first], data[first:k], volatile_only):
                    return error
                first = k
        return 0

    def refresh(self) -> None:
        m, i = self.motors, self.i
        sign = self.sign
        speed = sign * float(m.velocity[i]) / VELOCITY2
        counts, goal, trajectory = int(m.counts[i]), float(m.goal_position[i]), float(m.trajectory[i])
        amps = sign * float(m.current[i])
        self.put("torque_enable", int(m.torque[i]))
        self.put("hardware_error_status", int(m.errors[i]))
        self.put("realtime_tick", self.now // 1_000_000 % 32768)
        self.put("moving", int(abs(speed) > self.get("moving_threshold")))
        self.put("present_pwm", round(sign * float(m.pwm[i]) * FULL_PWM))
        if self.model.senses_current:
            self.put("present_current", round(amps / self.model.current_unit))
        else:
            self.put("present_load", round(min(max(amps / self.model.stall_current, -1), 1) * 1000))
        self.put("present_velocity", round(speed))
        self.put("present_position", self.shown(counts))
        self.put("velocity_trajectory", round(sign * float(m.trajectory_velocity[i]) / VELOCITY2))
        self.put("position_trajectory", round(self.shown(trajectory)))
        self.put("present_input_voltage", round(m.voltage[i] * 10))
        self.put("present_temperature", round(float(m.temperature[i])))
        profile = (3 if m.profile_acceleration[i] else 1) if m.profile_velocity[i] else 0
        there, on_the_way = abs(goal - counts) < 20, abs(goal - trajectory) > 1
        self.put("moving_status", there | on_the_way << 1 | profile << 4)

    def refuses(self, name: str, value: int) -> int:
        if self._tripped and name in _GOALS:
            return protocol2.RANGE
        if name == "drive_mode" and value & ~REVERSE:
            return protocol2.RANGE
        if name == "bus_watchdog" and value < 0:
            return protocol2.RANGE
        if name == "operating_mode":
            modes = {PWM, *(Family2.MODES[mode] for mode in self.model.modes)}
            return 0 if value in modes else protocol2.RANGE
        if name == "goal_position" and self.get("operating_mode") == POSITION:
            inside = self.get("min_position_limit") <= value <= self.get("max_position_limit")
            return 0 if inside else protocol2.LIMIT
        limit = {"goal_pwm": "pwm_limit", "goal_current": "current_limit", "goal_velocity": "velocity_limit"}.get(name)
        if limit is not None and abs(value) > self.get(limit):
            return protocol2.LIMIT
        return 0

    def take_effect(self, name: str, value: int) -> None:
        m, i = self.motors, self.i
        match name:
            case "torque_enable":
                m.switch(i, bool(value))
            case "drive_mode":
                m.goal_velocity[i] = 0.0
                self.put("goal_velocity", 0)
                self._goals_to_limits()
                self.put("goal_position", self.shown(int(m.counts[i])))
            case "operating_mode":
                self._change_mode(value)
            case "bus_watchdog":
                self._tripped = False
                m.stopped[i] = 0.0
                self._heard = self.now
            case "goal_position":
                m.goal_position[i] = self.aimed(value)
            case "goal_velocity":
                m.goal_velocity[i] = self.sign * value * VELOCITY2
            case "goal_current":
                m.goal_current[i] = self.sign * value * self.model.current_unit
            case "goal_pwm" | "pwm_limit":
                self._set_pwm()
            case "current_limit":
                m.current_cap[i] = value * self.model.current_unit
            case "profile_velocity":
                m.profile_velocity[i] = value * VELOCITY2
            case "profile_acceleration":
                m.profile_acceleration[i] = value * _ACCELERATION
            case "shutdown":
                m.shutdown[i] = value
            case "temperature_limit":
                m.temperature_limit[i] = value
            case _ if name.endswith("_gain"):
                self._set_gains()

    def restart(self) -> None:
        self._volatile_defaults()
        self._tripped = False
        self._heard = self.now
        m, i = self.motors, self.i
        m.power_up(i)
        m.mode[i] = self.get("operating_mode")
        m.shutdown[i], m.temperature_limit[i] = self.get("shutdown"), self.get("temperature_limit")
        self._goals_to_limits()
        self._set_gains()
        self.put("goal_position", self.shown(int(m.counts[i])))

    def instruction_taken(self) -> None:
        self._heard = self.now

    def tick(self) -> None:
        wait = self.get("bus_watchdog")
        if wait > 0 and not self._tripped and self.now - self._heard > wait * 20_000_000:
            self._tripped = True
            self.put("bus_watchdog", -1)
            self.motors.halt(self.i)

    def _target(self, address: int) -> int:
        """The address to which an indirect address points; other and invalid addresses point to themselves."""
        for addresses, data, count in self.model.series.indirect:
            if data <= address < data + count:
                at = addresses + 2 * (address - data)
                target = self.memory[at] | self.memory[at + 1] << 8
                return target if target < self.size else address
        return address

    def _change_mode(self, mode: int) -> None:
        m, i = self.motors, self.i
        m.mode[i] = mode
        for name in ("profile_velocity", "profile_acceleration"):
            self.put(name, 0)
            self.take_effect(name, 0)
        for name, register in self.by_name.items():
            if name.endswith("_gain"):
                self.put(name, register.default)
        self._goals_to_limits()
        self._set_gains()
        m.goal_velocity[i] = 0.0
        self.put("goal_velocity", 0)
        if mode == POSITION:
            m.fold(i)

    def _goals_to_limits(self) -> None:
        self.put("goal_pwm", self.get("pwm_limit"))
        self._set_pwm()
        if self.model.senses_current:
            self.put("goal_current", 0 if self.get("operating_mode") == CURRENT else self.get("current_limit"))
            self.take_effect("goal_current", self.get("goal_current"))
            self.take_effect("current_limit", self.get("current_limit"))

    def _set_pwm(self) -> None:
        m, i, goal, limit = self.motors, self.i, self.get("goal_pwm"), self.get("pwm_limit")
        driven = self.get("operating_mode") == PWM
        m.goal_pwm[i] = self.sign * goal / FULL_PWM if driven else 0.0
        m.pwm_cap[i] = (limit if driven else min(abs(goal), limit)) / FULL_PWM

    def _set_gains(self) -> None:
        self.motors.tune(self.i, Gains(*(self.get(f"{name}_gain") for name in Gains._fields)))
