"""Overhead drilling: a 5 kg drill is held in 20 holes overhead, with Kairos and by the person alone (Table II)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from runtime.contracts.rotation import normalised, turned
from sim.parts.person.plans import Press, drilling
from studies.result import Claim, Result
from studies.runs import Run, Task
from studies.superman import user_study
from studies.superman.assumptions import assumed
from studies.superman.persons import Person, persons
from studies.superman.published import CONDITIONS, HOLES, PRINTED_II, TABLE_II
from studies.superman.user_study import MUSCLES, Mask, Planned
from studies.toolkit.trials import Trial, each, table

STUDY: Final = "overhead-drilling"
_QUICK: Final = 2  # persons
_STAY: Final = 5.0  # s, paper
_ROWS, _COLUMNS, _SPACING, _THICK = 4, 5, 0.3, 0.02  # of the part drill-plate
MEASURES: Final = {m.name: (m.unit, m.meaning) for m in TABLE_II.measures}
# Hand, sensor and handle of the profile: kg, and m in the flange's frame.
_FLANGE: Final = (0.9, (0.019, 0.0, 0.042))


def task(person: Person, condition: str, a: dict[str, Any], name: str = "", holes: int = HOLES) -> Task:
    """Returns a trial of one person, with the assumptions `a`."""
    steps = list(drilling(holes=holes, depth=a["depth"], below=a["below"]))
    # On the robot the base follows: locomotion is switched on with the admittance. Alone there are no buttons to press.
    steps[1:1] = [Press(do="press", button="priority")]
    steps = steps if condition == "HR" else steps[2:-1]
    plan = user_study.plan(steps, a["patience"])
    for step in plan:
        if step["do"] == "go_to" and step["dwell"] > 0:
            step["tolerance"] = person.care
    drill = {"part": "drill", "mass": a["drill"], "bit": a["bit"]}
    tip = _tip(a)
    # Of the plate, whose first hole is over the tip.
    middle = [tip[0] + (_COLUMNS - 1) / 2 * _SPACING, tip[1] + (_ROWS - 1) / 2 * _SPACING, a["plate"] + _THICK / 2]
    parts: dict[str, Any] = {
        "plate": {
            "part": "drill-plate", "drill": "drill/tip", "thickness": _THICK, "rows": _ROWS, "columns": _COLUMNS,
            "at": {"position": middle},
        },
        "drill": drill,
        "person": person.options(overhead=True) | {"tool": "drill/tip", "plan": plan},
    }  # fmt: skip
    if condition == "HR":
        parts["drill"] |= {"at": {"parent": "arm/flange", "position": a["mount"]}}
        parts["arm"] = {"home": a["arm_home"]}
        mass, centre = _with_drill(a)
        changes = {
            "devices": {"arm": {"payload": mass, "payload_cog": centre}},
            "sim": {"ends_with": "person", "parts": parts},
        }
        profile = "kairos-man"
    else:
        parts["drill"] |= {"at": {"parent": "person/hand", "position": a["drill_in_hand"]}}
        reach = a["drill_in_hand"][2] + _long(a)
        parts["person"] |= {"at": {"parent": None, "position": [tip[0], tip[1], tip[2] - reach]}}
        changes, profile = user_study.alone(parts), "moca-man"
    label = name or f"{person.name}-{condition}".lower()
    return Task(label, profile, changes, a["duration"], person.seed)


def _long(a: dict[str, Any]) -> float:
    """Returns the m from the drill's frame to its tip."""
    return float(a["machine"] + a["bit"][1])


def _tip(a: dict[str, Any]) -> list[float]:
    """Returns the position of the drill's tip at the beginning, m, in the world."""
    x, y, z = a["mount"]
    out = turned(normalised(a["flange_quaternion"]), (x, y, z + _long(a)))
    return [round(f + v, 6) for f, v in zip(a["flange"], out, strict=True)]


def _with_drill(a: dict[str, Any]) -> tuple[float, list[float]]:
    """Returns the kg at the flange with the drill, and its centre of mass, as configured in the robot."""
    mass, centre = _FLANGE
    x, y, z = a["mount"]
    drill = (x, y, z + a["machine"] / 2)
    total = mass + a["drill"]
    return total, [round((mass * c + a["drill"] * d) / total, 5) for c, d in zip(centre, drill, strict=True)]


def read(run: Run, condition: str, a: dict[str, Any], holes: int = HOLES) -> dict[str, float]:
    """Returns Table II's measures of a trial, and further figures.

    The time runs from the first step towards a hole to the last step out of it, or to giving up. A hole is completed
    if the tip was in it for 5 s without a touch.
    """
    first = 2 if condition == "HR" else 0
    progress = run.value("world.person_progress")
    gave_up = float(progress[-1, 2])
    last = first + 4 * holes - 1
    # When a person gives up, the plan jumps to its end: that row still counts for the time.
    inside = user_study.between(run, first, last)
    t = run.t[inside]
    touches = run.value("world.plate_touches")[inside]
    # The stay is a part of `hold`. A hold that is one row shorter isn't refused.
    dwell = run.value("world.plate_dwell")[-1, :holes]
    done = int(np.sum(dwell >= _STAY - a["stay_margin"]))
    duration = float(t[-1] - t[0])
    return {
        "N_Hl": float(done),
        "T": round(each(duration, done), 3) if done else float("nan"),
        "N_err": float(touches[-1, 0] - touches[0, 0]),
        "duration": round(duration, 2),
        "contact_s": round(float(touches[-1, 2] - touches[0, 2]), 3),
        "off_mm": round(1000 * _off(run, inside), 3),
        "capacity": round(float(run.value("world.person_capacity")[inside][-1, 0]), 3),
        "missed": float(progress[-1, 1]),
        "gave_up": gave_up,
        "finished": float(progress[-1, 0] > last and not gave_up),
        **user_study.activity(run, inside),
    }


