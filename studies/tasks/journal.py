"""The journal of a study's trials: a line a row, on the disk before the next one is asked for."""

from __future__ import annotations

import fcntl
import json
import os
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

from srl.studies.tasks.task import Row, TrialTask
from srl.studies.toolkit.errors import StudyError

FILE: Final = "trials.journal"


@dataclass
class Journal:
    """An open journal; nobody else writes to it meanwhile.

    Attributes:
        path: the file.
        rows: those that it holds, by key; a later one replaces an earlier one.
        torn: whether a last, unfinished line was cut off.
        broken: lines that can't be read any more, elsewhere in the file. Their trials are run again.
    """

    path: Path
    rows: dict[str, Row] = field(default_factory=dict)
    torn: bool = False
    broken: int = 0
    _descriptor: int = -1
    _end: int = 0

    def append(self, rows: Iterable[Row]) -> None:
        """Writes rows and waits for the disk.

        Raises:
            StudyError: it can't be written. What was there is there still.
        """
        given = list(rows)
        data = b"".join(encoded(row) for row in given)
        try:
            done = 0
            while done < len(data):
                done += os.pwrite(self._descriptor, data[done:], self._end + done)
            os.fsync(self._descriptor)
        except OSError as error:
            try:
                os.ftruncate(self._descriptor, self._end)
            except OSError:
                pass  # the next start cuts the unfinished line off
            problem = f"it can't be written: {error.strerror}; the {len(self.rows)} rows before are kept"
            raise StudyError(str(self.path), problem, "Make room, then give the same command again") from None
        self._end += len(data)
        self.rows |= {row.key: row for row in given}


@contextmanager
def opened(folder: Path) -> Iterator[Journal]:
    """Opens the journal of a folder; both may be new.

    Raises:
        StudyError: it can't be opened, or somebody else writes to it.
    """
    path = folder / FILE
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise StudyError(str(path), f"it can't be opened: {error.strerror}", "Name another folder by --out") from None
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise StudyError(
                str(path), "another process runs this study into this folder", "Wait for it, or name another by --out"
            ) from None
        yield _salvaged(Journal(path, _descriptor=descriptor))
    finally:
        os.close(descriptor)  # releases the lock


def _salvaged(journal: Journal) -> Journal:
    """Reads what is there, and cuts off what was being written when the last writer was killed."""
    _fill(journal)
    if journal.torn:
        os.ftruncate(journal._descriptor, journal._end)
    folder = os.open(journal.path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(folder)  # a new file's name must outlive a power cut, too
    finally:
        os.close(folder)
    return journal


def read(path: Path) -> Journal:
    """Returns a journal's rows without opening it for writing; somebody may write to it. Raises OSError."""
    return _fill(Journal(path))


def _fill(journal: Journal) -> Journal:
    """Reads the rows, and finds the end of the last whole one."""
    data = journal.path.read_bytes()
    end = done = 0
    for line in data.splitlines(keepends=True):
        row = decoded(line)
        done += len(line)
        if row is None:
            journal.broken += 1
        else:
            journal.rows[row.key] = row
            end = done
    if end < len(data):
        journal.torn, journal.broken = True, journal.broken - len(data[end:].splitlines())
    journal._end = end
    return journal


def encoded(row: Row) -> bytes:
    """Returns a row as a line: a checksum and JSON, in which every float keeps its bits."""
    text = json.dumps(asdict(row), separators=(",", ":")).encode()
    return b"%08x %b\n" % (zlib.crc32(text), text)


def decoded(line: bytes) -> Row | None:
    """Returns the row of a line, or None if the line isn't whole."""
    sum_, _, text = line.removesuffix(b"\n").partition(b" ")
    if not line.endswith(b"\n") or sum_ != b"%08x" % zlib.crc32(text):
        return None
    try:
        entry: dict[str, Any] = json.loads(text)
        return Row(task=TrialTask(**entry.pop("task")), **entry)
    except (KeyError, TypeError, ValueError):
        return None
