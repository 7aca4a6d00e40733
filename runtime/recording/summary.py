"""What a recording is, in a line: profile, persons, date, length, how it stopped, and what is wrong with it.

The rows are read block by block, so a long recording takes no more memory than a short one.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np
from ruamel.yaml.error import YAMLError

from srl.runtime.contracts import yaml_text
from srl.runtime.contracts.calibration_content import parse
from srl.runtime.contracts.errors import RecordingError, SrlError
from srl.runtime.contracts.files import decoded
from srl.runtime.ipc.header import Cause, State
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.recording.reader import NO_ROWS, read
from srl.runtime.recording.segments import folder_of, listed
from srl.runtime.recording.source import Source

NO_FAULT: Final = (Cause.NONE, Cause.REQUEST, Cause.END)
_MOVING: Final = (State.ACTIVE, State.HOMING)
_UNFINISHED: Final = (
    "If no run writes it any more, read it as it is: replay and export take it. "
    "Rows after these are in the black box that the instance's next start saves"
)
_SALVAGED: Final = "What is there can be read and exported, but it isn't whole"
_REMEDY: Final = "Take a copy of it that is whole; if there is none, no more of it can be read"


@dataclass(frozen=True)
class Summary:
    """What a recording is.

    Attributes:
        profile: its name.
        persons: anonymous ids of those whose it is or whose calibration is in it.
        simulated: whether every device was, or on its twin.
        partly: the devices that were, where not every one was.
        began: Unix time, ns; 0 where nothing can be read.
        seconds: from the first row to the last, of the loop's clock.
        rows: that can be read.
        stop: the cause of the last stop, "" for none: "request", "device loss arm".
        fault: whether that cause is a fault.
        problem, remedy: what is wrong with it and what to do; "" for nothing.
    """

    profile: str = ""
    persons: tuple[str, ...] = ()
    simulated: bool = False
    partly: tuple[str, ...] = ()
    began: int = 0
    seconds: float = 0.0
    rows: int = 0
    stop: str = ""
    fault: bool = False
    problem: str = ""
    remedy: str = ""

    @property
    def date(self) -> str:
        """The beginning in the local time zone; "" where it isn't known."""
        return (
            datetime.fromtimestamp(self.began / 1e9, UTC).astimezone().isoformat(" ", "seconds")[:19]
            if self.began
            else ""
        )

    @property
    def text(self) -> str:
        """As JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def of(cls, text: str) -> Summary:
        """Reads `text`. Raises ValueError, KeyError or TypeError: it isn't one."""
        values = json.loads(text)
        partly = tuple(values.get("partly", ()))  # an index of an earlier version doesn't say it
        return cls(**values | {"persons": tuple(values["persons"]), "partly": partly})


def summarize(path: Path) -> Summary:
    """Sums a recording up: a .rrd file, a folder of segments, or a black box. What can't be read is a problem of it.

    Raises:
        ModuleNotFoundError: this machine hasn't the library that reads it.
    """
    try:
        if (path / "rows.ring").exists():
            recording = read(path)
            found = _Sum(recording.layout)
            found.add(recording.sequence, recording.rows)
            return found.summary("", "")
        return _summary(path)
    except SrlError as error:
        return Summary(problem=error.problem, remedy=error.remedy)
    except OSError as error:
        return Summary(problem=f"it can't be read: {error.strerror or error}", remedy="Correct its permissions")
    except ModuleNotFoundError:
        raise
    except Exception as error:  # whatever a damaged file makes a library do, the others are still listed
        return Summary(problem=f"it is damaged: {type(error).__name__}: {_line(error)}", remedy=_REMEDY)


def persons(layout: Layout) -> tuple[str, ...]:
    """The anonymous ids that a layout has: of the run, of the calibration that it is, of the files in it."""
    found = [layout.meta.get("person")]
    try:
        controllers = yaml_text.load(str(layout.meta.get("profile", ""))).get("controllers") or []
        found += [entry.get("person") for entry in controllers]
    except (YAMLError, AttributeError, TypeError):
        pass  # a profile without laws, or none
    try:
        files = list(decoded(layout.meta.get("files") or {}, "the layout").values())
    except (SrlError, AttributeError, TypeError):
        files = []
    found += [owner(content)[0] for content in files]
    return tuple(dict.fromkeys(person for person in found if isinstance(person, str) and person))


def owner(content: bytes) -> tuple[str, bool]:
    """Whose a calibration file is, and whether it was made in simulation; "" where it doesn't say."""
    record = parse(content)
    if not isinstance(record.get("person"), str):
        return "", False
    return record["person"], record.get("simulated") is True


