"""The claims `intention-accuracy` and `false-activations-...`, on simulated people: they say nothing about people.

Each simulated person is held out in turn: the recogniser is made of all others.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.control.intention.training import BACKGROUND, Thresholds
from srl.sim.wearer.people import MISFIT
from srl.studies.human_srl.intention_trial import UNRELATED, made_of, play, recorded
from srl.studies.human_srl.part import NAME, Part
from srl.studies.intention.accuracy import law_of
from srl.studies.intention.people import ACTIONS, DT, onsets
from srl.studies.result import Claim
from srl.studies.tasks.runner import Runner
from srl.studies.tasks.task import Row, TrialTask
from srl.studies.toolkit.estimates import Estimate, estimate
from srl.studies.toolkit.statistics import rate

WINDOWS, LEAST = 95.0, 90.0  # %, of windows, and of actions
MOST: Final = 1.0  # false activations a minute
_PEOPLE, _QUICK, _SWEPT = 50, 4, 10
_MANY: Final = 20  # people, of whom one repetition of each action is enough; of fewer two are taken
_TRIED: Final = 3  # repetitions of the person who is held out
_SECONDS: Final = 60.0  # s of each kind of unrelated motion
_OTHER: Final = 7  # seed of the session on which a recogniser is tried: the suit sits otherwise
_RECORDINGS: Final = "axis_neuron_bvh"


def claims(runner: Runner, folder: Path, quick: bool) -> Part:
    """Runs the trials and judges the claims; `quick`: four people."""
    return study(runner, folder, range(1, 1 + (_QUICK if quick else _PEOPLE)))


def study(runner: Runner, folder: Path, numbers: Sequence[int]) -> Part:
    """Holds out each of these people in turn."""
    part = analysed(runner.done([task(n, numbers) for n in numbers], folder / "intention"))
    lines = list(_recordings(numbers))
    return Part([*part.claims, *_real(lines)], [*part.table, *lines], part.files)


def task(number: int, numbers: Sequence[int], **changed: Any) -> TrialTask:
    """One person, held out of `numbers`. `changed`: parameters of `intention_trial.trial`."""
    parameters = {
        "person": number, "others": [n for n in numbers if n != number], "repetitions": _repetitions(numbers),
        "tried": _TRIED, "left_out": ACTIONS[number % len(ACTIONS)], "unrelated": _SECONDS,
    }  # fmt: skip
    return TrialTask.of(NAME, "human-srl-intention", _OTHER, parameters | changed)


def _repetitions(numbers: Sequence[int]) -> int:
    return 1 if len(numbers) > _MANY else 2


def analysed(rows: Sequence[Row]) -> Part:
    """Judges the rows of `claims`, but for the recordings of real people."""
    table: list[dict[str, Any]] = []
    for label in (*ACTIONS, *BACKGROUND):
        line: dict[str, Any] = {"part": "intention", "label": label, "n": len(rows)}
        for name in ("right", "rejected", *(("found", "another") if label in ACTIONS else ())):
            line |= _share(rows, f"{label}_{name}").columns(f"{name}_percent")
        if label in ACTIONS:
            line |= estimate(column(rows, f"{label}_delay")).columns("delay_s")
            line |= _share(rows, f"{label}_found_held").columns("found_held_percent")
        table.append(line)
    unseen = {name: _share(rows, f"unseen_{name}") for name in ("rejected", "taken")}
    table.append(
        {"part": "intention", "label": "an action that was left out", "n": len(rows)}
        | unseen["rejected"].columns("rejected_percent") | unseen["taken"].columns("another_percent")
    )  # fmt: skip
    found = []
    for kind in UNRELATED:
        claim, line = _alarms(rows, kind)
        found.append(claim)
        table.append(line)
    return Part([_accuracy(rows, unseen["rejected"]), *found], table, ["intention/rows.parquet"])


def column(rows: Sequence[Row], name: str) -> list[float]:
    """A column's values, one a person."""
    return [float(row.values[name] or 0.0) for row in rows]


