"""Sets up Dynamixel servos as they come from their box: id 1, 57600 bit/s (MX: protocol 1 or 2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from srl.drivers.dynamixel import protocol2
from srl.drivers.dynamixel.config import DynamixelConfig
from srl.drivers.dynamixel.family import RETURN_DELAY, Family, Family2, family
from srl.drivers.dynamixel.models import called
from srl.drivers.dynamixel.setup import NO_ID
from srl.drivers.dynamixel.table import baud_code, table
from srl.drivers.servo_bus import protocol1
from srl.drivers.servo_bus.asking import Asker
from srl.drivers.servo_bus.new_servo import Found, NewServo, broadcast
from srl.drivers.servo_bus.packets import BROADCAST, HIGHEST_ID
from srl.drivers.servo_bus.register import Register
from srl.drivers.transport import Transport
from srl.runtime.contracts.errors import DeviceError

_PARTS: Final = {1: ((0, 24), (24, 50)), 2: ((0, 64), (64, 83))}
_PING: Final = 0.03  # s for the answer of one servo; a USB adapter alone may take 16 ms
_WIZARD: Final = "with the vendor's DYNAMIXEL Wizard"


class NewDynamixel(NewServo):
    """See the module's docstring. Servos are looked for in the protocol of the profile."""

    rates: Sequence[int] = (57600, 1_000_000, 115200, 2_000_000, 3_000_000, 4_000_000, 9600)
    config: DynamixelConfig

    def __init__(self, config: DynamixelConfig, place: str) -> None:
        super().__init__(config, place)
        if config.protocol == 1:
            self.limits = "cw_angle_limit", "ccw_angle_limit"
            self.rates = 57600, 1_000_000  # each takes 8 s, as each id is asked by itself

    def _answers(self, link: Transport, rate: int) -> tuple[list[Found], int]:
        if self.config.protocol == 2:
            statuses, garbled = self._listened(link, protocol2.Parser(), protocol2.ping(BROADCAST))
            return list(broadcast(statuses, rate, 2)), garbled
        # Servos of protocol 1 don't take turns in answering a broadcast: each id is asked by itself.
        found: list[Found] = []
        garbled = 0
        for id in range(HIGHEST_ID + 1):
            statuses, bad = self._listened(link, protocol1.Parser(), protocol1.ping(id), _PING)
            found += broadcast(statuses, rate, 1)
            garbled += bad
        return found, garbled

    def _have_it_answer(self, asker: Asker, id: int) -> None:
        wire, level = asker.bus.wire, self._units().tables[0]["status_return_level"]
        if asker.ask(wire.read(id, 0, 2), id, 2, tries=2) is None:
            asker.tell(wire.write(id, level.address, level.encode(2)))

    def _bus(self, protocol: int) -> Family:
        return self._units()

    def _units(self) -> Family:
        return family(self.config)

    def _parts(self) -> Sequence[tuple[int, int]]:
        return _PARTS[self.config.protocol]

    def _lasting(self, memory: bytes) -> bytes:
        return memory[: _PARTS[self.config.protocol][0][1]]

    def _table(self, motor: Any, found: Found, memory: bytes) -> dict[str, Register]:
        number = int.from_bytes(memory[:2], "little")
        if number != motor.facts.number(self.config.protocol):
            problem = f"the servo (id {found.id}) is {called(number)}, the profile says {motor.model}"
            raise DeviceError(self.place, problem, "Correct 'model' in the profile, or connect the right servo")
        return table(motor.facts, self.config.protocol)

    def _wanted(self, name: str, found: Found) -> dict[str, int]:
        config, motor = self.config, self.config.motors[name]
        code = baud_code(config.baudrate, config.protocol)
        assert code is not None  # the profile was checked
        wanted = {"id": motor.id, "baud_rate": code}
        if config.return_delay is not None:
            wanted["return_delay_time"] = round(config.return_delay / RETURN_DELAY)
        if config.protocol == 2:
            wanted |= {
                "drive_mode": int(motor.reverse_mode), "homing_offset": motor.offset, "secondary_id": NO_ID,
                "operating_mode": Family2.MODES[config.mode],
            }  # fmt: skip
        return wanted
