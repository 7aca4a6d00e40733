"""One trial: a whole run with its processes, and one of them, or the host, that fails at a random instant.

The limb is simulated, everything else is real: processes, signals, sockets, files. So its figures are this machine's,
and no second trial gives the same bits.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.errors import SrlError
from srl.runtime.ipc.header import CYCLE, Cause, State
from srl.runtime.recording import reader
from srl.studies.faults.device_trial import Bench
from srl.studies.faults.live_run import LiveRun
from srl.studies.faults.process_faults import DIES, ENDS, FAULTS, GOES_ON, REFUSED, ProcessFault, ended
from srl.studies.faults.steps import ROUNDING, largest
from srl.studies.tasks.task import Value

WARM: Final = (0.2, 1.0)  # s after the processes are there
AFTER: Final = 0.5  # s that it goes on after a fault that it survives
# A machine that is too slow for a profile's simulation stops its limb before the fault does.
PATIENT: Final = ("faults.overrun.tolerate=1000000", "faults.overrun.stop=1000000")


def trial(profile: str, parameters: Mapping[str, Any], seed: int) -> dict[str, Value]:
    """Runs one trial; parameters: `profile` (a name, whose text is `profile`), `choices`, `fault`."""
    fault = FAULTS[parameters["fault"]]
    rng = np.random.default_rng(seed)
    overrides = [*parameters["choices"], f"seed={seed}"]
    if fault.due in (DIES, ENDS):
        overrides += PATIENT
    with LiveRun(parameters["profile"], overrides, fault.small, fault.room) as run:
        if fault.due == REFUSED:
            return _refused(run, fault)
        run.started()
        # Without `record` in the profile there is a recorder all the same: the run is recorded.
        run.until(lambda: {"loop", "recorder"} <= run.children().keys(), "the processes")
        run.until(run.is_recorded, "the first recorded row")
        if "bus" in parameters["fault"] or fault.restarts == "bus":
            run.until(lambda: "bus" in run.children(), "the bus")
        begun = time.monotonic() + float(rng.uniform(*WARM))
        run.until(lambda: time.monotonic() > begun, "the fault's instant")
        return _break(run, fault, rng, parameters)


def _refused(run: LiveRun, fault: ProcessFault) -> dict[str, Value]:
    run.finish()
    wrong = _exit(run, fault)
    if not run.err.strip():
        wrong.append("it doesn't say why")
    error_lines = run.err.strip().splitlines()
    return {
        "entered": "refused", "cause": error_lines[-1][:200] if error_lines else "", "fault_source": "", "safe": None,
        "due": None,
        "step": 0.0, "where": "", "recorded": True, "cycles": 0, "wrong": "; ".join(wrong),
    }  # fmt: skip


def _break(run: LiveRun, fault: ProcessFault, rng: np.random.Generator, given: Mapping[str, Any]) -> dict[str, Value]:
    children, before = run.children(), run.header(CYCLE.state)
    at, begun = run.cycles, time.monotonic()
    fault.make(run, rng)
    safe: float | None = None
    if fault.due == ENDS:
        run.until(lambda: run.header(CYCLE.state) == State.ENDED, "the run's end")
        safe = time.monotonic() - begun
    elif fault.due != DIES:
        if run.process.poll() is None:
            _go_on(run)
        safe = run.stopped_in
    found = run.finish()
    run.until(ended(run, children), "the end of all processes")
    if fault.due == DIES and found is not None and "death" in found:
        safe = found["death"]["actuators_stopped_ms"] * 1e-3
    rows = run.rows
    wrong = _exit(run, fault) + _judge(run, fault, found, safe, before)
    wrong += _after(rows, at, fault)
    recorded, problem = _recorded(run, found, fault)
    with Bench(given["profile"], list(given["choices"]), 1) as bench:
        assert run.layout is not None
        share, where = largest(run.layout, rows, bench.graph, bench.guards)
    if not share <= 1.0 + ROUNDING:
        wrong.append(f"{share:.3g} of what the limits allow was sent: {where}")
    if not recorded:
        wrong.append(problem)
    last = rows[-1]
    return {
        "entered": State(int(last[CYCLE.state])).name.lower(), "cause": Cause(int(last[CYCLE.cause])).name.lower(),
        "fault_source": "", "safe": safe, "due": fault.safe, "step": share, "where": where, "recorded": recorded,
        "cycles": len(rows), "wrong": "; ".join(wrong),
    }  # fmt: skip


def _go_on(run: LiveRun) -> None:
    """Lets it go on, then ends it as a person does. A run that ends by itself is found later."""
    end = time.monotonic() + AFTER
    run.until(lambda: time.monotonic() > end or run.process.poll() is not None, "some more rows")
    if run.process.poll() is None:
        run.process.send_signal(signal.SIGTERM)


def _exit(run: LiveRun, fault: ProcessFault) -> list[str]:
    wrong = []
    if run.process.returncode not in fault.code:
        wrong.append(f"exit code {run.process.returncode}: {run.err.strip()[-200:]}")
    if "Traceback" in run.err:
        wrong.append(f"a traceback: {run.err.strip().splitlines()[-1][:200]}")
    return wrong


def _judge(run: LiveRun, fault: ProcessFault, found: dict[str, Any] | None, safe: float | None, was: int) -> list[str]:
    wrong = []
    if fault.due == DIES and (found is None or "death" not in found):
        wrong.append("the supervisor doesn't tell of the loop's death")
    if fault.safe is not None and (safe is None or safe > fault.safe):
        wrong.append(f"stopped {'never' if safe is None else f'after {safe:.3f} s'}, {fault.safe:g} s is due")
    if fault.restarts and (found is None or found["restarts"].get(fault.restarts) != 1):
        wrong.append(f"the {fault.restarts} wasn't started again once")
    return wrong


def _after(rows: Any, at: int, fault: ProcessFault) -> list[str]:
    """Of a run that must go on: no stop but the end that was asked for."""
    if fault.due != GOES_ON:
        return []
    causes = {Cause(int(cause)) for cause in np.unique(rows[:, CYCLE.cause])} - {Cause.NONE, Cause.REQUEST, Cause.END}
    return [f"it stopped: {', '.join(cause.name.lower() for cause in causes)}"] if causes else []


def _recorded(run: LiveRun, found: dict[str, Any] | None, fault: ProcessFault) -> tuple[bool, str]:
    """Whether every row that the loop wrote is in the recording; after a death also in the black box."""
    rows = run.rows
    files = [run.kept]
    if fault.due == DIES and found is not None and found.get("death", {}).get("black_box"):
        files.append(Path(found["death"]["black_box"]))
    elif fault.due == DIES:
        return False, "there is no black box"
    for file in files:
        try:
            made = reader.read(file)
        except (SrlError, OSError) as error:
            return False, f"{file.name} can't be read: {error}"
        if made.missing:
            return False, f"{file.name} lacks {made.missing[:3]}"
        first, last = (int(made.rows[i][CYCLE.cycle]) for i in (0, -1))
        if last != int(rows[-1, CYCLE.cycle]):
            return False, f"{file.name} ends at cycle {last}, the loop at {int(rows[-1, CYCLE.cycle])}"
        same = made.rows[-len(rows) :]
        if file == files[0] and (first != 0 or not np.array_equal(same, rows[-len(same) :])):
            return False, f"{file.name} isn't what the loop wrote"
    return True, ""
