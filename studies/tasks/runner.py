"""Runs a study's tasks: takes what is there, runs what is missing, keeps each row at once."""

from __future__ import annotations

import os
import sys
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any, Final

from srl.runtime.contracts.errors import RequestError
from srl.studies.tasks import journal as journals
from srl.studies.tasks import table
from srl.studies.tasks.cluster import Cluster
from srl.studies.tasks.environment import decisive, environment
from srl.studies.tasks.local import LocalEngine
from srl.studies.tasks.progress import Progress
from srl.studies.tasks.task import Row, TrialTask, function
from srl.studies.tasks.worker import order
from srl.studies.toolkit.errors import StudyError

_SHOWN: Final = 5  # failed trials that are named at the end


class RowSource(ABC):
    """Gives the rows of tasks."""

    @abstractmethod
    def rows(self, tasks: Sequence[TrialTask], folder: Path) -> list[Row]:
        """Returns the tasks' rows, in the tasks' order."""

    def done(self, tasks: Sequence[TrialTask], folder: Path) -> list[Row]:
        """As `rows`, but only those that have values."""
        return [row for row in self.rows(tasks, folder) if row.done]

    def by_label(self, asked: Mapping[str, Sequence[TrialTask]], folder: Path) -> dict[str, list[Row]]:
        """As `done`, for the tasks of each label."""
        rows = iter(self.rows([task for tasks in asked.values() for task in tasks], folder))
        return {label: [row for row in islice(rows, len(tasks)) if row.done] for label, tasks in asked.items()}


@dataclass
class Runner(RowSource):
    """Where and how trials run; `srl study` makes it from its options.

    Attributes:
        engine: of this machine, or a cluster.
        retry: whether trials that failed before are run again.
        failed: trials of all calls of `rows` that have no values.
    """

    engine: LocalEngine | Cluster = field(default_factory=LocalEngine)
    retry: bool = False
    failed: int = 0

    def rows(self, tasks: Sequence[TrialTask], folder: Path) -> list[Row]:
        """Returns the tasks' rows, in the tasks' order; the same ones on any engine.

        They are in `folder`, which may be new: each in the journal as soon as it is there, all in `rows.parquet` at the
        end, or at the end of an interrupted run those that are there. Trials that failed have rows without values.

        Raises:
            StudyError: two tasks are the same, or rows can't be kept.
            SrlError: a trial isn't registered, or the engine gives up.
        """
        wanted, environments = self._wanted(tasks)
        try:
            with journals.opened(folder) as journal:
                missing = {key: t for key, t in wanted.items() if self._is_missing(journal.rows.get(key))}
                for line in _remarks(journal, wanted, environments):
                    print(line, file=sys.stderr)
                if missing:
                    self._run(missing, environments, journal, len(wanted))
                rows = [journal.rows[key] for key in wanted]
        except KeyboardInterrupt:
            _interrupted(folder, wanted)
            raise
        table.write(folder / table.FILE, rows)
        self._count(rows)
        return rows

    def _is_missing(self, row: Row | None) -> bool:
        return row is None or (self.retry and not row.done)

    def _wanted(self, tasks: Sequence[TrialTask]) -> tuple[dict[str, TrialTask], dict[str, dict[str, str]]]:
        environments = {trial: environment(trial) for trial in {t.trial for t in tasks}}
        for trial in environments:
            function(trial)  # what isn't there is better said now than by each worker
        wanted = {t.key(decisive(environments[t.trial])): t for t in tasks}
        if len(wanted) < len(tasks):
            twice = Counter(t.identity for t in tasks).most_common(1)[0][0]
            raise StudyError("trials", f"the same one is asked for twice: {twice}", "Give each its own seed")
        return wanted, environments

    def _run(
        self,
        missing: Mapping[str, TrialTask],
        environments: Mapping[str, dict[str, str]],
        journal: journals.Journal,
        total: int,
    ) -> None:
        study = next(iter(missing.values())).study
        orders = {key: order(task, environments[task.trial]) for key, task in missing.items()}
        with Progress(study, total - len(missing), total) as progress, closing(self._answers(orders, progress)) as all_:
            for answers in all_:
                rows = [_row(key, missing[key], answer) for key, answer in answers]
                journal.append(rows)
                progress.advance(len(rows), sum(not row.done for row in rows))

    def _answers(self, orders: dict[str, Any], progress: Progress) -> Generator[list[tuple[str, dict[str, Any]]]]:
        if isinstance(self.engine, Cluster):
            return self.engine.run(orders, progress.say)
        return self.engine.run(orders)

    def _count(self, rows: Sequence[Row]) -> None:
        failed = [row for row in rows if not row.done]
        self.failed += len(failed)
        for row in failed[:_SHOWN]:
            print(f"{row.state}: seed {row.task.seed}, {row.task.parameters}: {row.error}", file=sys.stderr)
        if failed:
            more = f" ({len(failed) - _SHOWN} more than shown)" if len(failed) > _SHOWN else ""
            print(f"{len(failed)} of {len(rows)} trials have no values{more}; --retry runs them again", file=sys.stderr)


