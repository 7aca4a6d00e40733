"""One door handle pressed by a hand that is full: a pure task.

Middle, ring and little finger carry something, so the extra finger presses the lever as the arm goes down. Thumb and
index are free, and the law sees them alone: a pinch is the command.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.rotation import from_matrix
from srl.studies.grasp.applications_rig import LEANING, STAND, Rig
from srl.studies.grasp.bottle_trial import UPRIGHT
from srl.studies.grasp.closing import FIST, HALF
from srl.studies.grasp.lifting_trial import LEAD, LEANS, Draw
from srl.studies.tasks.task import Value

TRIAL: Final = "grasp-door"
POINTS: Final = ["thumb", "index"]
LEVER: Final = 0.12  # m, of the handle
TURN: Final = 0.7  # rad, at which its latch is free
_TORQUE: Final = (0.2, 0.4)  # N m, of its spring at rest and there
_ON: Final = 0.10  # m from the axle, where the finger presses
_OVER: Final = 0.030  # m, of the finger's middle above the bar, when it comes
_DOWN: Final = 0.15  # m, that the arm goes down
_PINCH: Final = np.deg2rad([[20, 15, 15, 10], [0, 35, 35, 20]])  # of thumb and index; ours


def poses() -> list[dict[str, Any]]:
    """Start poses for the search: how near the bar, and how far the finger is bent and turned up against it."""
    return [
        {"distal": distal, "home": [abduction, flexion, 0.0, 0.0]}
        for distal in (0.060, 0.080, 0.100)
        for abduction in (-20.0, 0.0, 20.0)
        for flexion in (0.0, 25.0)
    ]


def trial(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """Presses a door's handle.

    Args:
        text: the profile's.
        parameters: `arm`, of ARMS, whose law sees thumb and index alone; `home`, (4,) degrees, of the finger;
            `distal`, m from the palm to the bar.
        seed: of the draw and of the noise.
    Returns:
        success; reason: "", not turned or leaning (the first link pressed it); closing, which is a pinch; turn, rad,
        the farthest of the lever; pushed and slip, which are 0; force, on the finger, N; root, the first link's share.
    """
    return press(text, parameters, seed)


def press(
    text: str, parameters: Mapping[str, Any], seed: int, watch: Callable[[Rig], None] = lambda rig: None
) -> dict[str, Value]:
    """As `trial`; `watch` is called after each cycle."""
    draw = Draw.of(seed)
    # Draws for objects serve: across the palm is up and down here, and the gap is how far the hand stops from the bar.
    up, along, gap = draw.place
    factor = draw.mass
    part = {
        "part": "door-handle", "length": LEVER, "turn": TURN, "start": factor * _TORQUE[0], "end": factor * _TORQUE[1],
        "friction": 0.6 * draw.friction, "at": {"position": [0.0, 0.0, STAND], "rpy": [0.0, 0.0, np.pi]},
    }  # fmt: skip
    posture = np.deg2rad(np.ravel([*HALF[:2], *FIST[2:]]))
    pinched = posture.copy()
    pinched[:8] += _PINCH.ravel()
    # The bar is at x = -0.05 m, and from the axle toward -y; the finger is 20 mm proximal of the wrist.
    x = -0.05 - (float(parameters["distal"]) + gap - 0.012)
    hand = (x, -_ON - 0.020 + along, STAND + _OVER + up, *from_matrix(UPRIGHT))
    rig = Rig(
        text, parameters["arm"], {"thing": part}, hand, posture, np.deg2rad(parameters["home"]), LEAD * draw.lead, seed,
        {"controllers.1.points": POINTS}, 0.0, watch,
    )  # fmt: skip
    turn, farthest = rig.cell.truth_arrays["thing_turn"], 0.0
    rig.run(0.2)
    rig.go(0.0, 0.8)
    rig.run(1.0)
    rig.person.go(np.array([posture, pinched]), rig.time, draw.seconds)
    rig.run(draw.seconds)
    rig.go(-_DOWN, 1.5)
    for _ in range(18):
        rig.run(0.1)
        farthest = max(farthest, float(turn[0]))
    reason = "not turned" if farthest < TURN else LEANS if rig.leaning > LEANING else ""
    return {
        "success": not reason, "reason": reason, "closing": "pinch", "turn": farthest, "pushed": 0.0,
        "slip": 0.0, "force": rig.force, "root": rig.leaning,
    }  # fmt: skip
