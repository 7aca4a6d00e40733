"""The servos of a Feetech bus in SI units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from srl.drivers.feetech import protocol
from srl.drivers.feetech.config import FeetechConfig
from srl.drivers.feetech.table import TABLE, TURNS, signed
from srl.drivers.servo_bus.models import PER_COUNT
from srl.drivers.servo_bus.register import Register
from srl.drivers.servo_bus.units import VOLT, Units, Wire
from srl.runtime.contracts.signals import Array, Limits

CURRENT: Final = 6.5e-3  # A per unit; one source only
RETURN_DELAY: Final = 2e-6  # s per unit
SAMPLE: Final = np.dtype(
    {
        "names": ["position", "velocity", "voltage", "temperature", "status", "current"],
        "formats": ["<u2", "<u2", "u1", "u1", "u1", "<u2"],
        "offsets": [0, 2, 6, 7, 9, 13],
        "itemsize": 15,
    }
)


class FeetechUnits(Units):
    """STS servos on one bus. A sample is position to current, a check everything volatile up to there."""

    goal_format: ClassVar[str] = "u"
    velocity_unit = PER_COUNT
    sample = extra = (56, 15)
    check = (40, 31)

    def __init__(self, config: FeetechConfig) -> None:
        self.config: FeetechConfig = config
        self.wire: Wire = protocol
        motors = list(config.motors.values())
        self.tables: list[dict[str, Register]] = [dict(TABLE) for _ in motors]
        self.mode = config.mode
        super().__init__(config.ids, motors)
        scale = np.array([motor.scale for motor in motors])
        self.per_velocity = self.per_count
        self.current_unit = np.full(len(motors), CURRENT)
        self.current_effort = np.array([motor.newton_metres for motor in motors]) * CURRENT / scale
        self._begin(1)

    def parser(self) -> protocol.Parser:
        return protocol.Parser()

    @property
    def goal(self) -> Register:
        return TABLE["goal_position"]

    def decode(self, data: bytes, size: int, out: Mapping[str, Array]) -> None:
        raw = np.frombuffer(data, SAMPLE)
        self.seen = signed(raw["position"], 15)
        np.multiply(self.seen, self.per_count, out=out["position"])
        out["position"] += self.offset
        np.multiply(signed(raw["velocity"], 15), self.per_count, out=out["velocity"])
        np.multiply(signed(raw["current"], 15), self.current_effort, out=out["effort"])
        out["temperature"][:] = raw["temperature"]
        np.multiply(raw["voltage"], VOLT, out=out["voltage"])

    def turned(self, data: bytes) -> NDArray[Any]:
        """Returns by how many whole turns each position of a sample differs from the one before, (n,).

        A servo doesn't turn half a turn between two samples. It has lost its count, or its encoder passed its end.
        """
        if self.seen is None:
            return np.zeros(len(self.ids))
        new = signed(np.frombuffer(data, SAMPLE)["position"], 15)
        return np.rint((new - self.seen) * PER_COUNT / (2 * pi))

    def set_limits(self, memory: Sequence[bytes]) -> Limits:
        """Sets the bounds of the goals from the motors' registers (address 0 on); returns the limits in SI units."""
        motors = list(self.config.motors.values())
        lower, upper = np.empty(len(motors)), np.empty(len(motors))
        velocity = np.array([motor.facts.no_load_speed * abs(motor.scale) for motor in motors])
        for i, (motor, data) in enumerate(zip(motors, memory, strict=True)):
            low, high = own_range(self.mode, data)
            self.low[i], self.high[i] = low, high
            ends = np.sort(np.array([low, high]) * self.per_count[i] + self.offset[i])
            lower[i] = ends[0] if motor.lower is None else max(ends[0], motor.lower)
            upper[i] = ends[1] if motor.upper is None else min(ends[1], motor.upper)
        return Limits(lower=lower, upper=upper, velocity=velocity)

    def _sign(self, goals: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.where(goals < 0, 0x8000 - goals, goals)


def own_range(mode: str, memory: bytes) -> tuple[int, int]:
    """Returns the lowest and highest goal position, counts, from a servo's registers (address 0 on)."""
    if mode == "extended":
        return -TURNS, TURNS
    return TABLE["min_position_limit"].decode(memory), TABLE["max_position_limit"].decode(memory)
