"""The grasping experiment with a person: the experimenter places the object, runs the clock and judges, by keys.

The order is one condition after the other, and the objects at random in each.
"""

from __future__ import annotations

import json
import sys
import termios
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from srl.runtime.contracts.errors import RequestError
from srl.sim.parts.hand.ycb import YCB
from srl.studies.ikns import people
from srl.studies.ikns.grasping_analysis import analysed
from srl.studies.ikns.grasping_trial import PROFILE
from srl.studies.ikns.grasping_wearer import KINDS
from srl.studies.ikns.published import LIMIT
from srl.studies.result import Result
from srl.studies.tasks import table
from srl.studies.tasks.task import Value

NAME: Final = "ikns-grasping"
Entry = tuple[str, str]
"""Condition and object."""
QUICK: Final = "AI"
"""Objects of a quick session."""
_REASONS: Final = {"d": "dropped", "l": "not lifted", "r": "not released", "g": "off the goal"}
_KEYS: Final = ", ".join(f"{key} {reason}" for key, reason in _REASONS.items())


def session(folder: Path, person: str, profile: str = PROFILE, quick: bool = False) -> Result:
    """Leads the experimenter through a person's trials, those that are missing; `quick`: two objects.

    Args:
        folder: of the study; the person's own is in it.
        person: anonymous id, such as P07.
        profile: the one whose loop is run beside it, by `srl run PROFILE --set input=ikns` (then `=ring`).
    Returns:
        The table of all people who are through, and the claims. Its files are in the person's folder.
    Raises:
        SrlError: the id isn't anonymous, trials can't be stored, or nobody types.
    """
    codes = QUICK if quick else "".join(YCB)
    with people.opened(NAME, folder, person, profile, lambda seed: ordered(seed, codes)) as on:
        for condition, missing in on.missing():
            for place, entry in missing:
                run = on.beside(condition)
                people.say(f"{place} of {len(on.order)}, {condition}: {YCB[entry[1]].name} ({entry[1]})")
                begin = time.monotonic()
                values = judged(typed, time.monotonic) | {"simulated": run.simulated}
                on.keep(place, entry, {"object": entry[1]}, run, values, time.monotonic() - begin)
    return _result(folder, person)


def ordered(seed: int, codes: str) -> list[Entry]:
    """A random order: which condition comes first, and then the objects within each."""
    rng = np.random.default_rng([seed])
    return [
        (condition, code)
        for condition in rng.permutation(list(KINDS)).tolist()
        for code in rng.permutation(list(codes)).tolist()
    ]


def judged(answer: Callable[[str], str], clock: Callable[[], float]) -> dict[str, Value]:
    """One trial by the experimenter's keys: `success`, `reason` and `duration` (s).

    Args:
        answer: says something, waits for a line and gives it.
        clock: s.
    """
    while True:
        answer("  The object is on the green square. Enter begins: ")
        begin = clock()
        key = answer(f"  Running. Enter: released, and well; {_KEYS}; x doesn't count: ").strip().lower()
        duration = clock() - begin
        if key in _REASONS or key == "":
            break
        people.say("  Once more." if key == "x" else f"  '{key}' is none of the keys; the trial doesn't count.")
    reason = _REASONS.get(key, "out of time" if duration > LIMIT else "")
    people.say(f"  {duration:.2f} s, {reason or 'success'}")
    return {"success": not reason, "reason": reason, "duration": duration}


def typed(question: str) -> str:
    """A line from the terminal. Raises RequestError: there is no more."""
    print(question, end="", file=sys.stderr, flush=True)
    if sys.stdin.isatty():
        termios.tcflush(sys.stdin, termios.TCIFLUSH)  # what was typed before it was asked
    line = sys.stdin.readline()
    if not line:
        raise RequestError("--person", "nobody types here", "Give the command in a terminal; it goes on where it was")
    return line


def _result(folder: Path, person: str) -> Result:
    """The people who are through, of whom the person is one."""
    found = people.through(folder)
    claims, lines, statistics = analysed(found)
    (folder / person / "statistics.json").write_text(json.dumps(statistics, indent=1) + "\n", encoding="utf-8")
    simulated = any(row["simulated"] for row in found)
    return Result(NAME, simulated, [], claims, lines, ["statistics.json", table.FILE])
