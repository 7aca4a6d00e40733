"""The instance's status: the last second's rows as diagnostic_msgs/DiagnosticArray, and back.

The first status is the instance's, with the state machine's state as text. One status for each device follows.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from srl.runtime.ipc import latches
from srl.runtime.ipc.header import (
    CYCLE,
    DEVICE,
    FLAG_DEGRADED,
    LINK_ACTIVE,
    LINK_CONNECTED,
    LINK_ERROR,
    LINK_STALE,
    Cause,
    State,
)
from srl.runtime.ipc.layout import Layout
from srl.runtime.messages import cdr
from srl.runtime.messages.messages import time_of

OK, WARN, ERROR, STALE = range(4)  # levels of diagnostic_msgs/DiagnosticStatus
WINDOW = 1_000_000_000  # ns
_TIMES = ("wake", "read", "control", "guard", "write", "log")
_COLUMNS = [getattr(CYCLE, name) for name in _TIMES]

CAUSES = {
    Cause.NONE: "",
    Cause.REQUEST: "stopped on request",
    Cause.INTENT_LOSS: "loss of intent: a sensor the motion follows is stale or gone",
    Cause.DEVICE_LOSS: "an actuator is stale or gone",
    Cause.DEVICE_FAULT: "a device refuses to move",
    Cause.OVERRUN: "too many cycles came late",
    Cause.DRIVER_ERROR: "a driver failed",
    Cause.CONTROLLER_ERROR: "a controller failed",
    Cause.CONTACT: "contact that must not be",
    Cause.FOLLOWING_ERROR: "the limb doesn't follow its command",
    Cause.EMERGENCY: "an e-stop or enabling input",
    Cause.BUS_LOSS: "the bus died",
    Cause.SUPERVISOR_LOSS: "the supervisor died",
    Cause.RESTART: "the stop of an earlier run",
    Cause.END: "the run's duration is over",
}


@dataclass
class Counts:
    """The bus's own counters."""

    lost_rows: int = 0
    rejected: int = 0
    last_rejection: str = ""


@dataclass
class Timing:
    """The cycle's times over the last second."""

    _chunks: deque[NDArray[np.int64]] = field(default_factory=deque)

    def add(self, rows: NDArray[np.int64]) -> None:
        """Adds rows (k, width)."""
        self._chunks.append(rows[:, _COLUMNS])
        newest = self._chunks[-1][-1, 0]
        while self._chunks[0][-1, 0] < newest - WINDOW:
            self._chunks.popleft()

    def metrics(self) -> dict[str, float]:
        """Rate in Hz, and times in us: percentiles of period and cycle, means of the phases."""
        if not self._chunks:
            return {}
        times = np.concatenate(self._chunks)
        times = times[times[:, 0] >= times[-1, 0] - WINDOW]
        found: dict[str, float] = {}
        periods = np.diff(times[:, 0])
        if periods.size:
            p50, p99 = np.percentile(periods, (50, 99)) / 1e3
            found = {"rate_hz": 1e9 / float(periods.mean()), "period_p50_us": p50, "period_p99_us": p99}
        p50, p99 = np.percentile(times[:, 4] - times[:, 0], (50, 99)) / 1e3
        found |= {"cycle_p50_us": p50, "cycle_p99_us": p99}
        phases = np.diff(times[:, :5], axis=1).mean(axis=0) / 1e3
        found |= {f"{name}_us": us for name, us in zip(_TIMES[1:5], phases, strict=True)}
        return found | {"log_us": float(times[:, 5].mean()) / 1e3}