def _percent(rows: Sequence[Row], name: str) -> list[float]:
    return [100.0 * v for v in column(rows, name)]


def _share(rows: Sequence[Row], name: str) -> Estimate:
    return estimate(_percent(rows, name), 0.0, 100.0)


def _overall(rows: Sequence[Row], name: str, labels: Sequence[str]) -> Estimate:
    """Over people, of each one's mean over the labels, %."""
    own = np.mean([_percent(rows, f"{label}_{name}") for label in labels], axis=0).tolist() if rows else []
    return estimate(own, 0.0, 100.0)


def _accuracy(rows: Sequence[Row], unseen: Estimate) -> Claim:
    windows, actions = _overall(rows, "right", (*ACTIONS, *BACKGROUND)), _overall(rows, "found", ACTIONS)
    rejected, another = _overall(rows, "rejected", (*ACTIONS, *BACKGROUND)), _overall(rows, "another", ACTIONS)
    return Claim(
        id="intention-accuracy",
        text=f"leave-one-subject-out over {len(rows)} simulated people, as the law runs online: of the windows of one "
        f"second at least {WINDOWS:g} % are recognised, of the actions {LEAST:g} % (lower ends of the 95 % intervals); "
        f"windows {windows} %, rejected {rejected} %; actions {actions} %, another one, too, {another} %; an "
        f"action that was left out of the training is rejected for {unseen} % of its time; measured: windows",
        paper="none; left to future work", measured=windows.mean if rows else None, unit="%",
        holds=windows.low >= WINDOWS and actions.low > LEAST,
    )  # fmt: skip


def _alarms(rows: Sequence[Row], kind: str) -> tuple[Claim, dict[str, Any]]:
    minutes = [float(row.task.parameters["unrelated"]) / 60.0 for row in rows]
    counts = column(rows, f"{kind}_activations")
    found = estimate([k / m for k, m in zip(counts, minutes, strict=True)], 0.0)
    # Where few had one, the spread over people says little: the interval isn't narrower than that of a Poisson process.
    poisson = rate(round(sum(counts)), sum(minutes)) if rows else (math.nan, math.nan)
    low, high = float(np.fmin(found.low, poisson[0])), float(np.fmax(found.high, poisson[1]))
    held = column(rows, f"{kind}_activations_held")
    words = {"stand": "standing", "walk": "walking", "stop-and-go": "standing and walking in turn"}
    claim = Claim(
        id=f"false-activations-{kind}",
        text=f"{words.get(kind, 'reaching about with one arm after the other')}: below {MOST:g} false activation a "
        f"minute (95 % interval {low:.2g} to {high:.2g}), {sum(minutes):.0f} simulated minutes of "
        f"{len(rows)} people, each held out; where holding still confirms, {sum(held):.0f} times",
        paper="none", measured=found.mean if rows else None, unit="1/min", holds=high < MOST,
    )  # fmt: skip
    line = {"part": "intention", "label": f"unrelated: {kind}", "n": len(rows), "minutes": sum(minutes)}
    return claim, line | {"per_minute": found.mean, "per_minute_low": low, "per_minute_high": high} | {
        "activations": sum(counts), "activations_held": sum(held),
    }  # fmt: skip


def _recordings(numbers: Sequence[int]) -> Iterator[dict[str, Any]]:
    """One line a recording of a real person, with the recogniser of all simulated ones."""
    files = sorted(recordings().glob("*.bvh"))
    if not files:
        return
    thresholds = Thresholds()
    law = law_of(made_of(numbers, _repetitions(numbers), thresholds), thresholds)
    names = law.outputs[0].labels
    for file in files:
        rotation, translation = recorded(file)
        played = play(law, rotation, translation)
        taken = Counter(names[k] for k in onsets(played.action))
        minutes = len(rotation) * DT / 60.0
        low, high = rate(taken.total(), minutes)
        yield {
            "part": "intention", "label": f"recorded: {file.name}", "n": 1, "minutes": minutes,
            "activations": taken.total(), "per_minute": taken.total() / minutes, "per_minute_low": low,
            "per_minute_high": high, "taken_for": ", ".join(f"{k} x {name}" for name, k in taken.items()),
            "rejected_percent": 100.0 * float(np.mean(played.rejected)),
        }  # fmt: skip


