"""One trial of the robustness study: the profile `ikns-finger` as it is, with something wrong. A pure task."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any, Final, cast

import numpy as np

from srl.control.ikns import record
from srl.runtime.contracts import rotation
from srl.runtime.contracts.wearer import Follow, Hold
from srl.runtime.ipc.header import State
from srl.runtime.ipc.requests import RequestKind
from srl.studies.ikns.curves import SETTLE, curve, scores
from srl.studies.ikns.rig import FILE, Rig
from srl.studies.tasks.task import Value

CURVE: Final = "T3"
SECONDS: Final = 15.0  # of the curve
MARKERS: Final = ("RSHO", "RUPA", "RELB", "RFRM", "RWRA", "RWRB", "RFIN")  # of clavicle and arm
_BURST: Final = (0.05, 0.7)  # s, least and longest drop-out of a marker; evenly in its logarithm
_SWAP: Final = (0.5, 2.0)  # s, how long two labels are exchanged, and from one exchange to the next
_STOPPED: Final = 50  # cycles that somebody takes until a reset


def trial(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """5 s to settle, the first 15 s of the curve T3.

    Args:
        text: the profile's.
        parameters: `set`, overrides by key path; `calibration`, the wearer's file; `closed`: whether the wearer sees c,
            else it moves by time alone; `display`: s until c is seen; what is wrong, if anything: `dropout`, share of
            the time in which each marker of the arm isn't seen; `swap`, two of the device's markers whose labels are
            exchanged, and `always`, whether for good; `turn`, degrees by which the hand is held turned.
        seed: of the world.
    Returns:
        rmse: % of the greatest value, from the curve; worst_c, 1/s, and worst_command, rad/s: the fastest change from
        cycle to cycle, of c and of the finger's command behind the guard; held: share of the cycles; stops: how often
        the limb stopped and was reset; path: JSON, c in each cycle of the 15 s.
    """
    own: dict[str, Any] = dict(parameters["set"])
    if share := parameters.get("dropout", 0.0):
        windows = {f"wearer/{marker}": gaps(share, seed, i) for i, marker in enumerate(MARKERS)}
        own["sim.devices.mocap"] = own.get("sim.devices.mocap", {}) | {"occlusion": windows}
    rig = Rig(text, own, seed, parameters["calibration"])
    if "swap" in parameters:
        rig.disturb = _swapped(rig, parameters["swap"], parameters["always"])
    sites = record.parse(parameters["calibration"].encode(), FILE).calibration().sites
    x, y, z = sites.mean(axis=0).tolist()
    times = np.arange(0.0, SETTLE + SECONDS + 1.0, 0.02)
    shown = curve(CURVE, times - SETTLE)[:, None]
    rig.tell(Hold((x, y, z)), 1.0)
    if turn := parameters.get("turn", 0.0):
        w, i, j, k = rotation.product(rotation.exp(0.0, 0.0, float(np.deg2rad(turn))), _quaternion(rig))
        rig.tell(Hold((x, y, z), turn=(w, i, j, k)), 1.0)
    rig.wearer.instruct(Follow(cast(Any, times), cast(Any, shown), ("swivel",)))
    count, late = round((SETTLE + SECONDS) * rig.rate), round(parameters["display"] * rig.rate)
    c, held = np.full(count, np.nan), np.zeros(count)
    command = np.zeros((count, rig.views["finger.position_command.applied"].size))
    stops = since = 0
    for n in range(count):
        if parameters["closed"]:
            rig.wearer.see([float(c[max(n - 1 - late, 0)])])
        stopped = rig.lockstep.cycle.machine.state is State.STOPPED
        stops += stopped and since == 0
        since = since + 1 if stopped else 0
        rig.step(RequestKind.RESET if since > _STOPPED else RequestKind.NONE)
        c[n], held[n] = rig.views["intent.c"].item(), rig.views["intent.held"].item()
        command[n] = rig.views["finger.position_command.applied"]
    t = np.arange(1, count + 1) / rig.rate - SETTLE
    counts = t > 0.0
    return {
        "rmse": scores(t[counts], c[counts], CURVE)["rmse"],
        "worst_c": float(np.abs(np.diff(c[counts])).max() * rig.rate),
        "worst_command": float(np.abs(np.diff(command[counts], axis=0)).max() * rig.rate),
        "held": float(held[counts].mean()),
        "stops": stops,
        "path": json.dumps(np.round(c[counts], 4).tolist()),
    }


def gaps(share: float, seed: int, marker: int) -> list[tuple[float, float]]:
    """Windows, s of world time, in which a marker isn't seen; `share` of the time in the mean, from the third s on."""
    rng = np.random.default_rng([seed, marker])
    low, high = np.log(_BURST)
    mean = (_BURST[1] - _BURST[0]) / (high - low)
    found, t = list[tuple[float, float]](), 3.0
    while t < SETTLE + SECONDS + 10.0:
        begin = t + float(rng.exponential(mean * (1.0 - share) / share)) + 0.01
        t = begin + float(np.exp(rng.uniform(low, high)))
        found.append((round(begin, 4), round(t, 4)))
    assert all(a[1] < b[0] for a, b in pairwise(found))
    return found


def _swapped(rig: Rig, pair: list[str], always: bool) -> Callable[[], None]:
    """Exchanges two labels, from the time on at which the hand is at its point."""
    labels = rig.lockstep.graph.layout.fields["mocap.markers"].labels
    a, b = (labels.index(name) for name in pair)
    points = rig.views["mocap.markers"]

    def exchange() -> None:
        t = rig.lockstep.count / rig.rate - SETTLE
        if t > 0.0 and (always or t % _SWAP[1] < _SWAP[0]):
            points[[a, b]] = points[[b, a]]

    return exchange


def _quaternion(rig: Rig) -> rotation.Quaternion:
    w, i, j, k = rig.views["world.wearer_hand"][3:].tolist()
    return (w, i, j, k)