def _summary(path: Path) -> Summary:
    segments = path.is_dir()
    files = listed(path) if segments else [path]
    if not files:
        raise RecordingError(str(path), "the folder holds neither segments nor a black box", _REMEDY)
    source = Source(files)
    found: _Sum | None = None
    problem, remedy = "", _REMEDY
    try:
        for sequence, rows in source.blocks():
            assert source.layout is not None
            found = found or _Sum(source.layout)
            found.add(sequence, rows)
    except SrlError as error:
        problem, remedy = error.problem, error.remedy
    except ModuleNotFoundError:
        raise
    except Exception as error:
        problem = f"it is damaged: {type(error).__name__}: {_line(error)}"
    if found is None:
        if not problem and source.cut:
            problem = "it is cut short, and no row of it is whole"
        elif not problem:
            problem, remedy = "it has no rows", NO_ROWS
        name = "" if source.layout is None else str(source.layout.meta.get("name", ""))
        return Summary(name, () if source.layout is None else persons(source.layout), problem=problem, remedy=remedy)
    if problem:
        return found.summary(f"{problem}; its first {found.rows} rows can be read", remedy)
    if segments:
        whole = path.with_name(path.name.removesuffix(".segments"))
        if source.last is not None:
            if source.cut or source.damaged or source.last > found.last:
                problem, remedy = f"it is damaged; {found.there(source.cut)} of {source.last}", _SALVAGED
        elif folder_of(whole) == path and whole.exists():
            problem = "segments of a recording that is there merged, too"
            remedy = "Compare the two, then delete the segments"
        else:
            problem, remedy = f"its recorder hasn't finished it; {found.there(source.cut)}", _UNFINISHED
    elif source.cut:
        problem, remedy = (
            f"its last {source.cut} bytes are torn",
            "The rows before them can be read, replayed and exported",
        )
    return found.summary(problem, remedy)


def _line(error: Exception) -> str:
    return (str(error).splitlines() or [""])[0]


class _Sum:
    """Sums rows up, block by block."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self.rows = 0
        self._first = self._last = 0
        self._sequence = 0
        self._missing = 0
        self._state = int(State.STARTING)
        self._stop: tuple[int, int] | None = None

    def add(self, sequence: Words, rows: Words) -> None:
        """Takes rows (k, width) with their sequence numbers (k,)."""
        if not len(rows):
            return
        now, states, causes, sources = (self._layout.header(rows, w) for w in ("now", "state", "cause", "fault_source"))
        self._first = self._first if self.rows else int(now[0])
        self._last = int(now[-1])
        self._missing += int(sequence[-1]) - self._sequence - len(sequence)
        self._sequence = int(sequence[-1])
        before = np.append(self._state, states[:-1])
        ends = np.flatnonzero(np.isin(before, _MOVING) & ~np.isin(states, _MOVING))
        if len(ends):
            self._stop = int(causes[ends[-1]]), int(sources[ends[-1]])
        elif self._stop is None and causes.any():  # it never moved: why it doesn't
            at = np.flatnonzero(causes)[-1]
            self._stop = int(causes[at]), int(sources[at])
        self._state = int(states[-1])
        self.rows += len(rows)

    @property
    def last(self) -> int:
        """The number of the last row."""
        return self._sequence

    def there(self, cut: int) -> str:
        """Which rows are there, and what is known to be lost; `cut` bytes are torn."""
        missing = f", {self._missing} of them missing" if self._missing else ""
        torn = f", and {cut} bytes are torn" if cut else ""
        return f"it has rows to number {self._sequence}{missing}{torn}"

    def summary(self, problem: str, remedy: str) -> Summary:
        """The summary, with what is wrong with it as far as its reader knows."""
        meta: dict[str, Any] = self._layout.meta
        if not problem and self._missing:
            problem = f"{self._missing} rows are missing"
            remedy = "It can be read and exported, but not replayed: the disk or the recorder was too slow"
        number, fault_source = self._stop or (0, -1)
        cause = next((c for c in Cause if c == number), None)
        text = "" if number == 0 else str(number) if cause is None else cause.name.lower().replace("_", " ")
        if cause is not None and cause not in NO_FAULT:
            try:
                text = f"{text} {self._layout.fault_source(cause, fault_source)}".rstrip()
            except (KeyError, IndexError):
                pass  # a layout of an earlier version doesn't name it
        return Summary(
            str(meta.get("name", "")), persons(self._layout), *_simulated(self._layout),
            self._first + int(meta.get("wall", 0)), (self._last - self._first) / 1e9, self.rows, text,
            number != 0 and cause not in NO_FAULT, problem, remedy if problem else "",
        )  # fmt: skip


def _simulated(layout: Layout) -> tuple[bool, tuple[str, ...]]:
    every = bool(layout.simulated) and layout.simulated == layout.devices
    return every, () if every else tuple(layout.simulated)
