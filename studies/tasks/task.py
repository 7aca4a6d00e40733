"""A trial as a task: what it depends on, and the flat row that it gives."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from srl.runtime.contracts import registry
from srl.runtime.profile import profile as profiles
from srl.studies.toolkit.errors import StudyError

Value = bool | int | float | str | None
Function = Callable[[str, dict[str, Any], int], Mapping[str, Value]]

GROUP: Final = "trials"  # entry points srl.trials: a name, and the function that runs one trial
DONE, FAILED, LOST = "done", "failed", "lost"
# The columns that each row of the table has besides those of the trial.
COLUMNS: Final = (
    "key", "study", "trial", "profile", "profile_sha256", "parameters", "seed", "state", "error", "seconds", "worker",
    "environment",
)  # fmt: skip
_WORD: Final = 2**63


@dataclass(frozen=True)
class TrialTask:
    """One trial to be run. Equal tasks give equal rows, whoever runs them.

    Attributes:
        study: the study's name.
        trial: the registered name of the function that runs it: `function(profile_text, parameters, seed) -> row`.
        seed: of whatever is random in it.
        parameters: plain data, as JSON has it (`of` turns tuples into lists, and keys into strings).
        profile: a name under profiles/ or a path; "" if the trial needs none, or one that is no file.
        text: the profile's text, which is sent along, so that no worker needs the file.
    """

    study: str
    trial: str
    seed: int
    parameters: dict[str, Any]
    profile: str = ""
    text: str = ""

    @classmethod
    def of(
        cls, study: str, trial: str, seed: int, parameters: Mapping[str, Any], *, profile: str = "", text: str = ""
    ) -> TrialTask:
        """Returns a task with its profile's text, read here unless `text` is given.

        Raises:
            StudyError: the parameters aren't plain data.
            ProfileError: there is no such profile.
        """
        try:
            plain = json.loads(json.dumps(dict(parameters)))
        except (TypeError, ValueError, RecursionError) as error:
            place = f"trial {trial}, parameters"
            raise StudyError(place, str(error), "Give numbers, texts, lists and mappings only") from None
        return cls(study, trial, seed, plain, profile, text or (profiles.find(profile)[1] if profile else ""))

    @property
    def profile_sha256(self) -> str:
        """The hash of the profile's text; "" without a profile."""
        return hashlib.sha256(self.text.encode()).hexdigest() if self.text else ""

    @property
    def identity(self) -> str:
        """What the caller chose, as one line: what the task is, apart from profile's text and program."""
        # Sorted keys would be wrong: the order of a mapping may matter, as it does in a profile.
        return json.dumps([self.study, self.trial, self.profile, self.parameters, self.seed])

    def key(self, environment: Mapping[str, str]) -> str:
        """Returns a key that changes if anything changes on which the row depends.

        Args:
            environment: `srl.studies.tasks.environment.decisive`.
        """
        words = json.dumps([self.identity, self.profile_sha256, sorted(environment.items())])
        return hashlib.sha256(words.encode()).hexdigest()[:32]


@dataclass(frozen=True)
class Row:
    """What a task gave.

    Attributes:
        key: of the task.
        task: without the profile's text.
        profile_sha256: of the profile's text.
        state: "done"; "failed": the trial raised an error; "lost": its worker died each time.
        values: what the trial gave, by column; empty unless done.
        error: what went wrong; "" if done.
        seconds: of real time, s.
        worker: host and process that ran it.
        environment: versions and so on, of that worker.
    """

    key: str
    task: TrialTask
    profile_sha256: str
    state: str
    values: dict[str, Value]
    error: str
    seconds: float
    worker: str
    environment: dict[str, str]

    def number(self, name: str) -> float:
        """The number in a column of a row that has one; NaN for None."""
        value = self.values[name]
        return float("nan") if value is None else float(value)

    @property
    def done(self) -> bool:
        """Whether there are values."""
        return self.state == DONE


def function(trial: str) -> Function:
    """Returns the function of a trial. Raises an SrlError: nothing has this name, or it can't be imported."""
    found: Function = registry.load(GROUP, trial, f"trial '{trial}'")
    return found


def flat(values: Any) -> dict[str, Value]:
    """Returns a trial's values as plain ones: numbers of numpy become Python's.

    Raises:
        StudyError: they aren't a mapping of names to numbers, texts, truths or None, or a name is taken.
    """
    if not isinstance(values, Mapping):
        raise StudyError("trial", f"it gave {type(values).__name__}", "Return a mapping of names to values")
    out: dict[str, Value] = {}
    for name, value in values.items():
        plain = value.item() if isinstance(value, np.generic) else value
        if not isinstance(name, str) or name in COLUMNS or not _encodes(name):
            raise StudyError("trial", f"{name!r} can't be a column of its own", f"Not {', '.join(COLUMNS)}: rename it")
        if not (plain is None or isinstance(plain, bool | int | float | str)):
            raise StudyError(f"trial: {name}", f"it is {type(value).__name__}", "Give a number, a text or None")
        if type(plain) is int and not -_WORD <= plain < _WORD:
            raise StudyError(f"trial: {name}", "the number doesn't fit into 64 bits", "Give it as text or float")
        if isinstance(plain, str) and not _encodes(plain):
            raise StudyError(f"trial: {name}", "the text isn't valid Unicode", "Replace the lone surrogates")
        out[name] = plain
    return out


def _encodes(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True
