"""Replays recorded inputs through the same profile and compares the commands with the recorded ones, bit for bit.

The inputs are what came from outside the cycle: device states with their stamps and links, setpoints,
parameters, what the cycle before sent (`.sent`), `now`, `dt`, overruns, the latches at the start and the requests with
their origin. The comparison covers what the cycle computed from them: every controller output, every command, every
applied command, the state with its latches, and each request's answer. What was refused without a cycle of its own is
only counted, and so an input.
"""

from __future__ import annotations

import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from srl.runtime import __version__
from srl.runtime.contracts import provenance
from srl.runtime.contracts.code_file import CodeError
from srl.runtime.contracts.compiled import PYTHON, Backend, available
from srl.runtime.contracts.errors import MissingError, ProfileError, RecordingError, WiringError
from srl.runtime.contracts.files import Files, KeptFile, decoded
from srl.runtime.contracts.signals import Limits
from srl.runtime.contracts.validation import refusal
from srl.runtime.ipc import latches
from srl.runtime.ipc.header import CYCLE, DEVICE, LINK_ACTIVE, LINK_STALE, Origin
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.requests import STATE_REQUESTS, Answer, Request, RequestKind
from srl.runtime.loop.cycle import Cycle
from srl.runtime.profile import code_files, profile, wiring
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.source import Source

_INPUT = ("state", "setpoint", "parameter", "truth")
_SENT = "sent"  # the row has it after the cycle's writes, so it is an input of the next cycle
_OUTPUT = ("command", "applied", "internal")
_DECIDED = [CYCLE.state, CYCLE.cause, CYCLE.fault_source, CYCLE.category, CYCLE.flags, CYCLE.latches, CYCLE.refused]
_DECIDED += [CYCLE.request, CYCLE.request_kind, CYCLE.request_target, CYCLE.request_result, CYCLE.request_origin]
_COPIED = [CYCLE.cycle, CYCLE.now, CYCLE.dt, CYCLE.overruns]
# Answers that the state machine gives; the others are given before a request reaches it, and so are inputs.
_MACHINES = (Answer.DONE, Answer.REFUSED_STATE, Answer.REFUSED_FAULT, Answer.REFUSED_LATCH)


_INSTALL = "Install the package that brings it, as on the machine that recorded this"
_DAMAGED = "Use another recording"


@dataclass
class _Meta:
    """What a replay takes from a layout's `meta`."""

    label: str
    profile: str
    overrides: list[str]
    simulated: list[str]
    limits: dict[str, dict[str, Any]]
    automatic: bool
    versions: dict[str, Any]
    latches: list[str] = field(default_factory=list)  # an earlier version had none: its rows are refused
    files: dict[str, dict[str, str]] = field(default_factory=dict)  # an earlier version had none


@dataclass
class Comparison:
    """The result of a replay.

    Attributes:
        cycles: number of rows replayed.
        largest: the largest absolute difference of any command, in its unit.
        where: (signal, cycle) of this difference.
        signals: largest difference by signal.
        states_differ: number of rows whose state, cause, fault source, category, flags, latches or request differ.
        identical: True if every compared bit is the same.
        warnings: reasons why bits may differ: other versions, another BLAS kernel.
    """

    cycles: int = 0
    largest: float = 0.0
    where: tuple[str, int] | None = None
    signals: dict[str, float] = field(default_factory=dict)
    states_differ: int = 0
    identical: bool = True
    warnings: list[str] = field(default_factory=list)

    def metrics(self) -> dict[str, Any]:
        """Returns the figures for `--json`."""
        return {
            "cycles": self.cycles,
            "largest_difference": self.largest,
            "where": self.where,
            "signals": self.signals,
            "states_differ": self.states_differ,
            "identical": self.identical,
            "warnings": self.warnings,
        }


