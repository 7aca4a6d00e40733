"""One trial of the grasping experiment by a simulated wearer: a pure task.

The profile itself runs in lockstep, from the markers that the simulated cameras see, or from the ring, through law,
guard and servos to the contact with the object.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from srl.control.ikns.calibration import flipped
from srl.control.ikns.record import Record, parse
from srl.runtime.contracts.rotation import Pose
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.models.body import FRACTIONS
from srl.runtime.models.models import BodyModel
from srl.sim.parts.body.arm_posture import ArmPosture
from srl.sim.parts.body.upper_body import UpperBodyPart
from srl.sim.parts.hand.objects import ObjectPart
from srl.sim.parts.hand.ycb import YCB
from srl.studies.ikns.grasp import ASIDE, Task, grasp_trial, wrist
from srl.studies.ikns.grasp_cell import SERVO
from srl.studies.ikns.grasping_wearer import HAND, KINDS, VALUE, Grasping, heading
from srl.studies.ikns.rig import FILE, Rig
from srl.studies.simulated import cell
from srl.studies.tasks.task import Value

PROFILE: Final = "ikns-finger"
STATURE: Final = 1.75
"""m, of the wearer for whom the lengths below are meant; chair and table are set to each."""
BELOW: Final = 0.31  # m, of the table's top below the jugular notch: 0.45 for the seat and 0.58, less 0.72
START: Final = (0.36, -0.24)  # m, from the chest
GOAL: Final = (0.36, -0.06)
_CHEST: Final[Pose] = (0.0, 0.0, 1.1, 1.0, 0.0, 0.0, 0.0)  # where the profile's wearer sits
_LIFT: Final = 0.05  # m; the paper doesn't say
_HANGS: Final = 0.1  # rad, swivel angle of an elbow at the trunk
_FROM_WRIST: Final = 0.020  # m, from the wrist to the finger, along the forearm
_SETTLE: Final = 5.0  # s at most for the hand to go to the side of the start
AIM: Final = 0.004
"""m, standard deviation along each axis of where the hand takes the object, by sight; ours."""
CARRIED: Final = 0.2
"""Share of a wearer's errors of motion that acts on a reach; null-space motion has them whole. Ours: the whole of them
would be 60 mm at the end of a reach, where people scatter less (van Beers et al. 2004); how much less is ours."""
CLEAR: Final = 2.0 * AIM
"""m, that the palm stops short of the object: twice the error of reaching, so that it is seldom knocked over; ours."""
OPTIONS: Final = ("aim", "clear", "servo", "thing", "skin", "outwards", "carried")
"""What a trial's parameters may have besides."""


