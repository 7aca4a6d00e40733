"""Simulated drives of MIT-mode actuators: what each makes of a frame, and what it answers.

The physics is that of the chain's motors. Where sources are silent the simulation chooses: an AK V1 or V2 answers no
command while it is off; a V3 sends its status after each command and is on once it has power; a Damiao's timeout is 0
at power-up; a Damiao takes a zero also while it is enabled.
"""

from __future__ import annotations

import struct
from typing import Final

from srl.drivers.mit_can import protocol
from srl.drivers.mit_can.config import MitCanConfig
from srl.drivers.mit_can.models import Range
from srl.drivers.mit_can.protocol import READ, STATE, TICK, WRITE, Register
from srl.sim.parts.actuators.motors import (
    NOTHING,
    OFF,
    SILENCE_BIT,
    SLACK,
    STAGE_BIT,
    VOLTAGE_BIT,
    WINDING_BIT,
    ActuatorMotors,
)

Frame = tuple[int, bytes, bool]  # identifier, bytes, extended
_DAMIAO: Final = {WINDING_BIT: 0xC, STAGE_BIT: 0xB, SILENCE_BIT: 0xD, VOLTAGE_BIT: 0x9}
_AK: Final = {WINDING_BIT: 1, STAGE_BIT: 6, VOLTAGE_BIT: 4}
_FIRMWARE: Final = 5013


