"""Where each arm is at its best: the finger's start pose and where the hand takes the object, found by search.

The splint would be a straw man in a pose that somebody guessed. So poses are tried on seeds that the study doesn't use:
many on two seeds, the best of them on more.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.rotation import from_rpy
from srl.runtime.contracts.signals import Array
from srl.runtime.profile import profile
from srl.sim.parts.hand.passive_hand import PALM_FACE
from srl.studies.grasp.cell import GraspCell
from srl.studies.grasp.things import Thing
from srl.studies.tasks.runner import Runner
from srl.studies.tasks.task import Row, TrialTask

FILE: Final = Path(__file__).with_name("starts.json")
"""What was found, by scene and arm: `distal` (m), `home` (degrees), successes `of` trials of the last round."""
ALIKE: Final = {"as-published": "mapping"}
"""Arms that begin where another one does."""
SEEDS: Final = 10_000
"""The first seed of the search; those of the study begin at 0."""
ROUNDS: Final = ((32, 2), (8, 4), (3, 8))
"""Poses of each round, and the seeds on which each is tried in it; seeds of the rounds before count."""
DISTAL: Final = (0.050, 0.070, 0.090, 0.110)  # m along the palm; the fingers' roots are at 73 mm
BARE: Final = (0.050, 0.065, 0.080, 0.095, 0.110, 0.125)  # m, for the bare hand
_FLEXIONS: Final = ((-50.0, 50.0), (-20.0, 70.0), (-20.0, 70.0))  # degrees
_GAP: Final = 0.012  # m between palm and object, as it is meant
_CLEAR: Final = 0.003  # m between finger and object
_NEAR: Final = 0.060  # m; a finger farther away doesn't wait for the object
_WAY: Final = (0.015, 0.03, 0.05, 0.07, 0.09, 0.11, 0.13, 0.15, 0.17)  # m before the object, on the way to it
_OUTER: Final = 2  # the first of the finger's joints that turns a link other than the first

UNUSABLE: Final = "unusable"
"""The reason of a trial in which the hand can't begin clear of the object, which says nothing about the finger."""


def candidates(thing: Thing, count: int, seed: int) -> list[dict[str, Any]]:
    """Draws poses in which the open hand can come to the object: finger clear of it all the way, and then not far away.

    The first link is never the nearest: what it holds, a stub would hold as well.

    Args:
        thing: the object, as it is meant.
        count: how many, evenly over `DISTAL`.
        seed: of the draw.
    """
    rng, text, found = np.random.default_rng([seed, 16]), profile.find("sixth-finger")[1], []
    turn = from_rpy(0.0, np.pi / 2 if thing.shape == "cylinder" else 0.0, 0.0)
    for number, distal in enumerate(DISTAL):
        place = np.array([0.0, distal, -(PALM_FACE + _GAP + thing.size / 2)])
        cell = GraspCell(text, thing, (place, turn))
        cell.model.geom_margin[cell.model.geom("thing/geom").id] = _NEAR
        before = [GraspCell(text, thing, (place - [0.0, 0.0, way], turn)) for way in _WAY]
        for one in before:
            one.model.geom_margin[one.model.geom("thing/geom").id] = 2.0 * _CLEAR
        finger, q = cell.digits["finger"], np.zeros(cell.n)
        wanted, kept = len(range(number, count, len(DISTAL))), 0
        for _ in range(4000):
            home = [0.0, *(rng.uniform(low, high) for low, high in _FLEXIONS)]
            q[finger] = np.deg2rad(home)
            cell.pose(q)
            apart = cell.apart()[finger]
            outer = apart[_OUTER:].min()
            if _CLEAR < outer < _NEAR and outer < apart[:_OUTER].min() and _passes(before, finger, q):
                found.append({"distal": distal, "home": [round(angle, 1) for angle in home]})
                kept += 1
            if kept == wanted:
                break
    return found


def _passes(cells: Sequence[GraspCell], finger: Any, q: Array) -> bool:
    """Whether the finger is clear of the object at all these places."""
    for cell in cells:
        cell.pose(q)
        if cell.apart()[finger].min() <= _CLEAR:
            return False
    return True


def search(
    poses: Sequence[Mapping[str, Any]],
    task: Callable[[Mapping[str, Any], int], TrialTask],
    runner: Runner,
    folder: Path,
    rounds: Sequence[tuple[int, int]] = ROUNDS,
) -> dict[str, Any]:
    """Returns the pose with most successes; among equals, the one with the least slip.

    Args:
        poses: what is tried.
        task: the trial of a pose on a seed.
        folder: of the rows.
    """
    results: dict[int, list[Row]] = {i: [] for i in range(len(poses))}
    left, first = [*results], SEEDS
    for number, (kept, seeds) in enumerate(rounds):
        left = sorted(left, key=lambda i: _worth(results[i]), reverse=True)[:kept]
        asked = [(i, task(poses[i], first + k)) for i in left for k in range(seeds)]
        rows = runner.rows([one for _, one in asked], folder / f"round-{number}")
        for (i, _), row in zip(asked, rows, strict=True):
            results[i].append(row)
        first += seeds
    best = max(left, key=lambda i: _worth(results[i]))
    good = sum(bool(row.values.get("success")) for row in results[best])
    return {**poses[best], "successes": good, "of": len(results[best])}


def _worth(rows: Sequence[Row]) -> tuple[float, float]:
    usable = [row.values for row in rows if row.values.get("reason") != UNUSABLE]
    if not usable:
        return (0.0, 0.0)
    share = float(np.mean([bool(values.get("success")) for values in usable]))
    return (share, -float(np.mean([float(values.get("slip") or 0.0) for values in usable])))


def found(scene: str, arm: str) -> dict[str, Any]:
    """The start of an arm in a scene: `distal`, m, and `home`, (4,) degrees; of an arm that wasn't searched for, that
    of the one in `ALIKE`, or the splint's.
    """
    arms: dict[str, Any] = json.loads(FILE.read_text(encoding="utf-8"))[scene]
    entry = arms[arm if arm in arms else ALIKE.get(arm, "splint")]
    return {"distal": entry["distal"], "home": entry["home"]}
