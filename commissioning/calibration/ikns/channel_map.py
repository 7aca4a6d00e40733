"""Where a calibration's signals are in the rows of a run, live or recorded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.commissioning.calibration.ikns.marks import MarksConfig
from srl.commissioning.calibration.ikns.samples import Samples
from srl.commissioning.calibration.profile_subset import MARKS
from srl.commissioning.calibration.run_channels import RunChannels, marks_law, words
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.layout import Layout

_FRAME: Final = "chest"  # of a hand whose law doesn't say in which frame it gives it


@dataclass(frozen=True)
class ChannelMap(RunChannels):
    """Places among a row's float64 words.

    Attributes:
        options: of the marks' law: names of joints and DoFs, thresholds, the person's id.
        frame: in which the hand's pose is.
        angles: (n,) of the joints' angles.
        held: (m,) of what says that a joint isn't observed; `holds` (m,) is the joint.
        hand: of the pose's first word.
    """

    options: MarksConfig
    frame: str
    angles: NDArray[np.intp]
    held: NDArray[np.intp]
    holds: NDArray[np.intp]
    hand: int

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the angles."""
        return tuple(self.options.angles)

    @property
    def person(self) -> str:
        """The anonymous id."""
        return self.options.person

    @property
    def parameter(self) -> str:
        """The name of the parameter that is the mark."""
        return f"{MARKS}.mark"

    def samples(self, rows: NDArray[np.int64]) -> Samples:
        """The samples of those of rows (k, width) in which the run was active. What wasn't observed is NaN."""
        rows = rows[self.active(rows)]
        floats = self.floats(rows)
        angles: Array = floats[:, self.angles]
        hand = floats[:, self.hand : self.hand + 3].copy()
        i, j = np.nonzero(floats[:, self.held] > 0.5)
        angles[i, self.holds[j]] = np.nan
        return Samples(self.times(rows), angles, hand, self.marks(floats))


def channel_map(layout: Layout, place: str, own: MarksConfig | None = None) -> ChannelMap:
    """Finds them by the marks' law in the layout's profile.

    Args:
        layout: of the rows.
        place: the recording, for errors.
        own: what to take for a recording that has no such law, as a plain run hasn't.
    Raises:
        RecordingError: it has none and `own` is None; or it lacks a signal.
    """
    _, entry = marks_law(layout, place, MARKS)
    if entry is not None:
        return _of(layout, place, MarksConfig.model_validate(entry.options), f"{entry.name or MARKS}.mark")
    if own is None:
        problem = "it has no marks, so which samples belong to which trial isn't known"
        remedy = "Use a recording of `srl calibrate`; or say whose it is (--person), for one degree of freedom"
        raise RecordingError(place, problem, remedy)
    return _of(layout, place, own, None)


def _of(layout: Layout, place: str, options: MarksConfig, mark: str | None) -> ChannelMap:
    names = list(options.angles)
    hand = layout.fields.get(options.hand)
    if hand is None or hand.shape != (7,):
        problem = f"there is no pose '{options.hand}' in it"
        raise RecordingError(place, problem, "Use a recording of the profile that is calibrated")
    return ChannelMap(
        layout, None if mark is None else layout.fields[mark].offset, options, hand.frame or _FRAME,
        words(layout, list(options.angles.values()), place), words(layout, list(options.held.values()), place),
        np.array([names.index(joint) for joint in options.held], np.intp), hand.offset,
    )  # fmt: skip
