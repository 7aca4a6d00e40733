"""Trials of studies as tasks: on this machine or on a cluster, each once, whatever ends (docs/studies/trials.md)."""

from srl.studies.result import Claim, Result
from srl.studies.tasks.runner import Runner, runner
from srl.studies.tasks.task import Row, TrialTask

__all__ = ["Claim", "Result", "Row", "Runner", "TrialTask", "runner"]
