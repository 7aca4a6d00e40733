"""Makes this process fit to keep deadlines; says what the host didn't allow."""

from __future__ import annotations

import ctypes
import gc
import os
import sys

PRIORITY = 80  # below the kernel's own threads (90 and up on PREEMPT_RT), above everything ordinary
_MCL_CURRENT, _MCL_FUTURE = 1, 2
_PR_SET_PDEATHSIG, _PR_SET_TIMERSLACK = 1, 29
_libc = ctypes.CDLL(None, use_errno=True)


def enter(priority: int = PRIORITY) -> list[str]:
    """SCHED_FIFO, locked memory, timer slack of 1 ns, garbage collection frozen and off.

    Returns:
        What could not be had, a sentence each with its remedy; empty when all is well.
    """
    refused = []
    try:
        # Children (a reopening thread, a helper) must not inherit the priority.
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except PermissionError:
        refused.append("no real-time priority: raise LimitRTPRIO (systemd) or `ulimit -r` to 80")
    if _libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) != 0:
        refused.append("memory isn't locked: raise LimitMEMLOCK (systemd) or `ulimit -l`")
    if _libc.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0) != 0:
        refused.append("timer slack can't be set")
    _stay_awake()
    sys.setswitchinterval(1e-4)  # a thread that opens a lost device gives way soon
    gc.collect()
    gc.freeze()
    gc.disable()
    return refused


def _stay_awake() -> None:
    """Asks the processors not to sleep deeply, for as long as this process lives; where the host lets us."""
    try:
        descriptor = os.open("/dev/cpu_dma_latency", os.O_WRONLY | os.O_CLOEXEC)
        os.write(descriptor, (0).to_bytes(4, "little"))  # the request stands until the descriptor is closed
    except OSError:
        pass


PARENT = "SRL_SUPERVISOR"  # environment: the supervisor's process id


def die_with_parent(signal_number: int) -> None:
    """This process gets `signal_number` when its supervisor dies; it ends at once if that has happened already."""
    _libc.prctl(_PR_SET_PDEATHSIG, signal_number, 0, 0, 0)
    if (parent := os.environ.get(PARENT)) and os.getppid() != int(parent):
        os._exit(1)
