"""What a client of the bus is told when the loop, or the role of its certificate, refuses a request."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from srl.runtime.bus.status import CAUSES
from srl.runtime.contracts.errors import RequestError
from srl.runtime.ipc import latches
from srl.runtime.ipc.header import CYCLE, Cause, Origin, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.requests import Answer, RequestKind
from srl.runtime.profile.keys import Keys

OVERTAKEN = "a stop came after it", "Ask again"


def refused(
    answer: Answer, kind: RequestKind, place: str, origin: Origin, row: NDArray[np.int64], layout: Layout, keys: Keys
) -> RequestError:
    """The loop's answer in words. `row` (width,): that of the cycle that refused it; `place`: the key."""
    if answer is Answer.REFUSED_ROLE:
        return beyond(place, origin)
    state = State(int(row[CYCLE.state])).name.lower()
    cause = Cause(int(row[CYCLE.cause]))
    who = layout.fault_source(cause, int(row[CYCLE.fault_source]))
    why = CAUSES[cause] + (f" ({who})" if who else "")
    latched = ", ".join(latches.names(int(row[CYCLE.latches])))
    problem, remedy = {
        Answer.REFUSED_STATE: (
            f"not possible while {state}",
            {
                RequestKind.START: "Start is for the state ready; a stopped limb is reset",
                RequestKind.RESET: "Reset is for the state stopped",
            }.get(kind, "Look at the status"),
        ),
        Answer.REFUSED_FAULT: (
            f"what caused the stop is still there: {why}",
            "Mend that (a device that refuses to move was told to recover), then ask again",
        ),
        Answer.REFUSED_LATCH: (
            f"clients of the bus may not release what stands ({latched})",
            f"Run `srl {'start' if state == 'ready' else 'reset'} {keys.instance}` on its machine, or let "
            "the profile grant it (`reset: {bus: [...]}`)",
        ),
        Answer.REFUSED_RATE: ("too many requests, more than 5 a second from the bus", "Ask less often"),
        Answer.OVERTAKEN: OVERTAKEN,
        Answer.REFUSED_UNMEASURED: (
            "nothing measures where the limb is now, and it would go home by itself",
            "End the run, put the limb near its home, and begin again",
        ),
        Answer.REFUSED_KEPT: (
            "the profile says that nothing may release in this run what stands",
            "End the run; `reset.keeps` of the profile names the latches",
        ),
        Answer.REFUSED_VALUE: (
            "the loop found the value not finite or out of bounds",
            "Ask without payload for the bounds",
        ),
        Answer.EXPIRED: (
            "the loop came to it too late",
            "Ask again; if it stays so, look at the overruns",
        ),
    }.get(answer, (f"the loop refused it ({answer.name.lower()})", "Look at the status"))
    return RequestError(place, problem, remedy)


def beyond(place: str, origin: Origin) -> RequestError:
    """The refusal of what a role may not ask for."""
    what = "may only read" if origin is Origin.OBSERVER else "may set no parameter"
    remedy = "Connect with a certificate of another role, or change `bus.roles`"
    return RequestError(place, f"this certificate's role is {origin.name.lower()}, who {what}", remedy)