def trial(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """Pick, lift, place and release of one object.

    Args:
        text: the profile's.
        parameters: `condition`, ikns or ring; `object`, its code; `set`, overrides by key path, which make the wearer;
            `calibration`, the wearer's file; and perhaps `OPTIONS`: `aim`, `clear` (m), `servo`, `thing` (options of
            the servos, of the object), `skin` (friction of the hand's), `outwards`: whether the finger closes with the
            elbow outwards, `carried` (share of errors, see `CARRIED`).
        seed: of the world, and of where the hand takes the object.
    Returns:
        success, reason; duration (s, from the beginning to the release); slip, off, leak (m), tilt (rad), force (N);
        closing, s; c, the greatest control value.
    """
    made = Setting(text, parameters, seed)
    who, c = made.grasper, made.lockstep.graph.row.views[VALUE]
    closed = [0.0]

    def watch() -> None:
        who.watch()
        closed[0] = max(closed[0], float(c[0]))

    found = grasp_trial(made.lockstep, who, made.task, YCB[parameters["object"]], watch=watch)
    return {
        "success": found.success, "reason": found.reason, "duration": found.seconds, "slip": found.slip,
        "tilt": found.tilt, "off": found.off, "force": found.force, "leak": who.leak, "closing": who.closing,
        "c": closed[0],
    }  # fmt: skip


class Setting:
    """A wearer at a table, the hand at the side of an object, the finger open.

    Attributes:
        lockstep, grasper, task: for `grasp_trial`.
    """

    def __init__(self, text: str, parameters: Mapping[str, Any], seed: int) -> None:
        code, rng = parameters["object"], np.random.default_rng([seed, 7])
        stature = parameters["set"].get("models.wearer", {}).get("stature", STATURE)
        size, thing = stature / STATURE, YCB[code]
        x, y = size * START[0], size * START[1]
        goal = (x, y + GOAL[1] - START[1])
        table = _CHEST[2] - size * BELOW
        self.lockstep = _lockstep(text, parameters, seed, (x, y), goal, table)
        world = cell(self.lockstep)
        part = world.part(UpperBodyPart, "wearer")
        aim = parameters.get("aim", AIM)
        miss = (aim * rng.standard_normal(3)).tolist()
        task = Task((x, y), goal, table=table, lift=_LIFT, behind=1.0, clear=parameters.get("clear", CLEAR))
        first, last = (heading(part.body, _CHEST, task, thing, place, _HANGS) for place in ((x, y), goal))
        self.task = replace(task, heading=first, turn=last - first, miss=tuple(miss))
        self.grasper: Grasping = KINDS[parameters["condition"]](self.lockstep, part, _CHEST)
        # A resting hand is over the start: it goes to the side, and the experimenter puts the object there.
        self.grasper.reach(wrist(self.task, thing, (x, y), aside=ASIDE), self.task.pace)
        for _ in range(round(_SETTLE * 1e9 / self.lockstep.period)):
            self.lockstep.step()
            self.grasper.watch()
            if self.grasper.arrived:
                break
        world.part(ObjectPart, "thing").put((x, y, table + thing.height / 2 + 1e-4, 1.0, 0.0, 0.0, 0.0))


def _lockstep(
    text: str,
    parameters: Mapping[str, Any],
    seed: int,
    start: tuple[float, float],
    goal: tuple[float, float],
    table: float,
) -> Lockstep:
    """The profile as it runs for one wearer and one object, with a table."""
    options, code, condition = parameters["set"], parameters["object"], parameters["condition"]
    forearm = options.get("models.wearer", {}).get("lengths", {}).get("forearm", FRACTIONS["forearm"] * STATURE)
    parts, half = "sim.parts", 0.5**0.5
    waits = [start[0] + 0.2, start[1] + 0.5, table + YCB[code].height / 2 + 1e-4]
    file = parse(parameters["calibration"].encode(), FILE)
    if inwards(file) == bool(parameters.get("outwards", False)):
        file = turned_round(file)
    own: dict[str, Any] = {
        "input": condition,
        f"{parts}.wearer.carried": parameters.get("carried", CARRIED),
        f"{parts}.table": {
            "part": "table", "size": [0.5, 0.9], "at": {"position": [start[0], 0.0, table]},
            "start": [0.0, start[1]], "goal": [0.0, goal[1]],
        },
        f"{parts}.hand": {
            "part": "passive-hand", "at": {"parent": "wearer/right_hand", "quaternion": list(HAND)},
            **({"friction": parameters["skin"]} if "skin" in parameters else {}),
        },
        f"{parts}.finger.at": {
            "parent": "wearer/right_forearm", "position": [0.0, 0.030, _FROM_WRIST - forearm],
            "quaternion": [0.0, half, half, 0.0],
        },
        f"{parts}.finger.servo": parameters.get("servo", SERVO),
        f"{parts}.thing": {
            "part": "object", "shape": "ycb", "code": code, "at": {"position": waits}, **parameters.get("thing", {}),
        },
    }  # fmt: skip
    if condition == "ring":
        own["sim.devices.ring"] = {"presses": []}
    return Rig(text, {**options, **own}, seed, file.model_dump_json()).lockstep


def inwards(file: Record) -> bool:
    """Whether c rises when the elbow comes to the trunk."""
    body = BodyModel(kind="body", stature=STATURE, sides=("right",)).body
    arm = ArmPosture(body, "right")
    hold = arm.natural(np.mean([p.site for p in file.points], axis=0), 0.6)
    change = dict(zip((body.names[i] for i in arm.joints), arm.solve(hold, 0.5) - arm.solve(hold, 0.7), strict=True))
    rise = np.mean([p.directions[0] for p in file.points], axis=0) @ [change[joint] for joint in file.joints]
    return bool(rise > 0.0)


def turned_round(file: Record) -> Record:
    """The calibration with the other sense of its degree of freedom, as a person may wish it."""
    return Record.of(
        flipped(file.calibration(), 0), file.thresholds, person=file.person, simulated=file.simulated, date=file.date,
        rate=file.rate, frame=file.frame, joints=file.joints, dofs=file.dofs,
    )  # fmt: skip
