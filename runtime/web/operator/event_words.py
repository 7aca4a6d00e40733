"""Events for the person at the panel: when, what happened, and what to do about it."""

from __future__ import annotations

import re
import time
from typing import Any, Final

from srl.runtime.bus.status import CAUSES
from srl.runtime.ipc.events import Event, Level
from srl.runtime.ipc.header import Cause
from srl.runtime.web.operator.health import REMEDIES

_STATE: Final = re.compile(r"([a-z]+) \(([a-z_]+)(?: (.+))?\)")  # as the loop tells of a state and its cause
_REMEDIES: Final = (  # by what an event's text has; the first that fits
    (r"^refused: .*_latch", "See which latches are set; who may end them: docs/safety.md."),
    (r"^refused: ", "Read the state above, and ask again once it allows it."),
    (r"^lost ", "Look at its cable and power. It is opened again by itself; then reset."),
    (r"is held: ", "Make room: it goes on by itself."),
    (r"^controller .* failed", "If it comes again after a reset, end the run and report it."),
    (r"has lost what it follows", "See that it gives new data again, then reset."),
    (r"found contact", "See what the limb pushes on, and free it. Then reset."),
    (r"^driver .* failed", "Look at the device. If it comes again, end the run."),
    (r"isn't sent as applied", "The device takes commands late: look at its connection."),
    (r"connections are being filled", "Find out which program of that user connects."),
)


def described(number: int, event: Event) -> dict[str, Any]:
    """Its number, local time, words, level ("info", "warning", "error") and remedy; "" where there is none."""
    at = time.localtime((event.time + time.time_ns() - time.monotonic_ns()) / 1e9)
    words, remedy = _words(event.text)
    return {
        "number": number, "at": time.strftime("%H:%M:%S", at), "words": words, "remedy": remedy,
        "level": Level(event.level).name.lower(),
    }  # fmt: skip


def _words(text: str) -> tuple[str, str]:
    state = _STATE.fullmatch(text)
    cause = next((c for c in Cause if state is not None and c.name.lower() == state[2]), Cause.NONE)
    if state is not None and cause is not Cause.NONE:
        who = state[3] or ""
        words = f"{state[1]}: {CAUSES[cause]}" + (f": {who}" if who else "")
        remedy = REMEDIES.get(cause, "").format(who=who or "it") if state[1] in ("stopping", "stopped") else ""
    else:
        words = text
        remedy = next((remedy for pattern, remedy in _REMEDIES if re.search(pattern, text)), "")
    return words[:1].upper() + words[1:], remedy
