"""What the experiments with a person share: the anonymous id, the stored order, the loop that runs beside them."""

from __future__ import annotations

import json
import re
import secrets
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeVar

from runtime.calibration.session import ANONYMOUS
from runtime.contracts.errors import RecordingError, RequestError
from runtime.ipc import private_file
from runtime.ipc.layout import Layout
from runtime.ipc.ring import RingReader
from runtime.ipc.run_folder import RunFolder, running
from studies.tasks import journal as journals
from studies.toolkit.errors import StudyError

_Entry = TypeVar("_Entry", bound=tuple[Any, ...])
ORDER: Final = "order.json"
_LOOK: Final = 0.5  # s between looks for the run


@dataclass(frozen=True)
class Run:
    """A running instance, and what its layout says of it."""

    folder: RunFolder
    layout: Layout

    @property
    def simulated(self) -> bool:
        """Whether any of its devices is."""
        return bool(self.layout.meta["simulated"])


def check(person: str) -> None:
    """Raises RequestError: the id may be somebody's name."""
    if not re.match(ANONYMOUS, person):
        problem = f"'{person}' isn't anonymous: up to four letters, then a number"
        raise RequestError("--person", problem, "Number the persons, P07, and keep their names elsewhere")


def stored_order(own: Path, person: str, draw: Callable[[int], Sequence[_Entry]]) -> list[_Entry]:
    """The person's order of trials: drawn by a seed and stored, or the stored one.

    Raises:
        StudyError: the stored one can't be read.
        RequestError: it has another number of trials, or other ones.
    """
    path, expected = own / ORDER, draw(0)
    if not path.exists():
        seed = secrets.randbits(32)
        content = {"person": person, "seed": seed, "order": list(draw(seed))}
        private_file.replace(path, json.dumps(content, indent=1).encode())
    try:
        found: list[tuple[Any, ...]] = [tuple(entry) for entry in json.loads(path.read_text(encoding="utf-8"))["order"]]
        different = len(set(found))
    except (OSError, ValueError, KeyError, TypeError):
        raise StudyError(str(path), "the order can't be read", "Mend it, or begin in another folder: --out") from None
    if len(found) != len(expected):
        problem = f"this person's session has {len(found)} trials"
        raise RequestError("--quick", problem, "Go on as it was begun, with or without --quick")
    known: dict[tuple[Any, ...], _Entry] = {entry: entry for entry in expected}
    if any(entry not in known for entry in found) or different < len(found):
        raise StudyError(
            str(path), "it names trials that this study hasn't", "Mend it, or begin in another folder: --out"
        )
    return [known[entry] for entry in found]


def beside(instance: str, profile: str, condition: str) -> Run:
    """Waits until the loop runs with this condition's input."""
    asked = False
    while True:
        for folder in running():
            run = _opened(folder) if folder.path.name == instance else None
            if run is not None and run.layout.meta["chosen"].get("input") == condition:
                return run
        if not asked:
            say(f"Waiting for the loop; in another terminal: srl run {profile} --set input={condition}")
            asked = True
        time.sleep(_LOOK)


def through(folder: Path) -> list[Mapping[str, Any]]:
    """The rows (parameters and values) of the people in a study's folder who did all their trials."""
    found: list[Mapping[str, Any]] = []
    for path in sorted(folder.glob(f"*/{ORDER}")):
        rows = [journals.decoded(line) for line in (path.parent / journals.FILE).read_bytes().splitlines(keepends=True)]
        own = {row.key: {**row.task.parameters, **row.values} for row in rows if row is not None}
        if len(own) == len(json.loads(path.read_text(encoding="utf-8"))["order"]):
            found += own.values()
    return found


def say(text: str) -> None:
    """Tells the experimenter."""
    print(text, file=sys.stderr, flush=True)


def _opened(folder: RunFolder) -> Run | None:
    """None while a run begins or ends."""
    try:
        layout = Layout.load(folder.layout)
        with RingReader(folder.rows, width=layout.width) as ring:
            return None if ring.closed or ring.head == 0 else Run(folder, layout)
    except (RecordingError, OSError):
        return None