def replay(layout: Layout, rows: NDArray[np.int64], place: str, run_code: bool = False) -> Comparison:
    """Replays rows.

    Args:
        layout: the rows' layout.
        rows: (k, width) int64, contiguous cycles from the first on.
        place: the recording's name, for errors.
        run_code: whether code that the recording holds may be run.
    """
    if not len(rows):
        raise RecordingError(place, "the recording has no rows", "Record a run first")
    if int(layout.header(rows[0], "cycle")) != 0:
        raise RecordingError(
            place, f"the recording begins at cycle {int(layout.header(rows[0], 'cycle'))}, not at the start of the run",
            "A replay needs the whole run: give the recording rather than a black box",
        )  # fmt: skip
    layout.needs(place, "label", "profile", "overrides", "simulated", "limits", "automatic", "versions", "blas")
    try:
        TypeAdapter(_Meta).validate_python(layout.meta)
    except ValidationError as error:
        first = refusal(error, layout.meta)
        raise RecordingError(place, f"the layout is damaged: {first.path}: {first.problem}", _DAMAGED) from None
    graph, cycle = _rebuild(layout, place, run_code)
    comparison = Comparison(warnings=_other_versions(layout))
    made = graph.row
    inputs = [(made.views[f.name], layout.value(rows, f.name)) for f in layout.fields.values() if f.role in _INPUT]
    sent = [(made.views[f.name], layout.value(rows, f.name)) for f in layout.fields.values() if f.role == _SENT]
    outputs = [
        (f.name, made.views[f.name], layout.value(rows, f.name)) for f in layout.fields.values() if f.role in _OUTPUT
    ]
    differences = {name: 0.0 for name, _, _ in outputs}
    overruns = 0
    for k, row in enumerate(rows):
        ints = made.ints
        ints[_COPIED] = row[_COPIED]
        _copy_devices(made.devices, row, rows[k - 1] if k else None, layout)
        for view, values in inputs:
            view[...] = values[k]
        for view, values in sent:
            view[...] = values[k - 1] if k else np.nan
        missed = int(ints[CYCLE.overruns]) - overruns
        overruns += missed
        _decide(cycle, row, missed)
        for name, view, values in outputs:
            if view.tobytes() != values[k].tobytes():
                comparison.identical = False
                gap = np.abs(view - values[k])
                largest = float(np.max(np.where(np.isnan(gap), np.inf, gap), initial=0.0))
                if largest > differences[name]:
                    differences[name] = largest
                    if largest > comparison.largest:
                        comparison.largest, comparison.where = largest, (name, int(row[CYCLE.cycle]))
        if (ints[_DECIDED] != row[_DECIDED]).any():
            comparison.identical = False
            comparison.states_differ += 1
    comparison.cycles, comparison.signals = len(rows), differences
    return comparison


def _decide(cycle: Cycle, row: NDArray[np.int64], missed: int) -> None:
    origin, answer = Origin(int(row[CYCLE.request_origin])), Answer(int(row[CYCLE.request_result]))
    request = None
    # The cycle sees presses of reset inputs by itself.
    if origin not in (Origin.NONE, Origin.INPUT):
        kind, target = RequestKind(int(row[CYCLE.request_kind])), int(row[CYCLE.request_target])
        request = Request(int(row[CYCLE.request]), kind, target, 0, np.empty(0), origin)
        if kind in STATE_REQUESTS and answer in _MACHINES:
            answer = Answer.NONE
    ints = cycle.graph.row.ints
    ints[CYCLE.refused] = row[CYCLE.refused] - (origin is not Origin.NONE and row[CYCLE.request_result] != Answer.DONE)
    cycle.check(missed, request, Answer.NONE if request is None else answer)
    cycle.control()
    cycle.guard()


def _copy_devices(
    made: NDArray[np.int64], row: NDArray[np.int64], before: NDArray[np.int64] | None, layout: Layout
) -> None:
    """Copies stamps and links as the drivers gave them. The cycle itself determines staleness and activity.

    The count of commands is that of the cycle `before`: this cycle's were sent after its decisions.
    """
    own = LINK_ACTIVE | LINK_STALE
    for i, words in enumerate(made):
        link = words.item(DEVICE.link)
        words[:] = row[layout.device(i)]
        words[DEVICE.commands] = 0 if before is None else before[layout.device(i)][DEVICE.commands]
        words[DEVICE.link] = (words.item(DEVICE.link) & ~own) | (link & own)


def rebuilt(layout: Layout, place: str, simulated: list[str], run_code: bool = False) -> Graph:
    """The wired system of a recording's profile, with its calibrations as they were; nothing is opened.

    Args:
        layout: the recording's.
        place: its name, for errors.
        simulated: names of the devices that the world simulates; none: there is no world.
        run_code: whether code that the recording holds may be run.

    Raises:
        RecordingError: this version doesn't take the recorded profile, or its code isn't run.
    """
    try:
        checked, source = _profile(layout, place, run_code)
        if not run_code and (code := code_files.names(checked)):
            problem = f"its profile runs code that the recording holds: {', '.join(code.values())}"
            remedy = f"Read it: srl replay {shlex.quote(place)} --show-code. If you trust it, add --run-code"
            raise RecordingError(place, problem, remedy)
        return wiring.build(checked, source, simulated or None)
    except CodeError as error:
        problem = f"the recorded code can't be run: {error.place}: {error.problem}"
        raise RecordingError(place, problem, error.remedy) from None
    except (ProfileError, WiringError) as error:
        problem = f"this version of srl doesn't take the recorded profile: {error.place}: {error.problem}"
        # What isn't installed has its own remedy; another version of srl wouldn't have it either.
        remedy = _INSTALL if isinstance(error, MissingError) else _remedy(layout)
        raise RecordingError(place, problem, remedy) from None


