"""What every calibration asks of a run, live or recorded: who was measured, whether it stands still, and when."""

from __future__ import annotations

import datetime
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.controller import ControllerConfig
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import LINK_CONNECTED, LINK_ERROR, LINK_FAULT, LINK_STALE, Cause, Latch, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.models.models import bodies, context
from srl.runtime.profile import profile
from srl.runtime.profile.plots import indices, split
from srl.runtime.profile.profile import ControllerEntry, Profile


@dataclass(frozen=True)
class RunChannels(ABC):
    """Places among a row's float64 words.

    Attributes:
        layout: of the rows.
        mark: of the mark; None in a recording without one.
        options: of the marks' law.
        law: the marks' law.
        config: the type of its options.
        unknown: what isn't known without marks: "which samples belong to which pose".
    """

    layout: Layout
    mark: int | None
    options: Any
    law: ClassVar[str]
    config: ClassVar[type[ControllerConfig]]
    unknown: ClassVar[str]

    @classmethod
    def of(cls, layout: Layout, place: str, kind: str) -> Self:
        """Finds them by the marks' law in a layout's profile.

        Args:
            layout: of the rows.
            place: the recording, for errors.
            kind: what `srl calibrate` calls it.
        Raises:
            RecordingError: the profile has no such law, or the layout lacks a signal.
        """
        checked, entry = marks_law(layout, place, cls.law)
        if entry is None:
            problem = f"it has no marks, so {cls.unknown} isn't known"
            raise RecordingError(place, problem, f"Use a recording of `srl calibrate PROFILE {kind}`")
        options = cls.config.model_validate(entry.options, context=context(checked.models))
        mark = layout.fields[f"{entry.name or cls.law}.mark"].offset
        return cls(layout, mark, options, *cls.places(layout, options, place))

    @classmethod
    @abstractmethod
    def places(cls, layout: Layout, options: Any, place: str) -> tuple[Any, ...]:
        """What a kind's own attributes are. Raises RecordingError: a signal is missing."""

    @property
    def person(self) -> str:
        """The anonymous id; "" of a device."""
        return str(getattr(self.options, "person", ""))

    @property
    def parameter(self) -> str:
        """The name of the parameter that is the mark."""
        return f"{self.law}.mark"

    def samples(self, rows: NDArray[np.int64]) -> Any:
        """The kind's samples of those of rows (k, width) in which the run was active. What wasn't observed is NaN."""
        rows = rows[self.active(rows)]
        return self._samples(self.times(rows), floats := self.floats(rows), self.marks(floats))

    @abstractmethod
    def _samples(self, times: Array, floats: NDArray[np.float64], marks: NDArray[np.intp]) -> Any:
        """The kind's own samples, of the float64 words (k, n) of rows in which the run was active."""

    def marks(self, floats: NDArray[np.float64]) -> NDArray[np.intp]:
        """(k,) the marks in a row's float64 words (k, n)."""
        return np.zeros(len(floats), np.intp) if self.mark is None else floats[:, self.mark].astype(np.intp)

    def floats(self, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """(k, n) the float64 words of rows (k, width). A device's are NaN while it isn't there or isn't fresh.

        A run isn't stopped by the loss of a device that feeds no law; then its last values stay.
        """
        found: NDArray[np.float64] = rows[:, self.layout.ints :].copy().view(np.float64)
        for device in self.layout.devices:
            if (lost := ~self._there(rows, device)).any():
                for field in self.layout.fields.values():
                    if field.role == "state" and field.name.partition(".")[0] == device:
                        found[lost, field.offset : field.offset + field.size] = np.nan
        return found

    def active(self, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(k,) whether the run was active in each of rows (k, width)."""
        found: NDArray[np.bool_] = self.layout.header(rows, "state") == int(State.ACTIVE)
        return found

    def _there(self, rows: NDArray[np.int64], device: str) -> NDArray[np.bool_]:
        """(k,) whether a device is there and fresh in each of rows (k, width)."""
        link = self.layout.header(rows, f"{device}.link")
        bad = LINK_STALE | LINK_ERROR | LINK_FAULT
        found: NDArray[np.bool_] = (link & (LINK_CONNECTED | bad)) == LINK_CONNECTED
        return found

    def times(self, rows: NDArray[np.int64]) -> Array:
        """(k,) s, of rows (k, width)."""
        found: Array = self.layout.header(rows, "now").astype(np.float64) * 1e-9
        return found

    @property
    def rate(self) -> float:
        """Hz, of the rows."""
        up, down = self.layout.meta["rate"]
        return float(up / down)

    @property
    def simulated(self) -> bool:
        """Whether the person is simulated: a sensor is. A simulated limb of a plain run doesn't count."""
        driven = {name.partition(".")[0] for name, field in self.layout.fields.items() if field.role == "sent"}
        return any(device not in driven for device in self.layout.simulated)

    @property
    def bodies(self) -> dict[str, dict[str, Any]]:
        """The bodies by which the angles were measured; as in `models.bodies`."""
        meta = self.layout.meta
        return bodies(profile.parse(meta["label"], meta["profile"], meta["overrides"])[0].models)

    def may_begin_again(self, row: NDArray[np.int64]) -> bool:
        """Whether a device was lost, nothing else keeps the stop, and every device is there again.

        Nothing can move, so the run may then go on without a person. What somebody stopped stays stopped.
        """
        if not self.lost(row):
            return False
        links = [int(self.layout.header(row, f"{device}.link")) for device in self.layout.devices]
        return all(link & LINK_CONNECTED and not link & (LINK_STALE | LINK_ERROR | LINK_FAULT) for link in links)

    def lost(self, row: NDArray[np.int64]) -> bool:
        """Whether the run is stopped by the loss of a device, and by nothing else."""
        state, cause, latched = (int(self.layout.header(row, name)) for name in ("state", "cause", "latches"))
        return state == State.STOPPED and cause == Cause.INTENT_LOSS and not latched & ~Latch.FAULT

    def date(self, rows: NDArray[np.int64]) -> datetime.date:
        """The day of the first row, UTC."""
        wall = int(self.layout.header(rows[0], "now")) + int(self.layout.meta.get("wall", 0))
        return datetime.datetime.fromtimestamp(wall * 1e-9, datetime.UTC).date()


def marks_law(layout: Layout, place: str, law: str) -> tuple[Profile, ControllerEntry | None]:
    """A layout's own profile and its entry of the marks' law; None: it has none. Raises RecordingError."""
    layout.needs(place, "label", "profile", "overrides", "rate")
    meta = layout.meta
    checked, _ = profile.parse(meta["label"], meta["profile"], meta["overrides"])
    return checked, next((entry for entry in checked.controllers if entry.use == law), None)


def words(layout: Layout, references: list[str], place: str) -> NDArray[np.intp]:
    """The places of references ("suit.rotation[Hips]"), one after another. Raises RecordingError."""
    found: list[int] = []
    for reference in references:
        field = layout.fields.get(split(reference)[0])
        if field is None:
            problem = f"there is no signal '{split(reference)[0]}' in it"
            raise RecordingError(place, problem, "Use a recording of the profile that is calibrated")
        places = np.arange(field.size).reshape(field.shape)[indices(field, reference, place)]
        found.extend((field.offset + places).ravel().tolist())
    return np.array(found, np.intp)
