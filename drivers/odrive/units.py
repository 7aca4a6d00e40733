"""Angles of the axes and turns of the encoders, velocities and torques likewise."""

from __future__ import annotations

from math import tau

from srl.drivers.odrive.config import OdriveAxis


class Scale:
    """One axis: axis = ±2π turns / ratio + offset."""

    def __init__(self, axis: OdriveAxis) -> None:
        self.axis = axis
        self.rad = axis.sign * tau / axis.ratio  # rad of the axis per turn of the encoder
        self.offset = axis.parked if axis.parked is not None else -axis.sign * (axis.zero or 0.0)

    def fold(self, turns: float) -> None:
        """With an absolute encoder of the axis, takes the turn in which the position is nearest to its range."""
        axis = self.axis
        if axis.encoder == "axis" and axis.lower is not None and axis.upper is not None:
            middle = (axis.lower + axis.upper) / 2
            self.offset -= tau * round((self.position(turns) - middle) / tau)

    def position(self, turns: float) -> float:
        """rad."""
        return turns * self.rad + self.offset

    def turns(self, position: float) -> float:
        """Turns of the encoder at a position of the axis, rad."""
        return (position - self.offset) / self.rad

    def velocity(self, turns: float) -> float:
        """rad/s, of turns/s."""
        return turns * self.rad

    def turns_velocity(self, velocity: float) -> float:
        """Turns/s, of rad/s."""
        return velocity / self.rad

    def torque(self, motor: float) -> float:
        """N m of the axis, of N m of the motor."""
        return motor * self.axis.gear * self.axis.sign

    def motor_torque(self, torque: float) -> float:
        """N m of the motor, of N m of the axis."""
        return torque / self.axis.gear * self.axis.sign

    @property
    def gain(self) -> float:
        """N m/(turn/s): the gain of the velocity loop that gives the axis its `damping`."""
        assert self.axis.damping is not None
        return self.axis.damping * abs(self.rad) / self.axis.gear

    @property
    def resolution(self) -> dict[str, float]:
        """What 24 bits of a number round to, at 100 turns, 100 turns/s, and the most torque."""
        single = 100 * 2.0**-23 * abs(self.rad)
        return {"position": single, "velocity": single, "torque": self.axis.most_torque * 2.0**-23}
