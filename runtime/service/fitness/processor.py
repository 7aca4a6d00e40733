"""Checks whether the loop can wake in time here: priority, memory, timers, processors, and how late it wakes."""

from __future__ import annotations

import glob
import os
import re
import resource
import shlex
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from fractions import Fraction
from pathlib import Path

import numpy as np

from srl.runtime.contracts import compiled
from srl.runtime.loop.clock import MonotonicClock
from srl.runtime.loop.realtime import PRIORITY
from srl.runtime.service.fitness.finding import Finding, read

_CAP_IPC_LOCK = 14  # linux/capability.h
_ENOUGH = 1 << 30  # bytes of locked memory
_MODE = "/sys/kernel/debug/sched/preempt"
_BOOTED = "/proc/cmdline"
_PREEMPTIBLE, _FASTER = "preemptible, not PREEMPT_RT", "For 1 kHz beside heavy I/O take an RT kernel"
_GOVERNORS = "/sys/devices/system/cpu/cpu*/cpufreq/scaling_governor"


def kernel() -> Finding:
    """Whether the kernel can be interrupted."""
    version = os.uname().version
    if "PREEMPT_RT" in version:
        return Finding("kernel", "good", "PREEMPT_RT")
    if "PREEMPT_DYNAMIC" in version:
        return _switched(_mode())
    if "PREEMPT" in version:
        return Finding("kernel", "good", _PREEMPTIBLE, _FASTER)
    return Finding("kernel", "doubtful", "not preemptible", "Take a kernel with CONFIG_PREEMPT, or an RT kernel")


def _switched(mode: str) -> Finding:
    """A kernel whose boot option says whether it can be interrupted."""
    if mode in ("full", "lazy"):
        return Finding("kernel", "good", f"{_PREEMPTIBLE} (preempt={mode})", _FASTER)
    if mode:
        return Finding("kernel", "doubtful", f"not preemptible now (preempt={mode})", "Boot with preempt=full")
    return Finding(
        "kernel", "doubtful", "it can be preemptible, and only root may read whether it is",
        "If this doesn't say (full), boot with preempt=full", f"sudo cat {_MODE}",
    )  # fmt: skip


def _mode() -> str:
    """The mode of a PREEMPT_DYNAMIC kernel: none, voluntary, full or lazy; "" if this user can't know it."""
    if found := re.search(r"\((\w+)\)", read(_MODE)):
        return found[1]
    if given := re.findall(r"(?:^|\s)preempt=(\w+)", read(_BOOTED)):
        return str(given[-1])
    for name, mode in (("PREEMPT_NONE", "none"), ("PREEMPT_VOLUNTARY", "voluntary"), ("PREEMPT", "full")):
        if re.search(rf"^CONFIG_{name}=y$", read(f"/boot/config-{os.uname().release}"), re.MULTILINE):
            return mode
    return ""


def rights() -> Iterator[Finding]:
    """Whether this user gets real-time priority and locked memory."""
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        os.sched_setscheduler(0, policy, parameters)
        yield Finding("real-time priority", "good", f"SCHED_FIFO {PRIORITY} is granted")
    except PermissionError:
        yield Finding(
            "real-time priority", "bad", f"SCHED_FIFO {PRIORITY} is refused",
            f"As a service: LimitRTPRIO={PRIORITY}; by hand, then log in again", _limit("rtprio", str(PRIORITY)),
        )  # fmt: skip
    soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if _may_lock() or soft == resource.RLIM_INFINITY or soft >= _ENOUGH:
        yield Finding("locked memory", "good", "no limit that matters")
    else:
        yield Finding(
            "locked memory", "bad", f"limited to {soft / (1 << 20):.3g} MiB",
            "As a service: LimitMEMLOCK=infinity; by hand, then log in again", _limit("memlock", "unlimited"),
        )  # fmt: skip


def _limit(item: str, value: str) -> str:
    return f'echo "$USER - {item} {value}" | sudo tee -a /etc/security/limits.d/srl.conf'


