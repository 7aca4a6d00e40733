"""How good a recogniser of intentions is: as figures, as text, and as a picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from srl.commissioning.calibration.picture import plt, save
from srl.commissioning.calibration.result import Result
from srl.control.intention.training import Held, Recogniser


@dataclass(frozen=True)
class Trained:
    """A recogniser, and what it is worth on what was `held` out, a round at a time."""

    made: Recogniser
    held: Held


def metrics(result: Result[Trained]) -> dict[str, Any]:
    """The report as JSON types; SI units."""
    made, held = result.found.made, result.found.held
    return {
        "accuracy": held.accuracy,
        "rejected": held.rejected,
        "found": float(held.found.sum() / held.trials.sum()),
        "alarms": held.alarms,
        "background_s": held.seconds,
        "temperature": made.discriminant.temperature,
        "dwell_s": made.triggers.dwell,
        "unknown_taken": made.triggers.unknown,
        "everyday_s": made.triggers.everyday,
        "actions": {
            name: {
                "windows": int(held.confusion[k].sum()),
                "recall": float(held.confusion[k, k] / held.confusion[k].sum()),
                "rejected": float(held.confusion[k, -1] / held.confusion[k].sum()),
                "trials": int(held.trials[k]),
                "found": int(held.found[k]),
                "wrong": int(held.wrong[k]),
                "trigger": float(made.triggers.limits[k]),
                "delay_s": None if np.isnan(held.delay[k]) else float(held.delay[k]),
            }
            for k, name in enumerate(made.actions)
        },
        "confusion": {"labels": [*made.labels, "rejected"], "windows": held.confusion.tolist()},
        "refusals": [{"place": r.place, "problem": r.problem, "remedy": r.remedy} for r in result.refusals],
    }


def lines(result: Result[Trained]) -> list[str]:
    """The report as text."""
    numbers, made = metrics(result), result.found.made.triggers
    text = [
        f"person {result.person}{result.when}: {len(numbers['actions'])} actions; each round held out in turn: "
        f"{numbers['accuracy']:.1%} "
        f"of the windows are what they are taken for, {numbers['rejected']:.1%} rejected; "
        f"{numbers['found']:.0%} of the actions found"
    ]
    text.append("  action          windows right  rejected  found  another too  after s")
    for name, row in numbers["actions"].items():
        delay = "-" if row["delay_s"] is None else f"{row['delay_s']:.2f}"
        text.append(
            f"  {name:<14}  {row['recall']:13.0%}  {row['rejected']:8.0%}  {row['found']:2d}/{row['trials']:<2d}"
            f"  {row['wrong']:11d}  {delay:>7}"
        )
    text.append(f"  standing and walking for {numbers['background_s']:.0f} s: {numbers['alarms']} actions found")
    text.append(
        f"  an action counts once it is seen for {numbers['dwell_s']:g} s; of actions that it doesn't know, "
        f"{numbers['unknown_taken']:.0%} are taken for another one"
    )
    seconds = numbers["everyday_s"]
    text.append(
        f"  everyday motion, {seconds:.0f} s, set the triggers of {made.lowered} actions: none became active; "
        f"other motion like it gives at most {made.alarms:.1f} false activations a minute (95 %)"
        if seconds > 0.0
        else "  everyday motion: none was recorded; how often it triggers an action is unknown"
    )
    return text


def draw(result: Result[Trained], png: Path) -> None:
    """Draws the confusion, and the share of each action's windows that is right. Raises RecordError."""
    made, held = result.found.made, result.found.held
    names = [*made.labels, "rejected"]
    share = held.confusion / held.confusion.sum(axis=1, keepdims=True)
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 6.5), width_ratios=(1.6, 1.0), constrained_layout=True)
    left.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    left.set_xticks(range(len(names)), names, rotation=60, ha="right", fontsize=8)
    left.set_yticks(range(len(names) - 1), names[:-1], fontsize=8)
    left.set_xlabel("taken for", fontsize=8)
    left.set_ylabel("what it was", fontsize=8)
    for (i, j), value in np.ndenumerate(share):
        if value >= 0.005:
            left.text(j, i, f"{value:.0%}", ha="center", va="center", fontsize=7, color="w" if value > 0.5 else "k")
    left.set_title("held-out windows", fontsize=9, loc="left")
    k = len(made.actions)
    at = np.arange(k)
    right.barh(at - 0.2, np.diag(share)[:k], 0.4, color="#0072B2", label="windows right")
    right.barh(at + 0.2, held.found / held.trials, 0.4, color="#E69F00", label="trials found")
    for place, delay in zip(at, held.delay, strict=True):
        right.text(0.02, place + 0.2, "never" if np.isnan(delay) else f"after {delay:.1f} s", va="center", fontsize=7)
    right.set_yticks(at, made.actions, fontsize=8)
    right.invert_yaxis()
    right.set_xlim(0.0, 1.0)
    right.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.05), ncols=2)
    title = f"Recogniser of {result.person}{result.when}: each round held out, {held.accuracy:.1%} right"
    figure.suptitle(title, fontsize=11)
    save(figure, png)
