"""Guards of one kind with the same limits for each of their joints."""

from __future__ import annotations

from typing import Any

from srl.runtime.contracts.signals import Array, Command, Kind
from srl.runtime.guard import GUARDS, CommandGuard, GuardLimits

PLACE = "guard.finger.command"


def guard_of(kind: Kind, joints: int = 1, dt: float = 0.01, rest: Array | None = None, **limits: Any) -> CommandGuard:
    """A guard with `applied` bound; velocity and torque guards need a `bind` of their measurements."""
    command = Command(name="command", shape=(joints,), unit="rad", kind=kind)
    return GUARDS[command.kind](PLACE, command, GuardLimits(**limits).to_limits((joints,), PLACE), dt, rest=rest)
