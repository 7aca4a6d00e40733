"""One lift of an object that is too large for the hand: a pure task.

The hand comes down over the object, closes, lifts it by 0.1 m and holds it for 5 s.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.rotation import Quaternion, from_rpy
from srl.runtime.contracts.signals import Array
from srl.runtime.models.human_hand import FINGERS
from srl.sim.parts.hand.passive_hand import PALM_FACE
from srl.studies.grasp.applications_rig import LEANING, LIFT, STAND, LostError, Rig
from srl.studies.grasp.cell import GraspCell
from srl.studies.grasp.closing import CLOSINGS, PATHS, start
from srl.studies.grasp.things import Shape, Thing
from srl.studies.tasks.task import Value

TRIAL: Final = "grasp-lifting"
HOLD: Final = 5.0  # s, the specification's
SAGS: Final = 0.02  # m that it may sink in the hand meanwhile; ours
SPREAD: Final = 0.05  # of sizes; ours
LEANS: Final = "leaning"
"""The reason of a trial in which the object is held, but leans on the finger's first link."""


@dataclass(frozen=True)
class Load:
    """What is lifted. `size`, m, as of `Thing`; `mass`, kg; `spread`, the greatest share by which the size differs."""

    shape: Shape
    size: float
    mass: float
    spread: float = SPREAD


LOADS: Final = {
    "box": Load("cube", 0.110, 0.15),
    "die": Load("cube", 0.100, 0.06),
    "mixed": Load("cube", 0.100, 0.10, spread=0.20),
    "near": Load("cube", 0.110, 0.15),
    "can": Load("cylinder", 0.050, 0.15),
}
"""Sizes and masses are ours: the paper names none. The bare hand lifted cubes of 110 mm in none of 36 tries, of 100 mm
in 3, of 90 mm in a third. `mixed` has cubes of 80 to 120 mm, for one start pose. `near` is the box from a start that is
missed. `can` is for the sanity pass: every hand holds it."""


@dataclass(frozen=True)
class Draw:
    """What varies from seed to seed, and is the same for all arms. All of it ours, but for the closing laws.

    Attributes:
        place: (3,) m, of the object across the palm, along it, and away from it, from where it is meant.
        turn: rad, about the palm's normal.
        size: from -1 to 1, of the scene's spread.
        mass, friction, lead: factors.
        closing: joints that curl, or tips that converge.
        seconds: of the closing.
    """

    place: Array
    turn: float
    size: float
    mass: float
    friction: float
    lead: float
    closing: str
    seconds: float

    @classmethod
    def of(cls, seed: int) -> Draw:
        """The draw of a seed; half of the seeds have each closing law."""
        rng = np.random.default_rng([seed, 15])
        return cls(
            place=np.array([rng.uniform(-0.010, 0.010), rng.uniform(-0.010, 0.010), rng.uniform(0.008, 0.016)]),
            turn=rng.uniform(-1.0, 1.0) * np.deg2rad(20.0),
            size=rng.uniform(-1.0, 1.0),
            mass=rng.uniform(0.8, 1.2),
            friction=rng.uniform(0.8, 1.2),
            lead=rng.uniform(0.75, 1.25),
            closing=CLOSINGS[seed % 2],
            seconds=rng.uniform(1.0, 1.6),
        )


FRICTION: Final = 0.8  # as of the parts `object`
LEAD: Final = 0.12  # rad, of the person's intention before the measured hand


def trial(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """Lifts and holds one object.

    Args:
        text: the profile's.
        parameters: `scene`, of LOADS; `arm`, of ARMS; `home`, (4,) degrees, of the finger; `distal`, m, where along the
            palm the object is meant to be; perhaps `hold`, s.
        seed: of the draw and of the noise.
    Returns:
        success; reason: "", unusable (the hand can't begin clear of the object), not lifted, dropped, leaning (held by
        the finger's first link); closing; pushed, by the closing hand, and slip, after it, m; force, the greatest sum
        of contact forces on the finger, N; root, the first link's share of them.
    """
    return lift(text, parameters, seed)


def lift(
    text: str, parameters: Mapping[str, Any], seed: int, watch: Callable[[Rig], None] = lambda rig: None
) -> dict[str, Value]:
    """As `trial`; `watch` is called after each cycle."""
    load, draw = LOADS[parameters["scene"]], Draw.of(seed)
    row: dict[str, Value] = {
        "closing": draw.closing,
        "success": False,
        "pushed": 0.0,
        "slip": 0.0,
        "force": 0.0,
        "root": 0.0,
    }
    taken = _taken(text, parameters["scene"], float(parameters["distal"]), seed)
    if taken is None:
        return row | {"reason": "unusable"}
    thing, place, quaternion, posture, path = taken
    half = thing.size / 2
    at = np.array([0.0, 0.0, STAND + half + 1e-4])
    part = thing.part(at, quaternion) | {
        "mass": load.mass * draw.mass, "friction": FRICTION * draw.friction, "held_until": 0.0,
    }  # fmt: skip
    rig = Rig(
        text, parameters["arm"], {"thing": part}, (*(at - place).tolist(), 1.0, 0.0, 0.0, 0.0), posture,
        np.deg2rad(parameters["home"]), LEAD * draw.lead, seed, watch=watch,
    )  # fmt: skip
    reason, stood = "not lifted", rig.height
    try:
        row["pushed"] = rig.take(path, draw.seconds)
        held = rig.inside()
        if rig.height - stood > LIFT - SAGS:
            reason = "dropped"
            rig.run(parameters.get("hold", HOLD))
            if rig.height - stood > LIFT - SAGS:
                reason = LEANS if rig.leaning > LEANING else ""
        row["slip"] = float(np.linalg.norm(rig.inside() - held))
    except LostError:
        pass
    return row | {"success": not reason, "reason": reason, "force": rig.force, "root": rig.leaning}


@lru_cache(maxsize=128)
def _taken(text: str, load: str, distal: float, seed: int) -> tuple[Thing, Array, Quaternion, Array, Array] | None:
    """The object, its place (3,), m, and turn in the hand's frame, and the hand's posture (20,) and way (k, 20), rad.

    None if the hand can't begin clear of it. Kept, because arms and poses are tried on the same.
    """
    draw, meant = Draw.of(seed), LOADS[load]
    thing = Thing(meant.shape, meant.size * (1.0 + meant.spread * draw.size))
    x, y, gap = draw.place
    place = np.array([x, distal + y, -(PALM_FACE + gap + thing.size / 2)])
    quaternion = from_rpy(0.0, np.pi / 2 if meant.shape == "cylinder" else 0.0, draw.turn)
    geometry = GraspCell(text, thing, (place, quaternion))
    begin = start(geometry)
    if begin is None:
        return None
    return thing, place, quaternion, begin[:20], PATHS[draw.closing](geometry, begin, FINGERS)[:, :20]
