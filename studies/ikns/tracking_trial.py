"""One trial of the tracking experiment by a simulated wearer, and its calibration: both are pure tasks.

The profile itself runs in lockstep, from the markers that the simulated cameras see to the control value.
"""

from __future__ import annotations

import datetime
import json
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any, Final, cast

import numpy as np

from runtime.contracts.errors import SrlError
from runtime.contracts.files import Files
from runtime.contracts.signals import Array
from runtime.control.ikns import record
from runtime.control.ikns.calibration import Recording, Thresholds, calibrate, refusals
from runtime.control.ikns.sibson import Sibson
from runtime.loop.lockstep import Lockstep
from runtime.profile import profile, wiring
from sim.devices.gamepad.fake import FakeGamepad
from sim.parts.body.instructions import Explore, Follow, Hold, Instruction
from sim.parts.body.upper_body import UpperBodyPart
from sim.parts.body.wearer_config import Tracking
from sim.world.cell import Cell
from studies.ikns.curves import SECONDS, SETTLE, curve
from studies.ikns.trigger import TriggerFinger
from studies.tasks.task import Value
from studies.toolkit.errors import StudyError

PROFILE: Final = "ikns-finger"
CALIBRATION: Final = "ikns-finger.calibration.json"  # as the profile names it
VALUE: Final = "intent.c"
_DATE: Final = datetime.date(2024, 1, 1)  # of simulated calibrations: a task depends on no clock
_PATIENCE: Final = 20.0  # s for the hand to come to a point
_EXPLORATION: Final = 60.0  # s, as in the paper
_HELD: Final = 5.0  # s at a point
_COARSE: Final = 10  # Hz, of the path that is kept for the figure


