"""Quasi-direct-drive actuators at their output shafts: what any drive on CAN makes of its commands.

One law serves every protocol: torque = kp (goal - angle) + kd (speed - velocity) + its integral + feedforward. MIT mode
is this law itself; position, velocity, current and brake commands are cases of it. It runs once a physics step. A fake
or a twin sets the rows of the state and calls `feed` for each frame that its firmware takes as a sign of life.

No source gives these assumptions: dry friction is 1.5 % of the peak torque, viscous friction a tenth of it a rad/s.
Driving torque falls to 0 at the no-load speed, from three times the peak torque at rest, which the drive doesn't give.
A winding at the peak torque rises by 400 K with 100 s, the power stage by 150 K with 40 s.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.sim.parts.actuators.models import ActuatorModel
from srl.sim.parts.servo_bus.drives import Drives, Row

AMBIENT: Final = 25.0  # degC
WINDING_LIMIT, STAGE_LIMIT = 100.0, 90.0  # degC, where the drive switches itself off
WINDING_BIT, STAGE_BIT, SILENCE_BIT, VOLTAGE_BIT = 1, 2, 4, 8
NOTHING, OFF, SLACK = 0, 1, 2  # what a drive does when it has heard nothing for its `timeout`
_FRICTION, _VISCOUS, _STALL = 0.015, 0.1, 3.0
_WINDING, _STAGE = (100.0, 400.0), (40.0, 150.0)  # s; K at the peak torque, final value
_UNBOUNDED: Final = 1e9  # N m
_BRAKE_SPEED: Final = 0.05  # rad/s, from which on a brake current gives its whole torque


class ActuatorMotors(Drives):
    """All actuators of a chain; see `Drives`.

    Attributes:
        models: of each.
    """

    torque: Row  # 0 or 1: the power stage
    powered: Row  # 0 or 1: the supply; without it the drive is silent
    kp: Row  # N m/rad
    kd: Row  # N m s/rad
    ki: Row  # N m/rad: of the integral of the velocity's error
    goal: Row  # rad, in the drive's own angle
    speed: Row  # rad/s
    feedforward: Row  # N m
    brake: Row  # N m against the motion, whichever way it goes
    cap: Row  # N m, the drive's limit
    integral: Row  # N m
    timeout: Row  # s of silence after which `expiry` follows; 0: never
    expiry: Row  # NOTHING, OFF or SLACK
    age: Row  # s since the last sign of life, while the power stage is on
    stored: Row  # rad, the shaft's true angle at the zero that outlasts a power-off
    zero: Row  # rad, the shaft's true angle at which the drive now reads 0
    current: Row  # A
    temperature: Row  # degC, of the winding
    stage: Row  # degC, of the power stage
    errors: Row  # bits

    def __init__(self, models: Sequence[ActuatorModel], voltage: Array | float, timestep: float) -> None:
        super().__init__(len(models), voltage, timestep)
        self.models = tuple(models)
        self.peak_torque = np.array([m.peak_torque for m in models])
        self.torque_constant = np.array([m.torque_constant for m in models])
        self.inertia = np.array([m.inertia for m in models])
        self.friction = _FRICTION * self.peak_torque
        speed = np.array([m.no_load_speed for m in models])
        self._no_load = speed * self.voltage / np.array([m.nominal_voltage for m in models])
        self.temperature[:] = self.stage[:] = AMBIENT
        for i in range(self.n):
            self.power_up(i)

    @property
    def drag(self) -> Array:
        """(n,) N m s/rad, of bearings and gears; the same with the power stage on and off."""
        return _VISCOUS * self.friction

    @property
    def angle(self) -> Array:
        """(n,) rad, what the drives take for their angle."""
        return self.position - self.zero

    @property
    def effort(self) -> Array:
        """(n,) N m, what the drives take for their torque: from the current, without friction."""
        return self.current * self.torque_constant

    def power_up(self, i: int) -> None:
        """Powers actuator `i` up: off, without commands and errors; the turns that its encoder can't tell are lost."""
        self.powered[i] = 1.0
        for row in (self.torque, self.timeout, self.expiry, self.errors):
            row[i] = 0.0
        self.slacken(i)
        self.cap[i] = self.peak_torque[i]
        turn = self.models[i].ambiguity
        self.zero[i] = self.stored[i] + turn * np.floor((self.position[i] - self.stored[i]) / turn + 0.5)

    def power_off(self, i: int) -> None:
        """Takes the supply away: no torque, no answer."""
        self.powered[i] = self.torque[i] = self.current[i] = 0.0

    def fold(self, i: int) -> None:
        """Lets actuator `i` know its turns: a world begins with drives that were homed."""
        self.zero[i] = self.stored[i]

    def set_zero(self, i: int, stored: bool) -> None:
        """Makes the present angle 0; if `stored`, also after a power-off."""
        self.zero[i] = self.position[i]
        if stored:
            self.stored[i] = self.position[i]

    def switch(self, i: int, on: bool) -> None:
        """Switches the power stage; it takes a supply, and no error."""
        on = on and bool(self.powered[i]) and not self.errors[i]
        if on and not self.torque[i]:
            self.age[i] = self.integral[i] = 0.0
        self.torque[i] = float(on)

    def slacken(self, i: int) -> None:
        """Takes every command away; the power stage stays as it is."""
        for row in (self.kp, self.kd, self.ki, self.goal, self.speed, self.feedforward, self.brake, self.integral):
            row[i] = 0.0

    def feed(self, i: int) -> None:
        """Actuator `i` has heard its host."""
        self.age[i] = 0.0

    def fail(self, i: int, bits: int) -> None:
        """Sets errors of actuator `i`, which switch it off."""
        self.errors[i] = int(self.errors[i]) | bits
        self.torque[i] = 0.0

    def step(self) -> Array:
        """Runs all drives once; returns the torques (n,), N m, of which `drag` times speed is still to be taken."""
        self._watch()
        slip = self.speed - self.velocity
        limit = np.minimum(self.cap, self.peak_torque)
        self.integral += self.ki * slip * self._dt
        np.clip(self.integral, -limit, limit, out=self.integral)
        wanted = self.kp * (self.goal - self.angle) + self.kd * slip + self.integral + self.feedforward
        wanted -= self.brake * np.clip(self.velocity / _BRAKE_SPEED, -1.0, 1.0)
        pace = self.velocity / self._no_load
        room = _STALL * self.peak_torque
        most = np.clip(room * (1.0 - pace), 0.0, limit)
        least = np.clip(room * (-1.0 - pace), -limit, 0.0)
        torque: Array = np.clip(wanted, least, most) * (self.torque > 0)
        self.current[:] = torque / self.torque_constant
        self._warm(torque)
        return torque

    def _watch(self) -> None:
        self.age += self._dt * (self.torque > 0)
        late = (self.timeout > 0) & (self.age > self.timeout) & (self.torque > 0)
        if late.any():
            for i in map(int, np.flatnonzero(late)):
                if self.expiry[i] == OFF:
                    self.fail(i, SILENCE_BIT)
                elif self.expiry[i] == SLACK:
                    self.slacken(i)

    def _warm(self, torque: Array) -> None:
        loss = (torque / self.peak_torque) ** 2
        self.temperature += self._dt / _WINDING[0] * (AMBIENT + _WINDING[1] * loss - self.temperature)
        self.stage += self._dt / _STAGE[0] * (AMBIENT + _STAGE[1] * loss - self.stage)
        hot = WINDING_BIT * (self.temperature > WINDING_LIMIT) + STAGE_BIT * (self.stage > STAGE_LIMIT)
        if hot.any():
            for i in map(int, np.flatnonzero(hot)):
                self.fail(i, int(hot[i]))


class IdealMotors(ActuatorMotors):
    """Drives that give the torque they are asked for, at any speed, for ever: a law seen without its motors."""

    def __init__(self, models: Sequence[ActuatorModel], voltage: Array | float, timestep: float) -> None:
        super().__init__(models, voltage, timestep)
        self.inertia, self.friction = np.zeros(self.n), np.zeros(self.n)
        self.peak_torque = np.full(self.n, _UNBOUNDED)
        self._no_load = np.full(self.n, np.inf)
        self.cap[:] = _UNBOUNDED

    def power_up(self, i: int) -> None:
        super().power_up(i)
        self.cap[i] = _UNBOUNDED

    def _warm(self, torque: Array) -> None:
        """They stay as cool as they are."""
