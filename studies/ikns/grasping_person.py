"""The grasping experiment with a person: the experimenter places the object, runs the clock and judges, by keys.

The order is drawn once and stored. Each trial is on the disk before the next one begins, and the same command goes on
where it was. Nothing here knows who the person is.
"""

from __future__ import annotations

import hashlib
import json
import sys
import termios
import time
from collections.abc import Callable
from itertools import groupby
from pathlib import Path
from typing import Final

import numpy as np

from runtime.contracts.errors import RequestError
from runtime.profile import profile as profiles
from sim.parts.hand.ycb import YCB
from studies.ikns import people
from studies.ikns.grasping_analysis import analysed
from studies.ikns.grasping_trial import PROFILE
from studies.ikns.grasping_wearer import KINDS
from studies.ikns.published import LIMIT
from studies.result import Result
from studies.tasks import journal as journals
from studies.tasks import table
from studies.tasks.environment import environment
from studies.tasks.task import DONE, Row, TrialTask, Value

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
    people.check(person)
    name = profiles.load(profile)[0].name
    own = folder / person
    own.mkdir(parents=True, exist_ok=True)
    order = people.stored_order(own, person, lambda seed: ordered(seed, QUICK if quick else "".join(YCB)))
    with journals.opened(own) as journal:
        try:
            for condition, entries in groupby(enumerate(order, 1), key=lambda item: item[1][0]):
                missing = [(place, entry) for place, entry in entries if key(person, entry) not in journal.rows]
                for place, entry in missing:
                    run = people.beside(name, profile, condition)
                    people.say(f"{place} of {len(order)}, {condition}: {YCB[entry[1]].name} ({entry[1]})")
                    begin = time.monotonic()
                    values = judged(typed, time.monotonic) | {"simulated": run.simulated}
                    journal.append([_row(person, entry, place, profile, run, values, time.monotonic() - begin)])
        except KeyboardInterrupt:
            people.say(f"{own}: {len(journal.rows)} of {len(order)} trials are kept; give the same command to go on")
            raise
        finally:
            table.write(own / table.FILE, [r for e in order if (r := journal.rows.get(key(person, e)))])
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
        said = answer(f"  Running. Enter: released, and well; {_KEYS}; x doesn't count: ").strip().lower()
        duration = clock() - begin
        if said in _REASONS or said == "":
            break
        people.say("  Once more." if said == "x" else f"  '{said}' is none of the keys; the trial doesn't count.")
    reason = _REASONS.get(said, "out of time" if duration > LIMIT else "")
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


def key(person: str, entry: Entry) -> str:
    """Names a person's trial. It stays done whatever changes in the program."""
    return hashlib.sha256(json.dumps([NAME, person, *entry]).encode()).hexdigest()[:32]


def _row(
    person: str, entry: Entry, place: int, profile: str, run: people.Run, values: dict[str, Value], seconds: float
) -> Row:
    condition, code = entry
    parameters = {"wearer": person, "condition": condition, "object": code, "place": place}
    return Row(
        key=key(person, entry), task=TrialTask(NAME, "person", place, parameters, profile),
        profile_sha256=str(run.layout.meta["sha256"]), state=DONE, values=values, error="", seconds=round(seconds, 3),
        worker="", environment=environment(NAME),
    )  # fmt: skip


def _result(folder: Path, person: str) -> Result:
    """The people who are through, of whom the person is one."""
    found = people.through(folder)
    claims, lines, statistics = analysed(found)
    (folder / person / "statistics.json").write_text(json.dumps(statistics, indent=1) + "\n", encoding="utf-8")
    simulated = any(row["simulated"] for row in found)
    return Result(NAME, simulated, [], claims, lines, ["statistics.json", table.FILE])
