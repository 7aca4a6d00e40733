"""An admittance law alone, with a robot that is where it is wanted."""

from __future__ import annotations

from typing import Any

from helpers.control import bound
from srl.control.cobot.admittance import Admittance, AdmittanceConfig

DT = 0.001


def admittance(
    pose: Any = (0, 0, 0, 1, 0, 0, 0), sensor: Any = (0, 0, 0, 1, 0, 0, 0), modes: Any = (1, 1, 0, 0), **options: Any
) -> Admittance:
    """`sensor`: its pose in the control point's frame."""
    controller = bound(Admittance("admittance", AdmittanceConfig(**options)), sensor=sensor)
    controller.input["pose"][:] = pose
    controller.input["modes"][:] = modes
    controller.reset()
    return controller


def follow(controller: Admittance, dt: float = DT) -> None:
    """One cycle of a perfect robot: it is where it was wanted."""
    controller.update(dt)
    controller.input["pose"][:] = controller.output["pose"]
    controller.input["twist"][:] = controller.output["twist"]
