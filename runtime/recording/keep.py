"""How long recordings are kept where a profile says so (`record.keep`). Without it nothing is ever deleted.

Only whole recordings of the same folder are deleted, the oldest first, and of no other person than the run's. Each
deletion is first written down in the folder's `LEDGER`, so none goes unrecorded, whatever is killed.
"""

from __future__ import annotations

import ctypes
import json
import os
import stat
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.ipc.layout import Layout
from srl.runtime.recording import plain
from srl.runtime.recording.index import Entry, delete, made_of, stamped
from srl.runtime.recording.segments import ENDING, listed
from srl.runtime.recording.source import Source
from srl.runtime.recording.summary import Summary, persons

LEDGER: Final = ".srl-deleted.jsonl"
_RESERVE: Final = 1 << 16  # bytes of disk space that the ledger has at least beyond its end
_KEEP_SIZE: Final = 1  # FALLOC_FL_KEEP_SIZE: the file's size stays what it is
_DAY: Final = 86400.0
_UNSET: Final = 5  # TIME_ERROR of adjtimex: nothing keeps the clock right
_SYNCHRONIZED: Final = Path("/run/systemd/timesync/synchronized")  # for a service that may not ask the kernel


@dataclass(frozen=True)
class Keep:
    """What is kept.

    Attributes:
        days: what ended earlier is deleted; None: nothing is by its age.
        bytes: what a folder's recordings may take; None: any.
    """

    days: float | None = None
    bytes: float | None = None

    @classmethod
    def of(cls, options: Mapping[str, Any] | None) -> Keep:
        """From `record.keep` of a profile, or of a layout that holds it."""
        size = (options or {}).get("gigabytes")
        return cls((options or {}).get("days"), None if size is None else size * 1e9)


@dataclass(frozen=True)
class _File:
    path: Path
    size: int
    ended: float  # Unix time, s, of its last change
    spared: str  # why it is none that may go; "": it may


def make_room(folder: Path, keep: Keep, mine: Collection[str], report: Callable[[str], None]) -> str:
    """Deletes what a folder needn't keep.

    Args:
        folder: whose recordings; those in folders below it don't count.
        keep: what is kept.
        mine: the persons whose recordings may go. Nobody's may go, too.
        report: is told each deletion, and what stands in its way.
    Returns:
        Why the folder holds more than `keep` allows all the same; "": it doesn't.
    """
    if keep == Keep():
        return ""
    with suppress(OSError), _ledger(folder):
        pass  # room for its next lines: on a full disk there is none to be had
    try:
        files = sorted(_files(folder), key=lambda file: (file.ended, file.path.name))
    except OSError as error:
        return f"it can't be read: {error.strerror}"
    total, now = sum(file.size for file in files), time.time()
    days = keep.days if keep.days is None or clock_is_kept() else None
    if days != keep.days:
        report(f"{folder}: nothing keeps this computer's clock right, so no recording is deleted by its age")
    for file in files:
        old = days is not None and now - file.ended > days * _DAY
        over = keep.bytes is not None and total > keep.bytes
        if not (old or over):
            break  # the others are younger
        if file.spared or _spared(file.path, mine):
            continue
        why = f"it is older than {days:g} days" if old else f"the folder holds more than {_gigabytes(keep.bytes)}"
        try:
            entry = Entry(file.path, file.path.name, file.size, Summary(), stamped(file.path)[0])
            beside = strike(folder, entry, why)
        except (OSError, RecordingError) as error:
            report(f"{file.path} stays: {error}")
            continue
        total -= file.size
        others = f" with {', '.join(beside)}" if beside else ""
        report(f"{file.path} was deleted{others} ({_gigabytes(file.size)}): {why}")
    if keep.bytes is None or total <= keep.bytes:
        return ""
    return f"its recordings take {_gigabytes(total)} of {_gigabytes(keep.bytes)}, and no more of them may be deleted"


def strike(folder: Path, entry: Entry, why: str) -> list[str]:
    """Writes down that a recording is deleted, and deletes it with what was made of it and lies beside it.

    Returns:
        The names of those pictures and exports.
    Raises:
        OSError: it can't be written down; nothing was deleted.
        RecordingError: as `delete`; that is written down, too.
    """
    ended, beside = _utc(entry.path.stat().st_mtime), [file.name for file in made_of(entry.path)]
    _note(folder, entry, ended, why, beside)
    try:
        delete(entry)
    except RecordingError as error:
        _note(folder, entry, ended, f"it stays: {error.problem}", [])
        raise
    return beside


def _note(folder: Path, entry: Entry, ended: str, why: str, beside: list[str]) -> None:
    deletion = {"at": _utc(time.time()), "name": entry.name, "bytes": entry.size, "ended": ended, "why": why}
    deletion |= {"with": beside} if beside else {}
    with _ledger(folder) as descriptor:
        line, size = (json.dumps(deletion) + "\n").encode(), os.fstat(descriptor).st_size
        if size and os.pread(descriptor, 1, size - 1) != b"\n":
            line = b"\n" + line  # a full disk took half a line
        if os.write(descriptor, line) != len(line):
            raise OSError(0, f"the deletion can't be written down in {LEDGER}")
        os.fsync(descriptor)


@contextmanager
def _ledger(folder: Path) -> Iterator[int]:
    """The ledger's descriptor. Disk space for lines to come is taken beforehand, where the file system can do so."""
    flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
    descriptor = os.open(folder / LEDGER, flags, 0o600)
    try:
        size = os.fstat(descriptor).st_size
        ctypes.CDLL(None).fallocate(
            descriptor, _KEEP_SIZE, ctypes.c_int64(size // _RESERVE * _RESERVE), ctypes.c_int64(2 * _RESERVE)
        )
        yield descriptor
    finally:
        os.close(descriptor)


def clock_is_kept() -> bool:
    """Whether a time service keeps the computer's clock right. One that jumped would make everything old."""
    state: int = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(512))  # modes = 0: it only asks
    return state < _UNSET if state >= 0 else _SYNCHRONIZED.exists()


def _files(folder: Path) -> list[_File]:
    """What takes a folder's room: recordings, and the segments of unfinished ones. No links."""
    found = []
    for item in os.scandir(folder):
        if item.is_dir(follow_symlinks=False) and item.name.endswith(f".rrd{ENDING}"):
            try:
                size = stamped(Path(item.path))[1]
            except FileNotFoundError:
                continue  # merged meanwhile
            whole = plain.ended(listed(Path(item.path)))
            found.append(_File(Path(item.path), size, item.stat().st_mtime, "" if whole else "it isn't finished"))
        elif item.is_file(follow_symlinks=False) and item.name.endswith(".rrd"):
            state = item.stat()
            kept = "" if state.st_mode & stat.S_IWUSR else "it is write-protected"
            found.append(_File(Path(item.path), state.st_size, state.st_mtime, kept))
    return found


def _spared(path: Path, mine: Collection[str]) -> bool:
    """Whether a recording isn't known to be one of these persons', or nobody's."""
    try:
        files = listed(path) if path.is_dir() else [path]
        return not set(persons(Layout.from_json(Source(files).head()))) <= set(mine)
    except Exception:  # whatever a damaged file makes a library do: nobody knows whose it is
        return True


def _gigabytes(size: float | None) -> str:
    return f"{(size or 0) / 1e9:.3g} GB"


def _utc(when: float) -> str:
    return datetime.fromtimestamp(when, UTC).isoformat(timespec="seconds")
