"""The twin of a Dynamixel bus: simulated servos with the real protocol on a half-duplex line."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from srl.drivers.dynamixel import protocol2
from srl.drivers.dynamixel.family import RETURN_DELAY
from srl.drivers.dynamixel.table import baud_code, baudrate
from srl.drivers.servo_bus import protocol1
from srl.drivers.servo_bus.packets import BROADCAST, Instruction
from srl.sim.devices.dynamixel.fake import REBOOT, FakeDynamixel
from srl.sim.devices.dynamixel.twin_registers import Registers
from srl.sim.devices.dynamixel.twin_servo1 import Servo1
from srl.sim.devices.dynamixel.twin_servo2 import Servo2
from srl.sim.devices.shared.servo_line import ServoLine

_KEPT: Final[dict[bytes, tuple[str, ...]]] = {b"\xff": (), b"\x01": ("id",), b"\x02": ("id", "baud_rate")}


class DynamixelTwin(ServoLine):
    """Servos obey instructions addressed to them and answer `return_delay` later, one after another.

    In a group read, servos after a missing one don't answer.

    Attributes:
        servos: in the order of the profile's motors.
        fast: whether fast sync reads are answered, as newer firmware of X servos does; an MX doesn't answer.
    """

    def __init__(self, fake: FakeDynamixel) -> None:
        super().__init__(fake)
        config = fake.config
        self.protocol: int = config.protocol
        code = baud_code(config.baudrate, config.protocol)
        assert code is not None
        kind, firmware = (Servo1, 41) if self.protocol == 1 else (Servo2, 42)
        self.servos: list[Registers] = [
            kind(fake.chain.motors, i, motor.facts, motor.id, code, firmware)
            for i, motor in zip(fake.numbers, config.motors.values(), strict=True)
        ]
        for servo, motor in zip(self.servos, config.motors.values(), strict=True):
            servo.mounted_for = motor.offset, motor.reverse_mode
            if self.protocol == 2:
                servo.put("homing_offset", motor.offset)
            if "drive_mode" in servo.by_name:
                servo.put("drive_mode", int(motor.reverse_mode))
            servo.restart()
        self.fast = False
        self._parser = protocol1.Parser() if self.protocol == 1 else protocol2.Parser()
        self._registered: dict[int, tuple[int, bytes]] = {}
        self._begin_with(self.servos)
        self._goals: list[tuple[int, int, int]] = []

    # -- instructions

    def _obey(self, instruction: Instruction) -> None:
        name = self._named(instruction, _NAMES1 if self.protocol == 1 else _NAMES2)
        groups: dict[str, Callable[[bytes], None]] = {
            "sync_read": self._sync_read,
            "fast_sync_read": self._fast_sync_read,
            "sync_write": self._sync_write,
            "bulk_read": self._bulk_read,
            "bulk_write": self._bulk_write,
        }
        if name in groups:
            if instruction.id == BROADCAST:
                groups[name](instruction.data)
            return
        everyone = instruction.id == BROADCAST
        for servo in sorted(self._awake(), key=lambda servo: servo.get("id")):
            if everyone or servo.get("id") == instruction.id:
                self._single(servo, name, instruction.data, everyone)
            elif self.protocol == 2 and servo.get("secondary_id") == instruction.id != 255 and name == "write":
                servo.write(int.from_bytes(instruction.data[:2], "little"), instruction.data[2:], volatile_only=True)

    def _rate_of(self, servo: Registers) -> int:
        return baudrate(servo.get("baud_rate"), self.protocol)

    def _single(self, servo: Registers, name: str, data: bytes, everyone: bool) -> None:
        width = self.protocol  # bytes in an address
        address, rest = int.from_bytes(data[:width], "little"), data[width:]
        level = servo.get("status_return_level")
        answer: tuple[int, bytes] | None = None
        match name:
            case "ping":
                whole = servo.read(0, 7)[1]
                self._answer(servo, 0, whole[:2] + whole[6:7] if self.protocol == 2 else b"")
                return
            case "read":
                answer = servo.read(address, int.from_bytes(rest[:width], "little"))
                if level < 1:
                    return
            case "write":
                answer = servo.write(address, rest), b""
            case "reg_write":
                self._registered[id(servo)] = address, rest
                servo.put("registered_instruction" if self.protocol == 2 else "registered", 1)
                answer = 0, b""
            case "action":
                if id(servo) in self._registered:
                    servo.write(*self._registered.pop(id(servo)))
                    servo.put("registered_instruction" if self.protocol == 2 else "registered", 0)
                answer = 0, b""
            case "reboot":
                answer = 0, b""
                self._restart(servo)
            case "clear":
                answer = self._clear(servo, data), b""
            case "factory_reset":
                keep = _KEPT.get(data if self.protocol == 2 else b"\xff")
                if everyone and not keep:
                    return  # else all servos of a bus would have the same id
                if keep is not None:
                    if level == 2 and not everyone:
                        self._answer(servo, 0, b"")
                    servo.factory_reset(keep)
                    self._restart(servo)
                    return
                answer = protocol2.RANGE, b""
            case _:
                answer = (protocol2.INSTRUCTION if self.protocol == 2 else protocol1.INSTRUCTION), b""
        if not everyone and (name == "read" or level == 2):
            self._answer(servo, *answer)

    def _restart(self, servo: Registers) -> None:
        k = self.servos.index(servo)
        self._deaf_until[k], self._restarting[k] = self._now + REBOOT, True
        servo.motors.switch(servo.i, False)

    def _clear(self, servo: Registers, data: bytes) -> int:
        if data != b"\x01DXL\x22" or servo.read(122, 1)[1] != b"\0":
            return protocol2.RESULT
        servo.motors.fold(servo.i)
        return 0

    def _sync_read(self, data: bytes) -> None:
        address, size = int.from_bytes(data[:2], "little"), int.from_bytes(data[2:4], "little")
        self._read_in_turn([(id, address, size) for id in data[4:]])

    def _bulk_read(self, data: bytes) -> None:
        if self.protocol == 1:
            rows = [data[k : k + 3] for k in range(1, len(data) - 2, 3)]
            self._read_in_turn([(id, address, size) for size, id, address in rows])
            return
        rows = [data[k : k + 5] for k in range(0, len(data) - 4, 5)]
        self._read_in_turn([(row[0], row[1] | row[2] << 8, row[3] | row[4] << 8) for row in rows])

    def _read_in_turn(self, wanted: list[tuple[int, int, int]]) -> None:
        present = {servo.get("id"): servo for servo in self._awake()}
        for servo_id, address, size in wanted:
            servo = present.get(servo_id)
            if servo is None:
                break  # the servos after it wait for its answer
            if servo.get("status_return_level") >= 1:
                self._answer(servo, *servo.read(address, size))

    def _fast_sync_read(self, data: bytes) -> None:
        if not self.fast:
            return
        address, size = int.from_bytes(data[:2], "little"), int.from_bytes(data[2:4], "little")
        present = {servo.get("id"): servo for servo in self._awake()}
        if all(servo_id in present for servo_id in data[4:]):
            parts = [(servo_id, 0, present[servo_id].read(address, size)[1]) for servo_id in data[4:]]
            self._send(protocol2.fast_status(parts), 0)

    def _sync_write(self, data: bytes) -> None:
        width = self.protocol
        address, size = int.from_bytes(data[:width], "little"), int.from_bytes(data[width : 2 * width], "little")
        for at in range(2 * width, len(data) - size, size + 1):
            self._write_one(data[at], address, data[at + 1 : at + 1 + size])

    def _bulk_write(self, data: bytes) -> None:
        at = 0
        while at + 5 <= len(data):
            size = data[at + 3] | data[at + 4] << 8
            self._write_one(data[at], data[at + 1] | data[at + 2] << 8, data[at + 5 : at + 5 + size])
            at += 5 + size

    def _write_one(self, servo_id: int, address: int, data: bytes) -> None:
        for servo in self._awake():
            if servo.get("id") == servo_id:
                servo.write(address, data)

    # -- answers

    def _answer(self, servo: Registers, error: int, data: bytes) -> None:
        servo_id = servo.get("id")
        if isinstance(servo, Servo1):
            packet = protocol1.status(servo_id, error | servo.error_bits, data)
        else:
            alert = protocol2.ALERT if servo.motors.errors[servo.i] else 0
            packet = protocol2.status(servo_id, error | alert, data)
        delay = round(servo.get("return_delay_time") * RETURN_DELAY * 1e9)
        self._send(self._in_transit(servo_id, packet), delay)


_NAMES2: Final = {
    protocol2.PING: "ping",
    protocol2.READ: "read",
    protocol2.WRITE: "write",
    protocol2.REG_WRITE: "reg_write",
    protocol2.ACTION: "action",
    protocol2.FACTORY_RESET: "factory_reset",
    protocol2.REBOOT: "reboot",
    protocol2.CLEAR: "clear",
    protocol2.SYNC_READ: "sync_read",
    protocol2.SYNC_WRITE: "sync_write",
    protocol2.FAST_SYNC_READ: "fast_sync_read",
    protocol2.BULK_READ: "bulk_read",
    protocol2.BULK_WRITE: "bulk_write",
}
_NAMES1: Final = {
    protocol1.PING: "ping",
    protocol1.READ: "read",
    protocol1.WRITE: "write",
    protocol1.REG_WRITE: "reg_write",
    protocol1.ACTION: "action",
    protocol1.FACTORY_RESET: "factory_reset",
    protocol1.SYNC_WRITE: "sync_write",
    protocol1.BULK_READ: "bulk_read",
}