class Reporter:
    """Makes the status message.

    Attributes:
        counts: the bus's own counters.
        timing: the cycle's times; the bus adds the rows.
    """

    def __init__(self, name: str, layout: Layout) -> None:
        self._name, self._layout = name, layout
        self._profile = str(layout.meta.get("name", name))
        self.counts, self.timing = Counts(), Timing()

    def message(self, row: NDArray[np.int64] | None, stamp: int, silent: bool) -> cdr.Message:
        """Returns a diagnostic_msgs/msg/DiagnosticArray.

        Args:
            row: the newest row (width,), None before the first.
            stamp: Unix time, ns.
            silent: True if the loop gives no sign of life.
        """
        own = {
            "lost_rows": self.counts.lost_rows,
            "rejected_setpoints": self.counts.rejected,
            "last_rejection": self.counts.last_rejection,
        }
        if row is None:
            values = {"state": "starting", "rate_nominal_hz": self._rate()} | own
            status = [_status(STALE if silent else OK, self._name, "starting", self._profile, values)]
        else:
            status = [self._instance(row, own, silent)]
            status += [_device(self._name, self._layout, row, i) for i in range(len(self._layout.devices))]
        return {"header": {"stamp": time_of(stamp), "frame_id": ""}, "status": status}

    def _rate(self) -> float:
        numerator, denominator = self._layout.meta["rate"]
        return float(numerator / denominator)

    def _instance(self, row: NDArray[np.int64], own: dict[str, Any], silent: bool) -> cdr.Message:
        ints = dict(zip(CYCLE._fields, row[: len(CYCLE)].tolist(), strict=True))
        state, cause = State(ints["state"]), Cause(ints["cause"])
        who = self._layout.fault_source(cause, ints["fault_source"])
        level = OK if state in (State.ACTIVE, State.READY, State.HOMING) else WARN
        if cause not in (Cause.NONE, Cause.REQUEST, Cause.END):
            level = ERROR
        words = state.name.lower()
        if cause is not Cause.NONE:
            words += f": {CAUSES[cause]}" + (f" ({who})" if who else "")
        latched = latches.names(ints["latches"])
        if latched:
            words += f"; latched: {', '.join(latched)}"
        if silent:
            level, words = STALE, f"the loop gives no sign of life (last: {words})"
        values = {
            "state": state.name.lower(),
            "cause": cause.name.lower(),
            "fault_source": who,
            "latches": " ".join(latched),
            "refused": ints["refused"],
            "cycle": ints["cycle"],
            "overruns": ints["overruns"],
            "degraded": int(bool(ints["flags"] & FLAG_DEGRADED)),
            "rate_nominal_hz": self._rate(),
        }
        return _status(level, self._name, words, self._profile, values | self.timing.metrics() | own)


def _device(name: str, layout: Layout, row: NDArray[np.int64], index: int) -> cdr.Message:
    device = layout.devices[index]
    words = dict(zip(DEVICE._fields, row[layout.device(index)].tolist(), strict=True))
    link = words.pop("link")
    stamp = words.pop("stamp")
    age = (int(row[CYCLE.now]) - stamp) / 1e6 if stamp >= 0 else -1.0
    awaited = stamp < 0 and device in layout.setpoint_owners
    bits = [
        "no setpoint yet" if awaited else "connected" if link & LINK_CONNECTED else "lost",
        *(["stale"] if link & LINK_STALE else []),
        *(["active"] if link & LINK_ACTIVE else []),
        *(["driver error"] if link & LINK_ERROR else []),
    ]
    bad = not link & LINK_CONNECTED or link & LINK_ERROR
    level = ERROR if bad else STALE if link & LINK_STALE else WARN if awaited else OK
    driver = str(layout.meta.get("devices", {}).get(device, {}).get("driver", ""))
    return _status(level, f"{name}/{device}", ", ".join(bits), driver, {"age_ms": age} | words)


def _status(level: int, name: str, message: str, hardware: str, values: dict[str, Any]) -> cdr.Message:
    pairs = [{"key": k, "value": f"{v:.3f}" if isinstance(v, float) else str(v)} for k, v in values.items()]
    return {"level": level, "name": name, "message": message, "hardware_id": hardware, "values": pairs}


def parse(message: cdr.Message) -> dict[str, Any]:
    """Converts a status to one dict: the instance's values, and `devices` with each device's values.

    Numbers become int or float. `instance`, `message` and `level` (0 well, 1 warning, 2 error, 3 stale) come from
    the status itself. `latches` is a list of names. `stamp` is Unix time in s.
    """
    stamp = message["header"]["stamp"]
    found: dict[str, Any] = {"stamp": stamp["sec"] + stamp["nanosec"] * 1e-9, "devices": {}}
    for i, status in enumerate(message["status"]):
        values: dict[str, Any] = {"message": status["message"], "level": status["level"]}
        values |= {pair["key"]: _number(pair["value"]) for pair in status["values"]}
        if "latches" in values:
            values["latches"] = str(values["latches"]).split()
        if i == 0:
            found |= {"instance": status["name"], "profile": status["hardware_id"]} | values
        else:
            device = status["name"].rpartition("/")[2]
            found["devices"][device] = {"driver": status["hardware_id"]} | values
    return found


def _number(text: str) -> Any:
    try:
        return int(text)
    except ValueError:
        try:
            return float(text)
        except ValueError:
            return text
