"""Long-distance load carrying (Giammarino et al. 2022, section IV-B2, Fig. 14): Kairos, 10 kg, past obstacles.

The hand's grasp is a joint of the simulated load itself: a hand that has closed near the bar holds it in that pose.
Kairos' law doesn't model the load, and the arm's controller doesn't know of it. As in the paper, the flange's sensor
shows its force.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, cast

import numpy as np
from matplotlib.figure import Figure

from runtime.contracts.gravity import GRAVITY
from runtime.contracts.signals import Array
from runtime.control.cobot.guide_buttons import MODES
from studies.result import Claim, Result
from studies.runs import Run, Task, largest, run_all
from studies.superman.assumptions import assumed

NAME: Final = "load-carrying"
_WATCHED: Final = ("base/base", "load/box", "arm/elbow", "arm/wrist_1", "hand/palm", "grip/grip")
_LOCOMOTION: Final = len(MODES) - 1
# The times in s of the paper's Fig. 14, taken from its text.
PAPER: Final = {"before": "0 to 35", "lifting": "35 to 38", "carrying": "38 to 80", "placing": "80 to 82"}
_VIOLET, _YELLOW, _BLUE, _PURPLE = "#7b4fa3", "#e0b400", "#56B4E9", "#CC79A7"


@dataclass(frozen=True)
class Outcome:
    """The outcome of a run. Times in s; None if it didn't get that far.

    Attributes:
        taken, lifted, lowered, placed: the load was grasped; locomotion with it began, ended; it was released.
        force: (3,) N, mean of the flange's force between `lifted` and `lowered`, axes of the arm's base.
        net: N, its z without the hand's part.
        spread: N, standard deviation of its z.
        off: m, distance of the load's middle from its target place, at the end.
        tilt: rad, of the load at the end.
        stands: whether the target table carries its weight at the end.
        touches: number of contacts with obstacles.
        least: m, least distance of the watched bodies to an obstacle.
        way: m, length of the load's path.
        manipulation, locomotion: s in either mode.
        missed: missed steps of the plan.
        strongest: N, the flange's greatest force while the load is held.
        stopped: whether the run ended in a stop other than its end.
    """

    taken: float | None
    lifted: float | None
    lowered: float | None
    placed: float | None
    force: Array | None
    net: float | None
    spread: float | None
    off: float
    tilt: float
    stands: bool
    touches: int
    least: float
    way: float
    manipulation: float
    locomotion: float
    missed: int
    strongest: float
    stopped: bool


def run(folder: Path, quick: bool) -> Result:
    """Runs the study. `quick`: only the first metre of the path, with the place of delivery beside it."""
    setup = shortened(assumed(NAME)) if quick else assumed(NAME)
    done = run_all([task("load-carrying", setup)], folder)[0]
    found = outcome(done, setup)
    draw(done, found, setup, folder / "load-carrying.png")
    result = Result(NAME, simulated=True, seeds=[setup["seed"]])
    result.claims, result.table = claims(found, setup), table(found, setup)
    result.files = [done.file.name, "load-carrying.png"]
    return result


def sweep(folder: Path) -> list[dict[str, Any]]:
    """Changes one assumption at a time; returns a row for each, with the figures on which the claims rest."""
    setup = assumed(NAME)
    cases = [("as assumed", setup)]
    for what, values in setup["sweep"].items():
        cases += [(f"{what} {value:g}", _changed(setup, what, value)) for value in values]
    tasks = [task("sweep-" + name.replace(" ", "-"), case) for name, case in cases]
    rows = []
    for (name, case), done in zip(cases, run_all(tasks, folder), strict=True):
        found = outcome(done, case)
        held = {claim.id: claim.holds for claim in claims(found, case)}
        rows.append(
            {
                "changed": name,
                "f_z (N)": None if found.force is None else float(found.force[2]),
                "off (m)": found.off,
                "least (m)": found.least,
                "missed": found.missed,
                "fail": ", ".join(c for c, holds in held.items() if not holds) or "none",
            }
        )
    return rows


def _changed(setup: dict[str, Any], what: str, value: Any) -> dict[str, Any]:
    case = deepcopy(setup)
    if what == "speed":
        case["duration"] *= max(setup["speed"] / value, 1.0)  # a slow person gets the time to arrive
    if what in case:
        case[what] = value
    else:
        case["person"][what] = value
    return case


def shortened(setup: dict[str, Any]) -> dict[str, Any]:
    """Returns a setup with a shorter path but the same tasks."""
    case = deepcopy(setup)
    (x, y), (tx, ty) = case["pick"], case["approach"]
    case["way"] = [[tx - 0.4, ty], [tx - 0.4, ty - 0.6], [tx, ty - 0.6]]
    case["place"] = [x, y - 0.6]
    case["obstacles"] = [{"position": [tx - 0.7, ty - 1.4, 0.6], "size": [0.4, 0.4, 1.2]}]
    case["duration"] = 46.0
    return case


# -- the run


def task(name: str, setup: dict[str, Any]) -> Task:
    """Returns the profile with load, tables, obstacles and the person's plan."""
    width, depth, height = setup["table"]
    (px, py), (gx, gy) = setup["pick"], setup["place"]
    across = [0.7071067811865476, 0.0, 0.0, 0.7071067811865476]  # the bar across the fingers
    parts = {
        "arm": {"home": setup["arm_home"]},
        "from": {"part": "box", "size": [width, depth, height], "at": {"position": [px, py, height / 2]}},
        "to": {"part": "box", "size": [width, depth, height], "at": {"position": [gx, gy, height / 2]}},
        "load": {
            "part": "load",
            "at": {"position": [px, py, height + setup["size"][2] / 2 + 0.001], "quaternion": across},
            "gripper": "hand",
            **{key: setup[key] for key in ("mass", "size", "grip", "reach")},
        },
        "boxes": {"part": "obstacles", "boxes": setup["obstacles"], "watch": list(_WATCHED)},
        "person": {"tool": "hand/palm", "plan": plan(setup), "speed": setup["speed"], **setup["person"]},
    }
    return Task(name, "kairos-man", {"sim": {"parts": parts}}, setup["duration"], setup["seed"])


