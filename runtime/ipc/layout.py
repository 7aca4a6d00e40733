"""The layout of a row: one description, written beside the ring, that every reader shares.

A row's payload is `Layout.ints` int64 words (the cycle's own, then seven for each device: `srl.runtime.ipc.header`),
then float64 words (every signal's values).
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.field import Field
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc import private_file
from srl.runtime.ipc.header import CYCLE, DEVICE, Cause

Words = NDArray[np.int64]
"""Rows: (k, width), or one of them."""

# The words of the first recordings, whose layouts don't name them.
_FIRST_CYCLE = (
    *("cycle", "now", "dt", "deadline", "wake", "read", "control", "guard", "write", "log", "state", "cause"),
    *("fault_source", "category", "overruns", "flags", "request", "request_kind", "request_target", "request_result"),
)
# Words of earlier recordings that have another name now.
_RENAMED = {"culprit": "fault_source"}
_FIRST_DEVICE = ("stamp", "link", "frames", "errors", "resyncs", "reconnects")


@dataclass
class Layout:
    """The layout of a row: names and places of its words.

    Attributes:
        devices: names of the devices, in the order of their words.
        fields: signals by name. A command `finger.position_command` is the controller's desired command;
            `finger.position_command.applied` is the guarded command, `finger.position_command.sent` what left.
        meta: other data for readers of rows: profile name, text and sha256, rate, seed, versions, clock,
            `wall` (ns to add to CLOCK_MONOTONIC for Unix time), parameters with their bounds,
            controllers, devices' drivers, kinds of the commands.
        recorded: names of the words of the cycle, and of a device, that the rows were written with. They differ from
            this version's for a recording of an earlier one. Readers get this version's words; see `upgrade`.
    """

    devices: list[str] = field(default_factory=list)
    fields: dict[str, Field] = field(default_factory=dict)
    meta: dict[str, Any] = field(default_factory=dict)
    recorded: tuple[tuple[str, ...], tuple[str, ...]] = (CYCLE._fields, DEVICE._fields)

    @property
    def int_names(self) -> list[str]:
        """Names of the int64 words, in their order."""
        return [*CYCLE._fields, *(f"{device}.{word}" for device in self.devices for word in DEVICE._fields)]

    @property
    def ints(self) -> int:
        """Number of int64 words."""
        return len(CYCLE) + len(DEVICE) * len(self.devices)

    def device(self, index: int) -> slice:
        """The words of the device at `index` in `devices`; `DEVICE` names them in their order."""
        first = len(CYCLE) + index * len(DEVICE)
        return slice(first, first + len(DEVICE))

    @property
    def floats(self) -> int:
        """Number of float64 words."""
        last = next(reversed(self.fields.values()), None)  # each begins where the one before it ends
        return 0 if last is None else last.offset + last.size

    @property
    def width(self) -> int:
        """Number of words in a row's payload."""
        return self.ints + self.floats

    @property
    def recorded_names(self) -> list[str]:
        """Names of the int64 words that the rows were written with, in their order."""
        cycle, device = self.recorded
        return [*cycle, *(f"{name}.{word}" for name in self.devices for word in device)]

    def upgrade(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Returns rows (k, width then) as they were written, in this version's form (k, width).

        Words that were not written are 0; words that this version doesn't know are left out.
        """
        then = self.recorded_names
        if then == self.int_names:
            return rows
        made = np.zeros((len(rows), self.width), np.int64)
        for i, name in enumerate(self.int_names):
            if name in then:
                made[:, i] = rows[:, then.index(name)]
        made[:, self.ints :] = rows[:, len(then) :]
        return made

    def add(self, name: str, role: str, shape: tuple[int, ...], unit: str, **rest: Any) -> Field:
        """Appends a signal; its name must be new."""
        if name in self.fields:
            raise ValueError(f"signal {name} is there already")
        self.fields[name] = Field(name, role, self.floats, shape, unit, **rest)
        return self.fields[name]

    def header(self, rows: NDArray[np.int64], name: str) -> NDArray[np.int64]:
        """The header field `name` ("cycle", "glove.stamp") of rows shaped (k, width) or (width,)."""
        field: NDArray[np.int64] = rows[..., self.int_names.index(name)]
        return field

    def stamped_by(self, field: Field) -> int:
        """The index of the header field with the time of a signal's values: its device's stamp, else the cycle's."""
        device = field.name.partition(".")[0]
        if field.role != "state" or device not in self.devices:
            return CYCLE.now
        return self.device(self.devices.index(device)).start + DEVICE.stamp

    def value(self, rows: NDArray[np.int64], name: str) -> Array:
        """The signal `name` of rows shaped (k, width) or (width,): (k, *shape) or (*shape,) float64."""
        f = self.fields[name]
        start = self.ints + f.offset
        words = np.ascontiguousarray(rows[..., start : start + f.size])
        return words.view(np.float64).reshape((*rows.shape[:-1], *f.shape))

    def fault_source(self, cause: Cause, index: int) -> str:
        """The name of the device, controller or emergency input to which a cause's index refers; "" for none."""
        if index < 0:
            return ""
        if cause in (Cause.CONTROLLER_ERROR, Cause.CONTACT):
            return str(self.meta["controllers"][index]["name"])
        return str(self.meta["emergency"][index] if cause is Cause.EMERGENCY else self.devices[index])

    @property
    def setpoint_owners(self) -> set[str]:
        """The names among `devices` under which clients' setpoints come; they are no devices."""
        return {entry["name"].partition(".")[0] for entry in self.meta.get("setpoints", [])}

    @property
    def simulated(self) -> list[str]:
        """The names among `devices` behind which there is no real device: simulated in the loop, or on their twins."""
        made = {*(self.meta.get("simulated") or ()), *(self.meta.get("twins") or ())}
        return [device for device in self.devices if device in made]

    def needs(self, place: str, *keys: str) -> None:
        """Checks that `meta` says all of this. Raises RecordingError."""
        if missing := [key for key in keys if key not in self.meta]:
            problem = f"the layout is damaged: it lacks {', '.join(missing)}"
            raise RecordingError(place, problem, "Use another recording, or the version of srl that wrote this one")

    @property
    def text(self) -> str:
        """The layout as JSON."""
        content = {
            "devices": self.devices,
            "words": {"cycle": self.recorded[0], "device": self.recorded[1]},
            "fields": [asdict(f) for f in self.fields.values()],
            "meta": self.meta,
        }
        return json.dumps(content)

    def save(self, path: Path) -> None:
        """Writes the layout as JSON."""
        private_file.replace(path, self.text.encode())

    @classmethod
    def load(cls, path: Path) -> Layout:
        """Reads what `save` wrote. Raises RecordingError."""
        return cls.from_json(private_file.read_text(path), str(path))

    @classmethod
    def from_json(cls, text: str, place: str = "the layout") -> Layout:
        """Makes a layout from `text`.

        Raises:
            RecordingError: the text is damaged; `place` is where it was found.
        """
        try:
            content = json.loads(text)
            words = content.get("words", {"cycle": _FIRST_CYCLE, "device": _FIRST_DEVICE})
            cycle = tuple(_RENAMED.get(str(word), str(word)) for word in words["cycle"])
            recorded = cycle, tuple(map(str, words["device"]))
            layout = cls([str(device) for device in content["devices"]], {}, dict(content["meta"]), recorded)
            for item in content["fields"]:
                item |= {
                    "shape": tuple(int(size) for size in item["shape"]),
                    "labels": tuple(item["labels"]),
                    "links": tuple(tuple(link) for link in item["links"]),
                    "components": tuple(tuple(names) for names in item.get("components", ())),
                    "groups": tuple(item.get("groups", ())),
                    "slides": tuple(item.get("slides", ())),
                }
                f = Field(**item)
                if not all(isinstance(text, str) for text in (f.name, f.role, f.unit)):
                    raise ValueError(f"signal '{f.name}': name, role and unit must be texts")
                if f.offset != layout.floats or min(f.shape, default=1) < 0 or f.name in layout.fields:
                    raise ValueError(f"signal '{f.name}' has no place of its own")
                layout.fields[f.name] = f
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
            problem = f"the layout is damaged: {type(error).__name__}: {error}"
            raise RecordingError(place, problem, "Without it no row can be read; use another recording") from None
        return layout
