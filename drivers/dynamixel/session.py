"""Requests to one servo at a time, blocking: for opening a bus, not for the loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

from srl.drivers.dynamixel import protocol2
from srl.drivers.dynamixel.family import Family
from srl.drivers.dynamixel.models import called
from srl.drivers.dynamixel.table import BAUDS2
from srl.drivers.servo_bus import protocol1
from srl.drivers.servo_bus.asking import Asker
from srl.drivers.servo_bus.packets import BROADCAST
from srl.drivers.servo_bus.register import Register
from srl.drivers.timeout import remaining
from srl.drivers.transport import Transport, open_transport
from srl.runtime.contracts.errors import DeviceError

SCAN: Final = 0.08  # s of listening for a broadcast's answers at another baud rate
_RATES: Final = (57600, 1_000_000, 115200, 2_000_000, 3_000_000, 4_000_000, 9600)


class Session(Asker):
    """Requests to the servos of a family over one link."""

    def __init__(self, link: Transport, family: Family, place: str) -> None:
        super().__init__(link, family, place)
        self.family = family

    def write(self, motor: str, id: int, register: Register, value: int, what: str) -> None:
        """Writes one register and waits for the acknowledgement.

        Raises:
            DeviceError: refused, with the servo's reason, or not acknowledged.
        """
        status = self.ask(self.family.wire.write(id, register.address, register.encode(value)), id, 0)
        if status is None:
            raise DeviceError(
                self.place, f"'{motor}' (id {id}) doesn't acknowledge its {what}", "Check the bus' cables and power"
            )
        if refusal := self._refusal(status.error):
            raise DeviceError(
                self.place,
                f"'{motor}' (id {id}) refuses {what} = {value}: {refusal}",
                "Switch the servo's power off and on, or set it with the vendor's DYNAMIXEL Wizard",
            )

    def _refusal(self, error: int) -> str:
        if self.family.protocol == 2:
            return protocol2.ERRORS.get(error, f"error {error}") if error else ""
        return "range or instruction error" if error & (protocol1.RANGE | protocol1.INSTRUCTION) else ""


def find(session: Session, scan: bool) -> list[tuple[int, int]]:
    """Returns model number and firmware version of each motor.

    Args:
        session: on the open link.
        scan: if no motor answers, look for them at other baud rates and in the other protocol.
    Raises:
        DeviceError: a motor is missing, is another model, or two motors answer as one.
    """
    family, place = session.family, session.place
    config = family.config
    found, missing = [], []
    if config.protocol == 1 and session.echoes(config.ids[0]):
        raise DeviceError(
            place,
            "the adapter returns the host's own bytes, which protocol 1 can't tell from answers",
            "Use an adapter that suppresses its echo, such as a U2D2, or firmware of protocol 2",
        )
    for name, motor in config.motors.items():
        before = session.parser.errors + session.parser.skipped
        who = _who(session, motor.id)
        if who is None:
            if session.parser.errors + session.parser.skipped > before:
                raise DeviceError(
                    place,
                    f"'{name}' (id {motor.id}) answers with garbled bytes",
                    "Most often two servos have the same id: connect them one by one and give each its own. Else "
                    "check the bus' cables, its termination and the return delay",
                )
            missing.append((name, motor.id))
            continue
        found.append(who)
        wanted = motor.facts.number(config.protocol)
        if who[0] != wanted:
            raise DeviceError(
                place,
                f"'{name}' (id {motor.id}) is {called(who[0])}, the profile says {motor.model}",
                "Correct 'model' or 'id' in the profile, or swap the servos' ids",
            )
    if not missing:
        return found
    if len(missing) == len(config.motors):
        raise _silence(session, scan)
    name, id = missing[0]
    others = ", ".join(str(motor.id) for key, motor in config.motors.items() if (key, motor.id) not in missing)
    strangers = [other for other in _listen(session.link, family, SCAN * 4) if other not in config.ids]
    heard = f"; servos the profile doesn't name answer as {', '.join(map(str, strangers))}" if strangers else ""
    raise DeviceError(
        place,
        f"'{name}' (id {id}) doesn't answer; {others} do{heard}",
        "Check its cable, its power, its id and its baud rate",
    )


def _who(session: Session, id: int) -> tuple[int, int] | None:
    wire = session.family.wire
    status = session.ask(wire.ping(id), id, wire.PING_SIZE)
    if status is None:
        return None
    data = status.data
    if session.family.protocol == 1:
        answer = session.ask(wire.read(id, 0, 3), id, 3)
        if answer is None or len(answer.data) != 3:
            return None
        data = answer.data
    if len(data) != 3:
        return None
    return data[0] | data[1] << 8, data[2]


def _listen(link: Transport, family: Family, seconds: float) -> dict[int, int]:
    """Returns the model numbers by id of all servos that answer a broadcast ping of protocol 2."""
    parser = protocol2.Parser()
    found: dict[int, int] = {}
    if family.protocol == 1:
        return found
    link.flush_input()
    link.write_all(protocol2.ping(BROADCAST), 1.0)
    for left in remaining(seconds):
        for status in parser.statuses(link.read_wait(left)):
            if len(status.data) == 3:
                found[status.id] = status.data[0] | status.data[1] << 8
    return found


def _silence(session: Session, scan: bool) -> DeviceError:
    """Returns the error if no motor answers: which servos do, at which baud rate and in which protocol."""
    config, place = session.family.config, session.place
    problem = f"no servo answers at {config.port} with {config.baudrate} baud and protocol {config.protocol}"
    power = "Check the servos' power and the adapter's switch (TTL or RS-485)"
    if not scan or "://" in config.port or config.port.startswith("spy:"):
        return DeviceError(place, problem, power)
    session.link.close()
    rates = [config.baudrate, *(rate for rate in _RATES if rate != config.baudrate)]
    if found := _scan(config.port, place, rates, config.ids[:2]):
        fix = [f"'baudrate: {found.rate}'"] if found.rate != config.baudrate else []
        fix += [f"'protocol: {found.protocol}'"] if found.protocol != config.protocol else []
        remedy = f"Set {' and '.join(fix)}" if fix else "Correct the ids in the profile"
        return DeviceError(place, f"{problem}; with {found}", remedy)
    tried = ", ".join(str(rate) for rate in rates if rate in BAUDS2)
    return DeviceError(place, f"{problem}, nor at {tried} baud in either protocol", power)


class _Found(NamedTuple):
    """Servos that answered, by id, with their model numbers; 0 where a ping's answer has none."""

    rate: int
    protocol: int
    servos: dict[int, int]

    def __str__(self) -> str:
        named = ", ".join(f"{id} ({called(number)})" if number else str(id) for id, number in self.servos.items())
        return f"{self.rate} baud and protocol {self.protocol} there are: {named}"


