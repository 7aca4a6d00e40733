"""Prepares this process to keep deadlines and reports what the host did not allow."""

from __future__ import annotations

import ctypes
import gc
import os
import sys

PRIORITY = 80  # below the kernel's own threads (90 and up on PREEMPT_RT), above all ordinary processes
_MCL_CURRENT, _MCL_FUTURE = 1, 2
_PR_SET_PDEATHSIG, _PR_SET_TIMERSLACK = 1, 29
_libc = ctypes.CDLL(None, use_errno=True)


def enter(priority: int = PRIORITY) -> list[str]:
    """Sets SCHED_FIFO, locked memory and a timer slack of 1 ns; freezes garbage collection and turns it off.

    Returns:
        What the host did not allow, one sentence each, if possible with a remedy; empty without problems.
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
    sys.setswitchinterval(1e-4)  # a thread that opens a lost device yields soon
    gc.collect()
    gc.freeze()
    gc.disable()
    return refused


def _stay_awake() -> None:
    """Keeps the processors out of deep sleep as long as this process lives, if the host allows it."""
    try:
        descriptor = os.open("/dev/cpu_dma_latency", os.O_WRONLY | os.O_CLOEXEC)
        os.write(descriptor, (0).to_bytes(4, "little"))  # the request is valid until the descriptor is closed
    except OSError:
        pass


PARENT = "SRL_SUPERVISOR"  # environment: the supervisor's process id


def die_with_parent(signal_number: int) -> None:
    """Makes the kernel send `signal_number` to this process when its supervisor dies.

    If the supervisor has died already, this process ends at once.
    """
    _libc.prctl(_PR_SET_PDEATHSIG, signal_number, 0, 0, 0)
    if (parent := os.environ.get(PARENT)) and os.getppid() != int(parent):
        os._exit(1)
