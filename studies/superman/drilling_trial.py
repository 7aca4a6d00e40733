"""One trial of overhead drilling: a 5 kg drill is held in holes overhead, with Kairos or by the person alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.rotation import Quaternion, normalised, turned
from srl.sim.parts.person.plans import Press, drilling
from srl.studies.simulated import Run, Setup, controllers, simulate, without_hand
from srl.studies.superman import user_trial
from srl.studies.superman.assumptions import assumed
from srl.studies.superman.persons import Person
from srl.studies.superman.user_trial import Mask
from srl.studies.tasks.task import Value

STUDY: Final = "overhead-drilling"
PROFILES: Final = {"HR": "kairos-man", "H": "moca-man"}
SIGNALS: Final = (
    "world.person_progress", "world.person_tool", "world.person_aim", "world.person_activation",
    "world.person_capacity", "world.plate_touches", "world.plate_dwell", "world.plate_inside",
)  # fmt: skip
_STAY: Final = 5.0  # s, paper
_ROWS, _COLUMNS, _SPACING, _THICK = 4, 5, 0.3, 0.02  # of the part drill-plate
# Hand, sensor and handle of the profile: kg, and m in the flange's frame.
_FLANGE: Final = (0.9, (0.019, 0.0, 0.042))


def trial(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """One person under one condition.

    Args:
        text: of the condition's profile.
        parameters: `person`, of `Person` by name; `condition`, HR or H; `holes`, how many by condition; `changed`,
            assumptions that are other.
        seed: of the world.

    Returns:
        see `read`; and `stop`, why the robot stopped, if it did.
    """
    a = assumed(STUDY) | parameters["changed"]
    condition = parameters["condition"]
    holes = parameters["holes"][condition]
    run = simulate(text, setup(text, Person(**parameters["person"]), condition, a, holes), seed, SIGNALS)
    return read(run, condition, a, holes) | {"stop": run.cause}


def setup(text: str, person: Person, condition: str, a: dict[str, Any], holes: int) -> Setup:
    """Returns a trial of one person, with the assumptions `a`."""
    steps = list(drilling(holes=holes, depth=a["depth"], below=a["below"]))
    # On the robot the base follows: locomotion is switched on with the admittance. Alone there are no buttons to press.
    steps[1:1] = [Press(do="press", button="priority")]
    steps = steps if condition == "HR" else steps[2:-1]
    plan = user_trial.plan(steps, a["patience"])
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
        tilt = person.tilt_at(a["flange_quaternion"])
        parts["drill"] |= {"at": {"parent": "arm/flange", "position": a["mount"], "quaternion": list(tilt)}}
        parts["arm"] = {"home": a["arm_home"]}
        mass, centre = _with_drill(a, tilt)
        changes = {
            "devices": {"arm": {"payload": mass, "payload_cog": centre}, "hand": None},
            "controllers": without_hand(controllers(text, "guide")),
            "guard": {"hand.position_command": None},
            "stop": {"hand": None},
            "sim": {"ends_with": "person", "parts": parts},
        }
    else:
        parts["drill"] |= {
            "at": {"parent": "person/hand", "position": a["drill_in_hand"], "quaternion": list(person.tilt)}
        }
        reach = a["drill_in_hand"][2] + _long(a)
        parts["person"] |= {"at": {"parent": None, "position": [tip[0], tip[1], tip[2] - reach]}}
        changes = user_trial.alone(parts)
    return Setup(PROFILES[condition], changes, a["duration"])


def _long(a: dict[str, Any]) -> float:
    """Returns the m from the drill's frame to its tip."""
    return float(a["machine"] + a["bit"][1])


def _tip(a: dict[str, Any]) -> list[float]:
    """Returns the position of the upright drill's tip at the beginning, m, in the world."""
    x, y, z = a["mount"]
    out = turned(normalised(a["flange_quaternion"]), (x, y, z + _long(a)))
    return [round(f + v, 6) for f, v in zip(a["flange"], out, strict=True)]


def _with_drill(a: dict[str, Any], tilt: Quaternion) -> tuple[float, list[float]]:
    """Returns the kg at the flange with the drill, and its centre of mass, as configured in the robot."""
    mass, centre = _FLANGE
    drill = [m + v for m, v in zip(a["mount"], turned(tilt, (0.0, 0.0, a["machine"] / 2)), strict=True)]
    total = mass + a["drill"]
    return total, [round((mass * c + a["drill"] * d) / total, 5) for c, d in zip(centre, drill, strict=True)]


def read(run: Run, condition: str, a: dict[str, Any], holes: int) -> dict[str, Value]:
    """Returns Table II's measures of a trial of so many holes (`tried`), and further figures.

    The time runs from the first step towards a hole to the last step out of it, or to giving up. A hole is completed
    if the tip was in it for 5 s without a touch. Without any there is no time for each (None).
    """
    first = 2 if condition == "HR" else 0
    progress = run.value("world.person_progress")
    gave_up = float(progress[-1, 2])
    last = first + 4 * holes - 1
    # When a person gives up, the plan jumps to its end: that row still counts for the time.
    inside = user_trial.between(run, first, last)
    if not inside.any():
        return {"tried": holes, "N_Hl": None, "T": None, "N_err": None, "gave_up": gave_up, "finished": 0.0}
    t = run.t[inside]
    touches = run.value("world.plate_touches")[inside]
    # The stay is a part of `hold`. A hold that is one row shorter isn't refused.
    dwell = run.value("world.plate_dwell")[-1, :holes]
    done = int(np.sum(dwell >= _STAY - a["stay_margin"]))
    duration = float(t[-1] - t[0])
    return {
        "tried": holes,
        "N_Hl": float(done),
        "T": round(duration / done, 3) if done else None,
        "N_err": float(touches[-1, 0] - touches[0, 0]),
        "duration": round(duration, 2),
        "contact_s": round(float(touches[-1, 2] - touches[0, 2]), 3),
        "off_mm": _off(run, inside),
        "capacity": round(float(run.value("world.person_capacity")[inside][-1, 0]), 3),
        "missed": float(progress[-1, 1]),
        "gave_up": gave_up,
        "finished": float(progress[-1, 0] > last and not gave_up),
        **user_trial.activity(run, inside),
    }


def _off(run: Run, inside: Mask) -> float | None:
    """Returns the RMS distance, mm, across the bit, of the tip from its target while it is in a hole."""
    there = inside & (run.value("world.plate_inside")[:, 0] >= 0)
    off = (run.value("world.person_tool") - run.value("world.person_aim"))[there, :2]
    return round(1000 * float(np.sqrt(np.mean(np.sum(off**2, axis=1)))), 3) if len(off) else None
