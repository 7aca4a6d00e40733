"""Where a calibration's signals are in the rows of a run, live or recorded."""

from __future__ import annotations

import datetime
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from runtime.calibration.cut import MARKS
from runtime.contracts.errors import RecordingError
from runtime.contracts.signals import Array
from runtime.control.ikns.marks import MarksConfig
from runtime.control.ikns.samples import Samples
from runtime.control.models import BodyModel
from runtime.ipc.layout import Layout
from runtime.ipc.words import LINK_CONNECTED, LINK_ERROR, LINK_FAULT, LINK_STALE, Cause, Latch, State
from runtime.profile import profile
from runtime.profile.plots import indices, split
from runtime.profile.profile import Profile

_FRAME: Final = "chest"  # of a hand whose law doesn't say in which frame it gives it


@dataclass(frozen=True)
class Taps:
    """Places among a row's float64 words.

    Attributes:
        options: of the marks' law: names of joints and DoFs, thresholds, the person's id.
        frame: in which the hand's pose is.
        angles: (n,) of the joints' angles.
        held: (m,) of what says that a joint isn't observed; `holds` (m,) is the joint.
        hand: of the pose's first word.
        mark: of the mark; None in a recording without one.
    """

    layout: Layout
    options: MarksConfig
    frame: str
    angles: NDArray[np.intp]
    held: NDArray[np.intp]
    holds: NDArray[np.intp]
    hand: int
    mark: int | None

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the angles."""
        return tuple(self.options.angles)

    @property
    def rate(self) -> float:
        """Hz, of the rows."""
        up, down = self.layout.meta["rate"]
        return float(up / down)

    @property
    def simulated(self) -> bool:
        """Whether the person is simulated: a sensor is. A simulated limb of a plain run doesn't count."""
        driven = {name.partition(".")[0] for name, field in self.layout.fields.items() if field.role == "sent"}
        return any(device not in driven for device in self.layout.meta["simulated"])

    @property
    def bodies(self) -> dict[str, dict[str, Any]]:
        """The bodies by which the angles were measured; as in `bodies`."""
        meta = self.layout.meta
        return bodies(profile.parse(meta["label"], meta["profile"], meta["overrides"])[0])

    def may_begin_again(self, row: NDArray[np.int64]) -> bool:
        """Whether a device was lost, nothing else keeps the stop, and every device is there again.

        Nothing can move, so the run may then go on without a person. What somebody stopped stays stopped.
        """
        if not self.lost(row):
            return False
        links = [int(self.layout.word(row, f"{device}.link")) for device in self.layout.devices]
        return all(link & LINK_CONNECTED and not link & (LINK_STALE | LINK_ERROR | LINK_FAULT) for link in links)

    def lost(self, row: NDArray[np.int64]) -> bool:
        """Whether the run is stopped by the loss of a device, and by nothing else."""
        state, cause, standing = (int(self.layout.word(row, name)) for name in ("state", "cause", "latches"))
        return state == State.STOPPED and cause == Cause.INTENT_LOSS and not standing & ~Latch.FAULT

    def active(self, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(k,) whether the run was active in each of rows (k, width)."""
        found: NDArray[np.bool_] = self.layout.word(rows, "state") == int(State.ACTIVE)
        return found

    def times(self, rows: NDArray[np.int64]) -> Array:
        """(k,) s, of rows (k, width)."""
        found: Array = self.layout.word(rows, "now").astype(np.float64) * 1e-9
        return found

    def samples(self, rows: NDArray[np.int64]) -> Samples:
        """The samples of those of rows (k, width) in which the run was active. What wasn't observed is NaN."""
        rows = rows[self.active(rows)]
        floats: Array = np.ascontiguousarray(rows[:, self.layout.ints :]).view(np.float64)
        angles: Array = floats[:, self.angles]
        hand = floats[:, self.hand : self.hand + 3].copy()
        i, j = np.nonzero(floats[:, self.held] > 0.5)
        angles[i, self.holds[j]] = np.nan
        marks = np.zeros(len(rows), np.intp) if self.mark is None else floats[:, self.mark].astype(np.intp)
        return Samples(self.times(rows), angles, hand, marks)

    def date(self, rows: NDArray[np.int64]) -> datetime.date:
        """The day of the first row, UTC."""
        wall = int(self.layout.word(rows[0], "now")) + int(self.layout.meta.get("wall", 0))
        return datetime.datetime.fromtimestamp(wall * 1e-9, datetime.UTC).date()


def bodies(checked: Profile) -> dict[str, dict[str, Any]]:
    """A profile's bodies by name: their sizes, but not which sides they have."""
    return {n: m.model_dump(exclude={"sides"}) for n, m in checked.models.items() if isinstance(m, BodyModel)}


def taps(layout: Layout, place: str, own: MarksConfig | None = None) -> Taps:
    """Finds them by the marks' law in the layout's profile.

    Args:
        layout: of the rows.
        place: the recording, for errors.
        own: what to take for a recording that has no such law, as a plain run hasn't.
    Raises:
        RecordingError: it has none and `own` is None; or it lacks a signal.
    """
    layout.needs(place, "label", "profile", "overrides", "rate")
    meta = layout.meta
    checked, _ = profile.parse(meta["label"], meta["profile"], meta["overrides"])
    entry = next((e for e in checked.controllers if e.use == MARKS), None)
    if entry is not None:
        return _of(layout, place, MarksConfig.model_validate(entry.options), f"{entry.name or MARKS}.mark")
    if own is None:
        problem = "it has no marks, so which samples belong to which trial isn't known"
        remedy = "Use a recording of `srl calibrate`; or say whose it is (--person), for one degree of freedom"
        raise RecordingError(place, problem, remedy)
    return _of(layout, place, own, None)


def _of(layout: Layout, place: str, options: MarksConfig, mark: str | None) -> Taps:
    names = list(options.angles)
    hand = layout.fields.get(options.hand)
    if hand is None or hand.shape != (7,):
        problem = f"there is no pose '{options.hand}' in it"
        raise RecordingError(place, problem, "Use a recording of the profile that is calibrated")
    return Taps(
        layout, options, hand.frame or _FRAME,
        _words(layout, list(options.angles.values()), place), _words(layout, list(options.held.values()), place),
        np.array([names.index(joint) for joint in options.held], np.intp), hand.offset,
        None if mark is None else layout.fields[mark].offset,
    )  # fmt: skip


def _words(layout: Layout, references: list[str], place: str) -> NDArray[np.intp]:
    found = []
    for reference in references:
        field = layout.fields.get(split(reference)[0])
        if field is None:
            problem = f"there is no signal '{split(reference)[0]}' in it"
            raise RecordingError(place, problem, "Use a recording of the profile that is calibrated")
        found.append(field.offset + indices(field, reference, place)[0])
    return np.array(found, np.intp)