def plan(setup: dict[str, Any]) -> list[dict[str, Any]]:
    """Returns the person's plan.

    To the load in locomotion, take and lift it in manipulation, past the obstacles in locomotion, put it down.
    """
    low = setup["table"][2] + setup["size"][2] + setup["grip"]
    high = low + setup["above"]
    hollow = setup["hollow"]

    def palm(place: list[float], z: float) -> list[float]:
        return [place[0] - hollow[0], place[1] - hollow[1], z - hollow[2]]

    def press(button: str) -> dict[str, Any]:
        return {"do": "press", "button": button}

    def go(place: list[float], z: float, **how: Any) -> dict[str, Any]:
        return {"do": "go_to", "position": palm(place, z), **how}

    wait = {"do": "wait", "seconds": 2.0}
    far: dict[str, Any] = {"tolerance": 0.05, "dwell": 0.0}
    return [
        {"do": "wait", "seconds": 0.5},
        press("A"), press("P"),
        go(setup["approach"], high, **far),
        press("P"),
        go(setup["pick"], high, tolerance=0.01),
        go(setup["pick"], low, tolerance=0.01, dwell=0.5),
        press("G"), wait,
        go(setup["pick"], high, tolerance=0.02),
        press("P"),
        *(go(place, high, **far) for place in setup["way"]),
        press("P"),
        go(setup["place"], high, tolerance=0.01),
        go(setup["place"], low + setup["gap"], tolerance=0.01, dwell=0.5),
        press("G"), wait,
        go(setup["place"], high, tolerance=0.02),
        press("A"), {"do": "wait", "seconds": 1.0},
    ]  # fmt: skip


# -- outcome