def runner(
    *,
    workers: int | None = None,
    on: str | None = None,
    tls: Path | None = None,
    insecure: bool = False,
    retry: bool = False,
) -> Runner:
    """Makes a runner from the options of `srl study`, which finds this function by its entry point.

    Args:
        workers: processes on this machine; None: one a core.
        on: a scheduler's address; None: this machine.
        tls: folder of certificates; None: the one named by $SRL_STUDY_TLS, if any.
        insecure: as in `Cluster`.
        retry: as in `Runner`.
    Raises:
        RequestError: the options contradict each other.
    """  # fmt: skip
    if on is None:
        if tls or insecure:
            raise RequestError(
                "--tls and --insecure-no-tls", "they are for the way to a scheduler, and none is named", "Add --on"
            )
        if workers is not None and workers < 1:
            raise RequestError("--workers", f"{workers} can't work", "Give 1 or more")
        return Runner(LocalEngine(workers or 0), retry)
    if tls is None and (named := os.environ.get("SRL_STUDY_TLS")):
        tls = Path(named)
    return Runner(Cluster(on, tls, insecure), retry)


def _row(key: str, task: TrialTask, answer: dict[str, Any]) -> Row:
    return Row(key=key, task=replace(task, text=""), profile_sha256=task.profile_sha256, **answer)


def _interrupted(folder: Path, wanted: Mapping[str, TrialTask]) -> None:
    """Makes the table of what is there, and says how to go on."""
    with journals.opened(folder) as journal:  # read again: the interrupt may have come between two of its steps
        there = [journal.rows[key] for key in wanted if key in journal.rows]
    table.write(folder / table.FILE, there)
    words = f"{len(there)} of {len(wanted)} trials are kept; give the same command again to go on"
    print(f"{folder}: {words}", file=sys.stderr)


def _remarks(
    journal: journals.Journal, wanted: Mapping[str, TrialTask], environments: Mapping[str, Mapping[str, str]]
) -> Iterator[str]:
    """What is odd about the rows that are there."""
    if journal.torn:
        yield f"{journal.path}: its last row was being written when the last run ended; it was cut off"
    if journal.broken:
        yield f"{journal.path}: {journal.broken} rows can't be read any more; their trials are run again"
    asked = {task.identity: (key, task) for key, task in wanted.items()}
    reasons: Counter[str] = Counter()
    for row in journal.rows.values():
        key, task = asked.get(row.task.identity, (row.key, row.task))
        if key == row.key or key in journal.rows:
            continue
        if row.profile_sha256 != task.profile_sha256:
            reasons[f"another text of the profile {task.profile}"] += 1
            continue
        ours = environments[task.trial]
        differ = [name for name in decisive(ours) if row.environment.get(name) != ours[name]]
        reasons[f"another {', '.join(differ)}"] += 1
    for reason, count in reasons.items():
        yield f"{journal.path}: {count} rows were made with {reason}; they stay, and their trials are run again"
