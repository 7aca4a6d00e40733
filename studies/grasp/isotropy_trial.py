"""One object at one place, closed around by a hand without and with its extra finger: a pure task."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.runtime.models.human_hand import FINGERS
from srl.studies.grasp.cell import PARTIAL, GraspCell
from srl.studies.grasp.closing import MOTIONS, Closing, Motion, follow, start
from srl.studies.grasp.measures import Contacts, epsilon, force_closure, isotropy, isotropy_of_moments, wrenches
from srl.studies.grasp.things import FRICTION, Thing
from srl.studies.tasks.task import Value

PROFILE: Final = "sixth-finger"
TRIAL: Final = "grasp-isotropy"
UNITS: Final = ("mm", "l", "m")
"""How torques are counted: in N mm, by the object's own length, in N m."""
SEEN: Final = ("measured", "intended")
"""What the mapping sees of the hand: stopped by the object, or as it would go on."""
AUGMENTED: Final = ("whole", "partial", "partial_all")
"""From all fingertips; from middle, ring and little finger while thumb and index don't move, or close as well."""
_DRAWS: Final = 400  # random contacts


def trial(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """Closes a hand around an object by each closing law, and lets the extra finger follow in each way.

    Args:
        text: the profile's.
        parameters: `shape`; `size`, m; `set`, overrides by key path; `grasps`, those of AUGMENTED that are wanted;
            `closings`, of CLOSINGS.
        seed: of where the object is.
    Returns:
        `usable`: False if hand or finger can't even begin clear of the object. Then for each closing law and grasp
        `CLOSING_GRASP_MEASURE`: `n`, contacts; `touch`, those of the extra finger; `gii_UNIT`; `closed`; `epsilon`, N.
        The human hand's are `CLOSING_human_MEASURE`, with `null_UNIT`, the mean isotropy with as many contacts at
        random as the finger has in the whole grasp (one, if it has none), `raised_UNIT`, the share of single random
        contacts that raise it, and `better_UNIT`, the share of the random ones that the measured whole grasp beats.
    """
    thing, rng = Thing(parameters["shape"], parameters["size"]), np.random.default_rng([seed, 1])
    place = thing.place(rng)
    row: dict[str, Value] = {"distal": float(place[0][1]), "gap": float(-place[0][2] - thing.size / 2)}
    cell = GraspCell(text, thing, place, parameters["set"])
    begin = start(cell)
    row["usable"] = begin is not None
    if begin is not None:
        for closing in parameters["closings"]:
            found = _grasps(cell, thing, begin, closing, parameters["grasps"], rng)
            row |= {f"{closing}_{name}": value for name, value in found.items()}
    return row


def _grasps(
    cell: GraspCell, thing: Thing, begin: Array, closing: Closing, wanted: Sequence[str], rng: np.random.Generator
) -> dict[str, Value]:
    motion = MOTIONS[closing](cell, begin, FINGERS)
    cell.pose(np.append(motion.postures[-1], begin[20:]))
    human = cell.contacts(FINGERS)
    row = {f"human_{k}": v for k, v in _measured(human, thing).items()}
    for grasp in grasps(cell, begin, closing, motion, wanted):
        cell.pose(grasp.postures[-1])
        found = _measured(cell.contacts([*grasp.digits, *cell.extra]), thing) | {
            "touch": len(cell.contacts(cell.extra))
        }
        row |= {f"{grasp.name}_{grasp.seen}_{k}": v for k, v in found.items()}
    return row | _null(human, thing, row, rng)


@dataclass(frozen=True)
class Grasp:
    """One closing of hand and finger.

    Attributes:
        name: of AUGMENTED.
        seen: of SEEN.
        digits: the human fingers that close.
        postures: (k, n) rad, from the start to the grasp.
    """

    name: str
    seen: str
    digits: Sequence[str]
    postures: Array


def grasps(
    cell: GraspCell, begin: Array, closing: Closing, motion: Motion, wanted: Sequence[str] = AUGMENTED
) -> Iterator[Grasp]:
    """Closes the extra finger in each way. `motion`: of a hand that closes all its fingers from `begin`."""
    for name in wanted:
        moves, digits = motion, list(FINGERS)
        if name == "partial":
            moves, digits = MOTIONS[closing](cell, begin, PARTIAL), PARTIAL
        for seen in SEEN:
            law = "whole" if name == "whole" else "partial"
            yield Grasp(name, seen, digits, follow(cell, law, begin, moves, getattr(moves, seen)))


def _measured(contacts: Contacts, thing: Thing) -> dict[str, Value]:
    W = wrenches(contacts, FRICTION, thing.length)
    closed = force_closure(W)
    return {
        "n": len(contacts), "closed": closed, "epsilon": epsilon(W) if closed else 0.0,
        **{f"gii_{unit}": isotropy(contacts.points, length(unit, thing)) for unit in UNITS},
    }  # fmt: skip


def length(unit: str, thing: Thing) -> float:
    """m, by which torques are divided."""
    return {"mm": 0.001, "l": thing.length, "m": 1.0}[unit]


def _null(human: Contacts, thing: Thing, row: Mapping[str, Value], rng: np.random.Generator) -> dict[str, Value]:
    """What contacts at random places do instead of the finger's."""
    extra = max(int(row.get("whole_measured_touch") or 0), 1)
    points = thing.surface(rng, _DRAWS * extra).points.reshape(_DRAWS, extra, 3)
    first, second = human.points.sum(axis=0), human.points.T @ human.points
    found: dict[str, Value] = {}
    for unit in UNITS:
        scale, bare = length(unit, thing), float(row[f"human_gii_{unit}"] or 0.0)
        outer = np.einsum("mki,mkj->mkij", points, points)
        one = isotropy_of_moments(len(human) + 1, first + points[:, 0], second + outer[:, 0], scale)
        some = isotropy_of_moments(len(human) + extra, first + points.sum(1), second + outer.sum(1), scale)
        found |= {f"human_null_{unit}": float(some.mean()), f"human_raised_{unit}": float((one > bare).mean())}
        if "whole_measured_n" in row:
            found[f"human_better_{unit}"] = float((float(row[f"whole_measured_gii_{unit}"] or 0.0) > some).mean())
    return found
