"""What a profile says of a command's following error: its window and its time-out, if it is monitored at all."""

from __future__ import annotations

from srl.runtime.contracts.signals import Array, Kind
from srl.runtime.profile.graph import Actuator, Graph
from srl.runtime.profile.guard_entry import FollowingEntry, GuardEntry


def monitored(graph: Graph, actuator: Actuator) -> tuple[Array | None, float] | None:
    """The profile's window, (size,), or None for the usual one, and the time-out in s.

    None if nothing is monitored: there is no feedback, it is a torque, or the profile says `off`.
    """
    entry = graph.profile.guard.get(actuator.name, GuardEntry())
    wanted = entry.following_error
    if actuator.measured is None or actuator.command.kind is Kind.TORQUE or not isinstance(wanted, FollowingEntry):
        return None
    return entry.window(actuator.command, graph.source.place(f"guard.{actuator.name}")), wanted.timeout