def outcome(done: Run, setup: dict[str, Any]) -> Outcome:
    """Computes the outcome from the recording alone."""
    t, held = done.t, done.value("world.load_held")[:, 0] > 0.5
    locomotion = done.value("keys.modes")[:, _LOCOMOTION] > 0.5
    pose = done.value("world.load_pose")
    step = np.diff(t, append=t[-1])
    carried = held & locomotion
    force = net = spread = None
    if carried.any():
        felt, hand = done.value("arm.wrench")[carried], done.value("world.person_wrench")[carried]
        force = felt[:, :3].mean(axis=0)
        net, spread = float((felt[:, 2] - hand[:, 2]).mean()), float(felt[:, 2].std())
    x, y, *_ = pose[-1]
    goal = np.array(setup["place"])
    qx, qy = pose[-1, 3], pose[-1, 4]
    weight = GRAVITY * setup["mass"]
    bears = -done.value("world.to_contact_force")[-1, 2]
    moved = np.linalg.norm(np.diff(pose[:, :3], axis=0), axis=1)
    times = np.flatnonzero(held), np.flatnonzero(carried)
    return Outcome(
        taken=_at(t, times[0], 0),
        lifted=_at(t, times[1], 0),
        lowered=_at(t, times[1], -1),
        placed=None if held[-1] else _at(t, times[0], -1),
        force=force,
        net=net,
        spread=spread,
        off=float(np.hypot(x - goal[0], y - goal[1])),
        tilt=float(2 * np.arcsin(min(np.hypot(qx, qy), 1.0))),
        stands=bool(abs(bears - weight) < 0.1 * weight and not held[-1]),
        touches=int(done.value("world.boxes_touches")[-1, 0]),
        least=float(done.value("world.boxes_distance").min()),
        way=float(moved.sum()),
        manipulation=float(step[~locomotion].sum()),
        locomotion=float(step[locomotion].sum()),
        missed=int(done.value("world.person_progress")[-1, 1]),
        strongest=largest(done.value("arm.wrench")[held][:, :3]),
        stopped=done.summary["cause"] not in ("end", "none"),
    )


def _at(t: Array, where: Any, which: int) -> float | None:
    return float(t[where[which]]) if len(where) else None


def claims(found: Outcome, setup: dict[str, Any]) -> list[Claim]:
    """Returns the paper's statements, and whether they held."""
    tolerance, expected, within = setup["tolerance"], -GRAVITY * setup["mass"], setup["force_within"]
    carried = found.placed is not None and found.lifted is not None
    f_z = None if found.force is None else float(found.force[2])
    return [
        Claim(
            id="load-carried",
            text=f"picked in manipulation, carried in locomotion, placed within {tolerance} m, upright",
            paper="accomplished",
            measured=found.off,
            unit="m off",
            holds=carried
            and found.stands
            and not found.stopped
            and found.off <= tolerance
            and found.tilt <= setup["upright"],
        ),
        Claim(
            id="load-force",
            text=f"f_z at the flange while carried is the load's weight, {expected:.1f} N, within {within:g} N",
            paper="approximately -100 N",
            measured=f_z,
            unit="N",
            holds=f_z is not None and abs(f_z - expected) <= within,
        ),
        Claim(
            id="obstacles-clear",
            text="base, arm, hand and load never touch an obstacle",
            paper="static obstacles successfully avoided",
            measured=found.least,
            unit="m, least distance",
            holds=found.touches == 0 and found.least > 0,
        ),
        Claim(
            id="both-modes",
            text="taken and let go in manipulation, carried in locomotion",
            paper="both phases",
            measured=found.locomotion,
            unit="s in locomotion",
            holds=carried and min(found.manipulation, found.locomotion) > 0,
        ),
    ]


def table(found: Outcome, setup: dict[str, Any]) -> list[dict[str, Any]]:
    """Returns the table's rows: what, the paper's value, ours."""

    def span(a: float | None, b: float | None) -> str | None:
        return None if a is None or b is None else f"{a:.1f} to {b:.1f}"

    rows = [
        ("load (kg)", "10", setup["mass"]),
        ("before the grasp (s)", PAPER["before"], span(0.0, found.taken)),
        ("grasp and lift (s)", PAPER["lifting"], span(found.taken, found.lifted)),
        ("carrying (s)", PAPER["carrying"], span(found.lifted, found.lowered)),
        ("placing (s)", PAPER["placing"], span(found.lowered, found.placed)),
        ("f_z while carried, mean (N)", "about -100", None if found.force is None else float(found.force[2])),
        ("  its standard deviation (N)", None, found.spread),
        ("  without the hand's part (N)", None, found.net),
        ("greatest force while held (N)", None, found.strongest),
        ("load's way (m)", None, found.way),
        ("placed off by (m)", None, found.off),
        ("tilt when placed (rad)", None, found.tilt),
        ("obstacles touched", "0", found.touches),
        ("least distance to an obstacle (m)", None, found.least),
        ("steps of the plan missed", None, found.missed),
    ]
    return [{"": what, "paper (Fig. 14)": paper, "simulated": ours} for what, paper, ours in rows]


