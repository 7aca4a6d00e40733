"""The worker's side: one task, from what was sent to what is sent back. Both are plain data."""

from __future__ import annotations

import os
import socket
import time
import traceback
from typing import Any, Final

from srl.runtime.contracts.errors import HostError
from srl.studies.tasks import environment as env
from srl.studies.tasks.task import DONE, FAILED, TrialTask, flat, function

PROTOCOL: Final = 1  # of what is sent


class ProgramError(HostError):
    """A worker's program isn't the one with which the study began."""


def order(task: TrialTask, environment: dict[str, str]) -> dict[str, Any]:
    """Returns what is sent to a worker: names and options, never functions."""
    return {
        "trial": task.trial, "profile": task.text, "parameters": task.parameters, "seed": task.seed,
        "environment": environment,
    }  # fmt: skip


def perform(sent: dict[str, Any]) -> dict[str, Any]:
    """Runs one task.

    Returns:
        State, values, error, seconds, worker and environment, as in `srl.studies.tasks.task.Row`. A trial that raises
        is an answer, too.
    Raises:
        ProgramError: the program here differs from the client's, so the row would be another one.
    """
    here = env.environment(sent["trial"])
    worker = f"{socket.gethostname()}:{os.getpid()}"
    if found := env.differences(sent["environment"], here):
        raise ProgramError(
            f"worker {worker}",
            f"its program isn't the one with which the study began ({'; '.join(found)})",
            "Install the same on every worker and start it again; an edited file needs the study to be started again",
        )
    state, values, error = DONE, {}, ""
    begin = time.perf_counter()
    try:
        values = flat(function(sent["trial"])(sent["profile"], sent["parameters"], sent["seed"]))
    except Exception as problem:  # whatever it is, the other trials go on
        state, error = FAILED, _words(problem)
    return {
        "state": state, "values": values, "error": error, "seconds": round(time.perf_counter() - begin, 6),
        "worker": worker, "environment": here,
    }  # fmt: skip


def _words(problem: Exception) -> str:
    """An error with its place, without the folders of the machine, so that it is the same on each."""
    last = traceback.extract_tb(problem.__traceback__)[-1:]
    at = "".join(f" ({os.path.basename(frame.filename)} line {frame.lineno})" for frame in last)
    text = f"{type(problem).__name__}: {problem}{at}"
    return text.encode(errors="replace").decode()
