"""A servo that comes from its box is set up for its place in the limb: id, baud rate, and what the profile says of it.

One servo at a time is on the bus, as new ones have the same id. Nothing moves: no goal and no torque is written, and a
servo whose torque is on is left as it is. What was written is read back.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from math import ceil, floor
from typing import Any, Final, NamedTuple

from srl.drivers.servo_bus.asking import Asker
from srl.drivers.servo_bus.packets import BROADCAST, Status
from srl.drivers.servo_bus.register import Register
from srl.drivers.servo_bus.units import Units
from srl.drivers.timeout import remaining
from srl.drivers.transport import Transport, open_transport
from srl.runtime.contracts.errors import DeviceError

LISTEN: Final = 0.1  # s for the answers to a broadcast
_READS: Final = 3  # of the same registers: two servos of one id rarely garble them in the same way
_ALONE: Final = "Connect one servo alone, then try again"
_CABLE: Final = "Check its cable and its power"


class Found(NamedTuple):
    """A servo that answers: at this baud rate, in this protocol, with this id."""

    rate: int
    protocol: int
    id: int


class Change(NamedTuple):
    """A register that was written: its name, and its values before and after."""

    what: str
    before: int
    after: int

    def __str__(self) -> str:
        return f"{self.what.replace('_', ' ')} {self.before} -> {self.after}"


class NewServo(ABC):
    """Sets up one servo after another, for the motors of one device of a profile.

    Attributes:
        rates: baud rates at which servos are looked for, the likelier ones first.
        limits: the registers of the lowest and highest position.
    """

    rates: Sequence[int]

    def __init__(self, config: Any, place: str) -> None:
        """`config`: the device's options. `place`: its name, for errors."""
        self.config, self.place = config, place
        self.limits = "min_position_limit", "max_position_limit"

    def find(self) -> Found:
        """Looks for the only servo, at all baud rates.

        Raises:
            DeviceError: none answers, or more than one does.
        """
        found: list[Found] = []
        garbled = 0
        for rate in dict.fromkeys((self.config.baudrate, *self.rates)):
            link = open_transport(self.config.port, place=self.place, baudrate=rate)
            try:
                answers, bad = self._answers(link, rate)
            finally:
                link.close()
            found += answers
            garbled += bad if answers or bad > 1 else 0
        if len(found) == 1 and not garbled:
            return found[0]
        if found or garbled:
            named = ", ".join(f"id {one.id} at {one.rate} bit/s" for one in found)
            more = f"more than one servo answers ({named})" if len(found) > 1 else "garbled bytes answer"
            why = "" if len(found) > 1 else " Most often two servos have the same id; else check the cable"
            raise DeviceError(self.place, more, f"{_ALONE}.{why}" if why else _ALONE)
        tried = ", ".join(map(str, self.rates))
        problem = f"no servo answers at {self.config.port}, at {tried} bit/s"
        raise DeviceError(self.place, problem, f"{_CABLE} (its own supply, not USB's)")

    def give(self, name: str, found: Found, limits: bool = False) -> list[Change]:
        """Makes the servo that answers the motor `name`, and reads back what was written.

        Args:
            name: of the motor, in the profile.
            found: the servo.
            limits: whether it gets the profile's `lower` and `upper`, too.
        Returns:
            What was changed; nothing if it was as the profile says.
        Raises:
            DeviceError: it is another model, its torque is on, it doesn't take a value, or it doesn't answer any more.
        """
        wanted = self._wanted(name, found) | (self._limits(name) if limits else {})
        motor = self.config.motors[name]
        with self._asked(found) as asker:
            memory = self._whole(asker, name, found.id)
            table = self._table(motor, found, memory)
            if table["torque_enable"].decode(memory):
                problem = f"the torque of the servo for '{name}' is on"
                raise DeviceError(self.place, problem, "Switch its power off and on: what is set is set without torque")
            # The id and the rate last: until then the servo is asked as it was found.
            order = [*(key for key in wanted if key not in ("id", "baud_rate")), "id", "baud_rate"]
            changes = [
                Change(key, now, wanted[key]) for key in order if (now := table[key].decode(memory)) != wanted[key]
            ]
            if changes:
                self._unlock(asker, found.id)
            id = found.id
            for change in changes:
                register = table[change.what]
                asker.ask(asker.bus.wire.write(id, register.address, register.encode(change.after)), id, 0, tries=2)
                id = motor.id if change.what == "id" else id
        with self._asked(Found(self.config.baudrate, found.protocol, motor.id)) as asker:
            self._lock(asker, motor.id)  # it may be open from a time that was broken off
            memory = self._whole(asker, name, motor.id)
        for change in changes:
            if (now := table[change.what].decode(memory)) != change.after:
                problem = f"the servo for '{name}' has {change.what.replace('_', ' ')} {now}, not {change.after}"
                raise DeviceError(self.place, problem, "Try again; what it has taken stays, and it is found again")
        return changes

    def fits(self, name: str, found: Found) -> bool:
        """Whether the servo that answers is the motor `name` already. Raises DeviceError: it doesn't answer."""
        motor = self.config.motors[name]
        if (found.id, found.rate) != (motor.id, self.config.baudrate):
            return False
        with self._asked(found) as asker:
            memory = self._whole(asker, name, found.id)
        table = self._table(motor, found, memory)
        return all(table[key].decode(memory) == value for key, value in self._wanted(name, found).items())

    def _asked(self, found: Found) -> _Session:
        link = open_transport(self.config.port, place=self.place, baudrate=found.rate)
        return _Session(Asker(link, self._bus(found.protocol), self.place))

    def _whole(self, asker: Asker, name: str, id: int) -> bytes:
        """All registers, from address 0 on. Raises DeviceError: it doesn't answer, or two answer as one."""
        reads = []
        self._have_it_answer(asker, id)
        for _ in range(_READS):
            before = asker.parser.errors + asker.parser.skipped
            memory = b""
            for address, size in self._parts():
                status = asker.ask(asker.bus.wire.read(id, address, size), id, size)
                if status is None or len(status.data) != size:
                    garbled = asker.parser.errors + asker.parser.skipped > before
                    problem = f"the servo for '{name}' (id {id}) " + ("garbles its answers" if garbled else "is silent")
                    raise DeviceError(self.place, problem, f"{_ALONE}; {_CABLE[0].lower()}{_CABLE[1:]}")
                memory += status.data
            reads.append(self._lasting(memory))
        if len(set(reads)) > 1:
            problem = f"the servo for '{name}' (id {id}) reads otherwise each time"
            raise DeviceError(self.place, problem, f"{_ALONE}: perhaps two have this id")
        return memory

    def _limits(self, name: str) -> dict[str, int]:
        """The registers of `lower` and `upper`, in counts, rounded outwards. Raises DeviceError: it can't have them."""
        motor, units = self.config.motors[name], self._units()
        if units.mode != "position" or motor.lower is None or motor.upper is None:
            problem = f"'{name}' can't have limits of its own: mode '{units.mode}', {motor.lower} to {motor.upper}"
            raise DeviceError(self.place, problem, "Leave --limits out, or give it lower, upper and mode position")
        i = list(self.config.motors).index(name)
        ends = sorted((end - units.offset[i]) / units.per_count[i] for end in (motor.lower, motor.upper))
        low, high = floor(ends[0] + 1e-6), ceil(ends[1] - 1e-6)
        if not 0 <= low < high <= 4095:
            problem = f"'{name}' would have limits of {low} to {high} counts, and one turn has 0 to 4095"
            raise DeviceError(self.place, problem, "Leave --limits out, or seat the horn nearer to the middle")
        return dict(zip(self.limits, (low, high), strict=True))

    def _listened(
        self, link: Transport, parser: Any, frame: bytes, seconds: float | None = None
    ) -> tuple[list[Status], int]:
        """The answers to a frame, and how many packets or bytes were garbled."""
        link.flush_input()
        link.write_all(frame, 1.0)
        statuses: list[Status] = []
        for left in remaining(LISTEN if seconds is None else seconds):
            statuses += parser.statuses(link.read_wait(left))
        return statuses, parser.errors + parser.skipped

    @abstractmethod
    def _have_it_answer(self, asker: Asker, id: int) -> None:
        """Has a servo answer reads and writes that answers pings alone."""

    @abstractmethod
    def _answers(self, link: Transport, rate: int) -> tuple[list[Found], int]:
        """Who answers on a link at this rate, and how many answers were garbled."""

    @abstractmethod
    def _bus(self, protocol: int) -> Any:
        """Who is on the line, for `Asker`."""

    @abstractmethod
    def _units(self) -> Units:
        """The servos of the profile in SI units."""

    @abstractmethod
    def _parts(self) -> Sequence[tuple[int, int]]:
        """(address, size) of the reads that give all registers, from address 0 on."""

    @abstractmethod
    def _lasting(self, memory: bytes) -> bytes:
        """Of all registers, those that don't change by themselves."""

    @abstractmethod
    def _table(self, motor: Any, found: Found, memory: bytes) -> dict[str, Register]:
        """The motor's registers. Raises DeviceError: the servo is another model than the profile says."""

    @abstractmethod
    def _wanted(self, name: str, found: Found) -> dict[str, int]:
        """The registers as the profile needs them, with "id" and "baud_rate". Raises DeviceError."""

    def _unlock(self, asker: Asker, id: int) -> None:
        """Lets what is written be kept over a power-off."""

    def _lock(self, asker: Asker, id: int) -> None:
        """Ends that."""


class _Session:
    """An open link, closed at the end."""

    def __init__(self, asker: Asker) -> None:
        self._asker = asker

    def __enter__(self) -> Asker:
        return self._asker

    def __exit__(self, *_: object) -> None:
        self._asker.link.close()


def broadcast(statuses: Sequence[Status], rate: int, protocol: int) -> Iterator[Found]:
    """Each answer to a broadcast; two of one id are two servos."""
    for status in statuses:
        if status.id < BROADCAST:
            yield Found(rate, protocol, status.id)