class Drives:
    """The drives of one bus, in the profile's order of motors.

    Attributes:
        motors: of the chain; `numbers` are those of this bus.
        ids, replies: the identifiers that each has. A test swaps or doubles them.
        spans: the ranges that each scales by.
        registers: of each Damiao, by number.
        unplugged: numbers of drives without a CAN cable.
        silence: s after which a CubeMars slackens by itself; 0: it goes on for ever.
    """

    def __init__(self, config: MitCanConfig, motors: ActuatorMotors, numbers: tuple[int, ...], silence: float) -> None:
        self._config, self.motors, self.numbers = config, motors, numbers
        self._v3, self._damiao = config.generation == "v3", config.maker == "damiao"
        self.silence = silence
        self.unplugged: set[int] = set()
        profile = list(config.motors.values())
        self.ids = [motor.id for motor in profile]
        self.replies = [config.reply_id(motor) for motor in profile]
        self.spans = [motor.span(config.generation) for motor in profile]
        self._scale = [protocol.status_scale(motor.facts) for motor in profile]
        serials = [motor.serial or 1000 + motor.id for motor in profile]
        self.registers: list[dict[int, float]] = [{} for _ in profile]
        self._stored = [self._fresh(k, serials[k]) for k in range(len(profile))]
        self.refused: dict[str, int] = {}
        self.seen: dict[str, int] = {}
        self.power_up()

    def _fresh(self, k: int, serial: int) -> dict[int, float]:
        span = self.spans[k]
        return {
            Register.OVER_TEMPERATURE: 100.0, Register.MST_ID: self.replies[k], Register.ESC_ID: self.ids[k],
            Register.TIMEOUT: 0, Register.CTRL_MODE: protocol.MIT, Register.HARDWARE: 1, Register.SOFTWARE: _FIRMWARE,
            Register.SERIAL: serial, Register.GEAR: self._scale[k][1], Register.P_MAX: span.position,
            Register.V_MAX: span.velocity, Register.T_MAX: span.torque,
        }  # fmt: skip

    def keep(self, k: int, register: Register, value: float) -> None:
        """Sets a register for good, as somebody with the maker's tool does."""
        self._stored[k][register] = self.registers[k][register] = value
        self._take_effect(k)

    def power_up(self, only: int | None = None) -> None:
        """All drives, or one, get power: off, registers as stored, turns forgotten if they had none before."""
        for k, i in enumerate(self.numbers):
            if only is not None and k != only:
                continue
            if not self.motors.powered[i]:
                self.motors.power_up(i)
            self.registers[k] = dict(self._stored[k])
            self._take_effect(k)
            if self._v3:
                self.motors.switch(i, True)

    def power_down(self, only: int | None = None) -> None:
        """All drives, or one, lose their power."""
        for k, i in enumerate(self.numbers):
            if only is None or k == only:
                self.motors.power_off(i)

    def _take_effect(self, k: int) -> None:
        i, registers = self.numbers[k], self.registers[k]
        if self._damiao:
            self.ids[k], self.replies[k] = int(registers[Register.ESC_ID]), int(registers[Register.MST_ID])
            self.spans[k] = Range(registers[Register.P_MAX], registers[Register.V_MAX], registers[Register.T_MAX])
            self.motors.timeout[i] = registers[Register.TIMEOUT] * TICK
            self.motors.expiry[i] = OFF
        else:
            self.motors.timeout[i], self.motors.expiry[i] = self.silence, SLACK if self.silence else NOTHING
        self.motors.cap[i] = min(self.spans[k].torque, float(self.motors.peak_torque[i]))

    # -- frames

    def take(self, id: int, data: bytes, extended: bool) -> list[Frame]:
        """Obeys a frame from the bus. Returns the answers of all drives that take it for theirs."""
        answers: list[Frame] = []
        for k, i in enumerate(self.numbers):
            if k in self.unplugged or not self.motors.powered[i]:
                continue
            if self._damiao and id == protocol.REGISTERS and not extended and len(data) >= 4:
                if int.from_bytes(data[:2], "little") == self.ids[k]:
                    answers += self._register(k, i, data)
            elif extended == self._v3 and id == self.ids[k] + (protocol.V3_COMMAND if self._v3 else 0):
                answers += self._own(k, i, data)
        return answers

    def _own(self, k: int, i: int, data: bytes) -> list[Frame]:
        if len(data) != 8:
            return []
        m, was_on = self.motors, bool(self.motors.torque[i])
        m.feed(i)
        state = self._state(k, i)  # the firmware packs its reply before it obeys
        if data in protocol.SPECIAL and not self._v3:
            self._count(("clear", "enable", "disable", "zero")[data[7] - 0xFB])
            if data == protocol.ENABLE:
                m.switch(i, True)
            elif data == protocol.DISABLE:
                m.switch(i, False)
            elif data == protocol.SET_ZERO:
                m.set_zero(i, stored=True)
            elif self._damiao:
                m.errors[i] = 0
            return [state]
        if self._damiao and self.registers[k][Register.CTRL_MODE] != protocol.MIT:
            return []
        self._count("command")
        wanted = protocol.parse_command(data, self.spans[k], self._v3)
        if was_on:
            m.goal[i], m.speed[i], m.kp[i], m.kd[i] = wanted.position, wanted.velocity, wanted.kp, wanted.kd
            m.feedforward[i] = wanted.torque
        return [state] if was_on or self._damiao or self._v3 else []

    def _state(self, k: int, i: int) -> Frame:
        m, errors = self.motors, int(self.motors.errors[i])
        values = float(m.angle[i]), float(m.velocity[i]), float(m.effort[i])
        winding, stage = round(float(m.temperature[i])), round(float(m.stage[i]))
        words = _DAMIAO if self._damiao else _AK
        code = next((code for bit, code in words.items() if errors & bit), 0)
        if self._v3:
            return self.replies[k], protocol.pack_status(*values, winding, code, *self._scale[k]), True
        if self._damiao:
            code = code or int(m.torque[i])
            head, tail = code << 4 | self.ids[k] & 0xF, bytes((min(stage, 255), min(winding, 255)))
        else:
            head, tail = self.ids[k], bytes((min(winding + 40, 255), code))
        return self.replies[k], protocol.pack_reply(head, *values, self.spans[k], tail), False

    def _register(self, k: int, i: int, data: bytes) -> list[Frame]:
        code, register = data[2], data[3]
        if code == STATE:
            self._count("state")
            return [self._state(k, i)]
        known = self.registers[k]
        if code not in (READ, WRITE) or register not in known:
            self.refused[f"{code:#04x} {register}"] = self.refused.get(f"{code:#04x} {register}", 0) + 1
            return []
        self._count("read" if code == READ else "write")
        if code == WRITE:
            (known[register],) = struct.unpack("<I" if register in protocol.WHOLE else "<f", data[4:8])
            self._take_effect(k)
        value = protocol.value_of(register, known[register])
        form = "<HBBI" if register in protocol.WHOLE else "<HBBf"
        return [(self.replies[k], struct.pack(form, self.ids[k], code, register, value), False)]

    def _count(self, what: str) -> None:
        self.seen[what] = self.seen.get(what, 0) + 1
