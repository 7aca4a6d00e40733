"""Checks whether this host is fit for a rate. Each finding states its meaning and a remedy."""

from __future__ import annotations

import glob
import os
import resource
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Literal

import numpy as np

from runtime.contracts import compiled
from runtime.ipc.run_folder import base, free_bytes
from runtime.loop.clock import MonotonicClock
from runtime.loop.realtime import PRIORITY
from runtime.profile.ports import local_path
from runtime.service.serial_ports import holder, obstacle

Verdict = Literal["good", "doubtful", "bad"]


@dataclass(frozen=True)
class Finding:
    """The result of one check."""

    what: str
    verdict: Verdict
    found: str
    remedy: str = ""


def examine(rate: Fraction, ports: dict[str, str]) -> Iterator[Finding]:
    """Checks the host.

    Args:
        rate: the loop's rate, Hz.
        ports: by device name, the port of each device that has one.
    """
    yield _kernel()
    yield from _rights()
    yield _throttling(rate)
    yield from _timers()
    yield _governor()
    yield _memory_folder()
    yield _disk()
    yield _laws()
    for name, port in ports.items():
        yield from _port(name, port)
    yield from _latency_timers(rate)
    yield _jitter(rate)


def _read(path: str) -> str:
    try:
        return Path(path).read_text().strip()
    except OSError:
        return ""


def _laws() -> Finding:
    if not compiled.missing():
        return Finding("laws and guards", "good", compiled.available())
    remedy = "Install srl-runtime where there is a C compiler; Python takes about five times as long"
    return Finding("laws and guards", "doubtful", compiled.missing(), remedy)


def _kernel() -> Finding:
    version = os.uname().version
    if "PREEMPT_RT" in version:
        return Finding("kernel", "good", "PREEMPT_RT")
    if "PREEMPT" in version:
        return Finding("kernel", "good", "preemptible, not PREEMPT_RT", "For 1 kHz beside heavy I/O take an RT kernel")
    return Finding("kernel", "doubtful", "not preemptible", "Boot with preempt=full, or take an RT kernel")


def _rights() -> Iterator[Finding]:
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        os.sched_setscheduler(0, policy, parameters)
        yield Finding("real-time priority", "good", f"SCHED_FIFO {PRIORITY} is granted")
    except PermissionError:
        yield Finding(
            "real-time priority", "bad", f"SCHED_FIFO {PRIORITY} is refused",
            f"As a service: LimitRTPRIO={PRIORITY}; by hand: '@srl - rtprio {PRIORITY}' in /etc/security/limits.d",
        )  # fmt: skip
    soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    privileged = os.geteuid() == 0
    if privileged or soft == resource.RLIM_INFINITY or soft >= 1 << 30:
        yield Finding("locked memory", "good", "no limit that matters")
    else:
        yield Finding(
            "locked memory", "bad", f"limited to {soft >> 20} MiB",
            "As a service: LimitMEMLOCK=infinity; by hand: '@srl - memlock unlimited' in /etc/security/limits.d",
        )  # fmt: skip


def _throttling(rate: Fraction) -> Finding:
    runtime = _read("/proc/sys/kernel/sched_rt_runtime_us")
    period = _read("/proc/sys/kernel/sched_rt_period_us") or "1000000"
    if runtime and runtime != "-1" and int(runtime) < 0.95 * int(period):
        return Finding(
            "real-time throttling", "doubtful", f"real-time tasks get {int(runtime) / int(period):.0%}",
            "sysctl kernel.sched_rt_runtime_us=950000",
        )  # fmt: skip
    return Finding("real-time throttling", "good", "at its default or off")


def _timers() -> Iterator[Finding]:
    resolution = time.clock_getres(time.CLOCK_MONOTONIC)
    if resolution > 1e-6:
        yield Finding(
            "timer", "bad", f"resolution {resolution * 1e3:g} ms", "Boot a kernel with high-resolution timers"
        )
    else:
        yield Finding("timer", "good", "high resolution")
    source = _read("/sys/devices/system/clocksource/clocksource0/current_clocksource")
    if source and source not in ("tsc", "kvm-clock", "arch_sys_counter", "hyperv_clocksource_tsc_page"):
        yield Finding(
            "clock source", "doubtful", f"{source} is slow to read", "Boot with clocksource=tsc if the TSC is stable"
        )
    else:
        yield Finding("clock source", "good", source or "unknown")


def _governor() -> Finding:
    governors = {_read(p) for p in glob.glob("/sys/devices/system/cpu/cpu*/cpufreq/scaling_governor")}
    if governors - {"performance"}:
        return Finding(
            "processor clock", "doubtful", f"governor {', '.join(sorted(governors))}",
            "cpupower frequency-set -g performance",
        )  # fmt: skip
    return Finding("processor clock", "good", "performance" if governors else "not scaled here")


def _memory_folder() -> Finding:
    folder = base()
    at = folder
    while not at.exists():
        at = at.parent
    mounts = [line.split()[1:3] for line in Path("/proc/mounts").read_text().splitlines()]
    kind = max(
        ((m, k) for m, k in mounts if str(at).startswith(m.rstrip("/") + "/") or str(at) == m), key=lambda x: len(x[0])
    )[1]
    if not os.access(at, os.W_OK):
        return Finding(
            "runtime folder", "bad", f"{folder} can't be written", "Set SRL_RUNTIME_DIR to a folder of yours on tmpfs"
        )
    if kind not in ("tmpfs", "ramfs"):
        return Finding(
            "runtime folder",
            "doubtful",
            f"{folder} is on {kind}, not in memory",
            "Set SRL_RUNTIME_DIR to a folder on tmpfs",
        )
    return Finding("runtime folder", "good", f"{folder} is in memory")


def _disk() -> Finding:
    free = free_bytes(Path.cwd())
    if free < 2 << 30:
        return Finding("disk", "doubtful", f"{free >> 20} MiB free here", "Make room before you record")
    return Finding("disk", "good", f"{free >> 30} GiB free here")


def _port(name: str, port: str) -> Iterator[Finding]:
    path = local_path(port)
    if path is None:
        return
    what = f"port of {name}"
    lack = obstacle(port)
    if lack is None and (program := holder(path)) is not None:
        yield Finding(what, "doubtful", f"{path}: {program} has it open", "End that program, if it isn't this run")
    elif lack is None:
        yield Finding(what, "good", f"{path} may be opened")
    elif os.path.exists(path):
        yield Finding(what, "bad", *lack)
    else:
        yield Finding(what, "bad", lack.problem, f"{lack.remedy}; set it with --set devices.{name}.port=...")


def _latency_timers(rate: Fraction) -> Iterator[Finding]:
    for path in sorted(glob.glob("/sys/bus/usb-serial/devices/*/latency_timer")):
        milliseconds = int(_read(path) or 0)
        name = path.split("/")[-2]
        if milliseconds > 1 and milliseconds * 1e-3 > 0.2 / float(rate):
            yield Finding(
                f"USB latency of {name}", "doubtful", f"{milliseconds} ms: each answer may wait that long",
                f"echo 1 > {path}, or the udev rule in docs/devices",
            )  # fmt: skip
        else:
            yield Finding(f"USB latency of {name}", "good", f"{milliseconds} ms")


def _jitter(rate: Fraction) -> Finding:
    """Runs the loop's own clock at the requested rate for half a second, at the priority it would get."""
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError:
        pass
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


def python() -> str:
    """The interpreter and the host, for the head of the report."""
    return f"Python {sys.version.split()[0]}, {os.cpu_count()} cores, Linux {os.uname().release}"
