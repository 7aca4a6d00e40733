"""Identifies and checks the servos of a bus, without moving them, switching torque, or writing anything they keep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from srl.drivers.feetech import protocol
from srl.drivers.feetech.models import STRANGERS, called
from srl.drivers.feetech.table import POSITION, SEVERAL_TURNS, TABLE
from srl.drivers.feetech.units import RETURN_DELAY, FeetechUnits, own_range
from srl.drivers.servo_bus.asking import Asker
from srl.drivers.servo_bus.packets import Status
from srl.drivers.servo_bus.register import Register
from srl.drivers.timeout import remaining
from srl.drivers.transport import Transport, open_transport
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.signals import Limits

SCAN: Final = 0.1  # s of listening for a broadcast's answers
_PARTS: Final = ((0, 40), (40, 31))  # (address, size) of the reads that give a servo's registers
_TRIES: Final = 3
_RATES: Final = (1_000_000, 115_200, 500_000, 250_000, 128_000)  # the likelier ones first
# Bits of the phase, by the maker's memory table: 0 and 7 turn directions, 2 is the unit of speeds, 3 says that a goal
# speed of 0 is the fastest, 4 counts several turns. The others are the hardware's own.
MEANINGS: Final = 0x9D
USUAL: Final = 0x0C  # as delivered
_TOOL: Final = "Set it with the vendor's debug tool (FD)"


@dataclass(frozen=True)
class Bus:
    """What was found.

    Attributes:
        firmware: version by motor.
        limits: the command's limits.
        powered: by motor: its torque is on, from an earlier run.
        errors: by motor: its error bits.
        hottest: by motor: degC at which it protects itself.
        voltages: by motor: lowest and highest voltage it bears, V.
        goals: by motor: the goal position it has stored, counts.
    """

    firmware: tuple[str, ...]
    limits: Limits
    powered: tuple[bool, ...]
    errors: tuple[int, ...]
    hottest: tuple[float, ...]
    voltages: tuple[tuple[float, float], ...]
    goals: tuple[int, ...]


def set_up(asker: Asker, units: FeetechUnits, scan: bool) -> Bus:
    """Identifies, checks and configures all motors.

    Args:
        asker: on the open link.
        scan: if no motor answers, look for them at other baud rates.
    Raises:
        DeviceError: with the problem, the motor, and the remedy.
    """
    config = units.config
    _find(asker, units, scan)
    memories, errors = [], []
    for i, (name, motor) in enumerate(config.motors.items()):
        who = f"'{name}' (id {motor.id})"
        memory, bits = _registers(asker, who, motor.id)
        _check(asker, who, units, motor.offset, memory)
        for key, value in settings(units).items():
            _set(asker, who, motor.id, TABLE[key], value, key.replace("_", " "))
        units.take_up_turns(i, TABLE["present_position"].decode(memory))
        memories.append(memory)
        errors.append(bits | TABLE["status"].decode(memory))

    def of(key: str) -> list[int]:
        return [TABLE[key].decode(memory) for memory in memories]

    limits = units.set_limits(memories)
    assert limits.lower is not None
    assert limits.upper is not None
    for name, low, high in zip(config.motors, limits.lower, limits.upper, strict=True):
        if not low < high:
            raise DeviceError(
                asker.place,
                f"the limits of '{name}' leave no room: {low:g} to {high:g}, of its own and of the profile",
                "Correct 'lower', 'upper', 'zero' or 'reversed'",
            )
    volts = zip(of("min_voltage_limit"), of("max_voltage_limit"), strict=True)
    return Bus(
        tuple(f"{a}.{b}" for a, b in zip(of("firmware_major"), of("firmware_minor"), strict=True)),
        limits,
        tuple(torque == 1 for torque in of("torque_enable")),
        tuple(errors),
        tuple(map(float, of("temperature_limit"))),
        tuple((low / 10, high / 10) for low, high in volts),
        tuple(of("goal_position")),
    )


def settings(units: FeetechUnits) -> dict[str, int]:
    """The registers that the driver sets, in this order. With the lock first, a servo forgets all at power-off."""
    found = {"lock": 1, "status_return_level": 1, "acceleration": 0, "goal_time": 0, "goal_velocity": 0}
    if units.config.return_delay is not None:
        found["return_delay_time"] = round(units.config.return_delay / RETURN_DELAY)
    return found


def _find(asker: Asker, units: FeetechUnits, scan: bool) -> None:
    """Raises DeviceError if a motor is missing, is another model, or two motors answer as one."""
    config, place = units.config, asker.place
    if asker.echoes(config.ids[0]):
        raise DeviceError(
            place,
            "the adapter returns the host's own bytes, which this protocol can't tell from answers",
            "Use an adapter that suppresses its echo, or set its jumper so",
        )
    missing = []
    model = TABLE["model_number"]
    for name, motor in config.motors.items():
        before = asker.parser.errors + asker.parser.skipped
        status = asker.ask(protocol.read(motor.id, model.address, model.size), motor.id, model.size)
        if status is None or len(status.data) != model.size:
            if asker.parser.errors + asker.parser.skipped > before:
                raise DeviceError(
                    place,
                    f"'{name}' (id {motor.id}) answers with garbled bytes",
                    "Most often two servos have the same id, as all new ones have id 1: connect them one by one and "
                    "give each its own. Else check the bus' cables and power",
                )
            missing.append((name, motor.id))
            continue
        number = model.decode(status.data, model.address)
        if number != motor.facts.number:
            swapped = int.from_bytes(status.data, "big")
            number = swapped if swapped in STRANGERS else number
            more = ". This driver doesn't drive the SCS series: it has no sync read" if number in STRANGERS else ""
            raise DeviceError(
                place,
                f"'{name}' (id {motor.id}) is {called(number)}, the profile says {motor.model}",
                f"Correct 'model' or 'id' in the profile, or swap the servos' ids{more}",
            )
    if not missing:
        return
    if len(missing) == len(config.motors):
        raise _silence(asker, units, scan)
    name, id = missing[0]
    others = ", ".join(str(motor.id) for key, motor in config.motors.items() if (key, motor.id) not in missing)
    strangers = [other for other in _heard(asker.link) if other not in config.ids]
    heard = f"; servos the profile doesn't name answer as {', '.join(map(str, strangers))}" if strangers else ""
    raise DeviceError(
        place,
        f"'{name}' (id {id}) doesn't answer; {others} do{heard}",
        "Check its cable, its power, its id and its baud rate",
    )


def _registers(asker: Asker, who: str, id: int) -> tuple[bytes, int]:
    """Returns a motor's registers from address 0 on, and the error bits of its answers."""
    memory, bits = b"", 0
    for address, size in _PARTS:
        status = asker.ask(protocol.read(id, address, size), id, size)
        if status is None or len(status.data) != size:
            raise DeviceError(
                asker.place, f"{who} answers, but not when its registers are read", "Check the bus' cables and power"
            )
        memory += status.data
        bits |= status.error
    return memory, bits


