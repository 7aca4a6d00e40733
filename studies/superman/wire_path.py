"""Prolonged manipulation: a ring is led along a bent wire and back, with MOCA and by the person alone (Table I)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from runtime.contracts.rotation import Quaternion, conjugate, normalised, product, turned
from sim.parts.person.path import ArcPath
from sim.parts.person.plans import wire_path
from sim.parts.things.wire_ring import WireConfig
from studies.result import Claim, Result
from studies.runs import Run, Task
from studies.superman import user_study
from studies.superman.assumptions import assumed
from studies.superman.persons import Person, persons
from studies.superman.published import CONDITIONS, PRINTED_I, TABLE_I
from studies.superman.user_study import MUSCLES, Planned
from studies.toolkit.trials import Trial, table

STUDY: Final = "wire-path"
_QUICK: Final = 2  # persons
MEASURES: Final = {m.name: (m.unit, m.meaning) for m in TABLE_I.measures}


def task(person: Person, condition: str, a: dict[str, Any], name: str = "") -> Task:
    """Returns a trial of one person, with the assumptions `a`."""
    steps = wire_path(speed=person.follow, pauses=tuple(a["marks"]))
    buttons = 2 if condition == "HR" else 0
    steps = steps[2 - buttons : len(steps) - 2 + buttons]  # alone there are no buttons to press
    turn = list(_ring_turn(a, condition))
    parts: dict[str, Any] = {
        "wire": {
            "part": "wire",
            "at": {"position": a["wire"], "quaternion": a["wire_quaternion"]},
            "marks": a["marks"],
        },
        "ring": {"part": "ring"},
        "person": person.options(overhead=False)
        | {"tool": "ring/centre", "plan": user_study.plan(steps, a["patience"])},
    }
    if condition == "HR":
        parts["ring"] |= {"at": {"parent": "arm/flange", "position": a["ring"], "quaternion": turn}}
        parts["arm"] = {"home": a["arm_home"]}
        changes = {"sim": {"ends_with": "person", "parts": parts}}
    else:
        parts["ring"] |= {"at": {"parent": "person/hand", "position": a["ring_in_hand"], "quaternion": turn}}
        parts["person"] |= {"at": {"parent": None, "position": _hand(a)}}
        wrist = {"parent": "person/hand", "position": a["weight_at"]}
        size = [a["weight_size"]] * 3
        parts["weight"] = {"part": "box", "at": wrist, "size": size, "mass": a["weight"], "touches": False}
        changes = user_study.alone(parts)
    label = name or f"{person.name}-{condition}".lower()
    return Task(label, "moca-man", changes, a["duration"], person.seed)


def _path(a: dict[str, Any]) -> ArcPath:
    return ArcPath(np.array(WireConfig().points), (1.0, 0.0, 0.0, 0.0), turning=False)


def _ring_turn(a: dict[str, Any], condition: str) -> Quaternion:
    """Returns the ring's rotation in the flange's or the hand's frame: its axis lies along the wire's beginning."""
    path = _path(a)
    x, y, z = (np.array(path.at(0.004)[:3]) - np.array(path.at(0.0)[:3])).tolist()
    # The smallest turn of the wire's x axis into its tangent.
    size = float(np.sqrt(x * x + y * y + z * z))
    tilt = normalised((size + x, 0.0, -z, y))
    world = product(normalised(a["wire_quaternion"]), tilt)
    return product(conjugate(normalised(a["flange_quaternion"])), world) if condition == "HR" else world


def _hand(a: dict[str, Any]) -> list[float]:
    """Returns the hand's start position, m: the ring is then at the same place as in HR."""
    flange = turned(normalised(a["flange_quaternion"]), tuple(a["ring"]))
    return [round(f + r - h, 6) for f, r, h in zip(a["flange"], flange, a["ring_in_hand"], strict=True)]


