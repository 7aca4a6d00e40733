"""STS servos at their shafts: as MX servos, but an overload doesn't end their torque, it weakens it.

No source gives these assumptions, besides those of the MX: the gain P 32 means the same as an MX's default; overload
comes after the protection time (10 ms a unit) above the overload torque; it ends when the torque is switched off.
"""

from __future__ import annotations

from srl.drivers.feetech.table import TABLE
from srl.sim.parts.servo_bus.motors import HEAT_BIT, OVERLOAD_BIT, Motors

GAIN: float = 850 / 128 / 885 / 32  # share of full voltage per count, for each unit of P


class FeetechMotors(Motors):
    """All servos of a chain; see `Motors`."""

    def power_up(self, i: int) -> None:
        super().power_up(i)
        self.kp[i] = GAIN * TABLE["position_p_gain"].default
        self.shutdown[i], self.temperature_limit[i] = HEAT_BIT, TABLE["temperature_limit"].default

    def fail(self, i: int, bits: int) -> None:
        """Sets errors of motor `i`. Overheating ends its torque, an overload leaves the protective torque."""
        super().fail(i, bits)
        if bits & OVERLOAD_BIT:
            self.pwm_cap[i] = TABLE["protective_torque"].default / 100

    def switch(self, i: int, on: bool) -> None:
        """Switches the torque of motor `i`; switching it off ends an overload."""
        if not on and int(self.errors[i]) & OVERLOAD_BIT:
            self.errors[i] = int(self.errors[i]) & ~OVERLOAD_BIT
            self.overloaded[i], self.pwm_cap[i] = 0.0, 1.0
        if on and not self.torque[i]:  # unlike an MX, it doesn't forget its turns here
            self.trajectory[i], self.trajectory_velocity[i] = self.counts[i], 0.0
            self.integral[i] = self.last_error[i] = 0.0
        self.torque[i] = float(on)
