"""The guard between controllers and drivers: it limits every command, so that nothing unsafe leaves the loop."""

from __future__ import annotations

from srl.runtime.contracts.signals import Kind
from srl.runtime.guard.base import CommandGuard
from srl.runtime.guard.intensity import IntensityGuard
from srl.runtime.guard.limits import GuardLimits, merge
from srl.runtime.guard.position import PositionGuard
from srl.runtime.guard.torque import TorqueGuard
from srl.runtime.guard.velocity import VelocityGuard

__all__ = [
    "GUARDS",
    "CommandGuard",
    "GuardLimits",
    "IntensityGuard",
    "PositionGuard",
    "TorqueGuard",
    "VelocityGuard",
    "merge",
]

# The guard that fits a command's kind.
GUARDS: dict[Kind, type[CommandGuard]] = {
    Kind.POSITION: PositionGuard,
    Kind.VELOCITY: VelocityGuard,
    Kind.TORQUE: TorqueGuard,
    Kind.INTENSITY: IntensityGuard,
}
