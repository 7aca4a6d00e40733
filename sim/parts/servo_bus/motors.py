"""Servos at their shafts: DC motors with gears, the firmware's control loops, heat and shutdown.

The values are the vendor's nominal ones. No source gives the following
assumptions. Rotors reach their speed with a time constant of 20 ms. Dry friction is 2 % of the stall torque. A case
reaches 80 degC after some 20 s at the stall current, and overload comes after 1.5 s above 80 % of it. Control loops
run once per physics step.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from srl.drivers.servo_bus.models import CENTRE, COUNTS, PER_COUNT, Nominal
from srl.runtime.contracts.signals import Array
from srl.sim.parts.servo_bus.drives import Drives, Row

CURRENT, VELOCITY, POSITION, EXTENDED, CURRENT_POSITION, PWM = 0, 1, 3, 4, 5, 16
SPIN_UP: Final = 0.02  # s
FRICTION: Final = 0.02  # share of the stall torque
COASTING: Final = 0.1  # share of the motor's drag that the gears alone have while the torque is off
AMBIENT: Final = 25.0  # degC
_HEAT_TIME, _HEAT_RISE = 100.0, 270.0  # s; K at the stall current, final value
_OVERLOAD, _OVERLOAD_TIME = 0.8, 1.5  # share of the stall current; s
VOLTAGE_BIT, HEAT_BIT, OVERLOAD_BIT = 1, 4, 32


class Motors(Drives):
    """All servos of a chain; see `Drives`. The rows are the firmware's values, which a fake or a twin sets."""

    torque: Row  # 0 or 1
    mode: Row
    goal_position: Row  # counts
    goal_velocity: Row  # rad/s
    goal_current: Row  # A
    goal_pwm: Row  # -1 to 1
    pwm_cap: Row  # 0 to 1
    current_cap: Row  # A
    kp: Row  # share of full voltage per count
    ki: Row  # per count and second
    kd: Row  # per count/s
    velocity_kp: Row  # per rad/s
    velocity_ki: Row  # per rad
    profile_velocity: Row  # rad/s, 0: none
    profile_acceleration: Row  # rad/s^2, 0: none
    watchdog: Row  # s left until it stops the motor, 0: off; used by a fake, a twin has its own count
    stopped: Row  # by the bus watchdog
    trajectory: Row  # counts
    trajectory_velocity: Row  # rad/s
    integral: Row
    last_error: Row  # counts
    pwm: Row  # -1 to 1
    current: Row  # A
    turns: Row  # whole turns the servo counts more than its shaft has made
    temperature: Row  # degC
    overloaded: Row  # s
    errors: Row  # hardware error bits
    shutdown: Row  # bits that switch the torque off
    temperature_limit: Row  # degC

    def __init__(self, models: Sequence[Nominal], voltage: Array | float, timestep: float) -> None:
        super().__init__(len(models), voltage, timestep)
        self.models = tuple(models)
        self.stall_torque = np.array([m.stall_torque for m in models])
        self.stall_current = np.array([m.stall_current for m in models])
        self.nominal_voltage = np.array([m.nominal_voltage for m in models])
        self.torque_constant = self.stall_torque / self.stall_current
        self.inertia = SPIN_UP * self.stall_torque / np.array([m.no_load_speed for m in models])
        self.friction = FRICTION * self.stall_torque
        self._drag = self.stall_torque / np.array([m.no_load_speed for m in models])
        for i in range(self.n):
            self.power_up(i)
            self.temperature[i] = AMBIENT

    def power_up(self, i: int) -> None:
        """Resets motor `i`: torque off, everything at its default, turns and errors cleared."""
        for row in (
            self.torque, self.goal_velocity, self.profile_velocity, self.profile_acceleration, self.watchdog,
            self.stopped, self.integral, self.last_error, self.pwm, self.trajectory_velocity, self.overloaded,
            self.errors,
        ):  # fmt: skip
            row[i] = 0.0
        self.mode[i] = POSITION
        self.goal_pwm[i] = self.pwm_cap[i] = 1.0
        self.goal_current[i] = self.current_cap[i] = self.stall_current[i]
        # Gains of protocol 2: P 850 / 128 of 885 per count, velocity P 100 / 128 and I 1920 / 65536 per 0.229 rpm.
        self.kp[i], self.ki[i], self.kd[i] = 850 / 128 / 885, 0.0, 0.0
        unit = 0.229 * 2 * np.pi / 60
        self.velocity_kp[i] = 100 / 128 / 885 / unit
        self.velocity_ki[i] = 1920 / 65536 / 885 / unit * 1000
        self.shutdown[i], self.temperature_limit[i] = 0x34, 80.0
        self.fold(i)

    @property
    def counts(self) -> Array:
        """(n,) present encoder readings, whole counts, turns included."""
        return np.rint(self.position / PER_COUNT) + CENTRE + COUNTS * self.turns

    @property
    def drag(self) -> Array:
        """See `Drives`; the motor's own voltage brakes it only while the bridge is closed."""
        return np.where(self.torque > 0, self._drag, COASTING * self._drag)

    def fold(self, i: int) -> None:
        """Clears the whole turns of motor `i`: it then counts 0 to 4095."""
        self.turns[i] = -((np.rint(self.position[i] / PER_COUNT) + CENTRE) // COUNTS)
        self.goal_position[i] = self.trajectory[i] = self.counts[i]

    def switch(self, i: int, on: bool) -> None:
        """Switches the torque of motor `i`; it starts at its present position."""
        if on and not self.torque[i]:
            if self.mode[i] == POSITION:
                self.fold_keeping_goal(i)
            self.trajectory[i], self.trajectory_velocity[i] = self.counts[i], 0.0
            self.integral[i] = self.last_error[i] = 0.0
        self.torque[i] = float(on)

    def fold_keeping_goal(self, i: int) -> None:
        """Like `fold`, but keeps the goal."""
        goal = self.goal_position[i]
        self.fold(i)
        self.goal_position[i] = goal

    def halt(self, i: int) -> None:
        """The bus watchdog: motor `i` stops and holds its position, within its current where that bounds it."""
        self.stopped[i] = 1.0
        self.goal_position[i] = self.trajectory[i] = self.counts[i]
        self.goal_velocity[i] = self.goal_pwm[i] = self.trajectory_velocity[i] = 0.0
        if self.mode[i] != CURRENT_POSITION:
            self.goal_current[i] = 0.0

    def step(self) -> Array:
        """Runs all control loops once; returns the motors' torques (n,), N m.

        `drag` times speed is still to be subtracted from them.
        """
        dt, mode, counts, speed = self._dt, self.mode, self.counts, self.velocity
        if self.watchdog.any():
            self._watch(dt)
        self._follow_profile(counts)
        positional = (mode == POSITION) | (mode == EXTENDED) | (mode == CURRENT_POSITION)
        error = np.where(positional, self.trajectory - counts, (self.goal_velocity - speed))
        ki = np.where(positional, self.ki, self.velocity_ki)
        self.integral += np.where(ki > 0, error * dt, 0.0)
        # The integral is limited to full voltage.
        most = np.divide(1.0, ki, out=np.zeros(self.n), where=ki > 0)
        np.clip(self.integral, -most, most, out=self.integral)
        pwm = np.where(positional, self.kp, self.velocity_kp) * error + ki * self.integral
        pwm += np.where(positional, self.kd, 0.0) * (error - self.last_error) / dt
        self.last_error[:] = error
        pwm = np.where(mode == PWM, self.goal_pwm, pwm)
        full = self.stall_torque * self.voltage / self.nominal_voltage
        drag = self._drag * speed
        pwm = np.where(mode == CURRENT, (self.goal_current * self.torque_constant + drag) / full, pwm)
        pwm = np.clip(pwm, -self.pwm_cap, self.pwm_cap) * (self.torque > 0)
        torque = pwm * full
        cap = np.where(mode == CURRENT_POSITION, np.abs(self.goal_current), self.current_cap) * self.torque_constant
        torque = np.clip(torque, drag - cap, drag + cap) * (self.torque > 0)
        self.pwm[:] = pwm
        self.current[:] = (torque - drag * (self.torque > 0)) / self.torque_constant
        self._wear(dt)
        return torque

    def _watch(self, dt: float) -> None:
        left = np.maximum(self.watchdog - dt, 0.0)
        for i in np.flatnonzero((self.watchdog > 0) & (left == 0)):
            self.halt(int(i))
        self.watchdog[:] = left

    def _follow_profile(self, counts: Array) -> None:
        """Moves the trajectory to the goal: a step, a rectangle or a trapezoid of velocity (sheet, §4)."""
        limited = self.profile_velocity > 0
        if not limited.any():
            self.trajectory[:] = self.goal_position
            return
        dt = self._dt
        way = (self.goal_position - self.trajectory) * PER_COUNT
        ramp = np.where(self.profile_acceleration > 0, self.profile_acceleration, np.inf)
        fastest = np.minimum(self.profile_velocity, np.sqrt(2 * np.where(np.isinf(ramp), 1e12, ramp) * np.abs(way)))
        wanted = np.sign(way) * np.minimum(fastest, np.abs(way) / dt)
        change = np.clip(wanted - self.trajectory_velocity, -ramp * dt, ramp * dt)
        self.trajectory_velocity += change
        moved = self.trajectory + self.trajectory_velocity * dt / PER_COUNT
        self.trajectory[:] = np.where(limited, moved, self.goal_position)

    def _wear(self, dt: float) -> None:
        """Updates heat and overload, and applies the shutdown that they cause."""
        share = np.abs(self.current) / self.stall_current
        self.temperature += dt / _HEAT_TIME * (AMBIENT + _HEAT_RISE * share * share - self.temperature)
        self.overloaded[:] = np.where(share > _OVERLOAD, self.overloaded + dt, 0.0)
        found = HEAT_BIT * (self.temperature > self.temperature_limit)
        found = found + OVERLOAD_BIT * (self.overloaded > _OVERLOAD_TIME)
        if found.any():
            for i in np.flatnonzero(found):
                self.fail(int(i), int(found[i]))

    def fail(self, i: int, bits: int) -> None:
        """Sets hardware errors of motor `i`; those in its shutdown mask switch its torque off."""
        self.errors[i] = int(self.errors[i]) | bits
        if int(self.errors[i]) & int(self.shutdown[i]):
            self.torque[i] = 0.0
