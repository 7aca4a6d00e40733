"""The control of a run, which one `srl panel` has at a time: a lock in the run folder.

The kernel lets go of it with the process that holds it, however that ends. One that hangs keeps it, until it is ended.
"""

from __future__ import annotations

import fcntl
import os
from typing import Final

from runtime.ipc.run_folder import RunFolder

_TAKEN: Final = "Another `srl panel` of this run has control. Give it up on its page, or end that `srl panel`"


class Control:
    """This process's hold on the control."""

    def __init__(self, run_folder: RunFolder) -> None:
        self._path = run_folder.panel_lock
        self._lock: int | None = None

    def take(self) -> str:
        """Takes the control, if this process doesn't have it. Returns why it can't; "" if it has it now."""
        if self._lock is not None:
            return ""
        try:
            lock = os.open(self._path, os.O_RDONLY | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        except OSError as error:
            return f"Control can't be taken: {error.strerror}: {self._path.name}"
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(lock)
            return _TAKEN if isinstance(error, BlockingIOError) else f"Control can't be taken: {error.strerror}"
        self._lock = lock
        return ""

    def release(self) -> None:
        """Gives the control back."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None
