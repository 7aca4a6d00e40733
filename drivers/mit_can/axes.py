"""The axes of the profile and the shafts of the drives: units, zeros, turns, travel, and the wire's ranges. No I/O."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from srl.drivers.mit_can import protocol
from srl.drivers.mit_can.config import MitCanConfig
from srl.drivers.mit_can.models import Range
from srl.drivers.mit_can.protocol import Impedance, State
from srl.runtime.contracts.signals import Array


class Axes:
    """The conversion between an axis (rad; m of a prismatic one) and its motor's shaft (rad), by the motor's number.

    Attributes:
        scale: rad, or m, of the axis for a rad of the shaft; negative where it turns the other way.
        spans: what the wire's fields carry.
        offset: rad of the shaft, of whole turns that the drive has lost.
    """

    def __init__(self, config: MitCanConfig, spans: Sequence[Range], offset: Sequence[float]) -> None:
        self._motors = list(config.motors.values())
        self._v3, self._positions = config.generation == "v3", config.interface == "position"
        self.scale = [motor.scale for motor in self._motors]
        self.spans, self.offset = spans, offset

    def shaft(self, i: int, value: float) -> float:
        """The position of the axis as the drive says it, rad."""
        return value / self.scale[i] + self._motors[i].zero - self.offset[i]

    def clear(self, i: int, value: float) -> float:
        """A position within its joint's travel, whatever the guard was told; a velocity or torque as it is."""
        if not self._positions:
            return value
        motor = self._motors[i]
        assert motor.lower is not None
        assert motor.upper is not None
        return min(max(value, motor.lower), motor.upper)

    def encode(self, i: int, wanted: Impedance) -> bytes:
        """The frame's data, of a command at the shaft."""
        return protocol.command(wanted, self.spans[i], self._v3)

    def fill(self, states: Mapping[str, Array], i: int, state: State) -> None:
        """Writes what a drive says into the states, each (n,)."""
        if not states:
            return
        scale, span = self.scale[i], self.spans[i]
        states["position"][i] = (state.position + self.offset[i] - self._motors[i].zero) * scale
        states["velocity"][i] = protocol.dead(state.velocity, span.velocity) * scale
        states["effort"][i] = protocol.dead(state.torque, span.torque) / scale
        states["temperature"][i] = state.hottest
