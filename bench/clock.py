"""Wake-up latency of the loop's clock, compared at the same priority with peers that wait in the same way.

Sleeping: ours without its spin, cyclictest (C) and loop-rate-limiters (Python). Spinning: ours as it is, which sleeps
first and spins the last 60 us, and the same written by hand in C.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import time
from fractions import Fraction
from pathlib import Path

import numpy as np

from bench.by_hand import compiled
from bench.pairs import PAIRS, Row, measure
from srl.runtime.loop import clock as clocks
from srl.runtime.loop import realtime
from srl.runtime.loop.clock import MonotonicClock


def run(rate: int) -> list[Row]:
    """Measures at `rate` Hz; a run takes about 1 s at 100 Hz, 0.5 s at 1 kHz."""
    count = 100 if rate <= 100 else rate // 2
    id = f"clock-{rate}hz" if rate < 1000 else f"clock-{rate // 1000}khz"
    sleeping = {"loop-rate-limiters": lambda: _worker("limiter", rate, count)}
    if shutil.which("cyclictest"):
        sleeping["cyclictest"] = lambda: _cyclictest(rate, count)
    with compiled("clock") as program:
        policies = {
            "sleeping": (measure(lambda: _worker("sleeping", rate, count), sleeping, PAIRS), sleeping),
            "spinning": (
                measure(
                    lambda: _worker("spinning", rate, count), {"by hand in C": lambda: _c(program, rate, count)}, PAIRS
                ),
                ("by hand in C",),
            ),
        }
    return [
        pairs.row(id, f"wake-up latency at {rate} Hz, {policy}, {figure}", figure, other, "us")
        for policy, (pairs, others) in policies.items()
        for other in others
        for figure in ("p50", "p99")
    ]


def _worker(kind: str, rate: int, count: int) -> dict[str, float]:
    command = [sys.executable, "-m", "bench.clock", kind, str(rate), str(count)]
    found: dict[str, float] = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return found


def _cyclictest(rate: int, count: int) -> dict[str, float]:
    command = ["cyclictest", "-v", "-t1", f"-p{realtime.PRIORITY}", "-m", f"-i{1_000_000 // rate}", f"-l{count}"]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return _metrics([float(m[1]) for m in re.finditer(r"^\s*0:\s*\d+:\s*(\d+)\s*$", text, re.MULTILINE)])


def _c(program: Path, rate: int, count: int) -> dict[str, float]:
    command = [str(program), str(clocks.SECOND // rate), str(count), str(realtime.PRIORITY), str(clocks.SPIN)]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return _metrics([float(line) for line in text.splitlines()])


def _metrics(latencies: list[float]) -> dict[str, float]:
    p50, p99 = np.percentile(latencies, [50, 99])
    return {"p50": float(p50), "p99": float(p99)}


def _measure(kind: str, rate: int, count: int) -> dict[str, float]:
    realtime.enter()
    late = []
    if kind in ("sleeping", "spinning"):
        if kind == "sleeping":
            clocks.SPIN = 0
        clock = MonotonicClock(Fraction(rate))
        clock.start()
        for _ in range(count):
            tick = clock.wait()
            late.append((time.monotonic_ns() - tick.deadline) / 1e3)
    else:
        from loop_rate_limiters import RateLimiter

        limiter = RateLimiter(rate, warn=False)
        for _ in range(count):
            due = limiter.next_tick
            limiter.sleep()
            late.append((time.perf_counter() - due) * 1e6)
    return _metrics(late)


if __name__ == "__main__":
    print(json.dumps(_measure(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))))
