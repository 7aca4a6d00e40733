"""Start mode: automatic or manual."""

from __future__ import annotations

from typing import Literal

from srl.runtime.profile.graph import Graph


def start(graph: Graph) -> Literal["auto", "manual"]:
    """The profile's `start`; that of `sim:` where all devices are simulated."""
    profile = graph.profile
    if profile.sim is not None and profile.sim.start is not None and len(graph.simulated) == len(graph.devices):
        return profile.sim.start
    return profile.start


def unseen(graph: Graph) -> list[str]:
    """The commands of real devices that nothing measures: where their limbs stand, only a person sees."""
    real = {device.name for device in graph.devices} - set(graph.simulated)
    return [a.name for a in graph.actuators if a.command.unseen and graph.devices[a.device].name in real]
