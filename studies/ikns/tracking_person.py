"""The tracking experiment with a person: the loop runs beside it, the person has the participant's screen.

A trial that was broken off is done once more.
"""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.control.ikns import record
from srl.control.ikns.sibson import Sibson
from srl.runtime.contracts.files import decoded
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.ring import RingReader
from srl.runtime.profile.plots import pick
from srl.runtime.web.panel.screen import Screen
from srl.runtime.web.panel.trial import ScreenTrial, Trial
from srl.studies.ikns import people
from srl.studies.ikns.curves import SECONDS, SETTLE, curve, scores
from srl.studies.ikns.tracking_analysis import analysed, figure
from srl.studies.ikns.tracking_order import NAME, REPETITIONS, Entry, ordered
from srl.studies.ikns.tracking_trial import COARSE, PROFILE, VALUE, stillness
from srl.studies.result import Result
from srl.studies.tasks import table
from srl.studies.tasks.task import Value
from srl.studies.toolkit.errors import StudyError

_REST: Final = 5.0  # s between trials, at least
_SAMPLES: Final = 1001  # of a curve, as the screen gets it
_HELD: Final = "intent.held"
_HAND: Final = "arm.hand"


def session(folder: Path, person: str, profile: str = PROFILE, quick: bool = False) -> Result:
    """Runs a person's trials, those that are missing; `quick`: one of each instead of three.

    Args:
        folder: of the study; the person's own is in it.
        person: anonymous id, such as P07.
        profile: the one whose loop is run beside it, by `srl run PROFILE --set input=ikns` (then `=gamepad`).
    Returns:
        The table of all people who are through; claims if they are three or more. Its files are in the person's folder.
    Raises:
        SrlError: the id isn't anonymous, trials can't be stored, or the screen has ended.
    """
    repetitions = 1 if quick else REPETITIONS
    with people.opened(NAME, folder, person, profile, lambda seed: list(ordered([seed], repetitions))) as on:
        for condition, missing in on.missing():
            run = on.beside(condition)
            with Screen(run.folder, VALUE, held=_HELD if _HELD in run.layout.fields else None) as screen:
                people.say(f"Open this once, in the participant's browser:\n  {screen.address}")
                for place, entry in missing:
                    _done(on, screen, run, place, entry)
    return _result(folder, person)


def _done(on: people.Session[Entry], screen: Screen, run: people.Run, place: int, entry: Entry) -> None:
    """Lets the person do one trial, as often as it takes until it counts, and stores it."""
    condition, name, repetition = entry
    shown = tuple(np.clip(curve(name, np.linspace(0.0, SECONDS, _SAMPLES)), 0.0, 1.0).tolist())
    attempt = 0
    while True:
        rest = _REST if place > 1 or attempt else 0.0
        trial = Trial(shown, SECONDS, SETTLE, rest, title=condition, number=place, of=len(on.order))
        begin = time.monotonic()
        found = screen.run_trial(trial)
        stem = f"{place:02}-{condition}-{name}-{repetition}"
        problem = found.aborted or ("" if len(found.samples) > 1 else "there are no rows")
        attempt += bool(problem)
        try:
            found.save(on.own / (f"{stem}-aborted-{attempt}" if problem else stem))
        except OSError as error:
            raise StudyError(str(on.own), f"the trial can't be stored: {error.strerror}", "Make room there") from None
        if problem:
            people.say(f"{stem}: broken off: {problem}; once more")
            continue
        values = _values(found, run, name)
        people.say(f"{stem}: RMSE {values['rmse']:.2f}")
        given = {"model": people.MODEL, "curve": name, "repetition": repetition}
        on.keep(place, entry, given, run, values, time.monotonic() - begin)
        return


def _values(found: ScreenTrial, run: people.Run, name: str) -> dict[str, Value]:
    """The figures of a trial: those of the simulated ones, and the screen's."""
    t, value = found.samples[:, 0], found.samples[:, 2]
    known = np.isfinite(value)
    rows = _rows(found, run)
    hand = pick(run.layout, rows, _HAND, _HAND)[:, :3] if _HAND in run.layout.fields else np.empty((0, 3))
    hand = hand[np.isfinite(hand).all(axis=1)]
    held = pick(run.layout, rows, _HELD, _HELD) if _HELD in run.layout.fields else np.zeros(1)
    at = np.linspace(0.0, SECONDS, round(COARSE * SECONDS) + 1)[1:]
    return {
        **scores(t[known], value[known], name),
        **(stillness(hand) if len(hand) else dict.fromkeys(("hand_rms", "hand_p95", "hand_max"), math.nan)),
        "held": float(np.mean(held)) if len(held) else math.nan,
        "outside": _outside(hand, run),
        "path": json.dumps(np.round(np.interp(at, t[known], value[known]), 3).tolist()),
        "simulated": run.simulated,
        "rows": len(found.samples),
        "rows_lost": found.lost,
        **{f"screen_{key}": value for key, value in found.timing.items()},
    }


def _rows(found: ScreenTrial, run: people.Run) -> Any:
    """The loop's rows during the curve, as far as the ring still has them."""
    with RingReader(run.folder.rows, width=run.layout.width) as ring:
        parts = [ring.take()]
        while len(parts[-1]):
            parts.append(ring.take())
    rows = np.concatenate(parts)
    t = run.layout.header(rows, "control") * 1e-9 - found.began
    return rows[(t >= 0.0) & (t <= SECONDS)]


def _outside(hand: Array, run: people.Run) -> float:
    """The share of the hand's places outside the calibration's hull; NaN where there is no calibration."""
    for content in decoded(run.layout.meta.get("files", {}), "the run's files").values():
        try:
            sites = record.parse(content, "calibration").calibration().sites
        except record.RecordError:
            continue  # another kind of file
        hull = Sibson(sites)
        return float(np.mean([hull.nearest(place).distance > 0.0 for place in hand[::10]])) if len(hand) else math.nan
    return math.nan


def _result(folder: Path, person: str) -> Result:
    """The people who are through, of whom the person is one."""
    found = people.through(folder)
    claims, lines, statistics = analysed({people.MODEL: found}, simulated=False)
    simulated = any(row["simulated"] for row in found)
    files = ["curves.png", "statistics.json", table.FILE]
    figure(found, folder / person / files[0], "simulated" if simulated else "people")
    (folder / person / files[1]).write_text(json.dumps(statistics, indent=1) + "\n", encoding="utf-8")
    return Result(NAME, simulated, [], claims, lines, files)
