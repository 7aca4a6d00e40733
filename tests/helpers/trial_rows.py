"""Rows of trials without processes: made up, or run here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from srl.studies.tasks.runner import RowSource
from srl.studies.tasks.task import DONE, Function, Row, TrialTask, flat


def row(task: TrialTask, values: Mapping[str, Any]) -> Row:
    """A task's row, done, with these values."""
    return Row(task.identity, task, task.profile_sha256, DONE, flat(values), "", 0.0, "", {})


@dataclass
class Here(RowSource):
    """A runner that runs each trial in this process. `trials`: the functions by the registered names."""

    trials: Mapping[str, Function]

    def rows(self, tasks: Sequence[TrialTask], folder: Path) -> list[Row]:
        """The tasks' rows; nothing is written into `folder`."""
        return [row(task, self.trials[task.trial](task.text, task.parameters, task.seed)) for task in tasks]
