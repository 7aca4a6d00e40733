"""What a calibration gave, whatever was calibrated."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from srl.runtime.contracts.errors import SrlError

F = TypeVar("F")


@dataclass(frozen=True)
class Result(Generic[F]):
    """What was found, and why it can't be used, if it can't.

    Attributes:
        channel_map: with the options with which it was measured.
        found: what was found.
        date: of the measurement.
        refusals: why it can't be used; none if it can.
    """

    channel_map: Any  # a RunChannels of the kind's own
    found: F
    date: datetime.date
    refusals: Sequence[SrlError]

    @property
    def options(self) -> Any:
        """Options of the marks' law."""
        return self.channel_map.options

    @property
    def person(self) -> str:
        """The anonymous id; "" of a device."""
        return str(self.channel_map.person)

    @property
    def simulated(self) -> bool:
        """Whether what was measured is simulated."""
        return bool(self.channel_map.simulated)

    @property
    def when(self) -> str:
        """Its date for a heading, and whether it is simulated: " (simulated), 2026-05-01"."""
        return f"{' (simulated)' if self.simulated else ''}, {self.date.isoformat()}"
