"""The loop's answer to a request of `control_socket`: in words, and as its rows tell it where no datagram arrives."""

from __future__ import annotations

from srl.runtime.contracts.errors import SrlError
from srl.runtime.ipc import latches
from srl.runtime.ipc.header import CYCLE, Cause, Origin, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.requests import Answer, RequestKind
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder

_NEWEST = 4096  # rows that are looked through
_WORDS = {
    Answer.REFUSED_FAULT: "what caused the stop is still there; a device that refuses to move was told to recover",
    Answer.REFUSED_VALUE: "the value isn't finite, in bounds and of the right size",
    Answer.REFUSED_LATCH: "it may not end this stop",
    Answer.REFUSED_RATE: "too many requests, more than 5 a second",
    Answer.EXPIRED: "the request came too late, or doesn't say until when it is valid",
    Answer.OVERTAKEN: "a stop came after it",
    Answer.REFUSED_UNMEASURED: "nothing measures where the limb is now. End the run, put it near its home, begin again",
    Answer.REFUSED_KEPT: "what stands can't be released in this run, as an emergency input isn't read; use `srl run`",
}
_INSTEAD = {State.STOPPED: "; `srl reset` lets it move again", State.READY: "; `srl start` lets it move"}


def content(answer: Answer, state: State, cause: Cause, fault_source: str, latched: int) -> dict[str, object]:
    """The answer as one JSON object. `latched`: the latches that stand."""
    found: dict[str, object] = {"ok": answer is Answer.DONE, "state": state.name.lower(), "cause": cause.name.lower()}
    found |= {"fault_source": fault_source, "latches": latches.names(latched)}
    if answer is not Answer.DONE:
        found["error"] = _WORDS.get(answer, "refused")
    if answer is Answer.REFUSED_STATE:
        found["error"] = f"not possible while {state.name.lower()}{_INSTEAD.get(state, '')}"
    return found


def in_rows(run_folder: RunFolder, kind: RequestKind, since: int) -> dict[str, object] | None:
    """The answer to a request of this kind from this machine, as the loop's rows hold it.

    Args:
        run_folder: the instance's folder.
        kind: what was asked for.
        since: CLOCK_MONOTONIC ns: when it was sent. Of several requests since then, one that was granted counts.
    Returns:
        The answer; None if no row has one, or this user can't read the rows.
    """
    try:
        layout = Layout.load(run_folder.layout)
        with RingReader(run_folder.rows, width=layout.width) as ring:
            ring.sequence = max(ring.head - _NEWEST, 0)
            rows = ring.take(_NEWEST)
    except (SrlError, OSError):
        return None
    asked = (rows[:, CYCLE.request_kind] == kind) & (rows[:, CYCLE.request_origin] == Origin.LOCAL)
    rows = rows[asked & (rows[:, CYCLE.write] >= since)]
    if not rows.shape[0]:
        return None
    granted = rows[rows[:, CYCLE.request_result] == Answer.DONE]
    row = (granted if granted.shape[0] else rows)[-1]
    cause = Cause(int(row[CYCLE.cause]))
    who = layout.fault_source(cause, int(row[CYCLE.fault_source]))
    result, state = Answer(int(row[CYCLE.request_result])), State(int(row[CYCLE.state]))
    return content(result, state, cause, who, int(row[CYCLE.latches]))
