"""Sets up STS servos as they come from their box: id 1, 1 Mbit/s. The lock is open only while it is written."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from srl.drivers.feetech import protocol
from srl.drivers.feetech.config import FeetechConfig
from srl.drivers.feetech.models import called
from srl.drivers.feetech.table import BAUDS, END, TABLE
from srl.drivers.feetech.units import RETURN_DELAY, FeetechUnits
from srl.drivers.servo_bus.asking import Asker
from srl.drivers.servo_bus.new_servo import Found, NewServo, broadcast
from srl.drivers.servo_bus.packets import BROADCAST
from srl.drivers.servo_bus.register import Register
from srl.drivers.transport import Transport
from srl.runtime.contracts.errors import DeviceError

_LASTING = 40  # the address from which on registers change by themselves


class NewFeetech(NewServo):
    """See the module's docstring."""

    rates = BAUDS
    config: FeetechConfig

    def _answers(self, link: Transport, rate: int) -> tuple[list[Found], int]:
        statuses, garbled = self._listened(link, protocol.Parser(), protocol.ping(BROADCAST))
        return list(broadcast(statuses, rate, 1)), garbled

    def _have_it_answer(self, asker: Asker, id: int) -> None:
        level = TABLE["status_return_level"]
        status = asker.ask(protocol.read(id, level.address, level.size), id, level.size, tries=2)
        if status is None or not level.decode(status.data, level.address):  # then it answers no writes
            asker.tell(protocol.write(id, level.address, level.encode(1)))

    def _bus(self, protocol: int) -> Any:
        return self._units()

    def _units(self) -> FeetechUnits:
        return FeetechUnits(self.config)

    def _parts(self) -> Sequence[tuple[int, int]]:
        return (0, _LASTING), (_LASTING, END - _LASTING)

    def _lasting(self, memory: bytes) -> bytes:
        return memory[:_LASTING]

    def _table(self, motor: Any, found: Found, memory: bytes) -> dict[str, Register]:
        number = TABLE["model_number"].decode(memory)
        if number != motor.facts.number:
            problem = f"the servo (id {found.id}) is {called(number)}, the profile says {motor.model}"
            raise DeviceError(self.place, problem, "Correct 'model' in the profile, or connect the right servo")
        return dict(TABLE)

    def _wanted(self, name: str, found: Found) -> dict[str, int]:
        config, motor = self.config, self.config.motors[name]
        wanted = {"id": motor.id, "baud_rate": BAUDS.index(config.baudrate), "homing_offset": motor.offset}
        if config.return_delay is not None:
            wanted["return_delay_time"] = round(config.return_delay / RETURN_DELAY)
        return wanted

    def _unlock(self, asker: Asker, id: int) -> None:
        self._set_lock(asker, id, 0)

    def _lock(self, asker: Asker, id: int) -> None:
        self._set_lock(asker, id, 1)

    def _set_lock(self, asker: Asker, id: int, value: int) -> None:
        lock = TABLE["lock"]
        if asker.ask(protocol.write(id, lock.address, lock.encode(value)), id, 0) is None:
            raise DeviceError(self.place, f"the servo (id {id}) doesn't answer", "Check its cable and its power")
