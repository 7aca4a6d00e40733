"""The twin of a Feetech bus: simulated STS servos with the real protocol on a half-duplex line."""

from __future__ import annotations

from typing import Any, Final

from srl.drivers.feetech import protocol
from srl.drivers.feetech.table import BAUDS
from srl.drivers.feetech.units import RETURN_DELAY
from srl.drivers.servo_bus.packets import Instruction
from srl.sim.devices.feetech.fake import FakeFeetech
from srl.sim.devices.feetech.twin_servo import Servo
from srl.sim.devices.shared.servo_line import ServoLine

POWER_UP: Final = 300_000_000  # ns from power to the first answer
_NAMES: Final = {
    protocol.PING: "ping",
    protocol.READ: "read",
    protocol.WRITE: "write",
    protocol.REG_WRITE: "reg_write",
    protocol.ACTION: "action",
    protocol.SYNC_READ: "sync_read",
    protocol.SYNC_WRITE: "sync_write",
}


class FeetechTwin(ServoLine):
    """See `ServoLine`. In a sync read, servos after a missing one don't answer.

    Attributes:
        servos: in the order of the profile's motors.
    """

    def __init__(self, fake: FakeFeetech) -> None:
        super().__init__(fake)
        config = fake.config
        motors = fake.chain.motors
        fake.chain.measure()
        self.servos = [
            Servo(motors, i, motor.facts, motor.id, BAUDS.index(config.baudrate), config.mode == "extended")
            for i, motor in zip(fake.numbers, config.motors.values(), strict=True)
        ]
        for servo, motor in zip(self.servos, config.motors.values(), strict=True):
            servo.mounted_for = motor.offset
            servo.keep("homing_offset", motor.offset)
            servo.put("goal_position", servo.position)
        self._parser = protocol.Parser()
        self._registered: dict[int, tuple[int, bytes]] = {}
        self._begin_with(self.servos)

    def brown_out(self, servo: Servo) -> None:
        """The supply of one servo dips: it starts anew."""
        k = self.servos.index(servo)
        self._deaf_until[k], self._restarting[k] = self._now + POWER_UP, True
        servo.motors.switch(servo.i, False)

    def _rate_of(self, servo: Any) -> int:
        code = servo.get("baud_rate")
        return BAUDS[code] if code < len(BAUDS) else 1

    def _obey(self, instruction: Instruction) -> None:
        name = self._named(instruction, _NAMES)
        data, everyone = instruction.data, instruction.id == protocol.BROADCAST
        if name in ("sync_read", "sync_write"):
            if everyone and len(data) > 2:
                (self._sync_read if name == "sync_read" else self._sync_write)(data)
            return
        for servo in sorted(self._awake(), key=lambda servo: int(servo.get("id"))):
            if everyone or servo.get("id") == instruction.id:
                self._single(servo, name, data, everyone)

    def _single(self, servo: Servo, name: str, data: bytes, everyone: bool) -> None:
        quiet = everyone or servo.get("status_return_level") == 0
        match name:
            case "ping":
                self._answer(servo)
            case "read":
                if len(data) == 2 and not everyone:
                    self._answer(servo, servo.read(data[0], data[1]))
            case "write" | "reg_write" if data:
                if name == "write":
                    servo.write(data[0], data[1:])
                else:
                    self._registered[id(servo)] = data[0], data[1:]
                if not quiet:
                    self._answer(servo)
            case "action":
                if id(servo) in self._registered:
                    servo.write(*self._registered.pop(id(servo)))
                if not quiet:
                    self._answer(servo)
            case _:
                servo.refused[name] = servo.refused.get(name, 0) + 1

    def _sync_read(self, data: bytes) -> None:
        present = {servo.get("id"): servo for servo in self._awake()}
        for servo_id in data[2:]:
            servo = present.get(servo_id)
            if servo is None:
                break  # the servos after it wait for its answer
            self._answer(servo, servo.read(data[0], data[1]))

    def _sync_write(self, data: bytes) -> None:
        address, size = data[0], data[1]
        present = {servo.get("id"): servo for servo in self._awake()}
        for at in range(2, len(data) - size, size + 1):
            if (servo := present.get(data[at])) is not None:
                servo.write(address, data[at + 1 : at + 1 + size])

    def _answer(self, servo: Servo, data: bytes = b"") -> None:
        servo_id = servo.get("id")
        packet = protocol.status(servo_id, servo.error_bits, data)
        self._send(self._in_transit(servo_id, packet), round(servo.get("return_delay_time") * RETURN_DELAY * 1e9))
