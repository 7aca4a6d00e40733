"""The files of a recording in progress: `FILE.rrd.segments/000001.rrd`, each readable by itself.

A batch is written with one `write`: a killed process leaves whole messages and at most one torn message.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

from runtime.contracts.errors import RecordingError

SECONDS = 60.0
BYTES = 64 << 20


def folder_of(target: Path) -> Path:
    """The folder with the segments of a recording to `target`."""
    return target.with_name(f"{target.name}.segments")


def listed(folder: Path) -> list[Path]:
    """The segments, oldest first."""
    return sorted(p for p in folder.glob("*.rrd") if p.stem.isdigit())


def check_target(target: Path) -> None:
    """Checks that a recording to `target` can begin.

    Raises:
        RecordingError: a recording exists there already, finished or not, or the folder can't be written.
    """
    if target.suffix != ".rrd":
        raise RecordingError(str(target), "the name doesn't end in .rrd", "Name it like run.rrd")
    if target.exists():
        raise RecordingError(str(target), "a recording is there already", "Move it away or choose another name")
    folder = folder_of(target)
    if folder.exists() and any(folder.iterdir()):
        problem = "the segments of an unfinished recording are there already"
        raise RecordingError(
            str(folder), problem, "Move them away (they can be read as they are) or choose another name"
        )
    if not target.parent.is_dir() or not os.access(target.parent, os.W_OK):
        raise RecordingError(str(target.parent), "the folder can't be written", "Make it, or choose another place")


class Segments:
    """Writes segments. A failed write leaves the file as it was, so that it can be tried again."""

    def __init__(self, folder: Path, prologue: bytes) -> None:
        """`prologue`: stream header and messages at the beginning of each file."""
        self.folder = folder
        self._prologue = prologue
        self._file: int | None = None
        self._size = 0
        self._begun = 0.0

    def write(self, data: bytes) -> None:
        """Appends whole messages. When it returns, they have left this process.

        Raises:
            OSError: the write failed; earlier data is unharmed.
        """
        if self._file is not None and (self._size >= BYTES or time.monotonic() - self._begun >= SECONDS):
            self.close()
        if self._file is None:
            self._begin()
        self._append(data)

    def close(self) -> None:
        """Ends the current file."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _begin(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        last = listed(self.folder)
        path = self.folder / f"{int(last[-1].stem) + 1 if last else 1:06d}.rrd"
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o640)
        self._size = 0
        self._begun = time.monotonic()
        try:
            self._append(self._prologue)
        except OSError:
            self.close()
            path.unlink()
            raise

    def _append(self, data: bytes) -> None:
        assert self._file is not None
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[os.write(self._file, rest) :]
        except OSError:
            os.ftruncate(self._file, self._size)
            os.lseek(self._file, self._size, os.SEEK_SET)
            raise
        self._size += len(data)
