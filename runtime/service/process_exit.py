"""Whether a process is about to end, before its parent is told.

The kernel frees a process's memory first and closes its descriptors afterwards. Where the memory is locked that takes
tens of milliseconds, in which nothing of the process runs any more.
"""

from __future__ import annotations

import os
import signal

_EXITING = 0x4  # PF_EXITING, include/linux/sched.h
_STATE, _FLAGS, _PENDING = 0, 6, 28  # proc(5), /proc/PID/stat: fields 3, 9 and 31, counted from the state
_KILLED = 1 << (signal.SIGKILL - 1)


class ProcessExit:
    """Looks at one process; see the module's docstring. Nothing is opened later."""

    def __init__(self, pid: int) -> None:
        """Opens the process's statistics. Without /proc no death is ever seen here."""
        try:
            self._stat = os.open(f"/proc/{pid}/stat", os.O_RDONLY | os.O_CLOEXEC)
        except OSError:
            self._stat = -1

    def seen(self) -> bool:
        """True once the process ends, has ended, or was killed and hasn't run since."""
        if self._stat < 0:
            return False
        try:
            line = os.pread(self._stat, 1024, 0)
        except OSError:
            return True  # ESRCH: it is gone
        fields = line[line.rindex(b")") + 2 :].split()
        return (
            fields[_STATE] in (b"Z", b"X")
            or bool(int(fields[_FLAGS]) & _EXITING)
            or bool(int(fields[_PENDING]) & _KILLED)
        )

    def close(self) -> None:
        """Closes the descriptor."""
        if self._stat >= 0:
            os.close(self._stat)
        self._stat = -1
