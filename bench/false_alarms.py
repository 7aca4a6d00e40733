"""How near a limb that obeys comes to its following error: `python -m bench.false_alarms --minutes 60 [PROFILE ...]`.

Each profile runs on its fakes, step by step, with the fault campaign's client and no fault, a minute a seed. What is
printed: time in motion, the largest error as a share of its window, and what stopped the limb. Simulated.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from typing import Any

import numpy as np

from srl.studies.faults.device_trial import Bench
from srl.studies.faults.study import variants

MINUTE = 60.0  # s of the world's time a seed
EVERY = 10  # cycles between two looks


class Watched(Bench):
    """A bench that looks at the monitors of the following error."""

    largest, command, moving, looked = 0.0, "", 0, 0

    def _cycle(self, kind: Any) -> None:
        super()._cycle(kind)
        if self.state != "active":
            return
        self.moving += 1
        if self.moving % EVERY:
            return
        monitors = self.machine_cycle._feedback._monitors
        for monitor, actuator in zip(monitors, self.graph.actuators, strict=True):
            if monitor is not None:
                self.looked += 1
                share = float(np.max(np.abs(monitor.errors()) / monitor.window))
                if share > self.largest:
                    self.largest, self.command = share, actuator.name


def watch(profile: str, choices: list[str], minutes: float) -> dict[str, Any]:
    """What a profile did in so many minutes of motion."""
    moving, largest, command, ends = 0.0, 0.0, "", Counter[str]()
    for seed in range(1, 1 + round(3 * minutes + 3)):
        if moving >= 60.0 * minutes:
            break
        with Watched(profile, [*choices, f"seed={seed}"], seed) as bench:
            bench.begin()
            end = bench.time + min(MINUTE, 60.0 * minutes - moving)
            while bench.time < end and bench.state == "active":
                bench.run(0.5)
            moving += bench.moving * bench.dt
            if not bench.looked:
                return {"profile": profile, "choices": choices, "monitored": False}
            if bench.largest > largest:
                largest, command = bench.largest, bench.command
            if bench.state != "active":
                ends[bench.cause] += 1
    return {
        "profile": profile, "choices": choices, "moving_s": round(moving, 1), "largest_share": round(largest, 3),
        "command": command, "ends": dict(ends),
    }  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("profiles", nargs="*")
    parser.add_argument("--minutes", type=float, default=60.0)
    given = parser.parse_args()
    false = 0
    for name, choices in variants():
        if given.profiles and name not in given.profiles:
            continue
        found = watch(name, list(choices), given.minutes)
        false += found.get("ends", {}).get("following_error", 0)
        print(json.dumps(found), flush=True)
    return 1 if false else 0


if __name__ == "__main__":
    sys.exit(main())
