"""The index of a folder's recordings: an SQLite file that saves reading them again.

It is a cache: whatever is in it can be made again from the files, and a damaged one is. An entry counts as long as size
and time of the recording's files stay the same. Where the folder can't be written, there is none.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
import stat
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from srl.runtime.contracts import extras
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.recording.segments import listed
from srl.runtime.recording.summary import Summary, summarize

NAME: Final = ".srl-recordings.sqlite"
VERSION: Final = 3  # of the table and of what a summary says
# of what `srl run --figure`, `srl export` and `srl recordings --export` make
MADE_OF: Final = (
    *(".png", ".jpg", ".jpeg", ".webp", ".pdf", ".svg", ".eps", ".gif"),
    *(".parquet", ".mcap", ".c3d", ".bvh", ".mat", ".trc", ".mot"),
)
# by which such a file says by what it was made; the other kinds don't
_MARKS: Final = {
    **dict.fromkeys((".png", ".pdf", ".svg", ".eps"), b"Matplotlib"),
    **{
        ".parquet": b"srl.layout",
        ".mcap": b"srl-runtime",
        ".c3d": b"SHA256",
        ".trc": b"srl-runtime",
        ".mot": b"srl-runtime",
    },
}
_ENDS: Final = 16 << 20  # bytes of a file's beginning and end, in which its mark is
_TIMEOUT: Final = 5.0  # s that another program may hold the index


@dataclass(frozen=True)
class Entry:
    """A recording of a folder.

    Attributes:
        path: the file, the folder of segments, or the black box.
        name: its path from the folder, with \\xNN for what is no UTF-8: it goes into the index, pages and terminals.
        size: of its files, bytes.
        summary: what it is.
        stamp: changes when its files do.
    """

    path: Path
    name: str
    size: int
    summary: Summary
    stamp: str


def entries(folder: Path, rebuild: bool = False, report: Callable[[str], None] = lambda text: None) -> list[Entry]:
    """The recordings in a folder and in those below it, the oldest first.

    Args:
        folder: where to look. The index is in it.
        rebuild: make the index anew from the files.
        report: is told where the index can't be used.
    Raises:
        RecordingError: there is no such folder, or it can't be read.
    """
    if not folder.is_dir():
        raise RecordingError(str(folder), "there is no such folder", "Name the folder with the recordings")
    try:
        found = sorted(_paths(folder))
    except OSError as error:
        raise RecordingError(str(folder), f"it can't be read: {error.strerror}", "Correct its permissions") from None
    made = []
    with _index(folder / NAME, rebuild, report) as index:
        for path in found:
            name = os.fsencode(path.relative_to(folder)).decode(errors="backslashreplace")
            stamp, size = stamped(path)
            summary = index.get(name, stamp)
            if summary is None:
                try:
                    summary = summarize(path)
                except ModuleNotFoundError as error:  # this machine's lack isn't kept for others
                    problem = f"it can't be read here: {error.name} isn't installed"
                    summary = Summary(problem=problem, remedy=extras.remedy(error.name or ""))
                else:
                    index.put(name, stamp, summary)
            made.append(Entry(path, name, size, summary, stamp))
        index.keep([entry.name for entry in made])
    return sorted(made, key=lambda e: (e.summary.began, e.name))


def made_of(path: Path) -> list[Path]:
    """The pictures and exports beside a recording: files of its name. No links, nothing write-protected.

    Nothing that is older than it, either, or that another program made: a motion capture or a form of the same trial
    wasn't made of it.
    """
    name = path.name.removesuffix(".segments")
    if not name.endswith(".rrd") or (name != path.name and path.with_name(name).exists()):
        return []  # a black box; or the finished recording's
    stem = name.removesuffix(".rrd")
    found = []
    for ending in MADE_OF:
        file = path.with_name(stem + ending)
        with contextlib.suppress(OSError):
            state, ended = file.lstat(), path.stat().st_mtime_ns
            ours = stat.S_ISREG(state.st_mode) and state.st_mode & stat.S_IWUSR and state.st_mtime_ns >= ended
            if ours and _marked(file, _MARKS.get(ending, b"")):
                found.append(file)
    return found


def _marked(file: Path, mark: bytes) -> bool:
    """Whether a file holds its kind's mark, near its beginning or its end."""
    if not mark:
        return True  # its kind has none
    with file.open("rb") as opened:
        if mark in opened.read(_ENDS):
            return True
        opened.seek(max(opened.seek(0, os.SEEK_END) - _ENDS, 0))
        return mark in opened.read()


def delete(entry: Entry) -> None:
    """Deletes a recording's files, and before them what was made of it and lies beside it.

    Raises:
        RecordingError: a process is writing or reading it, it has changed since it was listed, its folder holds
            something else, too, or it can't be deleted.
    """
    # A merge of segments that was killed left its copy of them.
    part = entry.path.with_name(f"{entry.path.name.removesuffix('.segments')}.part")
    segments = entry.path.name.endswith(".segments")
    if pid := _user(entry.path) or (_user(part) if segments else 0):
        raise RecordingError(str(entry.path), f"process {pid} has it open", "End the run, or the viewer, first")
    try:
        changed = stamped(entry.path)[0] != entry.stamp
    except OSError:
        changed = True  # it has gone, or a file of it has
    if changed:
        problem = "it has changed since it was listed, so it isn't what was chosen"
        raise RecordingError(str(entry.path), problem, "List them again")
    if others := _others(entry.path):
        problem = f"it also holds what is no part of a recording: {', '.join(others[:3])}"
        raise RecordingError(str(entry.path), problem, "Move that elsewhere first")
    try:
        for file in made_of(entry.path):
            file.unlink()
        if entry.path.is_dir():
            if segments:
                part.unlink(missing_ok=True)
            shutil.rmtree(entry.path)
        else:
            entry.path.unlink()
    except OSError as error:
        raise RecordingError(
            str(entry.path), f"it can't be deleted: {error.strerror}", "Correct its permissions"
        ) from None


