"""Options of a device that sends numbers by UDP."""

from __future__ import annotations

import ipaddress
from typing import Annotated, Literal
from urllib.parse import urlsplit

from pydantic import Field, field_validator, model_validator

from srl.drivers.numbers.signals import NumbersConfig, NumberSignal

Place = Annotated[str, Field(min_length=1, max_length=200)]


class UdpMessagesConfig(NumbersConfig):
    """Options of the device.

    Where a number is: in JSON the keys and indices on the way to it, with dots (`hand.tips.0`); in OSC the address, and
    after a space which of its arguments, from 1 on (`/acc 2`; without it the first).
    """

    port: str = Field(description="udp://ADDRESS:PORT of this host, on which it listens; udp://:PORT on all addresses")
    format: Literal["json", "osc"] = Field("json", description="what a datagram is")
    sender: str | None = Field(None, description="address of the only host that counts; none: the first that sends")
    sequence: Place | None = Field(None, description="where a whole number is that grows with each sample")
    sequence_modulus: int | None = Field(None, ge=4, le=1 << 53, description="at which `sequence` begins again at 0")
    time: Place | None = Field(None, description="where the sender's clock is, s: of its sampling, from any zero")
    start: float = Field(3.0, gt=0, le=60, description="s until the first sample")
    signals: dict[str, NumberSignal[Place]] = Field(min_length=1, description="by the name it gets here")

    @field_validator("sender")
    @classmethod
    def _address(cls, value: str | None) -> str | None:
        if value is not None:
            try:
                ipaddress.IPv4Address(value)
            except ValueError:
                raise ValueError(f"'{value}' isn't an address such as 192.168.1.30") from None
        return value

    @model_validator(mode="after")
    def _whole(self) -> UdpMessagesConfig:
        parts = urlsplit(self.port)
        if parts.scheme != "udp" or parts.path or parts.query:
            raise ValueError(f"port: '{self.port}' must read udp://ADDRESS:PORT or udp://:PORT")
        if self.format == "osc":
            if self.sequence is not None or self.time is not None:
                raise ValueError("sequence, time: they are for JSON, whose samples are whole")
            for place in self.places:
                address, _, number = place.partition(" ")
                if not address.startswith("/") or (number and not (number.isdigit() and int(number) > 0)):
                    raise ValueError(f"signals: '{place}' isn't an OSC address, or one and a number: /acc 2")
        return self

    @property
    def places(self) -> list[str]:
        """All places, signal after signal, then `sequence` and `time`."""
        found = [place for entry in self.signals.values() for place in entry.elements.values()]
        return [*found, *(place for place in (self.sequence, self.time) if place is not None)]