def _may_lock() -> bool:
    """Whether this process has the capability, which root in a container may lack."""
    for line in read("/proc/self/status").splitlines():
        if line.startswith("CapEff:"):
            return bool(int(line.split()[1], 16) >> _CAP_IPC_LOCK & 1)
    return False


def throttling() -> Finding:
    """How much of the time real-time tasks get."""
    runtime = read("/proc/sys/kernel/sched_rt_runtime_us")
    period = read("/proc/sys/kernel/sched_rt_period_us") or "1000000"
    if runtime and runtime != "-1" and int(runtime) < 0.95 * int(period):
        return Finding(
            "real-time throttling", "doubtful", f"real-time tasks get {int(runtime) / int(period):.0%}",
            "Give them 95 %", f"sudo sysctl kernel.sched_rt_runtime_us={int(period) * 95 // 100}",
        )  # fmt: skip
    return Finding("real-time throttling", "good", "at its default or off")


def timers() -> Iterator[Finding]:
    """Whether the kernel's clocks are fine and quick."""
    resolution = time.clock_getres(time.CLOCK_MONOTONIC)
    if resolution > 1e-6:
        yield Finding(
            "timer", "bad", f"resolution {resolution * 1e3:g} ms", "Boot a kernel with high-resolution timers"
        )
    else:
        yield Finding("timer", "good", "high resolution")
    source = read("/sys/devices/system/clocksource/clocksource0/current_clocksource")
    if source and source not in ("tsc", "kvm-clock", "arch_sys_counter", "hyperv_clocksource_tsc_page"):
        yield Finding(
            "clock source", "doubtful", f"{source} is slow to read", "Boot with clocksource=tsc if the TSC is stable"
        )
    else:
        yield Finding("clock source", "good", source or "unknown")


def governor() -> Finding:
    """Whether the processors stay at their full clock."""
    governors = {read(p) for p in glob.glob(_GOVERNORS)}
    if governors - {"performance"}:
        return Finding(
            "processor clock", "doubtful", f"governor {', '.join(sorted(governors))}",
            "Until the next boot (to keep it: your distribution's cpufrequtils or tuned)",
            f"echo performance | sudo tee {_GOVERNORS}",
        )  # fmt: skip
    return Finding("processor clock", "good", "performance" if governors else "not scaled here")


def laws() -> Finding:
    """Whether the laws in C are there, and those of this package."""
    if not compiled.missing():
        return Finding("laws and guards", "good", compiled.available())
    if compiled.is_old():
        # A checkout is built where it is; what is installed comes again.
        checkout = Path(compiled.__file__).resolve().parents[2]
        package = f"-e {shlex.quote(str(checkout))}" if (checkout / "native").exists() else "srl-runtime"
        return Finding(
            "laws and guards", "doubtful", compiled.missing(), "Python computes them. Install the package again",
            f"{shlex.quote(sys.executable)} -m pip install --no-deps --force-reinstall {package}",
        )  # fmt: skip
    remedy = "Install srl-runtime where there is a C compiler; Python takes about five times as long"
    return Finding("laws and guards", "doubtful", compiled.missing(), remedy, "sudo apt install gcc python3-dev")


def jitter(rate: Fraction) -> Finding:
    """Runs the loop's own clock at the requested rate for half a second, at the priority it would get."""
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    clock = MonotonicClock(rate)
    clock.start()
    late = []
    for _ in range(max(50, round(float(rate) / 2))):
        tick = clock.wait()
        late.append(time.monotonic_ns() - tick.deadline)
    os.sched_setscheduler(0, policy, parameters)
    p50, p99, most = (float(x) / 1e3 for x in np.percentile(late, [50, 99, 100]))
    found = f"wakes {p50:.0f} us late (p99 {p99:.0f}, max {most:.0f})"
    share = p99 / (1e6 / float(rate))
    if share > 0.5:
        return Finding(
            "wake-up at this rate", "bad", found, "Lower the rate, end other load, isolate a core (isolcpus)"
        )
    if share > 0.1:
        return Finding(
            "wake-up at this rate", "doubtful", found, "End other load; isolate a core (isolcpus=) for the loop"
        )
    return Finding("wake-up at this rate", "good", found)