def _off(run: Run, inside: Mask) -> float:
    """Returns the RMS distance, m, across the bit, of the tip from its target while it is in a hole."""
    there = inside & (run.value("world.plate_inside")[:, 0] >= 0)
    off = (run.value("world.person_tool") - run.value("world.person_aim"))[there, :2]
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1)))) if len(off) else float("nan")


def planned(people: Sequence[Person], a: dict[str, Any], holes: int, variant: str = "") -> list[Planned]:
    """Returns all trials; those of the persons alone come first. `variant` becomes part of the recordings' names."""
    return [
        Planned(
            person, condition, task(person, condition, a, f"{person.name}-{condition}{variant}".lower(), holes),
            _reader(condition, a, holes),
        )
        for condition in reversed(CONDITIONS)
        for person in people
    ]  # fmt: skip


def _reader(condition: str, a: dict[str, Any], holes: int) -> Any:
    return lambda run: read(run, condition, a, holes)


def run(folder: Path, quick: bool = False) -> Result:
    """Runs the study. `quick`: two persons, four holes."""
    a = assumed(STUDY)
    holes = a["quick_holes"] if quick else HOLES
    people = persons(_QUICK if quick else None)
    return result(user_study.trials(planned(people, a, holes), folder), folder, holes)


def sweep(folder: Path) -> list[dict[str, Any]]:
    """Shows how far the claims depend on the persons: the first few of them, one property at a time."""
    a, aside = assumed(STUDY), folder / "sweep"
    aside.mkdir(parents=True, exist_ok=True)  # its pictures must not replace the study's
    out = []
    for label, people in user_study.varied(persons(a["sweep"]["persons"]), a["sweep"]["factors"]):
        found = user_study.trials(planned(people, a, HOLES, user_study.slug(label)), folder)
        out.append((label, result(found, aside)))
    return user_study.swept(out)


def result(found: list[Trial], folder: Path, holes: int = HOLES) -> Result:
    """Makes tables, pictures and claims from trials of both conditions."""
    none = sorted({t.subject for t in found if not np.isfinite(t.values["T"])})
    # Without any completed hole there is no time per hole: such a subject is named, but left out of the times.
    timed = [t for t in found if t.subject not in none]
    counted = {name: MEASURES[name] for name in ("N_Hl", "N_err")}
    counts = table("Overhead drilling, simulated", found, ("HR", "H"), counted)
    times = table("Overhead drilling, simulated", timed, ("HR", "H"), {"T": MEASURES["T"]})
    files = [
        *user_study.pictures(counts, folder, "Overhead drilling"),
        *user_study.pictures(times, folder, "Overhead drilling"),
        user_study.muscles(found, folder, "Overhead drilling"),
    ]
    names = {t.subject for t in found}
    mean = {m.name: {c: m.summary(c).mean for c in CONDITIONS} for m in (*counts.measures, *times.measures)}
    p = {"N_Hl": counts.sign_test("N_Hl").p, "N_err": counts.sign_test("N_err").p, "T": times.sign_test("T").p}

    def against(name: str, unit: str) -> str:
        by = mean[name]
        return f"{by['HR']:.2f} against {by['H']:.2f} {unit}, sign test p = {p[name]:.2g}"

    aside = f"; without {', '.join(none)}, who completed none" if none else ""
    extra = ("off_mm", "missed", "gave_up", *MUSCLES)
    beside = {row["subject"]: row for row in user_study.rows(times, PRINTED_II, (), timed)}
    lines = user_study.rows(counts, PRINTED_II, extra, found)
    return Result(
        STUDY,
        simulated=True,
        seeds=[person.seed for person in persons() if person.name in names],
        claims=[
            Claim(
                id="robot-more-holes", text=f"more holes with the robot, of {holes}: {against('N_Hl', 'holes')}",
                paper="20 (0) against 13 (4.93), p < 0.01",
                measured=mean["N_Hl"]["HR"] - mean["N_Hl"]["H"], unit="holes",
                holds=mean["N_Hl"]["HR"] > mean["N_Hl"]["H"],
            ),
            Claim(
                id="robot-fewer-errors", text=f"fewer touches with the robot: {against('N_err', 'errors')}",
                paper="0.42 (0.51) against 2.17 (2.82), p < 0.01 (its rows give p = 0.29)",
                measured=mean["N_err"]["HR"] - mean["N_err"]["H"], unit="errors",
                holds=mean["N_err"]["HR"] < mean["N_err"]["H"],
            ),
            Claim(
                id="robot-slower", text=f"more time for each hole with the robot: {against('T', 's')}{aside}",
                paper="10.04 (1.15) s against 7.68 (0.53) s, p < 0.001",
                measured=mean["T"]["HR"] - mean["T"]["H"], unit="s", holds=mean["T"]["HR"] > mean["T"]["H"],
            ),
        ],
        table=[
            row | {f"T {c}": beside.get(row["subject"], {}).get(f"T {c}") for c in CONDITIONS} for row in lines
        ],
        files=[*files, *(t.place for t in found)],
    )  # fmt: skip
