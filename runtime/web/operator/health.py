"""How the run and its devices are, in words for the person beside the limb: what is, why, and what to do.

All of it comes from one row. Nothing here decides: what may be done the loop says when it is asked.
"""

from __future__ import annotations

from typing import Any, Final

from srl.runtime.bus.status import CAUSES
from srl.runtime.ipc import latches
from srl.runtime.ipc.header import (
    CYCLE,
    DEVICE,
    LINK_ACTIVE,
    LINK_CONNECTED,
    LINK_ERROR,
    LINK_FAULT,
    LINK_STALE,
    Cause,
    State,
)
from srl.runtime.ipc.layout import Layout, Words

STATES: Final = {
    State.STARTING: "The run begins: the devices are opened.",
    State.READY: "The run waits for its start. Nothing moves.",
    State.HOMING: "The limb goes slowly to its home.",
    State.ACTIVE: "The limb follows. It can move at any moment.",
    State.STOPPING: "The limb is being stopped.",
    State.STOPPED: "The limb is stopped. It moves again after a reset only.",
    State.ENDED: "The run is over.",
}
REMEDIES: Final = {
    Cause.REQUEST: "See that nobody is in the limb's way, then reset.",
    Cause.INTENT_LOSS: "See that {who} gives new data again, then reset.",
    Cause.DEVICE_LOSS: "Look at the cable and the power of {who}. Once it is well again, reset.",
    Cause.OVERRUN: "End other work on this computer; `srl doctor` says whether it is fit. Then reset.",
    Cause.DRIVER_ERROR: "Read the events. If {who} is well again, reset; if it comes again, end the run.",
    Cause.CONTROLLER_ERROR: "Read the events. If it comes again after a reset, end the run and report it.",
    Cause.EMERGENCY: "Find out why it was pressed or let go. Release it, then reset.",
    Cause.BUS_LOSS: "The bus is started again by itself. Once clients are back, reset.",
    Cause.SUPERVISOR_LOSS: "End the run and begin it anew.",
    Cause.RESTART: "Find out why the run before ended as it did, and look at the limb. Then reset.",
    Cause.DEVICE_FAULT: "Look at {who} itself: its lamp, its pendant. Mend that. The first reset asks it to recover "
    "and is refused; the second starts the limb.",
    Cause.CONTACT: "See what the limb pushes on, and free it. Then reset.",
    Cause.FOLLOWING_ERROR: "See what holds the limb, or whether its load is too heavy. Then reset.",
    Cause.END: "Begin a new run.",
}
LATCHED: Final = {
    "person": "a person stopped it",
    "bus": "a client of the bus stopped it",
    "emergency": "an emergency input stopped it",
    "fault": "a fault stopped it",
    "restart": "the run before ended badly",
    "start": "it waits for a person's first start",
}
MEASURES: Final = {  # of a run that commands nothing, such as a calibration's
    State.ACTIVE: "The run measures. It commands nothing.",
    State.STOPPING: "The run is being stopped.",
    State.STOPPED: "The run is stopped. Nothing counts until a reset.",
}
_READY: Final = "Put a limb that measures nothing at its home. See that nobody is in the way, then start."


def state(layout: Layout, row: Words) -> dict[str, str]:
    """The state of the machine: its name, what it means, why, what still stands (latches), and what to do."""
    now, cause = _state(int(row[CYCLE.state])), _cause(int(row[CYCLE.cause]))
    who = _who(layout, cause, int(row[CYCLE.fault_source]))
    still = cause not in (Cause.NONE, Cause.END)
    stopped = now in (State.STOPPING, State.STOPPED) or still
    why = CAUSES[cause] + (f": {who}" if who else "") if stopped else ""
    todo = ""
    if now is State.READY:
        todo = _READY
    elif stopped and cause is not Cause.NONE:
        todo = REMEDIES[cause].format(who=who or "it")
    latched = [LATCHED[name] for name in latches.names(int(row[CYCLE.latches]))]
    means = STATES if layout.meta.get("commands") != {} else STATES | MEASURES
    return {
        "now": now.name.lower(), "means": means[now], "why": why[:1].upper() + why[1:],
        "stands": "; ".join(latched), "todo": todo,
    }  # fmt: skip


def devices(layout: Layout, row: Words) -> list[dict[str, Any]]:
    """Each device's name, level ("well", "waits", "bad"), words, remedy ("" for none) and age of its sample, ms."""
    now = int(row[CYCLE.now])
    found = []
    for index, name in enumerate(layout.devices):
        words = row[layout.device(index)]
        stamp = int(words[DEVICE.stamp])
        age = (now - stamp) / 1e6 if stamp >= 0 else None
        level, text, remedy = _device(int(words[DEVICE.link]), age, name in layout.setpoint_owners)
        found.append({"name": name, "level": level, "words": text, "remedy": remedy, "age": age})
    return found


def _device(link: int, age: float | None, client: bool) -> tuple[str, str, str]:
    """Level, words and remedy. `client`: it is no device, but those who send setpoints."""
    if link & LINK_ERROR:
        return "bad", "its driver failed", "Read the events. If it comes again, end the run"
    if link & LINK_FAULT:
        return "bad", "refuses to move", "Look at it: lamp, pendant. Mend that, then reset twice"
    if not link & LINK_CONNECTED:
        return "bad", "lost", "Look at cable and power. It is opened again by itself; then reset"
    if client:
        if age is None:
            return "waits", "nobody has sent yet", "Begin the program that sends"
        if link & LINK_STALE:
            return "bad", "is silent", "Begin the program that sends again, then reset"
        return "well", "sends", ""
    if link & LINK_STALE or age is None:
        silent = "silent" if age is None else f"silent for {age / 1e3:.1f} s"
        return "bad", silent, "It is connected. See that it is switched on and measures; then reset"
    return "well", "well, takes commands" if link & LINK_ACTIVE else "well", ""


def _who(layout: Layout, cause: Cause, index: int) -> str:
    try:
        return layout.fault_source(cause, index)
    except (IndexError, KeyError):  # a layout of an earlier version doesn't name it
        return ""


def _state(number: int) -> State:
    return next((s for s in State if s == number), State.STOPPED)


def _cause(number: int) -> Cause:
    return next((c for c in Cause if c == number), Cause.NONE)
