"""The two firmware families in SI units: the registers of samples and goals, and the meaning of their numbers.

Protocol sheet dynamixel, §4 and §5. Everything here is for the whole bus at once, in the motors' order.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from math import pi
from typing import Any, ClassVar, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.dynamixel import protocol1, protocol2, table
from drivers.dynamixel.config import DynamixelConfig
from drivers.dynamixel.models import CENTRE, COUNTS, PER_COUNT
from drivers.dynamixel.packets import BROADCAST, Status
from runtime.contracts.signals import Array, Limits

VELOCITY2: Final = 0.229 * 2 * pi / 60  # rad/s per unit
VELOCITY1: Final = 0.114 * 2 * pi / 60
CURRENT2: Final = 3.36e-3  # A per unit
CURRENT1: Final = 4.5e-3
LOAD: Final = 1e-3  # of the stall torque, per unit
VOLT: Final = 0.1
WATCHDOG: Final = 0.02  # s per unit
RETURN_DELAY: Final = 2e-6  # s per unit
UNITS: Final = {"position": "rad", "velocity": "rad/s", "effort": "N m"}


class Parser(Protocol):
    """The interface of both protocols' parsers."""

    frames: int
    errors: int
    resyncs: int
    skipped: int

    def statuses(self, data: bytes) -> list[Status]: ...

    def forget(self) -> None: ...


class Wire(Protocol):
    """The interface of both protocols' modules."""

    PING_SIZE: int
    OVERHEAD: int

    def ping(self, id: int) -> bytes: ...

    def read(self, id: int, address: int, size: int) -> bytes: ...

    def write(self, id: int, address: int, data: bytes) -> bytes: ...

    def group_read(self, address: int, size: int, ids: Sequence[int]) -> bytes: ...

    def sync_write(self, address: int, size: int, values: Mapping[int, bytes]) -> bytes: ...


