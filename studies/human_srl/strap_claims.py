"""The claim `strap-compensated`: roll and pitch of a base in its straps, compensated at the tip of the arm.

Every wearer walks with each strap, and with a weld in its place, which is the reference. The wearers differ in size, in
how the arm's motion meets their steps, and in the sensors' noise; sizes as in `srl.sim.wearer.people`.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from math import degrees, radians
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.sim.parts.body.strap import Firmness
from srl.sim.wearer.people import subject
from srl.studies.human_srl.part import NAME, Part
from srl.studies.human_srl.strap_trial import MOVE, SKELETON, Compensation
from srl.studies.result import Claim
from srl.studies.tasks.runner import Runner
from srl.studies.tasks.task import Row, TrialTask
from srl.studies.toolkit.estimates import estimate

STRAPS: Final[tuple[Firmness, ...]] = ("soft", "medium", "hard")
WAYS: Final[tuple[Compensation, ...]] = ("none", "roll-pitch", "with-yaw", "perfect")
LAW: Final = "roll-pitch"
_WEARERS, _SECONDS = 10, 8.0
_QUICK: Final = ((1, 2), 4.0, ("medium",), ("none", LAW))
_SWEPT: Final = 3  # wearers of the sweep
Errors = Mapping[tuple[str, str], Mapping[int, float]]  # mm by strap and way, then by wearer


def claims(runner: Runner, folder: Path, quick: bool) -> Part:
    """Runs the trials and judges the claim; `quick`: two wearers, one strap, two ways."""
    return study(runner, folder, *(_QUICK if quick else (range(1, 1 + _WEARERS), _SECONDS, STRAPS, WAYS)))


def study(
    runner: Runner, folder: Path, who: Sequence[int], seconds: float = _SECONDS, straps: Sequence[Firmness] = STRAPS,
    ways: Sequence[Compensation] = WAYS,
) -> Part:  # fmt: skip
    """Runs the trials of these wearers."""
    asked = [task(n, "rigid", "none", seconds) for n in who]
    asked += [task(n, strap, way, seconds) for n in who for strap in straps for way in ways]
    return analysed(runner.done(asked, folder / "strap"))


def task(number: int, firmness: str, compensation: str, seconds: float = _SECONDS, **options: Any) -> TrialTask:
    """One trial of a wearer. `options`: of `strap_trial.Trial`, beyond those in which the wearers differ."""
    rng = np.random.default_rng([number, 0x57A])
    own = {"scale": round(subject(number, SKELETON.names).scale, 4), "begin": round(rng.uniform(0.0, 2.0 * MOVE), 3)}
    parameters = {
        "wearer": number, "firmness": firmness, "compensation": compensation, "seconds": seconds,
        "options": own | options,
    }  # fmt: skip
    return TrialTask.of(NAME, "human-srl-strap", number, parameters)


def analysed(rows: Sequence[Row]) -> Part:
    """Judges the rows of `claims`."""
    references = {p["wearer"]: tip(row) for row in rows if (p := row.task.parameters)["firmness"] == "rigid"}
    errors: dict[tuple[str, str], dict[int, float]] = {}
    motion: dict[str, list[tuple[float, float, float]]] = {}
    for row in rows:
        p, v = row.task.parameters, row.values
        if p["firmness"] == "rigid" or p["wearer"] not in references:
            continue
        own = errors.setdefault((p["firmness"], p["compensation"]), {})
        own[p["wearer"]] = rms(tip(row), references[p["wearer"]])
        if p["compensation"] == "none":
            shift, tilt, yaw = (float(v[name] or 0.0) for name in ("shift", "tilt", "yaw"))
            moved = (1e3 * shift, degrees(tilt), degrees(yaw))
            motion.setdefault(p["firmness"], []).append(moved)
    table = []
    for (strap, way), own in errors.items():
        moved = np.mean(motion.get(strap, [(np.nan,) * 3]), axis=0).tolist()
        line: dict[str, Any] = {"part": "strap", "strap": strap, "way": way, "n": len(own)}
        line |= estimate(list(own.values())).columns("error_mm")
        line |= dict(zip(("shift_mm", "tilt_deg", "yaw_deg"), moved, strict=True))
        table.append(line)
    return Part([_claim(errors)], table, ["strap/rows.parquet"])


def tip(row: Row) -> Array:
    """(k, 3) mm."""
    return np.array(json.loads(str(row.values["tip"])))


def rms(one: Array, other: Array) -> float:
    """The rms distance of places (k, 3)."""
    return float(np.sqrt(np.mean(np.sum((one - other) ** 2, axis=1))))


def _claim(errors: Errors) -> Claim:
    left, measured, holds = [], [], True
    for strap in (s for s in STRAPS if (s, LAW) in errors and (s, "none") in errors):
        law, none = errors[strap, LAW], errors[strap, "none"]
        both = sorted(law.keys() & none.keys())
        share = estimate([100.0 * law[n] / none[n] for n in both])
        left.append(share.mean)
        measured.append(f"{strap} {share} %")
        holds = holds and share.high < 100.0
    return Claim(
        id="strap-compensated",
        text="roll and pitch alone leave less of the tip's error than no compensation does: on each strap the 95 % "
        f"interval of the share that is left is below 100 %, over wearers: {', '.join(measured) or 'none'}; measured: "
        "the largest mean share",
        paper="none; left to future work", measured=max(left, default=None), unit="%", holds=bool(left) and holds,
    )  # fmt: skip


def sweep(runner: Runner, folder: Path) -> list[dict[str, Any]]:
    """What decides: one thing changed at a time, the law on a medium strap; mm, means of the first wearers."""
    who = range(1, 1 + _SWEPT)
    # What the strap itself does differs from what the sensors do: it changes the uncompensated error, too.
    changes = list(_changes())
    asked = [task(n, "rigid", "none") for n in who]
    for _, way, options in changes:
        asked += [task(n, "medium", each, **options) for n in who for each in dict.fromkeys((way, *_compared(options)))]
    unique = {one.identity: one for one in asked}
    rows = dict(zip(unique, runner.rows(list(unique.values()), folder / "sweep-strap"), strict=True))

    def mean(way: str, options: Mapping[str, Any]) -> float:
        values = []
        for n in who:
            pair = [rows[t.identity] for t in (task(n, "medium", way, **options), task(n, "rigid", "none"))]
            if all(row.done for row in pair):
                values.append(rms(tip(pair[0]), tip(pair[1])))
        return float(np.mean(values)) if values else float("nan")

    found = []
    for label, way, options in changes:
        line = {"claim": "strap-compensated", "changed": label, "error_mm": mean(way, options)}
        found.append(line | {"none_mm": mean("none", options if _compared(options) else {})})
    return found


def _compared(options: Mapping[str, Any]) -> tuple[str, ...]:
    return ("none",) if not options or "strap" in options else ()


def _changes() -> Iterator[tuple[str, str, dict[str, Any]]]:
    """In words, the way, and the options."""
    yield "nothing", LAW, {}
    for angle in (1, 2, 4, 8):
        yield f"sensor's yaw is used, off by {angle} degrees", "with-yaw", {"yaw": radians(angle)}
    yield "sensor's yaw is used, exact", "with-yaw", {"yaw": 0.0}
    for late in (0.0, 0.03, 0.1):
        both = {"delay": late}
        yield f"both sensors {round(1e3 * late)} ms late (8)", LAW, {"base": both, "belt": both}
    for angle in (-4, -2, 2, 4):
        for axis, turn in (("x, ahead", (1, 0, 0)), ("y", (0, 1, 0)), ("z, up", (0, 0, 1))):
            wrong = [radians(angle) * v for v in turn]
            yield f"mount wrong by {angle} degrees about {axis}", LAW, {"mount": wrong}
    yield "no translation (100 kN/m)", LAW, {"strap": {"translation": 1e5}}
    yield "no translation, true rotation", "perfect", {"strap": {"translation": 1e5}}
    yield "translation alone (1 kN m/rad)", LAW, {"strap": {"rotation": 1e3}}
    yield "true rotation", "perfect", {}
