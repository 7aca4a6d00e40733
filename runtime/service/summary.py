"""Figures of a run from its rows, for the output of `srl run --json` and the status line."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from srl.runtime.ipc import latches
from srl.runtime.ipc.header import FLAG_DEGRADED, LINK_CONNECTED, LINK_STALE, Cause, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.ring import RingReader

WELL = (Cause.NONE, Cause.REQUEST, Cause.END, Cause.RESTART)  # causes of a stop in which a run may end well
PHASES = ("read", "control", "guard", "write", "log")
# Bins of a factor 1.01 each, from 10 ns to 100 s: percentiles accurate to one per cent, in bounded memory.
_EDGES = 10.0 * 1.01 ** np.arange(int(np.log(1e10) / np.log(1.01)) + 1)


class Histogram:
    """A histogram of durations in ns, with percentiles accurate to one per cent."""

    def __init__(self) -> None:
        self._counts = np.zeros(_EDGES.size + 1, np.int64)
        self._most = 0.0

    def add(self, values: NDArray[np.int64]) -> None:
        """Adds durations in ns."""
        if values.size:
            self._counts += np.bincount(np.searchsorted(_EDGES, values), minlength=self._counts.size)
            self._most = max(self._most, float(values.max()))

    def percentile(self, share: float) -> float:
        """The percentile in ns; 0 without data. `share` is between 0 and 1."""
        total = int(self._counts.sum())
        if total == 0:
            return 0.0
        bin_ = int(np.searchsorted(np.cumsum(self._counts), share * total))
        return min(float(_EDGES[min(bin_, _EDGES.size - 1)]), self._most)

    def metrics(self) -> dict[str, float]:
        """p50, p99, p999, max in us."""
        shares = {"p50": 0.5, "p99": 0.99, "p999": 0.999}
        return {n: round(self.percentile(s) / 1e3, 2) for n, s in shares.items()} | {"max": round(self._most / 1e3, 2)}


class Summary:
    """Follows the rows of a run in progress."""

    def __init__(self, layout: Layout, ring: RingReader) -> None:
        self.layout, self.ring = layout, ring
        self.index = {name: i for i, name in enumerate(layout.int_names)}
        self.period, self.cycle = Histogram(), Histogram()
        self.phases = {phase: Histogram() for phase in PHASES}
        self.cycles = self.degraded = 0
        self.row: NDArray[np.int64] | None = None
        self.faulted: tuple[Cause, int] | None = None  # the last stop that was not requested
        self._first: tuple[int, int] | None = None
        self._wake = 0

    def update(self) -> None:
        """Reads the rows written since the last call."""
        while (rows := self.ring.take()).shape[0]:
            get = {
                n: rows[:, self.index[n]] for n in ("now", "wake", "read", "control", "guard", "write", "log", "cause")
            }
            if self._first is None:
                self._first = (int(get["now"][0]), int(get["wake"][0]))
            wakes = np.concatenate(([self._wake] if self._wake else [], get["wake"]))
            self.period.add(np.diff(wakes).astype(np.int64))
            self._wake = int(get["wake"][-1])
            self.cycle.add(get["write"] - get["wake"])
            ends = [get["wake"], get["read"], get["control"], get["guard"], get["write"]]
            for phase, start, end in zip(PHASES, ends, ends[1:], strict=False):
                self.phases[phase].add(end - start)
            self.phases["log"].add(get["log"][1:])
            self.degraded += int(np.count_nonzero(rows[:, self.index["flags"]] & FLAG_DEGRADED))
            bad = np.flatnonzero((get["cause"] > Cause.REQUEST) & (get["cause"] != Cause.END))
            if bad.size:
                last = rows[bad[-1]]
                self.faulted = Cause(int(last[self.index["cause"]])), int(last[self.index["fault_source"]])
            self.row = rows[-1]
        self.cycles = self.ring.sequence

    def header(self, name: str) -> int:
        """A header field of the newest row."""
        return 0 if self.row is None else int(self.row[self.index[name]])

    @property
    def state(self) -> State:
        """The newest row's state."""
        return State(self.header("state"))

    def seconds(self) -> tuple[float, float]:
        """How long the run has lasted, s: (on the loop's clock, in wall time)."""
        if self._first is None:
            return 0.0, 0.0
        return (self.header("now") - self._first[0]) / 1e9, (self.header("wake") - self._first[1]) / 1e9

    def devices(self) -> dict[str, dict[str, Any]]:
        """Each device's health according to the newest row."""
        found = {}
        for name in self.layout.devices:
            stamp, link = self.header(f"{name}.stamp"), self.header(f"{name}.link")
            state = "lost" if not link & LINK_CONNECTED else "stale" if link & LINK_STALE else "ok"
            if stamp < 0 and state == "ok" and name in self.layout.setpoint_owners:
                state = "awaited"  # no client has sent a setpoint yet
            found[name] = {
                "state": state,
                "age_ms": None if stamp < 0 else round((self.header("now") - stamp) / 1e6, 3),
                "frames": self.header(f"{name}.frames"),
                "errors": self.header(f"{name}.errors"),
                "resyncs": self.header(f"{name}.resyncs"),
                "reconnects": self.header(f"{name}.reconnects"),
                "commands": self.header(f"{name}.commands"),
            }
        return found

    def metrics(self) -> dict[str, Any]:
        """The summary object, without the data that only the supervisor has."""
        duration, wall = self.seconds()
        cause = Cause(self.header("cause"))
        return {
            "profile": self.layout.meta["name"],
            "state": self.state.name.lower(),
            "cause": cause.name.lower(),
            "fault_source": self.layout.fault_source(cause, self.header("fault_source")),
            "latches": latches.names(self.header("latches")),
            "refused": self.header("refused"),
            "cycles": self.cycles,
            "rate_hz": round((self.cycles - 1) / duration, 3) if duration > 0 else None,
            "duration_s": round(duration, 4),
            "overruns": self.header("overruns"),
            "degraded_cycles": self.degraded,
            "period_us": self.period.metrics(),
            "cycle_us": self.cycle.metrics(),
            "phases_us": {phase: h.metrics()["p50"] for phase, h in self.phases.items()},
            "phases_p99_us": {phase: h.metrics()["p99"] for phase, h in self.phases.items()},
            "devices": self.devices(),
            "realtime_factor": round(duration / wall, 2) if wall > 0 else None,
        }
