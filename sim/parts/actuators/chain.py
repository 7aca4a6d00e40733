"""A chain of axes with quasi-direct-drive actuators on CAN: an arm or a leg of one's own."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field, field_validator

from srl.runtime.contracts.errors import OptionError, nearest
from srl.runtime.contracts.signals import Array
from srl.sim.parts.actuators.models import MODELS, ActuatorModel
from srl.sim.parts.actuators.motors import ActuatorMotors, IdealMotors
from srl.sim.parts.servo_bus.chain import ServoAxis, ServoChain, ServoChainConfig
from srl.sim.world.part import PartConfig


class AxisConfig(ServoAxis):
    """An axis with an actuator; `reversed` and `zero` speak of its output shaft and the zero that it has stored."""

    model: str = Field(description="the maker's name, e.g. AK80-9, DM4310")
    radius: float = Field(0.025, gt=0, description="m, of the link")
    mass: float = Field(0.3, gt=0, description="kg, of the link without the next actuator")

    @field_validator("model")
    @classmethod
    def _known(cls, value: str) -> str:
        if value not in MODELS:
            raise OptionError(f"no actuator '{value}' is simulated", nearest(value, MODELS))
        return value


class ActuatorChainConfig(ServoChainConfig):
    """Options of the chain."""

    axes: dict[str, AxisConfig] = Field(min_length=1, description="from the base to the tip")
    voltage: float = Field(48.0, gt=0, description="V, of the supply")
    ideal: bool = Field(
        False,
        description="drives that give the torque they are asked for: no friction, no rotors' inertia, no limit of "
        "torque or speed, no heat",
    )


class ActuatorChain(ServoChain[ActuatorMotors]):
    """A chain of quasi-direct-drive actuators; see `ServoChain`. It hangs limp until a drive is enabled.

    With `ideal`, what is left of an error is the law's and the bus', not the motors'. The description of a limb from
    its URDF stays as it is, so this is that limb with torques as they are asked for.
    """

    Config: ClassVar[type[PartConfig]] = ActuatorChainConfig
    catalogue = MODELS
    summary = "chain of axes with actuators on CAN: CubeMars AK, Damiao, ODrive"

    def servos(self, voltage: Array, timestep: float) -> ActuatorMotors:
        assert all(isinstance(model, ActuatorModel) for model in self.models)
        models = [model for model in self.models if isinstance(model, ActuatorModel)]
        assert isinstance(self._config, ActuatorChainConfig)
        return (IdealMotors if self._config.ideal else ActuatorMotors)(models, voltage, timestep)
