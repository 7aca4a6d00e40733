"""The file that `srl calibrate PROFILE emg` writes: what each muscle gives at rest and at its greatest contraction."""

from __future__ import annotations

import datetime
from typing import Annotated, Final, Literal

from pydantic import ConfigDict, Field, FiniteFloat, model_validator

from srl.control.emg.processing import EmgError, Filters
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.models import record_file
from srl.runtime.models.record_file import Name

FORMAT: Final = "srl-emg-1"

_Positive = Annotated[FiniteFloat, Field(gt=0.0)]
_NotNegative = Annotated[FiniteFloat, Field(ge=0.0)]


class Muscle(BaseModel):
    """One muscle.

    Attributes:
        rest: V, mean of the envelope at rest.
        mvc: V, the greatest voluntary contraction: the highest mean of the envelope over `window`; above `rest`.
        repeats: V, the same of each contraction of this muscle, in their order.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    rest: _NotNegative
    mvc: _Positive
    repeats: Annotated[tuple[_NotNegative, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _rises(self) -> Muscle:
        if self.mvc <= self.rest:
            raise ValueError(f"mvc is {self.mvc:g} V, at rest {self.rest:g} V: a contraction must give more")
        return self


class EmgRecord(BaseModel):
    """What the file holds.

    Attributes:
        format: of the file.
        person: anonymous id.
        date: of the measurement. It holds while the electrodes stay on the skin.
        simulated: of simulated muscles, so it says nothing about a person.
        signal: the samples that were measured, "emg.samples".
        channels: the device's slot, or the stream's channel, of each muscle; none in a file of before they were kept.
        rate: Hz, of the samples.
        band, band_order, cutoff, cutoff_order: of the filters, as in `processing.Filters`.
        window: s, over which the mean of a contraction's envelope is taken.
        muscles: each by its name, in the device's order.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["srl-emg-1"]
    person: Name
    date: datetime.date
    simulated: bool
    signal: str
    channels: dict[str, int | str] = Field(default_factory=dict)
    rate: _Positive
    band: tuple[_Positive, _Positive]
    band_order: int
    cutoff: Annotated[FiniteFloat, Field(ge=2.5, le=20.0)]
    cutoff_order: int
    window: _Positive
    muscles: Annotated[dict[str, Muscle], Field(min_length=1, max_length=16)]

    @model_validator(mode="after")
    def _filters_exist(self) -> EmgRecord:
        if self.channels and self.channels.keys() != self.muscles.keys():
            raise ValueError("the slots aren't those of its muscles")
        try:
            self.filters()
        except EmgError as error:
            raise ValueError(f"{error.problem}: {error.remedy}") from None
        return self

    def filters(self) -> Filters:
        """The filters with which it was measured. Raises EmgError: there are none of these numbers."""
        return Filters(self.rate, self.band, self.band_order, self.cutoff, self.cutoff_order)


def parse(content: bytes, place: str) -> EmgRecord:
    """Makes the record of a file's content. Raises RecordError."""
    return record_file.parse(EmgRecord, content, place)
