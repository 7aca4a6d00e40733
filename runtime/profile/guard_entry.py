"""One entry of the profile's `guard:`: the limits of a command, and what it must keep clear of."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, field_validator

from srl.runtime.contracts.cue import Cue
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import OptionError, WiringError
from srl.runtime.contracts.per_element import NotNegative, Positive, in_order
from srl.runtime.contracts.signals import Array, Command, Kind
from srl.runtime.guard.limits import GuardLimits
from srl.runtime.profile.wire import Input


class ClearEntry(BaseModel):
    """`guard.<command>.clear`: the clearance, its wiring, what is known of the servo; its own options (all other)."""

    model_config = ConfigDict(extra="allow", frozen=True, populate_by_name=True)

    use: str
    inputs: dict[str, Input] = Field(default_factory=dict, alias="in")
    lag: NotNegative = Field(
        description="s, the longest time from a command until the limb is there, waiting for the link included"
    )
    least_lag: NotNegative = Field(
        0.0, description="s, the shortest lag of any joint: all are taken to differ by the rest"
    )
    tracking: NotNegative | list[NotNegative] | dict[str, NotNegative] = Field(
        description="the command's unit; a joint may be this far from what was commanded within the lag"
    )
    period: float | None = Field(
        None,
        gt=0,
        le=1,
        description="s; a command leaves at least this often; null: the driver's figure",
    )
    timeout: float | None = Field(
        None, gt=0, le=10, description="s; without a command a device of velocities stops by itself within this"
    )

    @property
    def options(self) -> dict[str, Any]:
        """The clearance's own options."""
        return dict(self.model_extra or {})


class FollowingEntry(BaseModel):
    """`guard.<command>.following_error`: how far the limb may be from its command, and for how long."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    window: Positive | list[Positive] | dict[str, Positive] | None = Field(
        None, description="rad or m; None: what the driver says. For a velocity, its lag's way comes to it"
    )
    timeout: float = Field(0.5, ge=0.02, le=60, description="s that an error beyond the window may last")


class GuardEntry(GuardLimits):
    """`guard.<command>`."""

    following_error: FollowingEntry | Literal["off"] = FollowingEntry()
    stop_cue: Cue | None = Field(None, description="of an intensity: given to the wearer when the limb stops")
    loss_cue: Cue | None = Field(
        None, description="instead, when it stops as what it follows is lost; left out: `stop_cue`"
    )

    @field_validator("following_error", mode="before")
    @classmethod
    def _window_or_off(cls, given: Any) -> Any:
        if given == "off" or isinstance(given, dict | FollowingEntry):
            return given
        raise OptionError(f"{given!r} isn't a following error", "Give {window: ..., timeout: ...}, or off: no check")

    def check(self, command: Command, place: str) -> None:
        """Raises WiringError: it says what such a command hasn't, or can't be; `place` is that of this entry."""
        self.window(command, place)
        felt = command.kind is Kind.INTENSITY
        if not felt and (self.stop_cue or self.loss_cue):
            raise WiringError(place, f"a command of kind {command.kind} gives no cues", "Give them to an intensity")
        if felt and "following_error" in self.model_fields_set:
            raise WiringError(f"{place}.following_error", "nothing measures what is felt", "Take it out")

    def window(self, command: Command, place: str) -> Array | None:
        """(size,): the window of the following error; None: the profile gives none, or it is `off`.

        Raises:
            WiringError: it names other joints, or has another number of values; `place` is that of this entry.
        """
        if isinstance(self.following_error, str) or (wanted := self.following_error.window) is None:
            return None
        try:
            values = in_order(wanted, command.labels, size=command.size, ordered=command.ordered)
        except OptionError as error:
            raise WiringError(f"{place}.following_error.window", error.problem, error.remedy) from None
        return np.array(values, np.float64)

    clear: ClearEntry | None = None