class Family(ABC):
    """One firmware family on this bus.

    Attributes:
        wire: the protocol's encoders.
        tables: each motor's registers.
        sample: (address, size) read in every cycle: position, velocity, current or load.
        extra: (address, size) of the same plus voltage and temperature.
        check: (address, size) of torque enable and of the registers that show a fault.
        velocity_unit: rad/s per unit; current_unit: A per unit.
        unit: the command of one unit of the goals' register, (n,), negative for a reversed motor.
        filler: bytes that complete any packet that was cut short, without harm.
    """

    protocol: ClassVar[int]
    velocity_unit: ClassVar[float]
    current_unit: ClassVar[float]
    check: ClassVar[tuple[int, int]]
    sample: tuple[int, int]
    extra: tuple[int, int]
    filler: bytes

    def __init__(self, config: DynamixelConfig) -> None:
        motors = list(config.motors.values())
        self.config = config
        self.ids = config.ids
        self.wire: Wire = protocol1 if self.protocol == 1 else protocol2
        self.tables = [table.table(motor.facts, self.protocol) for motor in motors]
        self.mode = config.mode
        self.senses_current = np.array([motor.facts.senses_current for motor in motors])
        scale = np.array([motor.scale for motor in motors])
        zero = np.array([motor.zero for motor in motors])
        self.per_count = PER_COUNT * scale  # rad or m
        self.offset = -(CENTRE * PER_COUNT + zero) * scale
        self.per_velocity = self.velocity_unit * scale
        self.current_effort = np.array([motor.newton_metres for motor in motors]) * self.current_unit / scale
        self.load_effort = np.array([motor.facts.stall_torque for motor in motors]) * LOAD / scale
        self.unit = {"velocity": self.per_velocity, "effort": self.current_effort}.get(self.mode, self.per_count)
        self._zero = self.offset if self.unit is self.per_count else np.zeros(len(motors))  # the command of goal 0
        self.low, self.high = np.zeros(len(motors)), np.zeros(len(motors))  # of the goals, in register units
        self.last = np.zeros(len(motors), np.int64)  # the newest goals, in register units
        self.seen: NDArray[np.int16] | NDArray[np.int32] | None = None  # positions of the newest sample, counts
        goal = self.goal
        self._body = np.zeros(len(motors), np.dtype([("id", "u1"), ("goal", f"<i{goal.size}")]))
        self._body["id"] = self.ids
        self._head = goal.address.to_bytes(self.protocol, "little") + goal.size.to_bytes(self.protocol, "little")

    @abstractmethod
    def parser(self) -> Parser:
        """Returns a parser for the servos' answers."""

    @property
    @abstractmethod
    def goal(self) -> table.Register:
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
        wanted = (command - self._zero) / self.unit
        finite = np.isfinite(wanted)
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

    def own_range(self, i: int, memory: bytes) -> tuple[float, float]:
        """Returns the lowest and highest goal position of motor `i`, counts, from its registers (address 0 on)."""
        return self._own_limits(i, memory)[:2]

    def again(self, motors: NDArray[np.bool_] | None = None) -> bytes:
        """Returns the packet that repeats the last goals, of all motors or of some (n,)."""
        self._body["goal"] = self._sign(self.last)
        body = self._body if motors is None else self._body[motors]
        return self._sync_write(self._head + body.tobytes())

    def take_up_turns(self, i: int, counts: int) -> None:
        """Corrects for lost turns: motor `i` reports `counts` instead of `seen[i]`, as it has forgotten whole turns.

        A servo counts turns only while it has power. It must not have moved by half a turn in the meantime.
        """
        if self.mode == "extended" and self.seen is not None:
            turns = round((int(self.seen[i]) - counts) / COUNTS)
            self.offset[i] += turns * COUNTS * self.per_count[i]

    def frame(self, name: str, value: int | Mapping[int, int], ids: Iterable[int] | None = None) -> bytes:
        """Encodes a write of one register (the same in all tables) to all motors, to some, or by id; unacknowledged."""
        register = self.tables[0][name]
        if isinstance(value, int):
            value = dict.fromkeys(self.ids if ids is None else ids, value)
        data = {id: register.encode(v) for id, v in value.items()}
        return self.wire.sync_write(register.address, register.size, data)

    def set_limits(self, memory: Sequence[bytes]) -> Limits:
        """Sets the bounds of the goals from the motors' registers; returns the command's limits in SI units.

        Args:
            memory: each motor's registers from address 0 on.
        """
        n, motors = len(self.ids), list(self.config.motors.values())
        lower, upper = np.full(n, -np.inf), np.full(n, np.inf)
        velocity, effort = np.full(n, np.inf), np.full(n, np.inf)
        for i, (motor, data) in enumerate(zip(motors, memory, strict=True)):
            low, high, fastest, strongest = self._own_limits(i, data)
            facts = motor.facts
            velocity[i] = min(fastest * self.velocity_unit, facts.no_load_speed) * abs(motor.scale)
            effort[i] = strongest * abs(self.current_effort[i])
            if self.mode in ("position", "extended"):
                ends = np.sort(np.array([low, high]) * self.per_count[i] + self.offset[i])
                lower[i], upper[i] = ends
                self.low[i], self.high[i] = low, high
            else:
                most = fastest if self.mode == "velocity" else strongest
                self.low[i], self.high[i] = -most, most
            lower[i] = lower[i] if motor.lower is None else max(lower[i], motor.lower)
            upper[i] = upper[i] if motor.upper is None else min(upper[i], motor.upper)
        return Limits(
            lower=lower if np.isfinite(lower).any() else None,
            upper=upper if np.isfinite(upper).any() else None,
            velocity=velocity,
            effort=effort if self.mode == "effort" else None,
        )

    @abstractmethod
    def _own_limits(self, i: int, data: bytes) -> tuple[float, float, float, float]:
        """Returns lowest and highest goal position (counts), greatest velocity, greatest current, in register units."""

    def _sync_write(self, data: bytes) -> bytes:
        wire: Any = self.wire
        frame: bytes = wire.packet(BROADCAST, wire.SYNC_WRITE, data)
        return frame


