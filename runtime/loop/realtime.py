"""Prepares this process to keep deadlines and reports what the host did not allow."""

from __future__ import annotations

import ctypes
import gc
import os
import resource
import sys

PRIORITY = 80  # below the kernel's own threads (90 and up on PREEMPT_RT), above all ordinary processes
# ns that the loop may compute, plus two periods, without a sleep. Then the kernel kills it (RLIMIT_RTTIME): nothing of
# ordinary priority, such as the supervisor, may get this processor meanwhile. Above the supervisor's own patience.
STUCK = 150_000_000
_MCL_CURRENT, _MCL_FUTURE = 1, 2
_PR_SET_TIMERSLACK = 29
_libc = ctypes.CDLL(None, use_errno=True)


def enter(stuck: int | None = None, priority: int = PRIORITY) -> list[str]:
    """Locks memory, sets a timer slack of 1 ns, freezes garbage collection and turns it off, and sets SCHED_FIFO.

    Args:
        stuck: ns of computing without a sleep, at real-time priority, after which the kernel ends this process
            (SIGXCPU); None: as long as it likes.
        priority: of SCHED_FIFO.
    Returns:
        What the host did not allow, one sentence each, if possible with a remedy; empty without problems.
    """
    refused = []
    if _libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) != 0:
        refused.append("memory isn't locked: raise LimitMEMLOCK (systemd) or `ulimit -l`")
    if _libc.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0) != 0:
        refused.append("timer slack can't be set")
    _stay_awake()
    sys.setswitchinterval(1e-4)  # a thread that opens a lost device yields soon
    gc.collect()
    gc.freeze()
    gc.disable()
    # Last: what stands above computes for a tenth of a second, which would count towards `stuck`.
    try:
        # Children (a reopening thread, a helper) must not inherit the priority.
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except PermissionError:
        refused.append("no real-time priority: raise LimitRTPRIO (systemd) or `ulimit -r` to 80")
    if stuck is not None:
        _, most = resource.getrlimit(resource.RLIMIT_RTTIME)
        wanted = stuck // 1000
        resource.setrlimit(
            resource.RLIMIT_RTTIME, (wanted if most == resource.RLIM_INFINITY else min(wanted, most), most)
        )
    return refused


def leave(pid: int = 0) -> None:
    """Gives the real-time priority of a process up (0: of this one), for what may take long after the last cycle.

    It may also be done to another process of the same user. Raises OSError if that has gone.
    """
    os.sched_setscheduler(pid, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))


def _stay_awake() -> None:
    """Keeps the processors out of deep sleep as long as this process lives, if the host allows it."""
    try:
        descriptor = os.open("/dev/cpu_dma_latency", os.O_WRONLY | os.O_CLOEXEC)
        os.write(descriptor, (0).to_bytes(4, "little"))  # the request is valid until the descriptor is closed
    except OSError:
        pass