# -- the paper's figure


def draw(done: Run, found: Outcome, setup: dict[str, Any], file: Path) -> None:
    """Draws left the flange's path, right forces and positions, coloured by mode as in the paper's Fig. 14."""
    figure = Figure(figsize=(12, 6.5), layout="constrained")
    left, right = cast(Any, figure.subfigures(1, 2, width_ratios=(1, 1.15)))
    every = max(1, len(done.t) // 4000)
    t, at = done.t[::every], done.value("world.arm_flange")[::every]
    mode = done.value("keys.modes")[::every, _LOCOMOTION] > 0.5
    force = done.value("arm.wrench")[::every, :3]
    _path(left, t, at, mode, found, setup)
    _series(right, t, force, at, mode, found)
    figure.suptitle(f"Load carrying, simulated: Kairos, {setup['mass']:g} kg")
    figure.savefig(file, dpi=110)


def _path(figure: Any, t: Array, at: Array, mode: Any, found: Outcome, setup: dict[str, Any]) -> None:
    axes = figure.add_subplot(projection="3d")
    for a, b in _spans(mode):
        axes.plot(*at[a : b + 1].T, color=_YELLOW if mode[a] else _VIOLET)
    for when, color, word in ((found.taken, _BLUE, "pick"), (found.placed, _PURPLE, "place")):
        if when is not None:
            axes.scatter(*at[np.searchsorted(t, when)], color=color, s=60, label=word)
    for color, word in ((_VIOLET, "manipulation"), (_YELLOW, "locomotion")):
        axes.plot([], [], [], color=color, label=word)
    for box in setup["obstacles"]:
        (x, y, z), (a, b, c) = box["position"], box["size"]
        axes.bar3d(x - a / 2, y - b / 2, z - c / 2, a, b, c, color="0.7", alpha=0.3)
    low, high = at.min(axis=0), at.max(axis=0)
    middle, half = (low + high) / 2, float((high - low).max()) / 2 + 0.2
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] - half, middle[1] + half)
    axes.set_zlim(0.0, 1.6)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.set_zlabel("z (m)")
    axes.set_title("the flange's way; obstacles grey")
    axes.legend(loc="upper left", fontsize=8)


def _series(figure: Any, t: Array, force: Array, at: Array, mode: Any, found: Outcome) -> None:
    rows = figure.subplots(2, 1, sharex=True)
    for axes, values, unit in ((rows[0], force, "force at the flange (N)"), (rows[1], at, "flange (m)")):
        for k, (axis, color) in enumerate(zip("xyz", ("#0072B2", "#009E73", "#D55E00"), strict=True)):
            axes.plot(t, values[:, k], color=color, lw=1, label=axis)
        for a, b in _spans(mode):
            axes.axvspan(t[a], t[b], color=_YELLOW if mode[a] else _VIOLET, alpha=0.15, lw=0)
        for begun, ended, color in ((found.taken, found.lifted, _BLUE), (found.lowered, found.placed, _PURPLE)):
            if begun is not None and ended is not None:
                axes.axvspan(begun, ended, color=color, alpha=0.5, lw=0)
        axes.set_ylabel(unit)
        axes.legend(loc="upper right", fontsize=8, ncols=3)
    rows[0].axhline(0.0, color="0.6", lw=0.5)
    rows[1].set_xlabel("s; violet manipulation, yellow locomotion, blue grasp and lift, purple placing")


def _spans(flags: Any) -> list[tuple[int, int]]:
    """Returns index pairs of runs of equal flags; each run ends where the next begins."""
    cuts = [0, *(np.flatnonzero(flags[1:] != flags[:-1]) + 1).tolist(), len(flags) - 1]
    return [(a, b) for a, b in pairwise(cuts) if b > a]
