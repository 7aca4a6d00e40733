"""Laws and guards in C compared with the same ones in Python: the decisions of a cycle over one simulated run's rows.

Ours is C. Interleaved blocks in one process at real-time priority, back to back.
"""

from __future__ import annotations

import gc
import json
import subprocess
import sys
from dataclasses import replace

from bench.pairs import Pairs, Row, measure
from bench.superman import BLOCK, PHASES, Decisions
from srl.runtime.contracts.compiled import available, missing
from srl.runtime.loop import realtime

# s of simulated time whose rows are decided on
SPANS = {"moca-man": 1.5, "kairos-man": 3.0, "sixth-finger": 6.0, "moca-finger": 1.5}
AIMS = {"control": 40.0, "guard": 30.0, "whole": 80.0}  # us, moca-man
SHARE = 0.25  # of Python's time, moca-man


def run() -> list[Row]:
    """Measures control, guard and all decisions of each profile."""
    if missing():
        raise SystemExit(f"bench: {missing()}")
    rows = []
    for name in SPANS:
        command = [sys.executable, "-m", "bench.compiled", name]
        found = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        pairs = Pairs(found["c"], found["again"], {"Python": found["python"]})
        for phase in PHASES:
            what = f"{name}, {phase}, {available()}, back to back, p50"
            aimed = name == "moca-man" and phase in AIMS
            aim = f"at most {SHARE:g} of Python's, under {AIMS[phase]:g} us" if aimed else ""
            row = pairs.row("compiled", what, phase, "Python", "us", aim)
            rows.append(replace(row, holds=row.ratio <= SHARE and row.ours < AIMS[phase]) if aimed else row)
    return rows


def _blocks(name: str) -> dict[str, list[dict[str, float]]]:
    span = SPANS[name]
    with Decisions(name, ("backend=c",), span) as c, Decisions(name, ("backend=python",), span) as python:
        gc.collect()
        realtime.enter()
        pairs = measure(lambda: c.cycles(BLOCK), {"Python": lambda: python.cycles(BLOCK)})
    return {"c": pairs.first, "again": pairs.again, "python": pairs.others["Python"]}


if __name__ == "__main__":
    print(json.dumps(_blocks(sys.argv[1])))