class Family2(Family):
    """MX(2.0): firmware of protocol 2."""

    protocol = 2
    velocity_unit, current_unit = VELOCITY2, CURRENT2
    check = (64, 7)
    sample, extra = (126, 10), (126, 21)

    _GOALS: Final = {
        "position": "goal_position",
        "extended": "goal_position",
        "velocity": "goal_velocity",
        "effort": "goal_current",
    }
    MODES: Final = {
        "position": table.POSITION,
        "extended": table.EXTENDED,
        "velocity": table.VELOCITY,
        "effort": table.CURRENT,
    }

    def __init__(self, config: DynamixelConfig) -> None:
        super().__init__(config)
        fields, formats = ["current", "velocity", "position"], ["<i2", "<i4", "<i4"]
        self._sample = np.dtype({"names": fields, "formats": formats, "offsets": [0, 2, 6], "itemsize": 10})
        self._extra = np.dtype(
            {
                "names": [*fields, "voltage", "temperature"],
                "formats": [*formats, "<u2", "u1"],
                "offsets": [0, 2, 6, 18, 20],
                "itemsize": 21,
            }
        )
        self._effort = np.where(self.senses_current, self.current_effort, self.load_effort)
        # Zeros: if a length is cut after its low byte, the high byte becomes 0, so the packet ends within these zeros.
        self.filler = bytes(7 * len(self.ids) + 16)

    def parser(self) -> Parser:
        return protocol2.Parser(longest=256)

    @property
    def goal(self) -> table.Register:
        return self.tables[0][self._GOALS[self.config.mode]]

    def decode(self, data: bytes, size: int, out: Mapping[str, Array]) -> None:
        whole = size != 10
        raw = np.frombuffer(data, self._extra if whole else self._sample)
        self.seen = raw["position"]
        np.multiply(self.seen, self.per_count, out=out["position"])
        out["position"] += self.offset
        np.multiply(raw["velocity"], self.per_velocity, out=out["velocity"])
        np.multiply(raw["current"], self._effort, out=out["effort"])
        if whole:
            out["temperature"][:] = raw["temperature"]
            np.multiply(raw["voltage"], VOLT, out=out["voltage"])

    def _sign(self, goals: NDArray[np.int64]) -> NDArray[np.int64]:
        return goals

    def _own_limits(self, i: int, data: bytes) -> tuple[float, float, float, float]:
        registers = self.tables[i]
        low, high = -table.TURNS, table.TURNS
        if self.mode == "position":
            low, high = registers["min_position_limit"].decode(data), registers["max_position_limit"].decode(data)
        limit = registers.get("current_limit")
        return low, high, registers["velocity_limit"].decode(data), limit.decode(data) if limit else np.inf


class Family1(Family):
    """MX as first delivered: firmware of protocol 1. It has no bus watchdog."""

    protocol = 1
    velocity_unit, current_unit = VELOCITY1, CURRENT1
    check = (24, 12)
    # 7E: the longest packet, cut within its length, ends within these bytes. No goal register accepts 7E7E.
    filler = b"\x7e" * 140

    _GOALS: Final = {
        "position": "goal_position",
        "extended": "goal_position",
        "velocity": "moving_speed",
        "effort": "goal_torque",
    }

    def __init__(self, config: DynamixelConfig) -> None:
        super().__init__(config)
        self._has_current = bool(self.senses_current.any())
        names = ["position", "speed", "load", "voltage", "temperature"]
        formats, offsets = ["<i2", "<u2", "<u2", "u1", "u1"], [0, 2, 4, 6, 7]
        if self._has_current:
            names, formats, offsets = [*names, "current"], [*formats, "<u2"], [*offsets, 32]
        size = 34 if self._has_current else 8
        self.sample = self.extra = (36, size)
        self._dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})

    def parser(self) -> Parser:
        return protocol1.Parser()

    @property
    def goal(self) -> table.Register:
        return self.tables[0][self._GOALS[self.config.mode]]

    def decode(self, data: bytes, size: int, out: Mapping[str, Array]) -> None:
        raw = np.frombuffer(data, self._dtype)
        self.seen = raw["position"]
        np.multiply(self.seen, self.per_count, out=out["position"])
        out["position"] += self.offset
        np.multiply(signed(raw["speed"]), self.per_velocity, out=out["velocity"])
        np.multiply(signed(raw["load"]), self.load_effort, out=out["effort"])
        if self._has_current:
            current = raw["current"].astype(np.int64) - CENTRE
            np.multiply(current, self.current_effort, out=out["effort"], where=self.senses_current)
        out["temperature"][:] = raw["temperature"]
        np.multiply(raw["voltage"], VOLT, out=out["voltage"])

    def _sign(self, goals: NDArray[np.int64]) -> NDArray[np.int64]:
        if self.mode in ("position", "extended"):
            return goals
        return np.where(goals < 0, 0x400 - goals, goals)

    def _own_limits(self, i: int, data: bytes) -> tuple[float, float, float, float]:
        registers = self.tables[i]
        low, high = registers["cw_angle_limit"].decode(data), registers["ccw_angle_limit"].decode(data)
        if self.mode == "extended":
            low, high = -table.MULTI_TURN, table.MULTI_TURN
        elif self.mode != "position":
            low, high = 0, COUNTS - 1
        return low, high, 1023.0, 1023.0


def signed(raw: NDArray[np.uint16]) -> NDArray[np.int64]:
    """Decodes protocol 1's speeds, loads and torques: magnitude in bits 0 to 9, bit 10 set for clockwise (negative)."""
    size = (raw & 0x3FF).astype(np.int64)
    return np.where(raw & 0x400, -size, size)


def family(config: DynamixelConfig) -> Family:
    """Returns the family of the profile's `protocol`."""
    return Family1(config) if config.protocol == 1 else Family2(config)
