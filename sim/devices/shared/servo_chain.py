"""What the fakes of servo buses share: which axis of the simulated chain each motor of the bus turns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from srl.drivers.servo_bus.config import AxisConfig
from srl.runtime.contracts.errors import WiringError, nearest
from srl.sim.parts.servo_bus.chain import ServoChain


def numbers(chain: ServoChain[Any], motors: Mapping[str, AxisConfig], name: str) -> tuple[int, ...]:
    """For each motor of the bus, the number of the chain's axis with its name; both must have the same construction."""
    found = []
    for axis, motor in motors.items():
        if axis not in chain.names:
            raise WiringError(
                f"sim.devices.{name}", f"the chain '{chain.name}' has no axis '{axis}'", nearest(axis, chain.names)
            )
        i = chain.names.index(axis)
        if chain.models[i].name != motor.model:
            raise WiringError(
                f"sim.parts.{chain.name}.axes.{axis}.model",
                f"it is an {chain.models[i].name}, devices.{name} says {motor.model}",
                "Make them agree",
            )
        if not np.isclose(abs(chain.scale[i]), abs(motor.scale)):
            raise WiringError(
                f"sim.parts.{chain.name}.axes.{axis}.m_per_rad",
                f"it moves {abs(chain.scale[i]):g} a radian, devices.{name} says {abs(motor.scale):g}",
                "Make them agree",
            )
        found.append(i)
    return tuple(found)
