"""The control of a run, which one `srl panel` has at a time: a locked file in the run folder.

The kernel lets go of the lock with the process that holds it, however that ends. One that hangs keeps its lock. So the
holder writes a sign of life into the file, and where that is too old another puts a locked file of its own in its
place. Whoever wakes up then finds that the file isn't the one that it holds, and has lost the control.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import struct
import time
from typing import Final

from srl.runtime.ipc.run_folder import RunFolder

LAPSE: Final = 3.0  # s without a sign of life, of the page or of its server, after which the control ends
_TAKEN: Final = "Another `srl panel` of this run has control. Give it up on its page, or end that `srl panel`"
_LIFE: Final = struct.Struct("q")  # CLOCK_MONOTONIC ns


class Control:
    """This process's hold on the control."""

    def __init__(self, run_folder: RunFolder) -> None:
        self._path = run_folder.panel_lock
        self._lock: int | None = None

    @property
    def held(self) -> bool:
        """Whether this process has the control; False also after another has taken it from one that hung."""
        if self._lock is None:
            return False
        try:
            return os.path.samestat(os.fstat(self._lock), os.lstat(self._path))
        except OSError:
            return False

    def take(self) -> str:
        """Takes the control, if this process doesn't have it. Returns why it can't; "" if it has it now."""
        if self.held:
            self.live()
            return ""
        self.release()
        try:
            lock = _opened(self._path, os.O_CREAT)
        except OSError as error:
            return f"Control can't be taken: {error.strerror}: {self._path.name}"
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            silent = _silent(lock)
            os.close(lock)
            if not isinstance(error, BlockingIOError):
                return f"Control can't be taken: {error.strerror}"
            return self._replace() if silent else _TAKEN
        self._lock = lock
        self.live()
        return "" if self.held else _TAKEN

    def live(self) -> None:
        """A sign of life; to be given more often than each `LAPSE`."""
        if self._lock is not None:
            os.pwrite(self._lock, _LIFE.pack(time.monotonic_ns()), 0)

    def release(self) -> None:
        """Gives the control back."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _replace(self) -> str:
        """Takes the control from one that gives no sign of life. Of two who do so at once the later one has it."""
        scratch = self._path.with_name(f".{self._path.name}.{os.getpid()}")
        try:
            with contextlib.suppress(FileNotFoundError):
                scratch.unlink()
            self._lock = _opened(scratch, os.O_CREAT | os.O_EXCL)
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self.live()
            os.replace(scratch, self._path)
        except OSError as error:
            self.release()
            return f"Control can't be taken: {error.strerror}: {self._path.name}"
        return ""


def _opened(path: os.PathLike[str], flags: int) -> int:
    return os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW | flags, 0o600)


def _silent(lock: int) -> bool:
    """Whether the holder of a lock has given no sign of life for too long."""
    data = os.pread(lock, _LIFE.size, 0)
    return len(data) == _LIFE.size and time.monotonic_ns() - _LIFE.unpack(data)[0] > LAPSE * 1e9
