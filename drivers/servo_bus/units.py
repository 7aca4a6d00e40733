"""The servos of a bus in SI units, whatever their make: goals as packets, and what a line must know of them.

Everything here is for the whole bus at once, in the motors' order.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from srl.drivers.servo_bus.config import AxisConfig
from srl.drivers.servo_bus.models import CENTRE, COUNTS, PER_COUNT
from srl.drivers.servo_bus.packets import BROADCAST, Status
from srl.drivers.servo_bus.register import Register
from srl.runtime.contracts.signals import Array

VOLT: Final = 0.1  # V of one unit of a sample
_TURNING: Final = ("extended", "current-position")  # modes in which a servo counts whole turns


class Parser(Protocol):
    """The interface of the protocols' parsers."""

    frames: int
    errors: int
    resyncs: int
    skipped: int

    def statuses(self, data: bytes) -> list[Status]: ...

    def forget(self) -> None: ...


class Wire(Protocol):
    """The interface of the protocols' modules."""

    PING_SIZE: int
    OVERHEAD: int

    def ping(self, id: int) -> bytes: ...

    def read(self, id: int, address: int, size: int) -> bytes: ...

    def write(self, id: int, address: int, data: bytes) -> bytes: ...

    def group_read(self, address: int, size: int, ids: Sequence[int]) -> bytes: ...

    def sync_write(self, address: int, size: int, values: Mapping[int, bytes]) -> bytes: ...


class Rates(Protocol):
    """What the profile says of a bus' timing."""

    @property
    def baudrate(self) -> int: ...

    @property
    def return_delay(self) -> float | None: ...


class OnLine(Protocol):
    """What a line must know of its bus."""

    @property
    def wire(self) -> Wire: ...

    @property
    def ids(self) -> tuple[int, ...]: ...

    @property
    def config(self) -> Rates: ...

    def parser(self) -> Parser: ...


class Starting(Rates, Protocol):
    """What the profile says of a bus' start."""

    @property
    def start_tolerance(self) -> float: ...

    @property
    def motors(self) -> Mapping[str, AxisConfig]: ...


