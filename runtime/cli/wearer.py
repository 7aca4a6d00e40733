"""`--wearer FILE`: the simulated person repeats a recording."""

from __future__ import annotations

import json
from collections.abc import Sequence

from srl.runtime.contracts.errors import RequestError
from srl.runtime.profile import profile


def overrides(name: str, given: Sequence[str], wearer: str | None) -> list[str]:
    """Returns the overrides with which the profile's simulated hand is moved by the recording `wearer`.

    Args:
        name: the profile's.
        given: the user's own overrides.
        wearer: the recording; None: none.
    Raises:
        RequestError: there isn't exactly one hand.
    """
    if wearer is None:
        return list(given)
    sim = profile.load(name, given)[0].sim
    parts = sim.options.get("parts") if sim is not None else None
    entries = parts.items() if isinstance(parts, dict) else ()
    hands = [key for key, entry in entries if isinstance(entry, dict) and entry.get("part") == "human-hand"]
    if len(hands) != 1:
        found = f"{len(hands)} hands ({', '.join(hands)})" if hands else "no hand"
        remedy = "Say whose with --set sim.parts.HAND.wearer.recording=FILE"
        raise RequestError(
            "--wearer", f"the simulated world has {found}", remedy if hands else "Add a part human-hand under sim.parts"
        )
    return [*given, f"sim.parts.{hands[0]}.wearer.recording={json.dumps(wearer)}"]
