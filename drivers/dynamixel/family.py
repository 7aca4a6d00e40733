"""The two firmware families in SI units: the registers of samples and goals, and the meaning of their numbers.

Protocol sheet dynamixel, §4 and §5. Everything here is for the whole bus at once, in the motors' order.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from math import pi
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from srl.drivers.dynamixel import protocol2, table
from srl.drivers.dynamixel.config import POSITIONAL, DynamixelConfig, MotorConfig
from srl.drivers.servo_bus import protocol1
from srl.drivers.servo_bus.models import CENTRE, COUNTS
from srl.drivers.servo_bus.units import VOLT, Parser, Units, Wire
from srl.runtime.contracts.signals import Array, Limits

VELOCITY2: Final = 0.229 * 2 * pi / 60  # rad/s per unit
VELOCITY1: Final = 0.114 * 2 * pi / 60
CURRENT1: Final = 4.5e-3
LOAD: Final = 1e-3  # of the stall torque, per unit
WATCHDOG: Final = 0.02  # s per unit
RETURN_DELAY: Final = 2e-6  # s per unit
UNITS: Final = {"position": "rad", "velocity": "rad/s", "effort": "N m"}


class Family(Units):
    """One firmware family on this bus.

    Attributes:
        filler: bytes that complete any packet that was cut short, without harm.
    """

    protocol: ClassVar[int]
    filler: bytes

    def __init__(self, config: DynamixelConfig) -> None:
        motors = list(config.motors.values())
        self.config: DynamixelConfig = config
        self.wire: Wire = protocol1 if self.protocol == 1 else protocol2
        self.tables = [table.table(motor.facts, self.protocol) for motor in motors]
        self.mode = config.mode
        super().__init__(config.ids, motors)
        scale = np.array([motor.scale for motor in motors])
        self.current_unit = self._current_units(motors)
        self.senses_current = np.array([motor.facts.senses_current for motor in motors])
        self.per_velocity = self.velocity_unit * scale
        self.current_effort = np.array([motor.newton_metres for motor in motors]) * self.current_unit / scale
        self.load_effort = np.array([motor.facts.stall_torque for motor in motors]) * LOAD / scale
        if self.mode in ("velocity", "effort"):
            self.unit = self.per_velocity if self.mode == "velocity" else self.current_effort
            self._zero = np.zeros(len(motors))
        self._begin(self.protocol)

    @abstractmethod
    def _current_units(self, motors: Sequence[MotorConfig]) -> Array:
        """(n,) A of one unit of each motor's current."""

    def own_range(self, i: int, memory: bytes) -> tuple[float, float]:
        """Returns the lowest and highest goal position of motor `i`, counts, from its registers (address 0 on)."""
        return self._own_limits(i, memory)[:2]

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
            if self.mode in POSITIONAL:
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


class Family2(Family):
    """MX(2.0) and X: firmware of protocol 2.

    Attributes:
        pressure: n goal currents that bound the effort in mode `current-position`, in the register's units.
    """

    protocol = 2
    velocity_unit = VELOCITY2
    check = (64, 7)
    sample, extra = (126, 10), (126, 21)

    _GOALS: Final = {
        "position": "goal_position",
        "extended": "goal_position",
        "current-position": "goal_position",
        "velocity": "goal_velocity",
        "effort": "goal_current",
    }
    MODES: Final = {
        "position": table.POSITION,
        "extended": table.EXTENDED,
        "current-position": table.CURRENT_POSITION,
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
        efforts = np.array([motor.effort or 0.0 for motor in config.motors.values()])
        self._asked = [int(x) for x in np.floor(efforts / np.abs(self.current_effort) + 1e-9)]
        self.pressure = list(self._asked)
        self._effort = np.where(self.senses_current, self.current_effort, self.load_effort)
        # Zeros: if a length is cut after its low byte, the high byte becomes 0, so the packet ends within these zeros.
        self.filler = bytes(7 * len(self.ids) + 16)

    def _current_units(self, motors: Sequence[MotorConfig]) -> Array:
        return np.array([motor.facts.current_unit for motor in motors])

    def bound_effort(self, i: int, memory: bytes) -> None:
        """Keeps the pressure of motor `i` within the current limit in its registers (address 0 on)."""
        if self.mode == "current-position":
            self.pressure[i] = min(self._asked[i], self.tables[i]["current_limit"].decode(memory))

    def volatile(self, i: int) -> dict[str, int]:
        """Returns what motor `i` needs in its registers after power-up, besides its watchdog."""
        wanted = {"bus_watchdog": 0, "profile_acceleration": 0, "profile_velocity": 0}
        match self.mode:
            case "velocity":
                wanted["goal_velocity"] = 0
            case "effort":
                wanted["goal_current"] = 0
            case "current-position":
                wanted["goal_current"] = self.pressure[i]
        return wanted

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
    velocity_unit = VELOCITY1
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

    def _current_units(self, motors: Sequence[MotorConfig]) -> Array:
        return np.full(len(motors), CURRENT1)

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
        if self.mode in POSITIONAL:
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
