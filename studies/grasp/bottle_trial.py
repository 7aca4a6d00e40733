"""One bottle whose cap is unscrewed by the hand that holds it: a pure task.

Middle, ring and little finger and the extra finger hold it in the air. Thumb and index turn the cap, let go, go back
and take it again. Their pinch isn't simulated: what they do to the cap is a torque about its axis, stroke by stroke.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.rotation import Quaternion, conjugate, from_matrix, log, product
from srl.runtime.contracts.signals import Array
from srl.sim.parts.hand.passive_hand import PALM_FACE
from srl.studies.grasp.applications_rig import LEANING, LIFT, STAND, LostError, Rig
from srl.studies.grasp.cell import PARTIAL, GraspCell
from srl.studies.grasp.closing import PATHS, start
from srl.studies.grasp.lifting_trial import FRICTION, LEAD, LEANS, SAGS, SPREAD, Draw
from srl.studies.grasp.things import Thing
from srl.studies.tasks.task import Value

TRIAL: Final = "grasp-bottle"
DIAMETER: Final = 0.075  # m: what three fingers and palm can't hold alone
HEIGHT: Final = 0.15  # m, without the cap
MASS: Final = 0.3  # kg
CAP: Final = (0.030, 0.025)  # m, diameter and height
TORQUE: Final = 0.05  # N m, of a cap that was loosened; ours: half of what 4 N of a pinch can exert, and no seal
TURN: Final = np.pi  # rad, the specification's
SLIP: Final = 0.005  # m, the specification's
_TOP: Final = -0.012  # m across the palm, where the bottle ends: beside the middle finger
_STROKE: Final = np.deg2rad(60.0)  # that thumb and index reach on both sides of such a cap, by the hand's kinematics
_STROKES: Final = 4  # at most; three do if the bottle doesn't turn along
_SECONDS: Final = 1.5  # for a stroke, at most; and then it isn't turned
_BACK: Final = 0.4  # s to take the cap anew
_EFFORT: Final = 1.2  # times the cap's friction, that thumb and index exert: the thread's drag makes it 1 rad/s
_STAND: Final = 0.2  # m
_CYCLE: Final = 0.01  # s, between two looks
_FREE: Final = 0.4  # share of the place's variation along the bottle: the fingers have to fit between cap and bottle
# The hand's x is down, its palm faces the bottle.
UPRIGHT: Final = np.array([[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]])


def trial(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """Holds a bottle and turns its cap.

    Args:
        text: the profile's.
        parameters: `arm`, of ARMS, whose law sees middle, ring and little finger alone; `home`, (4,) degrees, of the
            finger; `distal`, m, where along the palm the bottle is meant to be.
        seed: of the draw and of the noise.
    Returns:
        success; reason: "", unusable, not lifted, dropped, slipped, not turned; closing; pushed, by the closing hand,
        and slip, while the cap is turned, m, of the bottle's surface; cap, rad that it turned; strokes; force, on the
        finger, N.
    """
    return unscrew(text, parameters, seed)


def unscrew(
    text: str, parameters: Mapping[str, Any], seed: int, watch: Callable[[Rig], None] = lambda rig: None
) -> dict[str, Value]:
    """As `trial`; `watch` is called after each cycle."""
    draw, row = Draw.of(seed), dict[str, Value]()
    row |= {
        "closing": draw.closing,
        "success": False,
        "pushed": 0.0,
        "slip": 0.0,
        "force": 0.0,
        "root": 0.0,
        "cap": 0.0,
        "strokes": 0,
    }
    taken = _taken(text, float(parameters["distal"]), seed)
    if taken is None:
        return row | {"reason": "unusable"}
    diameter, place, posture, path = taken
    middle = np.array([0.0, 0.0, STAND + HEIGHT / 2 + 1e-4])
    part = {
        "part": "bottle", "diameter": diameter, "height": HEIGHT, "mass": MASS * draw.mass, "cap": CAP,
        "torque": TORQUE, "friction": FRICTION * draw.friction, "at": {"position": middle.tolist()},
    }  # fmt: skip
    hand = (*(middle - UPRIGHT @ place).tolist(), *from_matrix(UPRIGHT))
    rig = Rig(
        text, parameters["arm"], {"thing": part}, hand, posture, np.deg2rad(parameters["home"]), LEAD * draw.lead, seed,
        {"controllers.1.points": PARTIAL}, _STAND, watch,
    )  # fmt: skip
    _let_through(rig)
    stood = rig.height
    try:
        row["pushed"] = rig.take(path, draw.seconds)
        reason = "not lifted"
        if rig.height - stood > LIFT - SAGS:
            reason = _turn(rig, diameter, row) or (LEANS if rig.leaning > LEANING else "")
    except LostError:
        reason = "dropped"
    return row | {"success": not reason, "reason": reason, "force": rig.force, "root": rig.leaning}


def _turn(rig: Rig, diameter: float, row: dict[str, Value]) -> str:
    """Turns the cap stroke by stroke; the finger and three others hold the bottle against it."""
    cap, started, turned = rig.cell.truth_arrays["thing_cap"], rig.inside(), rig.turn()
    closed = float(cap[0])  # a closing hand may turn the cap, too: that isn't unscrewing

    def opened() -> float:
        return float(cap[0]) - closed

    body, data = int(rig.cell.model.body("thing/cap").id), rig.cell.data

    def go_on(torque: float) -> None:
        data.xfrc_applied[body, 3:] = torque * data.xmat[body].reshape(3, 3)[:, 2]
        rig.run(_CYCLE)
        moved = np.linalg.norm(rig.inside() - started) + diameter / 2 * angle(turned, rig.turn())
        row["slip"], row["cap"] = max(float(row["slip"] or 0.0), float(moved)), opened()

    effort = _EFFORT * rig.cell.model.dof_frictionloss[rig.cell.model.joint("thing/cap").dofadr[0]]
    for stroke in range(1, _STROKES + 1):
        until, goal = rig.time + _SECONDS, min(opened() + _STROKE, TURN)
        while rig.time < until and opened() < goal:
            go_on(effort)
            if float(row["slip"] or 0.0) > SLIP:
                return "slipped"
        row["strokes"], until = stroke, rig.time + _BACK
        while rig.time < until:
            go_on(0.0)
        if float(row["slip"] or 0.0) > SLIP:
            return "slipped"
        if opened() >= TURN:
            return ""
    return "not turned"


def _let_through(rig: Rig) -> None:
    """Lets thumb and index touch nothing: their pinch is a torque, so they neither hold nor brake."""
    model = rig.cell.model
    for geom in range(model.ngeom):
        if model.geom(geom).name.startswith(("hand/thumb", "hand/index")):
            model.geom_contype[geom] = model.geom_conaffinity[geom] = 0


def angle(one: Quaternion, other: Quaternion) -> float:
    """rad, between two orientations."""
    return float(np.linalg.norm(log(product(conjugate(one), other))))


@lru_cache(maxsize=128)
def _taken(text: str, distal: float, seed: int) -> tuple[float, Array, Array, Array] | None:
    """The bottle's diameter, its place (3,), m, the hand's posture (20,) and way (k, 20), rad."""
    draw = Draw.of(seed)
    diameter = DIAMETER * (1.0 + SPREAD * draw.size)
    x, y, gap = draw.place
    place = np.array([_TOP + _FREE * x + HEIGHT / 2, distal + y, -(PALM_FACE + gap + diameter / 2)])
    lying = from_matrix(np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]))
    cell = GraspCell(text, Thing("cylinder", diameter), (place, lying))
    begin = start(cell)
    if begin is None:
        return None
    cell.centre = place * [0.0, 1.0, 1.0]  # what the holding fingers close on is before them
    return diameter, place, begin[:20], PATHS[draw.closing](cell, begin, PARTIAL)[:, :20]
