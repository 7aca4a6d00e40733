"""One trial of prolonged manipulation: a ring is led along a bent wire and back, with MOCA or by the person alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.rotation import Quaternion, conjugate, normalised, product, turned
from srl.sim.parts.person.path import ArcPath
from srl.sim.parts.person.plans import wire_path
from srl.sim.parts.things.wire_ring import RingConfig, WireConfig
from srl.studies.simulated import Run, Setup, controllers, simulate, without_hand
from srl.studies.superman import user_trial
from srl.studies.superman.assumptions import assumed
from srl.studies.superman.persons import Person
from srl.studies.tasks.task import Value

STUDY: Final = "wire-path"
PROFILE: Final = "moca-man"
SIGNALS: Final = (
    "world.person_progress", "world.person_tool", "world.person_aim", "world.person_activation", "world.wire_touches",
)  # fmt: skip


def trial(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """One person under one condition.

    Args:
        text: of the profile `moca-man`.
        parameters: `person`, of `Person` by name; `condition`, HR or H; `changed`, assumptions that are other.
        seed: of the world.

    Returns:
        see `read`; and `stop`, why the robot stopped, if it did.
    """
    a = assumed(STUDY) | parameters["changed"]
    condition = parameters["condition"]
    run = simulate(text, setup(text, Person(**parameters["person"]), condition, a), seed, SIGNALS)
    return read(run, condition, a) | {"stop": run.cause}


def setup(text: str, person: Person, condition: str, a: dict[str, Any]) -> Setup:
    """Returns a trial of one person, with the assumptions `a`."""
    steps = wire_path(pauses=tuple(a["marks"]), pause=a["pause"], width=_play())
    buttons = 2 if condition == "HR" else 0
    steps = steps[2 - buttons : len(steps) - 2 + buttons]  # alone there are no buttons to press
    turn = list(_ring_turn(a, condition, person.tilt))
    parts: dict[str, Any] = {
        "wire": {
            "part": "wire",
            "at": {"position": a["wire"], "quaternion": a["wire_quaternion"]},
            "marks": a["marks"],
        },
        "ring": {"part": "ring"},
        "person": person.options() | {"tool": "ring/centre", "plan": user_trial.plan(steps, a["patience"])},
    }
    if condition == "HR":
        parts["ring"] |= {"at": {"parent": "arm/flange", "position": a["ring"], "quaternion": turn}}
        parts["arm"] = {"home": a["arm_home"]}
        changes = {
            "devices": {"hand": None},
            "controllers": without_hand(controllers(text, "guide")),
            "guard": {"hand.position_command": None},
            "stop": {"hand": None},
            "sim": {"ends_with": "person", "parts": parts},
        }
    else:
        parts["ring"] |= {"at": {"parent": "person/hand", "position": a["ring_in_hand"], "quaternion": turn}}
        parts["person"] |= {"at": {"parent": None, "position": _hand(a)}}
        wrist = {"parent": "person/hand", "position": a["weight_at"]}
        size = [a["weight_size"]] * 3
        parts["weight"] = {"part": "box", "at": wrist, "size": size, "mass": a["weight"], "touches": False}
        changes = user_trial.alone(parts)
    return Setup(PROFILE, changes, a["duration"])


def path(a: dict[str, Any]) -> ArcPath:
    """Returns the wire, in its own frame."""
    return ArcPath(np.array(WireConfig().points), (1.0, 0.0, 0.0, 0.0), turning=False)


def _play() -> float:
    """Returns how far the ring can go from side to side of the wire, m."""
    return round(RingConfig().diameter - 2 * WireConfig().radius, 6)


def _ring_turn(a: dict[str, Any], condition: str, tilt: Quaternion) -> Quaternion:
    """Returns the ring's rotation in the flange's or the hand's frame: its axis lies along the wire's beginning.

    The person saw to that, and so it is off by the person's `tilt`.
    """
    wire = path(a)
    x, y, z = (np.array(wire.at(0.004)[:3]) - np.array(wire.at(0.0)[:3])).tolist()
    # The smallest turn of the wire's x axis into its tangent.
    size = float(np.sqrt(x * x + y * y + z * z))
    world = product(tilt, product(normalised(a["wire_quaternion"]), normalised((size + x, 0.0, -z, y))))
    return product(conjugate(normalised(a["flange_quaternion"])), world) if condition == "HR" else world


def _hand(a: dict[str, Any]) -> list[float]:
    """Returns the hand's start position, m: the ring is then at the same place as in HR."""
    flange = turned(normalised(a["flange_quaternion"]), tuple(a["ring"]))
    return [round(f + r - h, 6) for f, r, h in zip(a["flange"], flange, a["ring_in_hand"], strict=True)]


def read(run: Run, condition: str, a: dict[str, Any]) -> dict[str, Value]:
    """Returns Table I's measures of a trial, and further figures.

    `moving`: s without the pauses; `contact_s` of contact; `off_mm`, RMS of the tool from where it is meant to be;
    `missed` steps; `gave_up`; `finished`. Figures are of the whole way if `finished`, else of what there was.
    """
    follow = 3 if condition == "HR" else 1  # after two presses and the way to the wire's beginning
    inside = user_trial.between(run, follow, follow)
    progress = run.value("world.person_progress")
    if not inside.any():
        return {"N_err": None, "T": None, "moving": None, "missed": float(progress[-1, 1]), "finished": 0.0}
    t = run.t[inside]
    touches = run.value("world.wire_touches")[inside]
    off = np.linalg.norm(run.value("world.person_tool")[inside] - run.value("world.person_aim")[inside], axis=1)
    seconds = float(t[-1] - t[0])
    return {
        "N_err": float(touches[-1, 0] - touches[0, 0]),
        "T": round(seconds, 3),
        "moving": round(seconds - 2 * len(a["marks"]) * a["pause"], 3),
        "contact_s": round(float(touches[-1, 2] - touches[0, 2]), 3),
        "off_mm": round(1000 * float(np.sqrt(np.mean(off**2))), 3),
        "missed": float(progress[-1, 1]),
        "gave_up": float(progress[-1, 2]),
        "finished": float(progress[-1, 0] > follow),
        **user_trial.activity(run, inside),
    }
