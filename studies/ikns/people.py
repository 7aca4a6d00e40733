"""What the experiments with a person share: the anonymous id, the stored order, the trials that are kept, the loop that
runs beside them.

The order is drawn once and stored. Each trial is on the disk before the next one begins, and the same command goes on
where it was. Nothing here knows who the person is.
"""

from __future__ import annotations

import hashlib
import json
import re
import secrets
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

from srl.commissioning.calibration.session import ANONYMOUS
from srl.runtime.contracts.errors import RecordingError, RequestError
from srl.runtime.ipc import private_file
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder, running
from srl.runtime.profile import profile as profiles
from srl.studies.tasks import journal as journals
from srl.studies.tasks import table
from srl.studies.tasks.environment import environment
from srl.studies.tasks.task import DONE, Row, TrialTask, Value
from srl.studies.toolkit.errors import StudyError

_Entry = TypeVar("_Entry", bound=tuple[Any, ...])
ORDER: Final = "order.json"
MODEL: Final = "person"
"""Of a trial that no simulated wearer did."""
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


@dataclass(frozen=True)
class Session(Generic[_Entry]):
    """A person's trials in a study, done and to be done. The first item of an entry is its condition.

    Attributes:
        study, person, profile: their names; the profile is the one whose loop runs beside it.
        own: the person's folder.
        order: all trials.
    """

    study: str
    person: str
    profile: str
    own: Path
    order: Sequence[_Entry]
    _instance: str
    _journal: journals.Journal

    def missing(self) -> Iterator[tuple[str, list[tuple[int, _Entry]]]]:
        """Yields each condition of which trials are missing, in turn, and those: place from 1, and entry."""
        for condition, entries in groupby(enumerate(self.order, 1), key=lambda item: str(item[1][0])):
            if left := [(i, e) for i, e in entries if key(self.study, self.person, e) not in self._journal.rows]:
                yield condition, left

    def beside(self, condition: str) -> Run:
        """Waits until the loop runs with this condition's input."""
        return beside(self._instance, self.profile, condition)

    def keep(
        self,
        place: int,
        entry: _Entry,
        parameters: Mapping[str, Any],
        run: Run,
        values: Mapping[str, Value],
        seconds: float,
    ) -> None:
        """Stores a trial that was done. Raises StudyError: it can't be written.

        Args:
            place: from 1.
            parameters: what the entry says besides its condition.
            run: the loop that ran beside it.
            seconds: that it took.
        """
        given = {"wearer": self.person, "condition": entry[0], **parameters, "place": place}
        task = TrialTask(self.study, MODEL, place, given, self.profile)
        row = Row(
            key=key(self.study, self.person, entry), task=task, profile_sha256=str(run.layout.meta["sha256"]),
            state=DONE, values=dict(values), error="", seconds=round(seconds, 3), worker="",
            environment=environment(self.study),
        )  # fmt: skip
        self._journal.append([row])

    def _ended(self) -> None:
        """Makes the table of the trials that are there."""
        rows = (self._journal.rows.get(key(self.study, self.person, entry)) for entry in self.order)
        table.write(self.own / table.FILE, [row for row in rows if row])

    def _interrupted(self) -> None:
        words = f"{len(self._journal.rows)} of {len(self.order)} trials are kept; give the same command again to go on"
        say(f"{self.own}: {words}")


@contextmanager
def opened(
    study: str, folder: Path, person: str, profile: str, draw: Callable[[int], Sequence[_Entry]]
) -> Iterator[Session[_Entry]]:
    """Opens a person's session, new or old; at its end, or if it is interrupted, the person's table is made.

    Args:
        folder: of the study; the person's own is in it.
        draw: the order by a seed.
    Raises:
        SrlError: the id isn't anonymous, there is no such profile, or trials can't be stored.
    """
    check(person)
    instance = profiles.load(profile)[0].name
    own = folder / person
    own.mkdir(parents=True, exist_ok=True)
    order = stored_order(own, person, draw)
    with journals.opened(own) as journal:
        session = Session(study, person, profile, own, order, instance, journal)
        try:
            yield session
        except KeyboardInterrupt:
            session._interrupted()
            raise
        finally:
            session._ended()


def key(study: str, person: str, entry: tuple[Any, ...]) -> str:
    """Of a person's trial in the journal. It stays done whatever changes in the program."""
    return hashlib.sha256(json.dumps([study, person, *entry]).encode()).hexdigest()[:32]


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
    """The rows (parameters and values) of the people in a study's folder who did all their trials.

    Raises RequestError: somebody's trials can't be read, so it isn't known whether these are all.
    """
    found: list[Mapping[str, Any]] = []
    for own in sorted(folder.iterdir()):
        try:
            order = json.loads((own / ORDER).read_text(encoding="utf-8"))["order"]
            journal = journals.read(own / journals.FILE)
            count = len(order)
        except NotADirectoryError:
            continue
        except FileNotFoundError as error:
            if error.filename == str(own / ORDER):
                continue  # nobody's
            raise _unreadable(own, f"{journals.FILE} isn't there") from None
        except OSError as error:
            raise _unreadable(own, str(error.strerror)) from None
        except (ValueError, KeyError, TypeError):
            raise _unreadable(own, f"{ORDER} is damaged") from None
        if len(journal.rows) < count and journal.broken:
            raise _unreadable(own, f"lines of {journals.FILE} are damaged: {journal.broken}")
        if len(journal.rows) == count:
            found += [{**row.task.parameters, **row.values} for row in journal.rows.values()]
    return found


def _unreadable(own: Path, why: str) -> RequestError:
    remedy = "Put it right, or move the folder out of the study's; the trials that were done stay there"
    return RequestError(str(own), f"this person's trials can't be read: {why}", remedy)


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
