"""From the samples of a run to a calibration, what is wrong with it, and the file."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from srl.commissioning.calibration import result
from srl.commissioning.calibration.ikns.channel_map import ChannelMap
from srl.commissioning.calibration.ikns.samples import Samples, joined, trials, whole
from srl.control.ikns import record
from srl.control.ikns.arm_angles import ArmAnglesConfig, one_arm
from srl.control.ikns.calibration import Calibration, CalibrationError, Recording, calibrate, flipped, refusals
from srl.control.ikns.noise import noise_of_c
from srl.runtime.contracts.errors import RequestError, nearest
from srl.runtime.contracts.files import Files, decoded
from srl.runtime.contracts.signals import Array
from srl.runtime.profile import code_files, profile, wiring


@dataclass(frozen=True)
class Result(result.Result[Calibration]):
    """A calibration with what its report tells. N points, k DoFs, n joints.

    Attributes:
        recording: the samples that it was made from.
        numbers: by which the person knows each point.
        noise: (N, k), standard deviation of c per mm of marker noise; None where angles aren't from markers.
        direction: the file whose direction was kept; None if there was none.
        turned: DoFs that were turned round for it.
    """

    recording: Recording
    numbers: tuple[int, ...]
    noise: Array | None
    direction: Path | None = None
    turned: tuple[str, ...] = ()

    @property
    def dofs(self) -> tuple[str, ...]:
        """Names of the degrees of freedom."""
        found: tuple[str, ...] = self.options.dofs
        return found

    def flipped(self, dof: str) -> Result:
        """The same with the direction of a DoF turned round. Raises RequestError: there is no such DoF."""
        if dof not in self.dofs:
            raise RequestError("flip", f"there is no degree of freedom '{dof}'", nearest(dof, self.dofs))
        return replace(self, found=flipped(self.found, self.dofs.index(dof)))

    def record(self) -> record.Record:
        """What the file holds. Raises RecordError."""
        return record.Record.of(
            self.found, self.options.thresholds, person=self.person, date=self.date, simulated=self.simulated,
            rate=self.channel_map.rate, frame=self.channel_map.frame, joints=self.channel_map.joints, dofs=self.dofs,
            bodies=self.channel_map.bodies,
        )  # fmt: skip


def compute(channel_map: ChannelMap, parts: Sequence[Samples], date: datetime.date) -> Result:
    """Computes the calibration of runs, in their order; with marks, the last trial at each point counts.

    Raises:
        CalibrationError: nothing can be computed, so `refusals` would have nothing to look at.
    """
    samples, options = joined(parts), channel_map.options
    if channel_map.mark is None:
        if len(options.dofs) > 1:
            problem = f"it has no marks, so it can't tell {len(options.dofs)} degrees of freedom apart"
            raise CalibrationError("recording", problem, "Record with `srl calibrate`, or use one: --dofs swivel")
        recording = whole(samples)
        numbers = tuple(range(1, options.thresholds.points + 1))
    else:
        recording, numbers = trials(samples, len(options.dofs))
    found = calibrate(recording, options.thresholds)
    reasons = refusals(found, options.thresholds, numbers)
    noise = _noise(channel_map, recording, found)
    return Result(channel_map, found, date, reasons, recording, numbers, noise)


def _noise(channel_map: ChannelMap, recording: Recording, found: Calibration) -> Array | None:
    """Of the fit that the run's own law makes; None if its angles come from something else."""
    meta = channel_map.layout.meta
    owners = {reference.partition(".")[0] for reference in channel_map.options.angles.values()}
    files = Files(Path(meta["label"]).parent, decoded(meta.get("files", {}), meta["label"]))
    checked, source = profile.parse(meta["label"], meta["profile"], meta["overrides"], files)
    if code_files.names(checked):
        return None  # a recording's code isn't run unasked
    laws = wiring.build(checked, source, [] if meta["simulated"] else None).controllers
    law = next((law for law in laws if {law.name} == owners), None)
    options = None if law is None else law.config
    if not isinstance(options, ArmAnglesConfig) or options.segments:
        return None
    return noise_of_c(one_arm(options.body.body, options.side), channel_map.joints, _postures(recording, found), found)


def _postures(recording: Recording, found: Calibration) -> Array:
    """(N, n): the mean angles of the samples nearest to each site; not finite where there are none."""
    seen = np.isfinite(np.column_stack([recording.angles, recording.hand])).all(axis=1)
    gaps = np.linalg.norm(recording.hand[:, None] - found.sites, axis=2)
    near = np.where(seen, np.nan_to_num(gaps, nan=np.inf).argmin(axis=1), -1)
    means = [recording.angles[near == i].mean(axis=0) if (near == i).any() else None for i in range(len(found.sites))]
    return np.array([np.full(recording.angles.shape[1], np.nan) if m is None else m for m in means])