def who(port: str) -> str:
    """See `Driver.who_is_at`. Servos of protocol 1 can't be asked all at once: those with ids 1 to 4 are."""
    if found := _scan(port, port, _RATES, (1, 2, 3, 4)):
        return f"with {found}"
    rates = ", ".join(map(str, _RATES))
    problem = f"no servo answers a ping at {rates} baud (in protocol 1: none with an id of 1 to 4)"
    raise DeviceError(port, problem, "Check the servos' power and the adapter's switch (TTL or RS-485)")


def _scan(port: str, place: str, rates: Sequence[int], ids: tuple[int, ...]) -> _Found | None:
    """Returns who answers, at the first baud rate with any; `ids` are asked in protocol 1."""
    for rate in rates:
        link = open_transport(port, place=place, baudrate=rate)
        try:
            protocol, servos = _heard(link, ids)
        finally:
            link.close()
        if servos:
            return _Found(rate, protocol, servos)
    return None


def _heard(link: Transport, ids: tuple[int, ...]) -> tuple[int, dict[int, int]]:
    """Returns the servos that answer a broadcast of protocol 2; if none do, those of `ids` in protocol 1."""
    found: dict[int, int] = {}
    parsers: tuple[Any, ...] = (protocol2.Parser(), protocol1.Parser())
    for protocol, parser in zip((2, 1), parsers, strict=True):
        pings = [protocol2.ping(BROADCAST)] if protocol == 2 else [protocol1.ping(id) for id in ids]
        for ping in pings:
            link.flush_input()
            link.write_all(ping, 1.0)
            for left in remaining(SCAN):
                for status in parser.statuses(link.read_wait(left)):
                    data = status.data
                    found[status.id] = data[0] | data[1] << 8 if len(data) == 3 else 0
            if found:
                return protocol, found
    return 0, found
