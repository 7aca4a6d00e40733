"""The firmware of one CubeMars AK actuator in servo mode (sheet can_actuators, section 3), on a simulated motor.

Assumed, as no source says it: after its time limit a drive coasts and obeys the next frame; a status stays at its end;
the position loop gives the peak torque at 0.2 rad. Duty and MIT mode aren't simulated.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from math import degrees, radians, sqrt
from typing import Final

import can

from srl.drivers.cubemars_servo import protocol
from srl.drivers.cubemars_servo.config import CubemarsServoConfig, ServoAxis
from srl.drivers.cubemars_servo.protocol import Mode
from srl.sim.devices.shared.can_drives import Node
from srl.sim.parts.actuators.chain import ActuatorChain
from srl.sim.parts.actuators.motors import SLACK, STAGE_BIT, VOLTAGE_BIT, WINDING_BIT

_BITS: Final = {WINDING_BIT: 1, STAGE_BIT: 6, VOLTAGE_BIT: 4}
_REACH: Final = 0.2  # rad of error at which the position loop gives the peak torque
_DAMPING: Final = 0.03  # s, of the position loop
_SPEED_GAIN: Final = 0.5  # s/rad: share of the peak torque for each rad/s of error
_STEP: Final = 0.005  # s, longest step of the ramp


class ServoNode(Node):
    """One actuator.

    Attributes:
        id: its number on the bus.
        origins: frames that moved its origin: temporary and stored.
        refused: frames of modes that aren't simulated.
    """

    def __init__(self, chain: ActuatorChain, i: int, axis: ServoAxis, config: CubemarsServoConfig) -> None:
        super().__init__(chain, i)
        self.id, self._erpm = axis.id, axis.facts.erpm
        self._timeout, self._period = config.timeout, round(1e9 / config.status_rate)
        self.origins = [0, 0]
        self.refused = 0
        self._model = chain.motors.models[i]
        self.motors.fold(i)
        self._restart()

    def _restart(self) -> None:
        self._mode, self._value, self._most, self._ramp = Mode.CURRENT, 0.0, 0.0, 0.0
        self._place = self._pace = 0.0  # rad, rad/s: where the ramp is
        self._sent = self._last = -1
        motors, i = self.motors, self.i
        motors.timeout[i], motors.expiry[i] = self._timeout, SLACK
        motors.switch(i, True)

    def power_up(self) -> None:
        """The turns that its encoder can't tell are lost."""
        self.motors.power_up(self.i)
        self._restart()

    def take(self, message: can.Message, now: int) -> Sequence[can.Message]:
        """It never answers: its status comes by itself."""
        mode, number = protocol.split(message.arbitration_id)
        data = bytes(message.data)
        if not message.is_extended_id or number != self.id or mode not in Mode.__members__.values():
            return ()
        self._run(now)
        if self._obey(Mode(mode), data):
            self.motors.feed(self.i)
            self._apply()
        else:
            self.refused += 1
        return ()

    def _obey(self, mode: Mode, data: bytes) -> bool:
        if mode == Mode.ORIGIN and len(data) == 1 and data[0] < 2:
            self.origins[data[0]] += 1
            self.motors.set_zero(self.i, bool(data[0]))
            return True
        if mode in (Mode.CURRENT, Mode.BRAKE, Mode.SPEED) and len(data) == 4:
            value = struct.unpack(">i", data)[0]
            self._value = value / self._erpm if mode == Mode.SPEED else value / 1000 * self._model.torque_constant
        elif mode in (Mode.POSITION, Mode.POSITION_SPEED) and len(data) >= 4:
            self._value = radians(struct.unpack_from(">i", data)[0] / 10_000)
            self._most, self._ramp = self._model.no_load_speed, 1e4
            if mode == Mode.POSITION_SPEED:
                if len(data) != 8:
                    return False
                self._most, self._ramp = (x * 10 / self._erpm for x in struct.unpack_from(">hh", data, 4))
            if self._mode not in (Mode.POSITION, Mode.POSITION_SPEED):
                self._place, self._pace = float(self.motors.angle[self.i]), float(self.motors.velocity[self.i])
        else:
            return False
        self._mode = mode
        return True

    def _run(self, now: int) -> None:
        """Moves the ramp."""
        span = (now - self._last) * 1e-9 if self._last >= 0 else 0.0
        self._last = now
        if self._mode not in (Mode.POSITION, Mode.POSITION_SPEED) or span <= 0 or self._slack:
            return
        span = min(span, 0.1)
        for _ in range(max(1, round(span / _STEP))):
            dt = span / max(1, round(span / _STEP))
            rest = self._value - self._place
            wanted = min(self._most, sqrt(2 * self._ramp * abs(rest))) * (1 if rest > 0 else -1)
            if abs(wanted) * dt > abs(rest):
                wanted = rest / dt
            change = self._ramp * dt
            self._pace += max(-change, min(change, wanted - self._pace))
            self._place += self._pace * dt
        self._apply()

    @property
    def _slack(self) -> bool:
        """Whether it heard nothing for too long."""
        return bool(self.motors.age[self.i] > self._timeout)

    def _apply(self) -> None:
        motors, i, peak = self.motors, self.i, self._model.peak_torque
        motors.slacken(i)
        match self._mode:
            case Mode.CURRENT:
                motors.feedforward[i] = self._value
            case Mode.BRAKE:
                motors.brake[i] = self._value
            case Mode.SPEED:
                motors.kd[i], motors.speed[i] = _SPEED_GAIN * peak, self._value
            case _:
                motors.kp[i] = peak / _REACH
                motors.kd[i] = _DAMPING * motors.kp[i]
                motors.goal[i], motors.speed[i] = self._place, self._pace

    def due(self, now: int) -> Sequence[can.Message]:
        if now >= 0:
            self._run(now)
            if self._sent >= 0 and 0 <= now - self._sent < self._period:
                return ()
            self._sent = now
        motors, i = self.motors, self.i
        place = max(-32000, min(32000, round(degrees(float(motors.angle[i])) * 10)))
        speed = max(-32768, min(32767, round(float(motors.velocity[i]) * self._erpm / 10)))
        current = max(-32768, min(32767, round(float(motors.current[i]) * 100)))
        error = next((code for bit, code in _BITS.items() if int(motors.errors[i]) & bit), 0)
        data = struct.pack(">hhhbB", place, speed, current, min(127, round(float(motors.stage[i]))), error)
        identifier = protocol.identifier(protocol.STATUS, self.id)
        return (can.Message(arbitration_id=identifier, data=data, is_extended_id=True),)
