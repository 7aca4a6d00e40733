"""What a row holds and where: one description, written beside the ring, that every reader shares.

A row's payload is `Layout.ints` int64 words (the cycle's own, then six a device), then float64 words (every
signal's values). All signal arrays of drivers, controllers and guard are views into one such row, the board:
logging a cycle is one copy.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.contracts.signals import Array

# The cycle's own int64 words. Times are ns: `now`, `deadline` and the ends of the phases on the loop's clock
# and CLOCK_MONOTONIC respectively; `log` is how long appending the row before took.
CYCLE = (
    "cycle", "now", "dt", "deadline", "wake", "read", "control", "guard", "write", "log",
    "state", "cause", "culprit", "category", "overruns", "flags",
    "request", "request_kind", "request_target", "request_result",
)  # fmt: skip
# The words of each device, named `<device>.<word>`.
DEVICE = ("stamp", "link", "frames", "errors", "resyncs", "reconnects")

# Bits of `flags`.
FLAG_LATE = 1  # this cycle began after its deadline by more than a period
FLAG_DEGRADED = 2  # overruns: telemetry is asked to take less
FLAG_REJECTED = 4  # the guard refused a non-finite command
FLAG_FALLBACK = 8  # the guard braked because its trajectory generator failed
FLAG_LIMITED = 16  # the guard changed a command
# Bits of `<device>.link`.
LINK_CONNECTED = 1
LINK_STALE = 2
LINK_ACTIVE = 4  # commands reach it
LINK_ERROR = 8  # its driver failed in a way it should not
LINK_FAULT = 16  # it is connected and refuses to move, until it has recovered


class State(IntEnum):
    """The state machine."""

    STARTING = 0
    READY = 1  # devices open, nothing moves
    ACTIVE = 2
    STOPPING = 3  # a stop is under way
    STOPPED = 4  # at rest in the stop; waits for a reset
    ENDED = 5
    HOMING = 6  # a device without feedback goes to its home slowly


class Cause(IntEnum):
    """Why it stopped."""

    NONE = 0
    REQUEST = 1  # a client, `srl stop`, SIGTERM
    INTENT_LOSS = 2  # a sensor that the motion follows is stale or gone
    DEVICE_LOSS = 3  # an actuator is stale or gone
    OVERRUN = 4
    DRIVER_ERROR = 5
    CONTROLLER_ERROR = 6
    EMERGENCY = 7  # an e-stop or enabling input
    BUS_LOSS = 8  # the bus died where the profile depends on it
    SUPERVISOR_LOSS = 9
    RESTART = 10  # started again after a crash
    END = 11  # the run's duration is over
    DEVICE_FAULT = 12  # a device refuses to move: protective stop, reflex, hardware error


@dataclass(frozen=True)
class Field:
    """One signal's place in the row's float words."""

    name: str
    role: str  # state, command (as the controller asked), applied, internal, parameter, setpoint, truth
    offset: int
    shape: tuple[int, ...]
    unit: str
    frame: str | None = None
    labels: tuple[str, ...] = ()
    visual: str = ""
    links: tuple[tuple[int, ...], ...] = ()

    @property
    def size(self) -> int:
        """Number of float64 words."""
        return int(np.prod(self.shape, dtype=int))


@dataclass
class Layout:
    """See the module's text.

    Attributes:
        devices: in the order of their words.
        fields: by name; a command `finger.position_command` is what the controller asked for, its
            `finger.position_command.applied` what the guard let through.
        meta: what a reader of rows needs besides: profile name, text and sha256, rate, seed, versions, clock,
            `wall` (ns to add to CLOCK_MONOTONIC for Unix time), parameters with their bounds,
            controllers, devices' drivers.
    """

    devices: list[str] = field(default_factory=list)
    fields: dict[str, Field] = field(default_factory=dict)
    meta: dict[str, Any] = field(default_factory=dict)

    @property
    def int_names(self) -> list[str]:
        """Names of the int64 words in their order."""
        return [*CYCLE, *(f"{device}.{word}" for device in self.devices for word in DEVICE)]

    @property
    def ints(self) -> int:
        """Number of int64 words."""
        return len(CYCLE) + len(DEVICE) * len(self.devices)

    @property
    def floats(self) -> int:
        """Number of float64 words."""
        return sum(f.size for f in self.fields.values())

    @property
    def width(self) -> int:
        """Words of a row's payload."""
        return self.ints + self.floats

    def add(self, name: str, role: str, shape: tuple[int, ...], unit: str, **rest: Any) -> Field:
        """Appends a signal; its name must be new."""
        if name in self.fields:
            raise ValueError(f"signal {name} is there already")
        self.fields[name] = Field(name, role, self.floats, shape, unit, **rest)
        return self.fields[name]

    def word(self, rows: NDArray[np.int64], name: str) -> NDArray[np.int64]:
        """The word `name` ("cycle", "glove.stamp") of rows shaped (k, width) or (width,)."""
        word: NDArray[np.int64] = rows[..., self.int_names.index(name)]
        return word

    def value(self, rows: NDArray[np.int64], name: str) -> Array:
        """The signal `name` of rows shaped (k, width) or (width,): (k, *shape) or (*shape,) float64."""
        f = self.fields[name]
        start = self.ints + f.offset
        words = np.ascontiguousarray(rows[..., start : start + f.size])
        return words.view(np.float64).reshape((*rows.shape[:-1], *f.shape))

    def culprit(self, cause: Cause, index: int) -> str:
        """The name of the device, controller or emergency input that a cause's index means; "" for none."""
        if index < 0:
            return ""
        if cause is Cause.CONTROLLER_ERROR:
            return str(self.meta["controllers"][index]["name"])
        return str(self.meta["emergency"][index] if cause is Cause.EMERGENCY else self.devices[index])

    def save(self, path: Path) -> None:
        """Writes it as JSON."""
        content = {"devices": self.devices, "fields": [asdict(f) for f in self.fields.values()], "meta": self.meta}
        scratch = path.with_suffix(".new")
        scratch.write_text(json.dumps(content))
        scratch.rename(path)

    @classmethod
    def load(cls, path: Path) -> Layout:
        """Reads what `save` wrote."""
        return cls.from_json(path.read_text())

    @classmethod
    def from_json(cls, text: str) -> Layout:
        """From the text that `save` writes."""
        content = json.loads(text)
        fields = {}
        for item in content["fields"]:
            item |= {
                "shape": tuple(item["shape"]),
                "labels": tuple(item["labels"]),
                "links": tuple(tuple(link) for link in item["links"]),
            }
            fields[item["name"]] = Field(**item)
        return cls(content["devices"], fields, content["meta"])


class Board:
    """The row being made: named views into one array of words."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.words = np.zeros(layout.width, np.int64)
        self.ints = self.words[: layout.ints]
        self.floats = self.words[layout.ints :].view(np.float64)
        self.index = {name: i for i, name in enumerate(layout.int_names)}
        self.views: dict[str, Array] = {
            f.name: self.floats[f.offset : f.offset + f.size].reshape(f.shape) for f in layout.fields.values()
        }
