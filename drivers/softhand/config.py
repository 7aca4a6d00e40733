"""Options of a SoftHand."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator

from srl.drivers.softhand.protocol import BAUDRATE, Limits
from srl.runtime.contracts.driver import DeviceConfig
from srl.runtime.contracts.per_element import PerElement

USUAL = Limits(0, 19000)  # ticks, used if the hand doesn't report its range


class SoftHandConfig(DeviceConfig):
    """Options in the profile."""

    port: str = Field(description="link: a serial port's path, tcp://HOST:PORT, spy:FILE:URL")
    id: int = Field(1, ge=1, le=254, description="the hand's number on the bus")
    baudrate: Literal[2_000_000, 460_800] = BAUDRATE
    limits: Annotated[tuple[int, int], PerElement(("open", "closed"))] | None = Field(
        None, description="ticks of the open and the closed hand; None: as the hand says, else 0 and 19000"
    )
    watchdog: float = Field(
        0.25, ge=0, le=0.51, description="s without a command after which the hand itself lets go; 0: never"
    )

    @field_validator("limits")
    @classmethod
    def _rising(cls, value: tuple[int, int] | None) -> tuple[int, int] | None:
        if value is not None and not -32768 <= value[0] < value[1] <= 32767:
            raise ValueError("must rise, within -32768 and 32767")
        return value

    @field_validator("watchdog")
    @classmethod
    def _long_enough(cls, value: float) -> float:
        if 0 < value < 0.1:
            raise ValueError("must be 0, or at least 0.1: commands are repeated every 0.04 s")
        return value