def _check(asker: Asker, who: str, units: FeetechUnits, offset: int, memory: bytes) -> None:
    """Raises DeviceError for a servo that isn't set up as the profile needs it."""
    mode, several = TABLE["operating_mode"].decode(memory), bool(TABLE["phase"].decode(memory) & SEVERAL_TURNS)
    if mode != POSITION:
        raise DeviceError(asker.place, f"{who} has operating mode {mode}, expected {POSITION} (position)", _TOOL)
    low, high = TABLE["min_position_limit"].decode(memory), TABLE["max_position_limit"].decode(memory)
    wanted = units.mode == "extended"
    if several != wanted or (low == high == 0) != wanted:
        found = "several turns" if several else "one turn"
        raise DeviceError(
            asker.place,
            f"{who} counts {found} (phase) with position limits {low} to {high}, which doesn't fit mode '{units.mode}'",
            f"Several turns need bit 4 of the phase and both limits 0; one turn needs neither. {_TOOL}",
        )
    low, high = own_range(units.mode, memory)
    if not low < high:
        raise DeviceError(asker.place, f"the position limits of {who}, {low} to {high}, leave no room", _TOOL)
    found_offset = TABLE["homing_offset"].decode(memory)
    if found_offset != offset:
        raise DeviceError(
            asker.place,
            f"{who} has a homing offset of {found_offset}, the profile says {offset}",
            "It is another servo: swap the ids back; or it was calibrated anew: "
            f"say 'offset: {found_offset}' and measure 'zero'",
        )
    phase = TABLE["phase"].decode(memory)
    if phase & MEANINGS != USUAL | (SEVERAL_TURNS if wanted else 0):
        raise DeviceError(asker.place, f"the phase of {who} is {phase}: directions or units turned", f"{_TOOL}")
    for key in ("max_torque", "torque_limit"):
        if TABLE[key].decode(memory) == 0:
            raise DeviceError(asker.place, f"the {key.replace('_', ' ')} of {who} is 0", _TOOL)


