"""Whether a run begins to move by itself, or waits for a person's start."""

from __future__ import annotations

from srl.runtime.profile import start_mode
from srl.runtime.profile.graph import Graph


def automatic(graph: Graph, confirmed: bool) -> tuple[bool, str]:
    """Returns whether motion begins without a request, and the text for the user if it doesn't.

    `confirmed`: a person has said that devices without feedback stand where the profile says, with nothing in the way.
    """
    if start_mode.start(graph) == "manual":
        return False, "ready; `srl start` lets the limb move"
    unmeasured = start_mode.unseen(graph)
    if not unmeasured or confirmed:
        return True, ""
    names = ", ".join(unmeasured)
    return False, (
        f"{names} has no position feedback: put the limb near its home, clear of people and things, then `srl start` "
        "(or run with --confirm)"
    )
