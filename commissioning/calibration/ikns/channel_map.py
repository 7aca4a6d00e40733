"""Where a calibration's signals are in the rows of a run, live or recorded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from srl.commissioning.calibration.ikns.marks import MarksConfig
from srl.commissioning.calibration.ikns.samples import Samples
from srl.commissioning.calibration.marks import Indices
from srl.commissioning.calibration.profile_subset import MARKS
from srl.commissioning.calibration.run_channels import RunChannels, marks_law, words
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.layout import Layout

_FRAME: Final = "chest"  # of a hand whose law doesn't say in which frame it gives it


@dataclass(frozen=True)
class ChannelMap(RunChannels):
    """What is read of a person whose arm does the motions.

    Attributes:
        frame: in which the hand's pose is.
        angles: (n,) of the joints' angles.
        held: (m,) of what says that a joint isn't observed; `holds` (m,) is the joint.
        hand: of the pose's first word.
    """

    law, config = MARKS, MarksConfig
    options: MarksConfig
    frame: str
    angles: Indices
    held: Indices
    holds: Indices
    hand: int

    @classmethod
    def places(cls, layout: Layout, options: MarksConfig, place: str) -> tuple[Any, ...]:
        names = list(options.angles)
        hand = layout.fields.get(options.hand)
        if hand is None or hand.shape != (7,):
            problem = f"there is no pose '{options.hand}' in it"
            raise RecordingError(place, problem, "Use a recording of the profile that is calibrated")
        angles, held = (words(layout, list(each.values()), place) for each in (options.angles, options.held))
        holds = np.array([names.index(joint) for joint in options.held], np.intp)
        return hand.frame or _FRAME, angles, held, holds, hand.offset

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the angles."""
        return tuple(self.options.angles)

    def _samples(self, times: Array, floats: Array, marks: Indices) -> Samples:
        angles: Array = floats[:, self.angles]
        hand = floats[:, self.hand : self.hand + 3].copy()
        i, j = np.nonzero(floats[:, self.held] > 0.5)
        angles[i, self.holds[j]] = np.nan
        return Samples(times, angles, hand, marks)


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
        return ChannelMap.of(layout, place, "ikns")
    if own is None:
        problem = "it has no marks, so which samples belong to which trial isn't known"
        remedy = "Use a recording of `srl calibrate`; or say whose it is (--person), for one degree of freedom"
        raise RecordingError(place, problem, remedy)
    return ChannelMap(layout, None, own, *ChannelMap.places(layout, own, place))