def _set(asker: Asker, who: str, id: int, register: Register, value: int, what: str) -> None:
    """Sets a register and reads it back; an acknowledgement alone isn't trusted."""
    for _ in range(_TRIES):
        status = asker.ask(protocol.read(id, register.address, register.size), id, register.size)
        if status is not None and len(status.data) == register.size:
            if register.decode(status.data, register.address) == value:
                return
            asker.tell(protocol.write(id, register.address, register.encode(value)))
    status = asker.ask(protocol.read(id, register.address, register.size), id, register.size)
    if status is None or len(status.data) != register.size or register.decode(status.data, register.address) != value:
        raise DeviceError(
            asker.place, f"{who} doesn't take its {what} ({value})", "Check the bus' cables and power, then try again"
        )


def _heard(link: Transport) -> list[int]:
    """Returns the ids of all servos that answer a broadcast ping."""
    return sorted({status.id for status in _answers(link, protocol.ping(protocol.BROADCAST))})


def _answers(link: Transport, frame: bytes) -> list[Status]:
    """Returns all that answers a packet within `SCAN`."""
    parser = protocol.Parser()
    found: list[Status] = []
    link.flush_input()
    link.write_all(frame, 1.0)
    for left in remaining(SCAN):
        found += parser.statuses(link.read_wait(left))
    return found


def _silence(asker: Asker, units: FeetechUnits, scan: bool) -> DeviceError:
    """Returns the error if no motor answers: which servos do, and at which baud rate."""
    config, place = units.config, asker.place
    problem = f"no servo of the profile answers at {config.port} with {config.baudrate} baud"
    power = "Check the servos' own power supply, the cable to the first servo and the adapter"
    if not scan or "://" in config.port or config.port.startswith("spy:"):
        return DeviceError(place, problem, power)
    asker.link.close()
    rates = [config.baudrate, *(rate for rate in _RATES if rate != config.baudrate)]
    rate, servos = _scan(config.port, place, rates)
    if servos:
        there = f"; with {rate} baud there are: {', '.join(map(str, servos))}"
        fix = f"Set 'baudrate: {rate}'" if rate != config.baudrate else "Correct the ids in the profile"
        return DeviceError(place, problem + there, fix)
    return DeviceError(place, f"{problem}, nor at {', '.join(map(str, rates[1:]))}", power)


def who(port: str) -> str:
    """See `Driver.who_is_at`: ids and models of the servos that answer, at the first baud rate with any."""
    rate, servos = _scan(port, port, _RATES)
    if not servos:
        rates = ", ".join(map(str, _RATES))
        raise DeviceError(port, f"no servo of this kind answers a ping at {rates} baud", "Check the servos' own power")
    named = (f"id {id}: {called(number) if number is not None else 'gives no model'}" for id, number in servos.items())
    return f"{rate} baud, {', '.join(named)}"


def _scan(port: str, place: str, rates: Sequence[int]) -> tuple[int, dict[int, int | None]]:
    """Returns the first baud rate at which servos answer a broadcast ping, and their model numbers by id."""
    model = TABLE["model_number"]
    for rate in rates:
        link = open_transport(port, place=place, baudrate=rate)
        try:
            found: dict[int, int | None] = {}
            for id in _heard(link):
                output = [s.data for s in _answers(link, protocol.read(id, model.address, model.size)) if s.id == id]
                whole = [data for data in output if len(data) == model.size]
                found[id] = model.decode(whole[0], model.address) if whole else None
            if found:
                return rate, found
        finally:
            link.close()
    return 0, {}
