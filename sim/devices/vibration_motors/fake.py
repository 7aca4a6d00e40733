"""Vibration motors on a simulated wearer."""

from __future__ import annotations

from pydantic import Field

from srl.drivers.vibration_motors import VibrationMotors, VibrationMotorsConfig
from srl.drivers.vibration_motors.config import FULL
from srl.drivers.vibration_motors.driver import COMMAND
from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.contracts.signals import Stop
from srl.runtime.contracts.world import Fake, FakeConfig, World
from srl.sim.devices.shared.windows import Windows, lose_while_gone, refuse_while_gone
from srl.sim.devices.vibration_motors.felt import FeltMotor


class FakeVibrationMotorsConfig(FakeConfig):
    """Options of the fake."""

    felt_above: float = Field(
        default=0.1, gt=0, lt=1, description="of a motor's full vibration: the wearer feels what is above it (assumed)"
    )
    loss: Windows = Field(default=(), description="s, [from, to] pairs in world time during which the board is gone")


class FakeVibrationMotors(Fake):
    """The motors get whole duties at once; a board that is gone has no supply.

    Attributes:
        felt: the motors, and what the wearer feels of each, in the profile's order; a twin drives them, too.
    """

    Options = FakeVibrationMotorsConfig
    real = VibrationMotors
    config: VibrationMotorsConfig

    def __init__(
        self, name: str, config: VibrationMotorsConfig, world: World, options: FakeVibrationMotorsConfig
    ) -> None:
        super().__init__(name, config, world, options)
        self._options = options
        self.felt = [FeltMotor(motor.start, motor.full, options.felt_above) for motor in config.motors.values()]

    def off(self) -> None:
        """All motors lose their supply."""
        for motor in self.felt:
            motor.drive(0.0, self.world.time)

    def open(self) -> None:
        self.close()
        refuse_while_gone(self.name, self._options.loss, self.world.time)
        self.health.opened()
        self.health.message = "simulated StandardFirmata"

    def read(self, now: int) -> None:
        self._check()
        self.health.stamp = now
        self.health.frames += 1

    def write(self, now: int) -> None:
        self._check()
        values = self.command_arrays[COMMAND].tolist()
        for i, (value, motor) in enumerate(zip(values, self.config.motors.values(), strict=True)):
            self.felt[i].drive(motor.duty_of(value) / FULL, self.world.time)
            self.sent_arrays[COMMAND][i] = min(max(value, 0.0), 1.0)

    def stop(self, category: Stop) -> None:
        self.off()

    def close(self) -> None:
        """The motors go off."""
        self.off()
        self.health.connected = False

    def metrics(self) -> dict[str, object]:
        """How often the wearer has felt each motor, and the vibration now."""
        felt = dict(zip(self.config.motors, self.felt, strict=True))
        return {
            "felt": {name: motor.felt for name, motor in felt.items()},
            "vibration": {name: motor.vibration(self.world.time) for name, motor in felt.items()},
        }

    def _check(self) -> None:
        try:
            lose_while_gone(self, self._options.loss)
        except DeviceLostError:
            self.off()
            raise
