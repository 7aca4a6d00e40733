"""The profile's `reset:` section: the buttons that reset, and what clients of the bus may release."""

from __future__ import annotations

from typing import Literal

from pydantic import ConfigDict, Field, field_validator

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.ipc import latches
from srl.runtime.profile.element import Element


class ResetInput(Element):
    """`reset.inputs[i]`: a button that resets when it is pressed. It is an element of a device's state."""

    when: float = Field(1.0, allow_inf_nan=False, description="the value while it is pressed")


class ResetConfig(BaseModel):
    """`reset`: who may end a stop besides `srl reset`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    inputs: tuple[ResetInput, ...] = ()
    bus: tuple[str, ...] = Field(
        tuple(latches.names(latches.GRANTED)), description="latches that clients of the bus may release"
    )

    unmeasured: Literal["home", "refuse"] = Field(
        "home",
        description="after the loss or a limp stop of an actuator that nothing measures: home, it goes home; refuse, "
        "no reset starts it again in this run",
    )
    keeps: tuple[str, ...] = Field((), description="latches that no start or reset of this run may release")

    @field_validator("keeps")
    @classmethod
    def _known(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        for name in value:
            if name not in latches.names(latches.ALL):
                raise ValueError(f"'{name}' is no latch; they are: {', '.join(latches.names(latches.ALL))}")
        return value

    @field_validator("bus")
    @classmethod
    def _grantable(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        known, grantable = latches.names(latches.ALL), latches.names(latches.GRANTABLE)
        for name in value:
            if name in known and name not in grantable:
                raise ValueError(
                    f"clients of the bus may not release '{name}': that takes `srl reset` on the machine or an input "
                    f"under reset.inputs; they may be granted: {', '.join(grantable)}"
                )
            if name not in known:
                raise ValueError(f"'{name}' is no latch; clients of the bus may be granted: {', '.join(grantable)}")
        return value
