"""One trial of the tracking experiment by a simulated wearer, and its calibration: both are pure tasks.

The profile itself runs in lockstep, from the markers that the simulated cameras see to the control value.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any, Final, cast

import numpy as np

from srl.commissioning.calibration import profile_subset
from srl.commissioning.calibration.guide import Guide, QuitError
from srl.commissioning.calibration.ikns import result as results
from srl.commissioning.calibration.ikns.channel_map import ChannelMap, channel_map
from srl.commissioning.calibration.ikns.procedure import Plan, Procedure
from srl.commissioning.calibration.screen import Plain
from srl.commissioning.calibration.sources import LOOK, Simulated
from srl.control.ikns import record
from srl.control.ikns.calibration import CalibrationError
from srl.control.ikns.record import RecordError
from srl.control.ikns.sibson import Sibson
from srl.control.ikns.thresholds import Thresholds
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Follow, Hold
from srl.sim.devices.gamepad.fake import FakeGamepad
from srl.sim.parts.body.wearer_config import Tracking
from srl.studies.ikns.curves import SECONDS, SETTLE, curve, scores
from srl.studies.ikns.rig import DATE, FILE, Rig, worn
from srl.studies.ikns.trigger import TriggerFinger
from srl.studies.tasks.task import Value

PROFILE: Final = "ikns-finger"
VALUE: Final = "intent.c"
_TIMEOUT: Final = 600.0  # s that a simulated calibration may take
COARSE: Final = 10  # Hz, of the path that is kept for the figure


def calibration(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """The wearer does what `srl calibrate --sim` asks for.

    Args:
        text: the profile's.
        parameters: `set`, overrides by key path; `person`, its anonymous id; `plan`, times that differ.
        seed: of the world.
    Returns:
        `calibration`: the file's content, empty if it is `refused`, which says why; figures of its quality.
    """
    dofs, thresholds = ("swivel",), Thresholds()
    checked, source = worn(text, parameters["set"], seed)
    made, subset = profile_subset.subset(checked, source, parameters["person"], dofs, thresholds, sim=True)
    simulated = Simulated(made, subset, channel_map, lambda _: None)
    seconds = 0.0

    def over() -> bool:
        nonlocal seconds
        seconds += LOOK
        return seconds > _TIMEOUT

    guide = Guide(simulated, Procedure(dofs, thresholds, Plan(**parameters["plan"])), Plain(lambda _: None), over)
    try:
        guide.run()
        result = results.compute(cast(ChannelMap, simulated.channel_map), guide.samples, DATE)
        if result.refusals:
            raise result.refusals[0]
        content = result.record().model_dump_json()
    except (CalibrationError, RecordError, QuitError) as error:
        return {"refused": str(error), "calibration": ""}
    finally:
        simulated.close()
    found = result.found
    return {
        "refused": "",
        "calibration": content,
        "samples": int(found.samples.min()),
        "explained": float(found.explained.min()),
        "range": float((found.upper - found.lower).min()),
        "wander": float(found.wander.max()),
        "agreement": float(found.agreement.min()),
        "noise": math.nan if result.noise is None else float(result.noise.max()),
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
    rig = Rig(text, parameters["set"], seed, parameters["calibration"])
    wearer, c, name, rate = rig.wearer, rig.views[VALUE], parameters["curve"], rig.rate
    sites = record.parse(parameters["calibration"].encode(), FILE).calibration().sites
    x, y, z = sites.mean(axis=0).tolist()
    hull = Sibson(sites)
    times = np.arange(0.0, SETTLE + SECONDS + 1.0, 0.02)
    shown = curve(name, times - SETTLE)
    trigger = None
    if parameters["set"].get("input", "ikns") == "gamepad":
        wearer.instruct(Hold((x, y, z)))
        tracking = Tracking.model_validate(parameters["tracking"])
        trigger = TriggerFinger(tracking, seed=seed, **parameters["trigger"])
        (pad,) = (d.driver for d in rig.lockstep.devices if isinstance(d.driver, FakeGamepad))
    else:
        wearer.instruct(Follow(cast(Any, times), cast(Any, shown[:, None]), ("swivel",), (x, y, z)))
    late = max(round(parameters["display"] * rate), 0)
    count = round((SETTLE + SECONDS) * rate)
    values, hands, held = np.zeros(count), np.zeros((count, 3)), np.zeros(count)
    hand = rig.views["world.wearer_hand"]
    law_held = rig.views.get("intent.held")
    for k in range(count):
        seen = float(values[max(k - 1 - late, 0)])
        if trigger is None:
            wearer.see([seen])
        else:
            pad.hold("right_trigger", trigger.until((k + 1) / rate, lambda t: float(np.interp(t, times, shown)), seen))
        rig.step()
        values[k], hands[k] = c.item(), hand[:3]
        held[k] = 0.0 if law_held is None else law_held.item()
    t = np.arange(1, count + 1) / rate - SETTLE
    counts = t > 0.0
    step = max(round(rate / COARSE), 1)
    return {
        **scores(t[counts], values[counts], name),
        **stillness(hands[counts]),
        "held": float(held[counts].mean()),
        "outside": float(np.mean([hull.nearest(place).distance > 0.0 for place in hands[counts][::step]])),
        "path": json.dumps(np.round(values[counts][step - 1 :: step], 3).tolist()),
    }


def stillness(hand: Array) -> dict[str, float]:
    """How far a hand (n, 3) m was from its mean place."""
    away = np.linalg.norm(hand - hand.mean(axis=0), axis=1)
    return {
        "hand_rms": float(np.sqrt(np.mean(away**2))),
        "hand_p95": float(np.percentile(away, 95)),
        "hand_max": float(away.max()),
    }
