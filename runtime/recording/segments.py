"""The files of a recording in progress: `FILE.rrd.segments/000001.rrd`, each readable by itself.

`000000.rrd` is the recording itself as it grows: what was merged into it is in no other file any more. A batch is
written with one `write`: a killed process leaves whole messages and at most one torn message. What somebody deletes or
moves away during the run is written again, from the file that is still open.
"""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Sequence
from pathlib import Path

from srl.runtime.contracts.errors import RecordingError

ENDING = ".segments"
ENDINGS = (".rrd", ".rows")  # of its files: rerun's, and the form for a machine without it
GROWING = "000000.rrd"
SECONDS = 20.0  # of a segment: the longer, the less its drawing takes, and the more there is to do at the end
BYTES = 16 << 20  # of its rows before they are packed
HELD = 64  # segments that are kept open until they are merged
FIRST = 2.0  # s of a process's first segment: what stands before the first rows takes long to make


def folder_of(target: Path) -> Path:
    """The folder with the segments of a recording to `target`."""
    return target.with_name(target.name + ENDING)


def listed(folder: Path) -> list[Path]:
    """The files, the oldest rows first."""
    return sorted(p for p in folder.glob("*") if p.suffix in ENDINGS and p.stem.isdigit() and p.is_file())


def numbered(folder: Path) -> list[Path]:
    """The segments that aren't merged yet, oldest first."""
    return [file for file in listed(folder) if file.name != GROWING]


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


def claim(folder: Path) -> int:
    """Makes the folder, and holds it for this process as long as the returned descriptor is open.

    Raises:
        RecordingError: another recorder writes there, or the folder can't be made.
    """
    try:
        folder.mkdir(exist_ok=True)
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError as error:
        raise RecordingError(str(folder), f"it can't be made: {error.strerror}", "Choose another place") from None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise RecordingError(str(folder), "another run is being recorded there", "Choose another name") from None
    except OSError:
        pass  # a file system without locks: names that are there already are refused all the same
    return descriptor


class Segments:
    """Writes segments. A failed write leaves the file as it was, so that it can be tried again."""

    def __init__(self, folder: Path, prologue: bytes, ending: str = ENDINGS[0]) -> None:
        """`prologue`: what stands at the beginning of each file. `ending`: of their names, one of ENDINGS."""
        self.folder, self._ending = folder, ending
        self._prologue = prologue
        self._number = 0
        self._file: int | None = None
        self._unmerged: dict[Path, int] = {}  # the descriptors of closed ones
        self._size = self._weight = 0
        self._started, self._seconds = 0.0, FIRST

    def write(self, data: bytes, weight: int = 0) -> None:
        """Appends whole messages. When it returns, they have left this process.

        Args:
            data: the messages.
            weight: bytes of their rows before they were packed.
        Raises:
            OSError: the write failed; earlier data is unharmed.
        """
        self._keep_all()
        if self._file is not None and (self._weight >= BYTES or time.monotonic() - self._started >= self._seconds):
            self._seconds = SECONDS
            self._end()
        if self._file is None:
            self._begin()
        self._append(data)
        self._weight += weight

    @property
    def closed(self) -> list[Path]:
        """The segments that no more is written to, oldest first."""
        files = numbered(self.folder)
        return files if self._file is None else [file for file in files if int(file.stem) != self._number]

    def merged(self, segments: Sequence[Path]) -> None:
        """These are safe elsewhere."""
        for segment in segments:
            if (file := self._unmerged.pop(segment, None)) is not None:
                os.close(file)

    def close(self) -> None:
        """Ends the current file. Raises OSError if what was deleted can't be written again."""
        try:
            self._keep_all()
        finally:
            self._end()
            self.merged(list(self._unmerged))

    def _end(self) -> None:
        if self._file is not None:
            self._unmerged[self._path] = self._file
            self._file = None
            self.merged(list(self._unmerged)[:-HELD])  # merging has failed for long: descriptors are few

    @property
    def _path(self) -> Path:
        return self.folder / f"{self._number:06d}{self._ending}"

    def _keep_all(self) -> None:
        """Writes again what isn't in the folder. One that was merged just then is merged again, without new rows."""
        for path, file in self._unmerged.items():
            if not is_at(file, path):
                self._unmerged[path] = write_again(file, path)
        if self._file is not None and not is_at(self._file, self._path):
            self._file = write_again(self._file, self._path)

    def _begin(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        # A name isn't used again: its segment may be being merged.
        self._number = max([self._number, *(int(file.stem) for file in listed(self.folder))]) + 1
        self._file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o640)
        self._size = self._weight = 0
        self._started = time.monotonic()
        try:
            self._append(self._prologue)
        except OSError:
            os.close(self._file)
            self._file = None
            self._path.unlink()
            raise

    def _append(self, data: bytes) -> None:
        assert self._file is not None
        self._size = append(self._file, data, self._size)


def is_at(file: int, path: Path) -> bool:
    """Whether an open file is the one at this path."""
    try:
        return os.path.samestat(os.fstat(file), path.stat())
    except FileNotFoundError:
        return False


def write_again(file: int, path: Path) -> int:
    """Writes an open file that was deleted, or moved away, at `path` again. Closes it; returns the copy's descriptor.

    Raises:
        OSError: something else is there, or it can't be written; then nothing of it is left there.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    copy = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o640)
    try:
        at, size = 0, os.fstat(file).st_size
        while at < size:
            at += os.sendfile(copy, file, at, size - at)
        os.fsync(copy)
    except OSError:
        os.close(copy)
        path.unlink()
        raise
    os.close(file)
    return copy


def append(file: int, data: bytes, size: int) -> int:
    """Writes at the end of a file of `size` bytes and returns its new size.

    Raises:
        OSError: the write failed; the file is as it was.
    """
    rest = memoryview(data)
    try:
        while rest:
            rest = rest[os.write(file, rest) :]
    except OSError:
        os.ftruncate(file, size)
        os.lseek(file, size, os.SEEK_SET)
        raise
    return size + len(data)
