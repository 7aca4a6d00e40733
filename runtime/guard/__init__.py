"""The guard between controllers and drivers: it limits every command, so that nothing unsafe leaves the loop."""

from __future__ import annotations

from runtime.contracts.signals import Kind
from runtime.guard.base import CommandGuard
from runtime.guard.limits import GuardLimits, merge
from runtime.guard.position import PositionGuard
from runtime.guard.torque import TorqueGuard
from runtime.guard.velocity import VelocityGuard

__all__ = [
    "GUARDS",
    "CommandGuard",
    "GuardLimits",
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
}