class Units(ABC):
    """The servos of one bus.

    Attributes:
        config: the profile's options; set by the subclass, as `wire`, `tables` and `mode` are.
        wire: the protocol's encoders.
        tables: each motor's registers.
        mode: what is commanded; "extended" and "current-position" are positions over several turns.
        sample: (address, size) read in every cycle: position, velocity, current or load.
        extra: (address, size) of the same plus voltage and temperature.
        check: (address, size) of torque enable and of the registers that show a fault.
        velocity_unit: rad/s of one unit of a sample.
        current_unit: (n,) A of one unit of each motor's current.
        per_velocity, current_effort: (n,) rad/s and N m (m/s, N) of an axis for these.
        unit: the command of one unit of the goals' register, (n,), negative for a reversed motor.
        low, high: bounds of the goals, (n,), in register units.
        last: the newest goals, (n,), in register units.
        seen: (n,), positions of the newest sample, counts; None before the first.
    """

    config: Starting
    wire: Wire
    tables: list[dict[str, Register]]
    mode: str
    goal_format: ClassVar[str] = "i"  # of the goals' register, for numpy
    velocity_unit: ClassVar[float]
    current_unit: Array
    per_velocity: Array
    current_effort: Array
    check: tuple[int, int]
    sample: tuple[int, int]
    extra: tuple[int, int]

    def __init__(self, ids: tuple[int, ...], axes: Sequence[AxisConfig]) -> None:
        self.ids = ids
        scale = np.array([axis.scale for axis in axes])
        zero = np.array([axis.zero for axis in axes])
        self.per_count = PER_COUNT * scale  # rad or m
        self.offset = -(CENTRE * PER_COUNT + zero) * scale
        self.unit = self.per_count
        self._zero = self.offset  # the command of goal 0
        self.low, self.high = np.zeros(len(axes)), np.zeros(len(axes))
        self.last = np.zeros(len(axes), np.int64)
        self.seen: NDArray[Any] | None = None

    def _begin(self, width: int) -> None:
        """Prepares the goals' packet; `width`: bytes of an address on the wire."""
        goal = self.goal
        self._body = np.zeros(len(self.ids), np.dtype([("id", "u1"), ("goal", f"<{self.goal_format}{goal.size}")]))
        self._body["id"] = self.ids
        self._head = goal.address.to_bytes(width, "little") + goal.size.to_bytes(width, "little")

    @abstractmethod
    def parser(self) -> Parser:
        """Returns a parser for the servos' answers."""

    @property
    @abstractmethod
    def goal(self) -> Register:
        """The register that holds this mode's goals."""

    @abstractmethod
    def decode(self, data: bytes, size: int, out: Mapping[str, Array]) -> None:
        """Fills `position`, `velocity`, `effort`, and with `extra`'s size also `temperature` and `voltage`.

        Args:
            data: all motors' bytes, one motor after another.
            size: bytes per motor, `sample`'s or `extra`'s.
            out: arrays (n,) by name.
        """

    @abstractmethod
    def _sign(self, goals: NDArray[np.int64]) -> NDArray[np.int64]:
        """Returns the register values for signed goals."""

    def encode(self, command: Array) -> bytes:
        """Returns the packet that gives all motors their goals; the goals stay in `last`.

        If a command isn't finite, that motor keeps its last goal.
        """
        finite = np.isfinite(command)
        with np.errstate(over="ignore"):  # the bounds are then the goal
            wanted = (command - self._zero) / self.unit
        np.rint(wanted, out=wanted)
        np.maximum(wanted, self.low, out=wanted)
        np.minimum(wanted, self.high, out=wanted)
        np.copyto(self.last, wanted, casting="unsafe", where=finite)
        return self.again()

    def bounded(self, command: Array) -> Array:
        """Returns the commands (n,) that `encode` makes of these, before rounding: within the servos' own limits."""
        goals = np.clip((command - self._zero) / self.unit, self.low, self.high)
        found: Array = goals * self.unit + self._zero
        return found

    def again(self, motors: NDArray[np.bool_] | None = None) -> bytes:
        """Returns the packet that repeats the last goals, of all motors or of some (n,)."""
        self._body["goal"] = self._sign(self.last)
        body = self._body if motors is None else self._body[motors]
        return self._sync_write(self._head + body.tobytes())

    def take_up_turns(self, i: int, counts: int) -> None:
        """Corrects for lost turns: motor `i` reports `counts`, and may have forgotten whole turns.

        A servo counts turns only while it has power. What was seen before tells them, if it hasn't moved by half a turn
        since. Else bounds that are less than a turn apart do: the axis is the one place between them, or the nearest.
        """
        if self.mode not in _TURNING:
            return
        turn = COUNTS * self.per_count[i]
        if self.seen is not None:
            self.offset[i] += round((int(self.seen[i]) - counts) / COUNTS) * turn
            return
        axis = list(self.config.motors.values())[i]
        if axis.lower is not None and axis.upper is not None and axis.upper - axis.lower < abs(turn):
            middle = (axis.lower + axis.upper) / 2.0
            self.offset[i] += round((middle - counts * self.per_count[i] - self.offset[i]) / turn) * turn

    def frame(self, name: str, value: int | Mapping[int, int], ids: Iterable[int] | None = None) -> bytes:
        """Encodes a write of one register (the same in all tables) to all motors, to some, or by id; unacknowledged."""
        register = self.tables[0][name]
        if isinstance(value, int):
            value = dict.fromkeys(self.ids if ids is None else ids, value)
        data = {id: register.encode(v) for id, v in value.items()}
        return self.wire.sync_write(register.address, register.size, data)

    def _sync_write(self, data: bytes) -> bytes:
        wire: Any = self.wire
        frame: bytes = wire.packet(BROADCAST, wire.SYNC_WRITE, data)
        return frame
