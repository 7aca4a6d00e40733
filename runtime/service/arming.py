"""Whether a run begins to move by itself, or waits for a person's start."""

from __future__ import annotations

from runtime.profile.graph import Graph


def automatic(graph: Graph, confirmed: bool) -> tuple[bool, str]:
    """Returns whether motion begins without a request, and the text for the user if it doesn't.

    `confirmed`: a person has said that devices without feedback stand where the profile says, with nothing in the way.
    """
    start, sim = graph.profile.start, graph.profile.sim
    real = [d.name for d in graph.devices if d.name not in graph.simulated]
    if sim is not None and sim.start is not None and not real:
        start = sim.start
    if start == "manual":
        return False, "ready; `srl start` lets the limb move"
    blind = [
        a for a in graph.actuators if a.command.feedback is None and graph.devices[a.device].name not in graph.simulated
    ]
    if not blind or confirmed:
        return True, ""
    names = ", ".join(a.name for a in blind)
    return False, (
        f"{names} has no position feedback: put the limb near its home, clear of people and things, then `srl start` "
        "(or run with --confirm)"
    )
