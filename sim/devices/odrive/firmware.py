"""The firmware of one ODrive axis, as far as the protocol sheet can_actuators (section 4) tells, on a simulated motor.

Assumed, as no source says it: with 0.6 the watchdog is fed by a state and by inputs, not by requests; it runs only
while the axis has torque. The integrator of the velocity loop runs at the pace of the frames. Gains are as delivered.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from math import tau
from typing import Final

import can

from srl.drivers.odrive import protocol
from srl.drivers.odrive.config import Endpoints, OdriveAxis, OdriveConfig
from srl.drivers.odrive.protocol import CLOSED_LOOP, IDLE, Command
from srl.drivers.odrive.units import Scale
from srl.drivers.odrive.words import WATCHDOG
from srl.sim.devices.shared.can_drives import Node
from srl.sim.parts.actuators.chain import ActuatorChain
from srl.sim.parts.actuators.motors import OFF, SILENCE_BIT, STAGE_BIT, VOLTAGE_BIT, WINDING_BIT

BEAT: Final = 100_000_000  # ns between two heartbeats
ESTIMATES: Final = 10_000_000  # ns between two estimates
POSITION_GAIN, VELOCITY_GAIN, INTEGRATOR = 20.0, 0.16, 0.32  # as delivered: 1/s, N m/(turn/s), N m/turn
FIRMWARE, HARDWARE = (0, 6, 10), (4, 4, 58)
TIMEOUT, ENABLE, TORQUE_CONSTANT = 401, 402, 403  # numbers of the endpoints, where the profile names no file
ESTOP: Final = {"0.5": 0x4000, "0.6": 1 << 25}
_OF_MOTOR: Final = {  # error bits of the motor by firmware
    "0.6": {WINDING_BIT: 0x2000, STAGE_BIT: 0x4000, VOLTAGE_BIT: 0x200},
    "0.5": {WINDING_BIT: 0x40000, STAGE_BIT: 0x40000, VOLTAGE_BIT: 0x40},
}


class OdriveNode(Node):
    """One axis of an ODrive.

    Attributes:
        node, serial: its id and its serial number.
        firmware, hardware: what it tells as its version (0.6).
        error: its error bits.
        state: its state.
        watchdog: s; 0: none.
        torque_constant: N m/A, as it is set in the ODrive.
    """

    def __init__(self, chain: ActuatorChain, i: int, axis: OdriveAxis, config: OdriveConfig) -> None:
        super().__init__(chain, i)
        self.axis, self.config, self._scale = axis, config, Scale(axis)
        self.node = axis.node
        self.serial = axis.serial or f"{0x3564_0000_0000 + axis.node:012X}"
        self.firmware: tuple[int, ...] = FIRMWARE
        self.hardware: tuple[int, ...] = HARDWARE
        self.timeout_at, self.enable_at, self.torque_constant_at = TIMEOUT, ENABLE, TORQUE_CONSTANT
        self.torque_constant = axis.torque_constant
        # A world begins with an axis that was switched on where it is parked.
        if axis.encoder == "motor":
            assert axis.parked is not None
            self.motors.zero[i] = axis.parked / chain.scale[i] + chain.zero[i]
        else:
            self.motors.fold(i)
        self._restart()

    def fits(self, endpoints: Endpoints) -> None:
        """Becomes an ODrive to which the profile's file of endpoints belongs."""
        self.firmware, self.hardware = _numbers(endpoints.firmware), _numbers(endpoints.hardware)
        self.timeout_at, self.enable_at = endpoints.timeout, endpoints.enable
        self.torque_constant_at = endpoints.torque_constant

    def _restart(self) -> None:
        self.state, self.error, self.reason = IDLE, 0, 0
        self._mode, self._input = "position", 0.0
        self._gains = (VELOCITY_GAIN, INTEGRATOR)
        self._limits = 10.0, 10.0  # turns/s, A
        self.watchdog, self.armed = 0.0, False
        if self.config.firmware == "0.5" and self.config.watchdog_set:
            self.watchdog, self.armed = self.config.watchdog, True
        self._beat = self._sent = self._last = -1
        self._integral = 0.0

    def power_up(self) -> None:
        """A motor's encoder counts from 0 where it stands; an axis' own knows its angle within a turn."""
        motors, i = self.motors, self.i
        motors.power_up(i)
        if self.axis.encoder == "motor":
            motors.zero[i] = motors.position[i]
        else:
            motors.zero[i] = tau * round(motors.position[i] / tau)
        self._restart()

    # -- angles

    @property
    def turns(self) -> float:
        """Its position estimate."""
        return float(self.motors.angle[self.i]) / tau * self.axis.ratio

    @property
    def speed(self) -> float:
        """Its velocity estimate, turns/s."""
        return float(self.motors.velocity[self.i]) / tau * self.axis.ratio

    # -- frames

    def take(self, message: can.Message, now: int) -> Sequence[can.Message]:
        if message.is_extended_id:
            return ()
        node, command = protocol.split(message.arbitration_id)
        if node != self.node and not (node == protocol.BROADCAST and self.config.firmware == "0.6"):
            return ()
        self._run(now)
        data = bytes(message.data)
        if message.is_remote_frame or (not data and command not in (0x02, 0x16, 0x18)):
            if self.config.firmware == "0.5":
                self.motors.feed(self.i)
            return self._reply(command)
        if self.config.firmware == "0.5" or command in (0x07, 0x0C, 0x0D, 0x0E):
            self.motors.feed(self.i)
        return self._obey(command, data)

    def _reply(self, command: int) -> Sequence[can.Message]:
        new = self.config.firmware == "0.6"
        motors, i = self.motors, self.i
        torque = float(motors.effort[i]) / self.axis.gear
        iq = torque / self.axis.torque_constant
        match command:
            case Command.VERSION if new:
                data = bytes((2, *self.hardware, *self.firmware, 0))
            case Command.ADDRESS if new:
                data = bytes((self.node,)) + int(self.serial, 16).to_bytes(6, "little") + b"\0"
            case Command.HEARTBEAT:
                return (self._heartbeat(),)
            case Command.ESTIMATES:
                return (self._estimates(),)
            case Command.ERROR:
                data = struct.pack("<II", self.error, self.reason) if new else bytes(8)
            case Command.RX_SDO | Command.CONTROLLER_ERROR if not new:
                data = bytes(8)
            case Command.IQ:
                data = struct.pack("<ff", iq, iq)
            case Command.TEMPERATURE if new:
                data = struct.pack("<ff", motors.stage[i], motors.temperature[i])
            case Command.BUS:
                data = struct.pack("<ff", motors.voltage[i], 0.0)
            case Command.TORQUES if new:
                data = struct.pack("<ff", torque, torque)
            case _:
                return ()
        return (protocol.message(self.node, command, data),)

    def _obey(self, command: int, data: bytes) -> Sequence[can.Message]:
        first = struct.unpack_from("<f", data)[0] if len(data) >= 4 else 0.0
        match command:
            case Command.ESTOP:
                self._disarm(ESTOP[self.config.firmware])
            case Command.SET_STATE if len(data) >= 4:
                self._request(struct.unpack_from("<I", data)[0])
            case Command.SET_MODE if len(data) == 8:
                self._choose(*struct.unpack("<II", data))
            case Command.INPUT_POSITION if len(data) == 8 and self._mode == "position":
                self._input = first
            case Command.INPUT_VELOCITY if len(data) == 8 and self._mode == "velocity":
                self._input = first
            case Command.INPUT_VELOCITY:
                self._later = first
            case Command.INPUT_TORQUE if self._mode == "torque":
                self._input = first
            case Command.SET_LIMITS if len(data) == 8:
                self._limits = struct.unpack("<ff", data)
            case Command.VELOCITY_GAINS if len(data) == 8:
                self._gains = struct.unpack("<ff", data)
            case Command.CLEAR:
                self.error = 0
                self.motors.errors[self.i] = 0
            case Command.RX_SDO if self.config.firmware == "0.6" and len(data) >= 4:
                return self._endpoint(data)
        self._apply()
        return ()

    def _request(self, state: int) -> None:
        if state == IDLE:
            self.state = IDLE
        elif state == CLOSED_LOOP and not self.error and not self.motors.errors[self.i]:
            self.state, self._integral = CLOSED_LOOP, 0.0
        elif self.config.firmware == "0.5":
            self.error |= 0x1
        self.motors.switch(self.i, self.state == CLOSED_LOOP)
        self._apply()

    def _choose(self, mode: int, ramp: int) -> None:
        names = {number: name for name, number in protocol.MODES.items()}
        if mode in names and ramp == protocol.PASSTHROUGH:
            self._mode, self._integral = names[mode], 0.0
            self._input = self.turns if self._mode == "position" else self._later if self._mode == "velocity" else 0.0

    _later = 0.0  # a velocity that came in another mode

    def _endpoint(self, data: bytes) -> Sequence[can.Message]:
        opcode, number = data[0], struct.unpack_from("<H", data, 1)[0]
        if number not in (self.timeout_at, self.enable_at, self.torque_constant_at):
            return ()
        if opcode == 1:
            if number == self.timeout_at and len(data) == 8:
                self.watchdog = struct.unpack_from("<f", data, 4)[0]
            elif number == self.enable_at and len(data) == 5:
                self.armed = bool(data[4])
            self._apply()
            return ()
        values = {self.timeout_at: self.watchdog, self.torque_constant_at: self.torque_constant}
        value = struct.pack("<f", values[number]) if number in values else bytes((self.armed,))
        return (protocol.message(self.node, Command.TX_SDO, struct.pack("<BHB", 0, number, 0) + value),)

    # -- control

    def _disarm(self, bits: int) -> None:
        self.error |= bits
        self.reason = bits
        self.state = IDLE
        self.motors.switch(self.i, False)

    def _run(self, now: int) -> None:
        """Takes what happened to the motor since, and the integrator's part."""
        motors, i = self.motors, self.i
        if bits := int(motors.errors[i]):
            table = _OF_MOTOR[self.config.firmware] | {SILENCE_BIT: WATCHDOG[self.config.firmware]}
            found = 0
            for bit, error in table.items():
                found |= error if bits & bit else 0
            if self.state != IDLE or found & ~self.error:
                self._disarm(found)
        if now < 0:
            return
        span, self._last = (now - self._last) * 1e-9 if self._last >= 0 else 0.0, now
        if self.state == CLOSED_LOOP and self._mode == "position" and span > 0:
            wanted = POSITION_GAIN * (self._input - self.turns)
            self._integral += self._gains[1] * (wanted - self.speed) * min(span, 0.05)
            most = float(motors.cap[i]) / self.axis.gear
            self._integral = max(-most, min(most, self._integral))
            self._apply()

    def _apply(self) -> None:
        """Puts the present mode into the motor's law, at the output shaft."""
        motors, i, axis = self.motors, self.i, self.axis
        per = axis.gear * axis.ratio / tau  # N m/(rad/s) of the shaft for each N m/(turn/s) of the motor
        gain, integrator = self._gains
        rad = tau / axis.ratio
        motors.slacken(i)
        motors.cap[i] = min(self._limits[1] * axis.torque_constant * axis.gear, motors.peak_torque[i])
        motors.timeout[i], motors.expiry[i] = (self.watchdog if self.armed else 0.0), OFF
        if self._mode == "torque":
            motors.feedforward[i] = self._input * axis.gear
        elif self._mode == "velocity":
            motors.kd[i], motors.ki[i] = gain * per, integrator * per
            motors.speed[i] = max(-self._limits[0], min(self._limits[0], self._input)) * rad
        else:
            motors.kd[i], motors.kp[i] = gain * per, gain * POSITION_GAIN * per
            motors.goal[i] = self._input * rad
            motors.feedforward[i] = self._integral * axis.gear

    # -- what it says by itself

    def due(self, now: int) -> Sequence[can.Message]:
        self._run(now)
        if now < 0:
            return self._heartbeat(), self._estimates()
        found = []
        if self._beat < 0 or not 0 <= now - self._beat < BEAT:
            self._beat = now
            found.append(self._heartbeat())
        if self._sent < 0 or not 0 <= now - self._sent < ESTIMATES:
            self._sent = now
            found.append(self._estimates())
        return found

    def _heartbeat(self) -> can.Message:
        if self.config.firmware == "0.5":
            motor = bool(self.error & 0x40)
            data = struct.pack("<IBBBB", self.error, self.state, motor, 0, 0x80)
        else:
            data = struct.pack("<IBBBB", self.error, self.state, 0, 0, 0)
        return protocol.message(self.node, Command.HEARTBEAT, data)

    def _estimates(self) -> can.Message:
        return protocol.message(self.node, Command.ESTIMATES, struct.pack("<ff", self.turns, self.speed))


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split("."))
