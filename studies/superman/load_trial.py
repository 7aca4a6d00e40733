"""One trial of long-distance load carrying (Giammarino et al. 2022, section IV-B2): Kairos, 10 kg, past obstacles.

The hand's grasp is a joint of the simulated load itself: a hand that has closed near the bar holds it in that pose.
Kairos' law doesn't model the load, and the arm's controller doesn't know of it. As in the paper, the flange's sensor
shows its force.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from copy import deepcopy
from typing import Any, Final

import numpy as np

from srl.control.cobot.guide_buttons import MODES
from srl.runtime.contracts.gravity import GRAVITY
from srl.runtime.contracts.signals import Array
from srl.studies.simulated import Run, Setup, largest, simulate
from srl.studies.superman.assumptions import assumed
from srl.studies.superman.persons import Person
from srl.studies.tasks.task import Value

STUDY: Final = "load-carrying"
PROFILE: Final = "kairos-man"
SIGNALS: Final = (
    "world.load_held", "world.load_pose", "world.to_contact_force", "world.boxes_touches", "world.boxes_distance",
    "world.person_progress", "world.person_wrench", "world.arm_flange", "keys.modes", "arm.wrench",
)  # fmt: skip
POINTS: Final = 800  # of the series that a figure shows
_WATCHED: Final = ("base/base", "load/box", "arm/elbow", "arm/wrist_1", "hand/palm", "grip/grip")
_LOCOMOTION: Final = len(MODES) - 1


def trial(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """One person carries the load.

    Args:
        text: of the profile `kairos-man`.
        parameters: `person`, of `Person` by name; `short`, the same tasks over a shorter path; `changed`, assumptions
            that are other; `series`, whether the row has what the figure shows.
        seed: of the world.

    Returns:
        see `read`.
    """
    a = assumed(STUDY) | parameters["changed"]
    a = shortened(a) if parameters["short"] else a
    run = simulate(text, setup(Person(**parameters["person"]), a), seed, SIGNALS)
    row = read(run, a)
    return row | {"series": series(run) if parameters["series"] else ""}


def shortened(a: dict[str, Any]) -> dict[str, Any]:
    """Returns assumptions with a shorter path but the same tasks."""
    case = deepcopy(a)
    (x, y), (tx, ty) = case["pick"], case["approach"]
    case["way"] = [[tx - 0.4, ty], [tx - 0.4, ty - 0.6], [tx, ty - 0.6]]
    case["place"] = [x, y - 0.6]
    case["obstacles"] = [{"position": [tx - 0.7, ty - 1.4, 0.6], "size": [0.4, 0.4, 1.2]}]
    return case


def setup(person: Person, a: dict[str, Any]) -> Setup:
    """Returns the profile with load, tables, obstacles and the person's plan."""
    width, depth, height = a["table"]
    (px, py), (gx, gy) = a["pick"], a["place"]
    across = [0.7071067811865476, 0.0, 0.0, 0.7071067811865476]  # the bar across the fingers
    tilt = person.tilt_at(a["flange_quaternion"])
    parts = {
        "arm": {"home": a["arm_home"]},
        "hand": {"at": {"parent": "arm/flange", "quaternion": list(tilt)}},
        "from": {"part": "box", "size": [width, depth, height], "at": {"position": [px, py, height / 2]}},
        "to": {"part": "box", "size": [width, depth, height], "at": {"position": [gx, gy, height / 2]}},
        "load": {
            "part": "load",
            "at": {"position": [px, py, height + a["size"][2] / 2 + 0.001], "quaternion": across},
            "gripper": "hand",
            **{key: a[key] for key in ("mass", "size", "grip", "reach")},
        },
        "boxes": {"part": "obstacles", "boxes": a["obstacles"], "watch": list(_WATCHED)},
        "person": person.options() | {"tool": "hand/palm", "plan": plan(a)},
    }
    return Setup(PROFILE, {"sim": {"ends_with": "person", "parts": parts}}, a["duration"])