def read(run: Run, condition: str) -> dict[str, float]:
    """Returns Table I's measures of a trial, and further figures: given up, steps missed, seconds of contact."""
    follow = 3 if condition == "HR" else 1  # after two presses and the way to the wire's beginning
    inside = user_study.between(run, follow, follow)
    t = run.t[inside]
    touches = run.value("world.wire_touches")[inside]
    progress = run.value("world.person_progress")
    tool, aim = run.value("world.person_tool")[inside], run.value("world.person_aim")[inside]
    off = np.linalg.norm(tool - aim, axis=1)
    return {
        "N_err": float(touches[-1, 0] - touches[0, 0]),
        "T": round(float(t[-1] - t[0]), 3),
        "contact_s": round(float(touches[-1, 2] - touches[0, 2]), 3),
        "off_mm": round(1000 * float(np.sqrt(np.mean(off**2))), 3),
        "missed": float(progress[-1, 1]),
        "gave_up": float(progress[-1, 2]),
        "finished": float(progress[-1, 0] > follow),
        **user_study.activity(run, inside),
    }


def planned(people: Sequence[Person], a: dict[str, Any], variant: str = "") -> list[Planned]:
    """Returns all trials; those of the persons alone come first. `variant` becomes part of the recordings' names."""
    return [
        Planned(
            person, condition, task(person, condition, a, f"{person.name}-{condition}{variant}".lower()),
            _reader(condition),
        )
        for condition in reversed(CONDITIONS)
        for person in people
    ]  # fmt: skip


def _reader(condition: str) -> Any:
    return lambda run: read(run, condition)


def run(folder: Path, quick: bool = False) -> Result:
    """Runs the study. `quick`: two persons."""
    a = assumed(STUDY)
    return result(user_study.trials(planned(persons(_QUICK if quick else None), a), folder), folder)


def sweep(folder: Path) -> list[dict[str, Any]]:
    """Shows how far the claims depend on the persons: the first few of them, one property at a time."""
    a, aside = assumed(STUDY), folder / "sweep"
    aside.mkdir(parents=True, exist_ok=True)  # its pictures must not replace the study's
    out = []
    for label, people in user_study.varied(persons(a["sweep"]["persons"]), a["sweep"]["factors"]):
        found = user_study.trials(planned(people, a, user_study.slug(label)), folder)
        out.append((label, result(found, aside)))
    return user_study.swept(out)


def result(found: list[Trial], folder: Path) -> Result:
    """Makes tables, pictures and claims from trials of both conditions."""
    got = table("Prolonged manipulation, simulated", found, ("HR", "H"), MEASURES)
    files = [*user_study.pictures(got, folder, "Wire path"), user_study.muscles(found, folder, "Wire path")]
    names = {t.subject for t in found}
    errors, time = got.measure("N_err"), got.measure("T")
    mean = {c: (errors.summary(c).mean, time.summary(c).mean) for c in CONDITIONS}
    (e_hr, t_hr), (e_h, t_h) = mean["HR"], mean["H"]
    return Result(
        STUDY,
        simulated=True,
        seeds=[p.seed for p in persons() if p.name in names],
        claims=[
            Claim(
                id="robot-fewer-errors",
                text=f"fewer touches with the robot than alone: {e_hr:.2f} against {e_h:.2f}, "
                f"sign test p = {got.sign_test('N_err').p:.2g}",
                paper="0.58 (0.79) against 1.25 (1.48), not significant",
                measured=e_hr - e_h, unit="errors", holds=e_hr < e_h,
            ),
            Claim(
                id="robot-slower",
                text=f"slower with the robot: {t_hr:.1f} s against {t_h:.1f} s, "
                f"sign test p = {got.sign_test('T').p:.2g}",
                paper="180.75 (23.25) s against 129.58 (11.64) s, p < 0.001",
                measured=t_hr - t_h, unit="s", holds=t_hr > t_h,
            ),
        ],
        table=user_study.rows(got, PRINTED_I, ("off_mm", "missed", *MUSCLES), found),
        files=[*files, *(t.place for t in found)],
    )  # fmt: skip
