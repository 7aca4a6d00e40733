"""What decides `no-blame` and `goals-reached`: one thing at a time is other than in the profile.

The rows under `attacks` are the table of docs/collision.md, "What it is worth".
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from srl.studies.human_srl.goals_claims import PACE_STILL
from srl.studies.human_srl.reach_claims import ARMS, line, plain, tasks
from srl.studies.tasks.runner import Runner

MOTIONS: Final = 8
_STANDARD: Final = [-0.10, -0.05, 0.20]  # m, the base of the model where a profile gives none


def conditions() -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Group, words, and what is changed. The first group is the page's table."""
    for words, attack in ARMS.items():
        yield "attacks", words, attack
    yield "attacks", "with the law reach", {"planned": True}
    yield "attacks", "reach, no clearance", {"guarded": False, "planned": True}
    yield "attacks", "30 % of the frames lost", {"drop": 0.3}
    yield "attacks", "suit repeats one frame for 4 s", {"freeze": [4.0, 8.0]}
    yield "attacks", "servos twice as late as told", {"servo": 2.0}
    yield "attacks", "servos four times as late as told", {"servo": 4.0}
    yield "attacks", "frames 0.1 s late, told", {"delay": 0.1, "clear": {"latency": 0.1}}
    yield "attacks", "frames 0.1 s late, not told", {"delay": 0.1}
    for pace, words in ((2.0, "wearer twice as quick"), (3.0, "wearer three times as quick")):
        yield "attacks", words, {"pace": pace}
        yield "attacks", f"{words}, no clearance", {"pace": pace, "guarded": False}
    yield "attacks", "radii assumed 0.6 of the table", {"assumed": 0.6}
    for degrees in (10.0, 20.0):
        yield "attacks", f"suit off by {degrees:g} degrees rms in each joint, not told", {"bias": degrees}
    for degrees, most in ((10.0, 0.05), (20.0, 0.1)):  # a bias doesn't change, so it isn't noise
        words = f"suit off by {degrees:g} degrees rms, uncertainty {most:g} m declared"
        yield "attacks", words, {"bias": degrees, "clear": {"uncertainty": most, "noise": 0.0}}
    noise = {"uncertainty": 0.01, "noise": 0.015}
    yield "attacks", "the suit's own noise declared: 0.01 m, 0.015 m in 0.05 s", {"clear": noise}
    yield "attacks", "trunk sways by 20 degrees", {"sway": 20.0}
    yield "attacks", "wearer marches, thighs to 50 degrees", {"march": 50.0}
    yield "attacks", "wearer marches, no clearance", {"march": 50.0, "guarded": False}
    yield "attacks", "the arm starts elsewhere", {"away": True}
    all_wrong = {"pace": 3.0, "delay": 0.1, "servo": 4.0, "assumed": 0.6}
    yield "attacks", "three times as quick, frames late, servos late, radii 0.6, not told", all_wrong
    yield "delay", "frames 0 s late, told", {"delay": 0.0, "clear": {"latency": 0.0}}
    yield "delay", "frames 0.06 s late, told", {"delay": 0.06, "clear": {"latency": 0.06}}
    for factor in (0.5, 2.0):
        yield "a_H", f"a_e x {factor:g} told", {"clear": {"acceleration": factor}}
    for least in (0.005, 0.05):
        yield "C", f"C {least:g} m", {"clear": {"least": least}}
    yield "Z_d", "Z_d 0.05 m, constant", {"clear": {"uncertainty": 0.05, "noise": 0.0}}
    for factor in (0.8, 1.2):
        yield "radii", f"radii assumed {factor:g} of the table", {"assumed": factor}
    for lag in (0.0, 0.1):
        yield "servo lag", f"servos {lag:g} s late, told", {"lag": lag}
    yield "tracking", "joints within 0.001 of their commands, told", {"tracking": 0.001}
    yield "pace", "wearer half as quick", {"pace": 0.5}
    yield "pace", "wearer stands still", {"pace": PACE_STILL}
    yield "pace", "wearer stands still, no clearance", {"pace": PACE_STILL, "guarded": False}
    yield "base", "the model's standard base", {"base": _STANDARD}
    yield "base", "the model's standard base, no clearance", {"base": _STANDARD, "guarded": False}


def sweep(runner: Runner, folder: Path) -> list[dict[str, Any]]:
    """A row of the table for each condition: the first motions, the same ones in each."""
    all_ = list(conditions())
    by_condition = [tasks(MOTIONS, attack) for _, _, attack in all_]
    asked = [task for motion in zip(*by_condition, strict=True) for task in motion]  # what is there first is whole
    rows = runner.rows(asked, folder / "sweep-reach")
    found = []
    for k, (group, words, _) in enumerate(all_):
        own = [row for row in rows[k :: len(all_)] if row.done]
        found.append(line({"decides": group, "changed": words}, [plain(row.task, row.values) for row in own]))
    return found
