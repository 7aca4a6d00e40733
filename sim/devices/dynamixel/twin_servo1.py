"""A simulated MX servo with protocol 1 firmware."""

from __future__ import annotations

from typing import Final

import numpy as np

from srl.drivers.dynamixel.family import CURRENT1, VELOCITY1
from srl.drivers.dynamixel.table import CURRENT, EXTENDED, POSITION, VELOCITY
from srl.drivers.servo_bus import protocol1
from srl.drivers.servo_bus.models import CENTRE
from srl.sim.devices.dynamixel.twin_registers import REVERSE, Registers, whole
from srl.sim.parts.servo_bus.motors import HEAT_BIT, OVERLOAD_BIT, VOLTAGE_BIT

FULL_PWM: Final = 1023
_ACCELERATION: Final = np.radians(8.583)  # rad/s^2 per unit


class Servo1(Registers):
    """See `Registers`. Not simulated: the resolution divider, the multi-turn offset, the lock. Slaves are refused."""

    protocol = 1
    # The angle error is only for goals beyond the angle limits.
    access_error = length_error = range_error = protocol1.RANGE

    def refresh(self) -> None:
        m, i = self.motors, self.i
        sign = self.sign
        speed = sign * m.velocity[i] / VELOCITY1
        self.put("torque_enable", int(m.torque[i]))
        self.put("present_position", self.shown(int(m.counts[i])))
        self.put("present_speed", with_sign(speed))
        self.put("present_load", with_sign(sign * m.current[i] / m.stall_current[i] * 1000))
        self.put("present_voltage", whole(m.voltage[i] * 10))
        self.put("present_temperature", whole(m.temperature[i]))
        self.put("moving", int(abs(speed) > 5))
        self.put("realtime_tick", self.now // 1_000_000 % 32768)
        if self.model.senses_current:
            self.put("current", CENTRE + whole(sign * m.current[i] / CURRENT1))

    @property
    def error_bits(self) -> int:
        """The error bits that every status packet contains."""
        return int(self.motors.errors[self.i]) & (VOLTAGE_BIT | HEAT_BIT | OVERLOAD_BIT)

    def refuses(self, name: str, value: int) -> int:
        if name == "drive_mode" and value & ~REVERSE:
            return protocol1.RANGE
        if name == "goal_position" and self.motors.mode[self.i] == POSITION:
            inside = self.get("cw_angle_limit") <= value <= self.get("ccw_angle_limit")
            return 0 if inside else protocol1.ANGLE
        return 0

    def take_effect(self, name: str, value: int) -> None:
        m, i = self.motors, self.i
        match name:
            case "torque_enable":
                m.switch(i, bool(value))
            case "cw_angle_limit" | "ccw_angle_limit" | "torque_control_mode":
                self._set_mode()
            case "goal_position":
                m.goal_position[i] = self.aimed(value)
                m.switch(i, True)
                m.goal_position[i] = self.aimed(value)
            case "drive_mode":
                self.put("goal_position", self.shown(int(m.counts[i])))
                self._set_speed()
            case "moving_speed":
                self._set_speed()
            case "goal_torque":
                m.goal_current[i] = self.sign * magnitude(value) * CURRENT1
            case "torque_limit":
                m.pwm_cap[i] = value / FULL_PWM
                if value:
                    m.errors[i] = m.overloaded[i] = 0.0
            case "goal_acceleration":
                m.profile_acceleration[i] = value * _ACCELERATION
            case "position_p_gain" | "position_i_gain" | "position_d_gain":
                self._set_gains()
            case "shutdown":
                m.shutdown[i] = value
            case "temperature_limit":
                m.temperature_limit[i] = value

    def restart(self) -> None:
        self._volatile_defaults()
        m, i = self.motors, self.i
        m.power_up(i)
        self.put("torque_limit", self.get("max_torque"))
        m.pwm_cap[i] = self.get("max_torque") / FULL_PWM
        m.shutdown[i], m.temperature_limit[i] = self.get("shutdown"), self.get("temperature_limit")
        m.goal_current[i] = 0.0
        self._set_gains()
        self._set_mode()
        self.put("goal_position", self.shown(int(m.counts[i])))

    def instruction_taken(self) -> None:
        """Does nothing: this firmware doesn't watch the bus."""

    def tick(self) -> None:
        m, i = self.motors, self.i
        if int(m.errors[i]) & int(m.shutdown[i]) and m.pwm_cap[i]:
            self.put("torque_limit", 0)  # how this firmware releases the motor
            m.pwm_cap[i] = 0.0

    def _set_mode(self) -> None:
        m, i = self.motors, self.i
        low, high = self.get("cw_angle_limit"), self.get("ccw_angle_limit")
        mode = VELOCITY if low == high == 0 else EXTENDED if low == high == 4095 else POSITION
        if self.model.senses_current and self.get("torque_control_mode"):
            mode = CURRENT
        if m.mode[i] != mode:
            m.mode[i] = mode
            m.integral[i] = 0.0
            if mode == POSITION:
                m.fold(i)
            m.goal_position[i] = m.counts[i]
        self._set_speed()

    def _set_speed(self) -> None:
        m, i, value = self.motors, self.i, self.get("moving_speed")
        m.goal_velocity[i] = self.sign * magnitude(value) * VELOCITY1 if m.mode[i] == VELOCITY else 0.0
        m.profile_velocity[i] = 0.0 if m.mode[i] == VELOCITY else abs(magnitude(value)) * VELOCITY1

    def _set_gains(self) -> None:
        m, i = self.motors, self.i
        m.kp[i] = self.get("position_p_gain") / 8 / FULL_PWM
        m.ki[i] = self.get("position_i_gain") * 1000 / 2048 / FULL_PWM
        m.kd[i] = self.get("position_d_gain") * 4 / 1000 / FULL_PWM


def magnitude(raw: int) -> int:
    """Converts magnitude and direction to a signed number (bit 10 set: clockwise, negative)."""
    return -(raw & 0x3FF) if raw & 0x400 else raw & 0x3FF


def with_sign(value: float) -> int:
    """Converts a signed number to magnitude and direction."""
    size = min(abs(whole(value)), 0x3FF)
    return size | 0x400 if value < 0 and size else size
