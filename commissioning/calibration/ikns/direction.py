"""The direction that a person is used to: a new calibration keeps that of the file that stands there.

A recording doesn't hold it: it is turned round by `--flip`, or by a key, after the samples were taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from srl.commissioning.calibration.ikns.marks import MarksConfig
from srl.commissioning.calibration.ikns.result import Result
from srl.control.ikns import record
from srl.control.ikns.record import Record
from srl.runtime.contracts.errors import RequestError


class Directions:
    """The files whose direction may be kept, as they are before the calibration."""

    def __init__(self, named: Path | None, others: Sequence[Path]) -> None:
        """Reads them.

        Args:
            named: on the command line: it must fit.
            others: the first that fits is taken; what is no calibration file is passed over.
        Raises:
            RecordError: `named` can't be read.
        """
        self._named = named is not None
        self._found: list[tuple[Path, Record]] = [] if named is None else [(named, record.read(named))]
        for path in others if named is None else ():
            if (made := standing(path)) is not None:
                self._found.append((path, made))

    def of(self, options: MarksConfig) -> tuple[Path, Record] | None:
        """The file of this person, joints and DoFs. Raises RequestError: the one that was named isn't."""
        for path, made in self._found:
            lack = _lack(made, options)
            if lack and self._named:
                raise RequestError(f"--direction {path}", lack, "Name a calibration file of the same person and joints")
            if not lack:
                return path, made
        return None

    def kept(self, result: Result) -> Result:
        """The calibration with the direction of the file that fits, if there is one; its result names both."""
        fitting = self.of(result.channel_map.options)
        if fitting is None:
            return result
        path, made = fitting
        turned = tuple(dof for dof, cosine in zip(result.dofs, _cosines(result, made), strict=True) if cosine < 0.0)
        for dof in turned:
            result = result.flipped(dof)
        return replace(result, direction=path, turned=turned)


def standing(path: Path) -> Record | None:
    """What a calibration file holds; None if there is none, or something else."""
    try:
        return record.read(path)
    except record.RecordError:
        return None


def _lack(made: Record, options: MarksConfig) -> str:
    """Why a file's direction can't be compared; empty if it can."""
    if made.person != options.person:
        return f"it is of {made.person}, and this calibration of {options.person}"
    if set(made.dofs) != set(options.dofs):
        return f"its degrees of freedom are {', '.join(made.dofs)}, here {', '.join(options.dofs)}"
    return "" if set(made.joints) == set(options.angles) else "it has other joints"


def _cosines(result: Result, made: Record) -> list[float]:
    """Per DoF: of the angle between a direction and the file's at the site nearest to it, mean of the points."""
    found, older = result.found, made.calibration()
    near = np.linalg.norm(found.sites[:, None] - older.sites, axis=2).argmin(axis=1)
    dofs, joints = ([have.index(name) for name in want] for have, want in (
        (made.dofs, result.dofs), (made.joints, result.channel_map.joints),
    ))  # fmt: skip
    theirs = older.directions[near][:, dofs][:, :, joints]
    lengths = np.linalg.norm(found.directions, axis=2) * np.linalg.norm(theirs, axis=2)
    cosines: list[float] = (np.sum(found.directions * theirs, axis=2) / lengths).mean(axis=0).tolist()
    return cosines