def plan(a: dict[str, Any]) -> list[dict[str, Any]]:
    """Returns the person's plan.

    To the load in locomotion, take and lift it in manipulation, past the obstacles in locomotion, put it down.
    """
    low = a["table"][2] + a["size"][2] + a["grip"]
    high = low + a["above"]
    hollow = a["hollow"]

    def palm(place: list[float], z: float) -> list[float]:
        return [place[0] - hollow[0], place[1] - hollow[1], z - hollow[2]]

    def press(button: str) -> dict[str, Any]:
        return {"do": "press", "button": button}

    def go(place: list[float], z: float, **how: Any) -> dict[str, Any]:
        return {"do": "go_to", "position": palm(place, z), **how}

    wait = {"do": "wait", "seconds": 2.0}
    far: dict[str, Any] = {"tolerance": 0.05, "dwell": 0.0, "speed": a["speed"]}  # walking, no reach
    return [
        {"do": "wait", "seconds": 0.5},
        press("A"), press("P"),
        go(a["approach"], high, **far),
        press("P"),
        go(a["pick"], high, tolerance=0.01),
        go(a["pick"], low, tolerance=0.01, dwell=0.5),
        press("G"), wait,
        go(a["pick"], high, tolerance=0.02),
        press("P"),
        *(go(place, high, **far) for place in a["way"]),
        press("P"),
        go(a["place"], high, tolerance=0.01),
        go(a["place"], low + a["gap"], tolerance=0.01, dwell=0.5),
        press("G"), wait,
        go(a["place"], high, tolerance=0.02),
        press("A"), {"do": "wait", "seconds": 1.0},
    ]  # fmt: skip


def read(run: Run, a: dict[str, Any]) -> dict[str, Value]:
    """Returns the outcome from the recording alone. Times in s; None if it didn't get that far.

    taken, lifted, lowered, placed: the load was grasped; locomotion with it began, ended; it was released.
    force_z: N, mean of the flange's force between `lifted` and `lowered`, z of the arm's base; net: without the hand's
    part; spread: its standard deviation. off: m, of the load's middle from its target place, at the end. tilt: rad, of
    the load at the end. stands: whether the target table carries its weight at the end. touches: number of contacts
    with obstacles. least: m, least distance of the watched bodies to an obstacle. way: m, length of the load's path.
    manipulation, locomotion: s in either mode. missed: steps of the plan. strongest: N, the flange's greatest force
    while the load is held. stop: why the robot stopped, if it did.
    """
    t, held = run.t, run.value("world.load_held")[:, 0] > 0.5
    locomotion = run.value("keys.modes")[:, _LOCOMOTION] > 0.5
    pose = run.value("world.load_pose")
    step = np.diff(t, append=t[-1])
    carried = held & locomotion
    force_z = net = spread = None
    if carried.any():
        felt, hand = run.value("arm.wrench")[carried], run.value("world.person_wrench")[carried]
        force_z = float(felt[:, 2].mean())
        net, spread = float((felt[:, 2] - hand[:, 2]).mean()), float(felt[:, 2].std())
    goal = np.array(a["place"])
    qx, qy = pose[-1, 4], pose[-1, 5]
    weight = GRAVITY * a["mass"]
    bears = -run.value("world.to_contact_force")[-1, 2]
    moved = np.linalg.norm(np.diff(pose[:, :3], axis=0), axis=1)
    times = np.flatnonzero(held), np.flatnonzero(carried)
    return {
        "taken": _at(t, times[0], 0),
        "lifted": _at(t, times[1], 0),
        "lowered": _at(t, times[1], -1),
        "placed": None if held[-1] else _at(t, times[0], -1),
        "force_z": force_z,
        "net": net,
        "spread": spread,
        "off": float(np.hypot(*(pose[-1, :2] - goal))),
        "tilt": float(2 * np.arcsin(min(np.hypot(qx, qy), 1.0))),
        "stands": bool(abs(bears - weight) < 0.1 * weight and not held[-1]),
        "touches": int(run.value("world.boxes_touches")[-1, 0]),
        "least": float(run.value("world.boxes_distance").min()),
        "way": float(moved.sum()),
        "manipulation": float(step[~locomotion].sum()),
        "locomotion": float(step[locomotion].sum()),
        "missed": int(run.value("world.person_progress")[-1, 1]),
        "strongest": largest(run.value("arm.wrench")[held][:, :3]),
        "stop": run.cause,
    }


def _at(t: Array, where: Any, which: int) -> float | None:
    return float(t[where[which]]) if len(where) else None


def series(run: Run) -> str:
    """Returns what the figure shows, as JSON: t (s), at (m, of the flange), force (N), locomotion; thinned out."""
    every = max(1, len(run.t) // POINTS)
    found = {
        "t": np.round(run.t[::every], 3).tolist(),
        "at": np.round(run.value("world.arm_flange")[::every], 4).tolist(),
        "force": np.round(run.value("arm.wrench")[::every, :3], 2).tolist(),
        "locomotion": (run.value("keys.modes")[::every, _LOCOMOTION] > 0.5).tolist(),
    }
    return json.dumps(found)
