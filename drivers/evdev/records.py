"""evdev's records and a device's description (sheet A1, A2). No I/O."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

RECORD: Final = struct.Struct("<qqHHi")  # seconds, microseconds, type, code, value: 64-bit kernels
EV_SYN, EV_KEY, EV_ABS, EV_MSC = 0, 1, 3, 4
SYN_REPORT, SYN_DROPPED = 0, 3


class Event(NamedTuple):
    """One change. `at` is ns of the device's clock, which is CLOCK_MONOTONIC after a request."""

    at: int
    type: int
    code: int
    value: int


class AxisInfo(NamedTuple):
    """An axis (EVIOCGABS): its present value and its range, in its own counts."""

    value: int
    minimum: int
    maximum: int
    fuzz: int = 0
    flat: int = 0
    resolution: int = 0


@dataclass
class Description:
    """A device's description of itself.

    Attributes:
        name, uniq: its names; `uniq` is a Bluetooth address, or "".
        vendor, product, version: USB's numbers.
        keys: codes of its keys and buttons.
        pressed: the codes of those that are pressed now.
        axes: axes by code.
    """

    name: str = ""
    uniq: str = ""
    vendor: int = 0
    product: int = 0
    version: int = 0
    keys: frozenset[int] = frozenset()
    pressed: frozenset[int] = frozenset()
    axes: dict[int, AxisInfo] = field(default_factory=dict)

    def state(self) -> list[tuple[int, int, int]]:
        """Returns the whole state as (type, code, value)."""
        keys = [(EV_KEY, code, int(code in self.pressed)) for code in sorted(self.keys)]
        return keys + [(EV_ABS, code, axis.value) for code, axis in sorted(self.axes.items())]

    def to_line(self) -> bytes:
        """Encodes it as one line of JSON, for a connection that has no ioctls."""
        content = {
            "name": self.name, "uniq": self.uniq, "vendor": self.vendor, "product": self.product,
            "version": self.version, "keys": sorted(self.keys), "pressed": sorted(self.pressed),
            "axes": {str(code): list(axis) for code, axis in self.axes.items()},
        }  # fmt: skip
        return json.dumps(content).encode() + b"\n"

    @classmethod
    def from_line(cls, line: bytes) -> Description:
        """Decodes a line from `to_line`. Raises ValueError."""
        try:
            content: dict[str, Any] = json.loads(line)
            return cls(
                str(content["name"]), str(content["uniq"]), int(content["vendor"]), int(content["product"]),
                int(content["version"]), frozenset(map(int, content["keys"])), frozenset(map(int, content["pressed"])),
                {int(code): AxisInfo(*map(int, axis)) for code, axis in content["axes"].items()},
            )  # fmt: skip
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"no description: {error}") from None


class Parser:
    """Cuts bytes into whole reports: the changes between two SYN_REPORTs.

    Attributes:
        frames: whole reports.
        errors: records of no known type, or without meaning.
        drops: number of times the kernel reported that it lost events (SYN_DROPPED). The parser discards everything
            up to the next SYN_REPORT; `lost` stays True until the reader has read the whole state again.
        lost: see `drops`.
    """

    LONGEST: Final = 512  # changes in a report; a device with more isn't a gamepad

    def __init__(self) -> None:
        self.frames = self.errors = self.drops = 0
        self.lost = False
        self._dropping = False
        self._rest = b""
        self._changes: list[Event] = []

    def feed(self, data: bytes) -> list[list[Event]]:
        """Returns the whole reports that `data` completes, oldest first."""
        data = self._rest + data
        end = len(data) - len(data) % RECORD.size
        self._rest = data[end:]
        reports: list[list[Event]] = []
        for seconds, micros, kind, code, value in RECORD.iter_unpack(data[:end]):
            if kind == EV_SYN and code == SYN_DROPPED:
                self.drops += 1
                self._dropping = self.lost = True
                self._changes = []
            elif kind == EV_SYN and code == SYN_REPORT:
                self.frames += 1
                if self._changes and not self._dropping:
                    reports.append(self._changes)
                self._changes, self._dropping = [], False
            elif kind in (EV_KEY, EV_ABS) and len(self._changes) < self.LONGEST:
                self._changes.append(Event(seconds * 1_000_000_000 + micros * 1000, kind, code, value))
            elif kind != EV_MSC:
                self.errors += 1
        return reports


def encode(at: int, changes: list[tuple[int, int, int]]) -> bytes:
    """Encodes a report: the changes (type, code, value) and their SYN_REPORT, all stamped `at` (ns)."""
    seconds, micros = at // 1_000_000_000, at % 1_000_000_000 // 1000
    records = [*changes, (EV_SYN, SYN_REPORT, 0)]
    return b"".join(RECORD.pack(seconds, micros, *record) for record in records)