def recorded_code(layout: Layout, place: str) -> dict[str, KeptFile]:
    """By key path of its profile: the files with code that a recording holds. Runs none. Raises RecordingError."""
    layout.needs(place, "label", "profile", "overrides", "versions")
    try:
        return code_files.files(*_profile(layout, place, False))
    except ProfileError as error:
        raise RecordingError(place, f"{error.place}: {error.problem}", _remedy(layout)) from None


def _profile(layout: Layout, place: str, run_code: bool) -> tuple[profile.Profile, Source]:
    meta = layout.meta
    files = Files(Path(meta["label"]).parent, decoded(meta.get("files", {}), place), run_code=run_code)
    return profile.parse(meta["label"], meta["profile"], meta["overrides"], files)


def _remedy(layout: Layout) -> str:
    then, now = layout.meta["versions"].get("srl-runtime", "?"), __version__
    return f"Use srl-runtime {then}" + " as it was at that time: this is a later state of it" * (then == now)


def _rebuild(layout: Layout, place: str, run_code: bool) -> tuple[Graph, Cycle]:
    meta, remedy = layout.meta, _remedy(layout)
    if layout.recorded_names != layout.int_names:
        raise RecordingError(place, "its rows have other words than this version's", remedy)
    graph = rebuilt(layout, place, meta["simulated"], run_code)
    have = {n: (f.shape, f.unit, f.role) for n, f in graph.layout.fields.items() if f.role != "truth"}
    want = {n: (f.shape, f.unit, f.role) for n, f in layout.fields.items() if f.role != "truth"}
    if have != want:
        odd = sorted(set(have.items()) ^ set(want.items()))[0][0]
        raise RecordingError(
            place, f"this version of srl builds other signals from the recorded profile (first: {odd})", remedy
        )
    for then in layout.fields.values():
        now = graph.layout.fields[then.name].labels if then.name in graph.layout.fields else ()
        if then.labels and now and then.labels != now:
            problem = f"'{then.name}' was recorded as {', '.join(then.labels)}, this version has {', '.join(now)}"
            raise RecordingError(place, problem, remedy)
    try:
        limits = {name: Limits(**{k: np.array(v) for k, v in value.items()}) for name, value in meta["limits"].items()}
        # Bits are the same within one backend. An earlier version had Python alone.
        backend: Backend = "auto" if _computed(layout).startswith("c") else "python"
        latched = latches.of_names(meta["latches"])
        return graph, Cycle(graph, limits, meta["automatic"], latched, backend=backend)
    except (KeyError, TypeError, ValueError) as error:
        problem = f"the layout's limits or latches are damaged: {type(error).__name__}: {error}"
        raise RecordingError(place, problem, _DAMAGED) from None


def _other_versions(layout: Layout) -> list[str]:
    then = layout.meta["versions"] | {"blas": layout.meta["blas"], "backend": _computed(layout)}
    # What Python has computed it computes anywhere.
    backend = PYTHON if then["backend"] == PYTHON else available()
    now = provenance.versions() | {"blas": provenance.blas(), "backend": backend}
    return [f"{name}: recorded with {then[name]}, now {now.get(name)}" for name in then if then[name] != now.get(name)]


def _computed(layout: Layout) -> str:
    """What computed the laws and guards of a recording that have a C version."""
    found = layout.meta.get("backend", {})
    return str(found.get("computed", PYTHON)) if isinstance(found, dict) else PYTHON


def perturbed(layout: Layout, rows: NDArray[np.int64], what: str) -> NDArray[np.int64]:
    """Returns a copy of rows with the first element of one input sample changed, as a negative control.

    `what` is "SIGNAL:CYCLE:AMOUNT".
    """
    try:
        name, cycle, amount = what.split(":")
        k, by = int(cycle), float(amount)
        fields = layout.fields[name]
    except (ValueError, KeyError):
        inputs = ", ".join(n for n, f in layout.fields.items() if f.role in (*_INPUT[:3], _SENT))
        raise RecordingError(f"--perturb {what}", "expected SIGNAL:CYCLE:AMOUNT", f"Inputs are: {inputs}") from None
    if not 0 <= k < len(rows):
        raise RecordingError(f"--perturb {what}", f"there is no cycle {k}", f"Cycles go from 0 to {len(rows) - 1}")
    changed = rows.copy()
    first = layout.ints + fields.offset
    changed[k, first : first + 1].view(np.float64)[0] += by
    return changed
