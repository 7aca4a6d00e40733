"""The guard: stands between controllers and drivers, so that nothing unsafe leaves the loop."""

from __future__ import annotations

from runtime.contracts.signals import Array, Command, Kind, Limits
from runtime.guard.base import CommandGuard
from runtime.guard.limits import GuardLimits, merge
from runtime.guard.position import PositionGuard
from runtime.guard.torque import TorqueGuard
from runtime.guard.velocity import VelocityGuard

__all__ = [
    "CommandGuard",
    "GuardLimits",
    "PositionGuard",
    "TorqueGuard",
    "VelocityGuard",
    "make_guard",
    "merge",
]

GUARDS: dict[Kind, type[CommandGuard]] = {
    Kind.POSITION: PositionGuard,
    Kind.VELOCITY: VelocityGuard,
    Kind.TORQUE: TorqueGuard,
}


def make_guard(
    place: str,
    command: Command,
    limits: Limits,
    dt: float,
    *,
    rest: Array | None = None,
    tolerance: float = 1e-3,
) -> CommandGuard:
    """The guard that fits the command's kind; arguments and errors as `CommandGuard`."""
    return GUARDS[command.kind](place, command, limits, dt, rest=rest, tolerance=tolerance)
