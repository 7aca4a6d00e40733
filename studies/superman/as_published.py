"""MOCA and Kairos as published: the profiles' laws with every addition of the runtime switched off.

docs/super-man.md says what each of these options buys and costs. Device guards stay: they belong to the robots.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

OFF: Final[Mapping[str, Mapping[str, Any]]] = {
    "admittance": {"leash": None, "tank": None, "release": None},
    "moca-impedance": {"unit_mass": True, "rotors": "none", "blend": 0.0, "base_acceleration": None},
    "kairos-clik": {
        "blend": 0.0,
        "speed": None,
        "acceleration": None,
        "base_speed": None,
        "base_acceleration": None,
        "force_feedback": None,
    },
}
"""By controller: the options that are additions, with the value at which they do nothing."""
WATCH: Final = "payload"
"""The law that identifies what is held and watches for contact: an addition as a whole."""
_INPUTS: Final = ("flange_wrench", "hand", "outside")  # of force feedback, which is off


def as_published(entries: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Returns a profile's controllers with the additions of the published laws off; others stay as they are."""
    found = []
    for entry in entries:
        if entry["use"] == WATCH:
            continue
        changed = {**entry, **OFF.get(entry["use"], {})}
        if changed["use"] == "kairos-clik":
            changed["in"] = {name: source for name, source in entry["in"].items() if name not in _INPUTS}
        found.append(changed)
    return found