def recordings() -> Path:
    """The folder with recordings of real people in a suit, under SRL_SHARED; it need not be there."""
    return Path(os.environ.get("SRL_SHARED", "shared")) / "data" / _RECORDINGS


def _real(lines: Sequence[dict[str, Any]]) -> list[Claim]:
    """The rate that the recordings leave, and whether there was any activation at all."""
    ids = ("false-activations-recorded", "no-activation-recorded")
    if not lines:
        text = "real people's recordings: there are none (SRL_SHARED names no folder with data/axis_neuron_bvh)"
        return [Claim(id=each, text=text, paper="none", measured=None, unit="1/min", holds=False) for each in ids]
    count, minutes = sum(line["activations"] for line in lines), sum(line["minutes"] for line in lines)
    low, high = rate(count, minutes)
    whose = f"{len(lines)} recordings of real people who mean none of the actions, by a recogniser of simulated ones"
    found = f"{count} in {60 * minutes:.0f} s, exact 95 % interval {low:.2g} to {high:.2g} a minute"
    below = f"{whose}: below {MOST:g} false activation a minute; {found}; so short a time can't show it"
    return [
        Claim(
            id=ids[0], text=below, paper="none", measured=count / minutes, unit="1/min", holds=high < MOST,
        ),
        Claim(
            id=ids[1], text=f"{whose}: none; {found}", paper="none", measured=float(count), unit="activations",
            holds=count == 0,
        ),
    ]  # fmt: skip


def sweep(runner: Runner, folder: Path) -> list[dict[str, Any]]:
    """What decides: one thing changed at a time, for the first people."""
    numbers = list(range(1, 1 + _SWEPT))
    asked = {label: [task(n, numbers, **changed) for n in numbers] for label, changed in _changes()}
    asked |= {
        f"made of {k} others": [task(n, [m for m in numbers if m != n][:k]) for n in numbers]
        for k in (3, 5)
    }  # fmt: skip
    found = []
    for label, own in runner.by_label(asked, folder / "sweep-intention").items():
        line: dict[str, Any] = {"claim": "intention-accuracy", "changed": label, "n": len(own)}
        line |= _overall(own, "right", (*ACTIONS, *BACKGROUND)).columns("right_percent")
        line |= _overall(own, "found", ACTIONS).columns("found_percent")
        line["unseen_rejected_percent"] = _share(own, "unseen_rejected").mean
        line |= {f"{kind}_per_minute": estimate(column(own, f"{kind}_activations")).mean for kind in UNRELATED}
        found.append(line)
    return found


def _changes() -> Iterator[tuple[str, dict[str, Any]]]:
    """In words, and as parameters."""
    yield "nothing", {}
    for misfit in (0.0, 8.0, 12.0):
        yield f"the suit is off by {misfit:g} degrees rms ({MISFIT:g})", {"misfit": misfit}
    for dwell in (0.3, 0.6, 1.0):
        yield f"dwell {dwell:g} s (chosen)", {"thresholds": {"dwell": dwell}}
    yield "triggers as before: dwell 0.3 s, whole limits, no everyday motion", {
        "thresholds": {"dwell": 0.3, "trigger": 1.0}, "everyday": 0.0,
    }  # fmt: skip
    yield "no everyday motion (185 s)", {"everyday": 0.0}
    for cost in (0.3, 3.0):
        yield f"cost of a wrong trigger {cost:g} (1)", {"thresholds": {"cost": cost}}
    for least in (0.3, 0.9):
        yield f"confidence {least:g} (0.6)", {"thresholds": {"confidence": least}}
    for slack in (1.0, 2.0):
        yield f"limits of reject x {slack:g} (1.3)", {"thresholds": {"slack": slack}}