def _paths(folder: Path) -> Iterator[Path]:
    """The recordings, each once: a folder of segments and a black box are one, whatever is in them."""

    def refuse(error: OSError) -> None:
        if Path(str(error.filename)) == folder:
            raise error

    for at, folders, files in os.walk(folder, onerror=refuse):
        here = Path(at)
        if here != folder and "rows.ring" in files and "layout.json" in files:
            folders.clear()
            yield here
            continue
        for name in [n for n in folders if n.endswith(".rrd.segments")]:
            folders.remove(name)
            if not (here / name).is_symlink():  # what it leads to belongs to another folder
                yield here / name
        yield from (here / name for name in files if name.endswith(".rrd") and not (here / name).is_symlink())


def stamped(path: Path) -> tuple[str, int]:
    """What changes when a recording's files do, and their size in bytes."""
    files = [path]
    if not path.is_file():
        there = listed(path) or (path.iterdir() if path.is_dir() else ())
        files = sorted(p for p in there if p.is_file())
    states = [p.stat() for p in files]
    return ";".join(f"{s.st_ino}:{s.st_size}:{s.st_mtime_ns}" for s in states), sum(s.st_size for s in states)


def _others(path: Path) -> list[str]:
    """What else is in a recording's folder: somebody's notes, or all of an instance that runs."""
    if not path.is_dir():
        return []
    box = {file.name for file in RunFolder(path).evidence} | {"notes.ring"}  # of 0.1.0, too
    own = box if (path / "rows.ring").exists() else {file.name for file in listed(path)}
    return sorted(p.name for p in path.iterdir() if p.name not in own)


def _user(path: Path) -> int:
    """The id of a process that has one of the files open; 0 for none that we may see."""
    inside = str(path.resolve())
    for process in Path("/proc").iterdir():
        if process.name.isdigit() and any(n == inside or n.startswith(f"{inside}/") for n in _opened(process)):
            return int(process.name)
    return 0


def _opened(process: Path) -> Iterator[str]:
    """The files that a process has open; none of a process that has ended or is another user's."""
    with contextlib.suppress(OSError):
        for link in list((process / "fd").iterdir()):
            with contextlib.suppress(OSError):  # closed meanwhile
                yield os.readlink(link)


class _Index:
    """The table; without a connection it knows nothing and keeps nothing."""

    def __init__(self, connection: sqlite3.Connection | None) -> None:
        self._connection = connection

    def get(self, name: str, stamp: str) -> Summary | None:
        if self._connection is None:
            return None
        row = self._connection.execute(
            "SELECT summary FROM recordings WHERE name = ? AND stamp = ?", (name, stamp)
        ).fetchone()
        try:
            return None if row is None else Summary.of(row[0])
        except (ValueError, KeyError, TypeError):
            return None

    def put(self, name: str, stamp: str, summary: Summary) -> None:
        if self._connection is not None:
            self._connection.execute("REPLACE INTO recordings VALUES (?, ?, ?)", (name, stamp, summary.text))

    def keep(self, names: list[str]) -> None:
        """Forgets all others."""
        if self._connection is not None:
            known = {row[0] for row in self._connection.execute("SELECT name FROM recordings")}
            self._connection.executemany("DELETE FROM recordings WHERE name = ?", [(n,) for n in known - set(names)])


@contextlib.contextmanager
def _index(path: Path, rebuild: bool, report: Callable[[str], None]) -> Iterator[_Index]:
    connection = _open(path, rebuild, report)
    index = _Index(connection)
    if connection is None:
        yield index
        return
    try:
        yield index
        connection.commit()
    except sqlite3.Error as error:
        raise RecordingError(str(path), f"the index can't be used: {error}", "Delete it, or add --rebuild") from None
    finally:
        connection.close()


def _open(path: Path, rebuild: bool, report: Callable[[str], None]) -> sqlite3.Connection | None:
    """Opens the index, or makes it. None where it can't be."""
    for attempt in range(2):
        connection = None
        try:
            if rebuild or attempt:
                path.unlink(missing_ok=True)
            os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600))  # it has persons' ids
            connection = sqlite3.connect(path, timeout=_TIMEOUT)
            connection.execute("PRAGMA secure_delete = ON")  # a person's ids go with the recordings
            if connection.execute("PRAGMA user_version").fetchone()[0] != VERSION:
                connection.execute("DROP TABLE IF EXISTS recordings")
                connection.execute("CREATE TABLE recordings (name TEXT PRIMARY KEY, stamp TEXT, summary TEXT)")
                connection.execute(f"PRAGMA user_version = {VERSION}")
            connection.execute("BEGIN IMMEDIATE")
            connection.execute("SELECT name, stamp, summary FROM recordings LIMIT 1").fetchone()
            if connection.execute("PRAGMA quick_check").fetchone()[0] != "ok":
                raise sqlite3.DatabaseError("it is damaged")
            return connection
        except (OSError, sqlite3.OperationalError) as error:  # a full or a read-only disk, or another program
            if connection is not None:
                connection.close()
            if attempt or not isinstance(error, sqlite3.OperationalError) or "no such" not in str(error):
                report(f"{path}: the index can't be used ({error}), so every recording is read")
                return None
        except sqlite3.DatabaseError:
            if connection is not None:
                connection.close()
            report(f"{path}: the index is damaged and is made anew")
    return None