def calibration(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """The wearer does what a calibration asks for: a minute of exploration, then 10 points, 5 s each.

    Args:
        text: the profile's.
        parameters: `set`, overrides by key path; `calibration`, any valid one, which the profile's law needs to run.
        seed: of the world.
    Returns:
        `calibration`: the file's content, empty if it is `refused`, which says why; figures of its quality.
    """
    lockstep = _lockstep(text, parameters, seed)
    part, views = _wearer(lockstep), lockstep.graph.row.views
    rate = float(lockstep.graph.profile.rate)
    rows: list[tuple[float, ...]] = []

    def tell(instruction: Instruction, seconds: float, trial: bool = False) -> Array:
        part.wearer.instruct(instruction)
        for _ in range(round(_PATIENCE * rate)):
            lockstep.step()
            if isinstance(instruction, Explore) or part.wearer.done:
                break
        else:
            raise StudyError("calibration", f"the hand didn't get there: {instruction}", "Look at the wearer's options")
        hand = []
        for _ in range(round(seconds * rate)):
            lockstep.step()
            hand.append(views["arm.hand"][:3].copy())
            if trial:
                rows.append((lockstep.count / rate, *views["arm.angles"], *hand[-1]))
        return np.array(hand)

    explored = tell(Explore(_EXPLORATION), _EXPLORATION)
    middle, half = 0.5 * (explored.max(axis=0) + explored.min(axis=0)), 0.5 * np.ptp(explored, axis=0)
    for corner in (*product((-1.0, 1.0), repeat=3), (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)):
        x, y, z = (middle + 0.9 * half * corner).tolist()
        tell(Hold((x, y, z)), 1.0)
        tell(Hold((x, y, z), "swivel"), _HELD, trial=True)
    data, thresholds = np.array(rows), Thresholds()
    try:
        found = calibrate(Recording(data[:, 0], data[:, 1:-3], data[:, -3:], np.zeros(len(data), int)), thresholds)
        for reason in refusals(found, thresholds):
            raise reason
        made = record.Record.of(
            found, thresholds, person="simulated", date=_DATE, rate=rate, frame="chest",
            joints=lockstep.graph.layout.fields["arm.angles"].labels, dofs=("swivel",),
        )  # fmt: skip
    except SrlError as error:
        return {"refused": f"{error.place}: {error.problem}", "calibration": ""}
    return {
        "refused": "",
        "calibration": made.model_dump_json(),
        "samples": int(found.samples.min()),
        "explained": float(found.explained.min()),
        "range": float((found.upper - found.lower).min()),
        "wander": float(found.wander.max()),
        "agreement": float(found.agreement.min()),
    }


def trial(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """One trial: 5 s to bring the pointer to the curve's beginning, then 25 s that count.

    Args:
        text: the profile's.
        parameters: `set`, overrides by key path, among them `input`; `calibration`, the wearer's file; `curve`, T1, T2
            or T3; `display`, s until the pointer is seen; `trigger`, options of `TriggerFinger`; `tracking`, as of
            the part `upper-body`.
        seed: of the world.
    Returns:
        rmse, mean_error, worst_step: % of the greatest value; hand_rms, hand_p95, hand_max: m from its mean place;
        outside, held: share of the 25 s; path: JSON, the value each 0.1 s, from 0.1 s on.
    """
    lockstep = _lockstep(text, parameters, seed)
    part, graph = _wearer(lockstep), lockstep.graph
    c = graph.row.views[VALUE]
    name, rate = parameters["curve"], float(graph.profile.rate)
    sites = record.parse(parameters["calibration"].encode(), CALIBRATION).calibration().sites
    x, y, z = sites.mean(axis=0).tolist()
    hull = Sibson(sites)
    times = np.arange(0.0, SETTLE + SECONDS + 1.0, 0.02)
    shown = curve(name, times - SETTLE)
    trigger = None
    if parameters["set"].get("input", "ikns") == "gamepad":
        part.wearer.instruct(Hold((x, y, z)))
        tracking = Tracking.model_validate(parameters["tracking"])
        trigger = TriggerFinger(tracking, seed=seed, **parameters["trigger"])
        (pad,) = (d.driver for d in lockstep.devices if isinstance(d.driver, FakeGamepad))
    else:
        part.wearer.instruct(Follow(cast(Any, times), cast(Any, shown[:, None]), ("swivel",), (x, y, z)))
    late = max(round(parameters["display"] * rate), 0)
    count = round((SETTLE + SECONDS) * rate)
    values, hands, held = np.zeros(count), np.zeros((count, 3)), np.zeros(count)
    hand = graph.row.views["world.wearer_hand"]
    law_held = graph.row.views.get("intent.held")
    for k in range(count):
        seen = float(values[max(k - 1 - late, 0)])
        if trigger is None:
            part.wearer.see([seen])
        else:
            pad.hold("right_trigger", trigger.until((k + 1) / rate, lambda t: float(np.interp(t, times, shown)), seen))
        lockstep.step()
        values[k], hands[k] = c.item(), hand[:3]
        held[k] = 0.0 if law_held is None else law_held.item()
    t = np.arange(1, count + 1) / rate - SETTLE
    counts = t > 0.0
    row: dict[str, Value] = dict(scores(t[counts], values[counts], name))
    row |= stillness(hands[counts])
    step = max(round(rate / _COARSE), 1)
    return row | {
        "held": float(held[counts].mean()),
        "outside": float(np.mean([hull.nearest(place).distance > 0.0 for place in hands[counts][::step]])),
        "path": json.dumps(np.round(values[counts][step - 1 :: step], 3).tolist()),
    }


def scores(t: Array, value: Array, name: str) -> dict[str, float]:
    """How well a control value (n,) at t (n,) s followed a curve: % of the greatest value."""
    error = 100.0 * (value - curve(name, t))
    return {
        "rmse": float(np.sqrt(np.mean(error**2))),
        "mean_error": float(np.mean(np.abs(error))),
        "worst_step": float(100.0 * np.abs(np.diff(value)).max(initial=0.0)),
    }


def stillness(hand: Array) -> dict[str, float]:
    """How far a hand (n, 3) m was from its mean place."""
    away = np.linalg.norm(hand - hand.mean(axis=0), axis=1)
    return {
        "hand_rms": float(np.sqrt(np.mean(away**2))),
        "hand_p95": float(np.percentile(away, 95)),
        "hand_max": float(away.max()),
    }


def _lockstep(text: str, parameters: Mapping[str, Any], seed: int) -> Lockstep:
    """The profile as it runs for one wearer."""
    part = "sim.parts.wearer"
    # What the wearer sees is the screen, not the finger.
    own = {f"{part}.plan": [], f"{part}.watches": {}, "seed": seed}
    overrides = [f"{key}={json.dumps(value)}" for key, value in {**parameters["set"], **own}.items()]
    files = Files(recorded={CALIBRATION: parameters["calibration"].encode()})
    return Lockstep(wiring.build(*profile.parse(f"{PROFILE}.yaml", text, overrides, files), []))


def _wearer(lockstep: Lockstep) -> UpperBodyPart:
    parts: Sequence[Any] = list(cast(Cell, lockstep.graph.world).parts.values())
    (found,) = (part for part in parts if isinstance(part, UpperBodyPart))
    return found
