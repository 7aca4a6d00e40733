"""Latches: what keeps a stop after its cause has gone, and who may end it.

A stop lasts until a reset whose origin may release every latch that stands. The state machine acts on the tables
below; the page on safety shows them (`table`).
"""

from __future__ import annotations

from collections.abc import Iterable

from srl.runtime.ipc.header import CLIENTS, Cause, Latch, Origin

NONE = Latch(0)
LASTING = Latch.PERSON | Latch.BUS | Latch.EMERGENCY | Latch.FAULT | Latch.RESTART  # those that outlive a run
ALL = LASTING | Latch.START
# Which latch the request for a stop sets, by its origin.
OF_STOP = {Origin.LOCAL: Latch.PERSON, Origin.INPUT: Latch.PERSON, Origin.SERVICE: NONE}
OF_STOP |= dict.fromkeys(CLIENTS, Latch.BUS)
# Which latches a start or a reset may release, by its origin. For the bus the profile decides.
RELEASES = {Origin.LOCAL: ALL, Origin.INPUT: ALL, Origin.SERVICE: NONE}
GRANTED = Latch.BUS  # what clients of the bus may release unless the profile says otherwise (`reset.bus`)
GRANTABLE = Latch.BUS | Latch.FAULT | Latch.START  # what the profile may grant them

_SET_BY = {
    Latch.PERSON: "`srl stop` on the machine, in any state",
    Latch.BUS: "the request `stop` of a client of the bus, in any state",
    Latch.EMERGENCY: "an `emergency` input, in any state",
    Latch.FAULT: "any other fault that stops the limb; also an actuator lost or at fault while the limb is stopped",
    Latch.START: "a run that waits for its first start: `start: manual`, or an actuator without feedback and no "
    "`--confirm`",
    Latch.RESTART: "an earlier run of the instance on real actuators was killed or ended with exit code 1",
}


def of_cause(cause: Cause) -> Latch:
    """The latch that a cause sets when it stops the limb; none for a request, whose origin decides."""
    if cause in (Cause.NONE, Cause.REQUEST, Cause.END):
        return NONE
    return Latch.EMERGENCY if cause is Cause.EMERGENCY else Latch.FAULT


def releasable(origin: Origin, granted: Latch) -> Latch:
    """The latches that a start or reset of this origin may release. `granted`: to clients of the bus."""
    return granted if origin in CLIENTS else RELEASES[origin]


def names(latches: int) -> list[str]:
    """The names of the latches in a set, as they are shown and stored: ["person", "fault"]."""
    return [str(latch.name).lower() for latch in ALL if latch & latches]


def of_names(given: Iterable[str]) -> Latch:
    """The set of the latches with these names. Raises KeyError for a name that is none."""
    latches = NONE
    for name in given:
        latches |= Latch[name.upper()]
    return latches


def table() -> str:
    """Who may end which stop, as a table in Markdown."""
    lines = ["| latch | set by | `srl reset` on the machine | a `reset` input | the bus | the service |"]
    lines.append("| --- " * 6 + "|")
    for latch in ALL:
        cells = [f"`{names(latch)[0]}`", _SET_BY[latch]]
        for origin in (Origin.LOCAL, Origin.INPUT, Origin.BUS, Origin.SERVICE):
            if origin is Origin.BUS and latch & GRANTABLE:
                given = latch & GRANTED
                cells.append("yes, unless the profile denies it" if given else "only where the profile grants it")
            else:
                cells.append("yes" if latch & releasable(origin, GRANTED) else "no")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(table())
