"""The human-SRL study: the skeleton, the verified stop, and what stands on them, on simulated wearers.

Zhang, Liu and Li (2022) test their system with one motion, and publish no figures but its rate. The claims are ours.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from srl.studies.human_srl import (
    intention_claims,
    nodes_claims,
    operation_claims,
    reach_claims,
    reach_sweep,
    strap_claims,
)
from srl.studies.human_srl.part import NAME
from srl.studies.human_srl.wearers import assumed
from srl.studies.result import Result
from srl.studies.tasks.runner import Runner

__all__ = ["run", "sweep"]
PARTS = (
    nodes_claims.claims, reach_claims.claims, intention_claims.claims, operation_claims.claims, strap_claims.claims
)  # fmt: skip
SWEEPS = (
    nodes_claims.sweep, reach_sweep.sweep, intention_claims.sweep, operation_claims.sweep, strap_claims.sweep
)  # fmt: skip


def run(folder: Path, quick: bool, runner: Runner) -> Result:
    """The whole study; `quick`: a few motions of each."""
    found = [part(runner, folder, quick) for part in PARTS]
    return Result(
        NAME, True, [assumed()["seed"]],
        claims=[claim for part in found for claim in part.claims],
        table=[row for part in found for row in part.table],
        files=[file for part in found for file in part.files],
    )  # fmt: skip


def sweep(folder: Path, runner: Runner) -> list[dict[str, Any]]:
    """One thing at a time is other than in the study."""
    return [row for part in SWEEPS for row in part(runner, folder)]
