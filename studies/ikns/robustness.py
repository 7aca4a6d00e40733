"""How the control value and the finger bear what goes wrong with the markers and the body: one thing at a time.

The profile `ikns-finger` with its own simulated wearer and calibration. Read in two ways: closed loop, the wearer
follows the curve T3 and sees c; open loop, the wearer moves by time alone, and c is compared with c of the same motion
with nothing wrong.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.studies.ikns.columns import mean, most
from srl.studies.ikns.rig import FILE
from srl.studies.ikns.robustness_trial import MARKERS
from srl.studies.ikns.wearers import assumed
from srl.studies.result import Claim, Result
from srl.studies.tasks.runner import Runner
from srl.studies.tasks.task import Row, TrialTask
from srl.studies.toolkit.statistics import interval

STUDY: Final = "ikns-robustness"
PROFILE: Final = "ikns-finger"
SEEDS: Final = 3
PICTURE: Final = "robustness.png"
_MOCAP: Final = "sim.devices.mocap"
_SWAY: Final = "sim.parts.wearer.sway"
_FASTEST: Final = 4.0  # rad/s, the guard's limit in the profile


@dataclass(frozen=True)
class Condition:
    """One thing that is wrong, and how much of it.

    Attributes:
        what: one curve of the picture.
        much: in the words of the table.
        parameters: of the trial, on top of the common ones.
        open: whether the open loop says something: the motion is the undisturbed one.
    """

    what: str
    much: str
    parameters: dict[str, Any] = field(default_factory=dict)
    open: bool = True


def conditions() -> list[Condition]:
    """The first one has nothing wrong."""
    found = [Condition("nothing", "")]
    found += [Condition("marker noise", f"{mm} mm", {"set": {_MOCAP: {"noise": 1e-3 * mm}}}) for mm in (1, 2, 3, 5)]
    found += [Condition("drop-outs", f"{share:.0%}", {"dropout": share}) for share in (0.05, 0.10, 0.20)]
    for pair in (["rwra", "rwrb"], ["relb", "rfrm"]):
        for always in (False, True):
            words = f"{' and '.join(pair)}, {'for good' if always else '0.5 s of 2 s'}"
            found.append(Condition("swapped", words, {"swap": pair, "always": always}))
    found += [Condition("torso", f"{d} degrees rms", {"set": {_SWAY: float(np.deg2rad(d))}}) for d in (10, 15)]
    found.append(Condition("hand turned", "20 degrees", {"turn": 20.0}, open=False))
    for marker in MARKERS:
        slip = {"sim.parts.wearer.slip": {marker: {"by": [0.0, 0.0, -0.01]}}}
        found.append(Condition("slip", f"{marker} by 10 mm along its segment", {"set": slip}))
    return found


def run(folder: Path, quick: bool, runner: Runner) -> Result:
    """Runs all trials; `quick`: three conditions, one seed."""
    chosen = conditions()
    if quick:
        chosen = [c for c in chosen if c.what == "nothing" or c.much in ("5 mm", "20%")]
    count = 1 if quick else SEEDS
    rows = runner.rows(tasks(chosen, count), folder)
    found = {_key(row): row for row in rows if row.done}
    table = [_line(condition, found, count) for condition in chosen]
    _draw(folder / PICTURE, table)
    return Result(STUDY, True, list(range(1, count + 1)), claims=_claims(table), table=table, files=[PICTURE])


def _key(row: Row) -> tuple[str, str, bool, int]:
    given = row.task.parameters
    return given["what"], given["much"], given["closed"], row.task.seed


def tasks(chosen: Iterable[Condition], count: int) -> list[TrialTask]:
    """All seeds of one condition together."""
    calibration = (resources.files("srl.profiles") / FILE).read_text()
    found = []
    for seed in range(1, count + 1):
        for condition in chosen:
            for closed in (True, False) if condition.open else (True,):
                given = {"set": {}, "calibration": calibration, "closed": closed, "display": assumed()["display"]}
                given |= {"what": condition.what, "much": condition.much} | condition.parameters
                found.append(TrialTask.of(STUDY, "ikns-robustness", seed, given, profile=PROFILE))
    return found


def _line(condition: Condition, found: dict[tuple[str, str, bool, int], Row], count: int) -> dict[str, Any]:
    """A row of the table: means over the seeds, the RMSE with Student's interval."""
    seeds = range(1, count + 1)
    closed = [r.values for s in seeds if (r := found.get((condition.what, condition.much, True, s)))]
    open_loop = [
        (found.get((condition.what, condition.much, False, s)), found.get(("nothing", "", False, s))) for s in seeds
    ]
    apart = [_apart(own, base) for own, base in open_loop if own and base]
    rmse: list[Any] = [values["rmse"] for values in closed]
    low, high = interval(rmse) if len(rmse) > 1 else (float("nan"), float("nan"))
    return {
        "what": condition.what,
        "much": condition.much,
        "trials": len(closed),
        "rmse": mean(closed, "rmse"),
        "low": low,
        "high": high,
        "open rms": mean(apart, "rms") if condition.open else None,
        "open max": mean(apart, "max") if condition.open else None,
        "fastest c, 1/s": most(closed, "worst_c"),
        "fastest command, rad/s": most(closed, "worst_command"),
        "held": mean(closed, "held"),
        "stops": sum(int(str(values["stops"])) for values in closed),
    }


def _apart(own: Row, base: Row) -> dict[str, float]:
    """How far c is from c of the same motion with nothing wrong, `rms` and `max`, % of the range."""
    off: Array = np.array(json.loads(str(own.values["path"]))) - np.array(json.loads(str(base.values["path"])))
    return {"rms": 100.0 * float(np.sqrt(np.mean(off**2))), "max": 100.0 * float(np.abs(off).max())}


def _claims(table: list[dict[str, Any]]) -> list[Claim]:
    """Ours: the paper disturbs nothing. None is about the finger's command: the guard bounds what is read of it."""
    swapped = [line["open rms"] for line in table if line["what"] == "swapped"]
    if not swapped:
        return []
    worst = max(swapped)
    return [
        Claim(
            id="swapped-seen", text="exchanged labels change c by less than 5 % of its range, rms",
            paper="", measured=worst, unit="% of range", holds=worst < 5.0,
        )
    ]  # fmt: skip


def _draw(file: Path, table: list[dict[str, Any]]) -> None:
    """Closed and open loop, and the fastest command, beside each other."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 0.3 * len(table) + 1.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 3, sharey=True)
    at = np.arange(len(table))[::-1]
    rmse = np.array([line["rmse"] for line in table])
    reach = np.array([[line["rmse"] - line["low"], line["high"] - line["rmse"]] for line in table]).T
    axes[0].errorbar(rmse, at, xerr=np.nan_to_num(reach), fmt="o", capsize=3)
    axes[0].axvline(rmse[0], color="0.8")
    axes[0].set_xlabel("closed loop, RMSE, % of range (95 % interval)")
    apart = np.array([np.nan if line["open rms"] is None else line["open rms"] for line in table], dtype=float)
    axes[1].plot(apart, at, "s", color="C1")
    axes[1].set_xlabel("open loop, c off by, rms, % of range")
    axes[2].plot([line["fastest command, rad/s"] for line in table], at, "d", color="C2")
    axes[2].axvline(_FASTEST, color="0.5", linestyle="--")
    axes[2].set_xlabel("fastest command behind the guard, rad/s")
    axes[0].set_yticks(at, [f"{line['what']} {line['much']}".strip() for line in table])
    figure.suptitle("ikns-finger with something wrong (simulated)")
    figure.savefig(file, dpi=120)
