"""Options of a device that is a stream of the Lab Streaming Layer."""

from __future__ import annotations

import ipaddress
import re
from typing import Final

from pydantic import ConfigDict, Field, field_validator, model_validator

from srl.drivers.lsl.units import KNOWN, factor
from srl.runtime.contracts import terms
from srl.runtime.contracts.driver import DeviceConfig
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.signals import Signal

PORT: Final = 16571  # liblsl's own, for discovery; streams have those after it
_NAME = re.compile(r"^[a-z][a-z0-9_]*$")
_ADDRESS = re.compile(r"^lsl://(?P<host>[^:/\[\]@?#]+)(?::(?P<port>\d{1,5}))?$")
_OWN = ("count",)


class LslStream(BaseModel):
    """Which stream. All that is given must fit; nothing is taken for being the first."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    source_id: str | None = Field(
        None, min_length=1, max_length=200, description="the sender's own, e.g. a serial number"
    )
    name: str | None = Field(None, min_length=1, max_length=200)
    type: str | None = Field(None, min_length=1, max_length=200, description="EMG, EEG, MoCap, Gaze, ...")
    hostname: str | None = Field(None, min_length=1, max_length=200, description="of the machine that sends")

    @model_validator(mode="after")
    def _one(self) -> LslStream:
        if self.source_id is None and self.name is None:
            raise ValueError("needs `source_id` or `name`: a type alone may be anybody's")
        self.predicate()
        return self

    def predicate(self) -> str:
        """The XPath predicate that liblsl resolves by. Raises ValueError: a text that it can't say."""
        return " and ".join(f"{key}={_quoted(value)}" for key, value in self.model_dump(exclude_none=True).items())


class LslSignal(BaseModel):
    """One signal: channels of the stream, in SI."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    channels: dict[str, str | int] = Field(
        min_length=1,
        max_length=256,
        description="name here: the channel's label there, or its number from 1 where it has none",
    )
    unit: str = Field(description="SI, of the values here")
    sent: str | None = Field(
        None, description="the sender's unit (microvolts, degrees), if the stream doesn't state it"
    )
    frame: str | None = Field(None, description="the frame of its coordinates")
    block: int = Field(
        0, ge=0, le=512, description="keep the newest so many samples in a row of their own; 0: the newest"
    )
    nan: bool = Field(False, description="let NaN through (an eye that isn't seen)")

    @field_validator("channels")
    @classmethod
    def _channels(cls, value: dict[str, str | int]) -> dict[str, str | int]:
        taken = list(value.values())
        for name, where in value.items():
            if isinstance(where, int) and where < 1:
                raise ValueError(f"'{name}' is channel {where}; numbers begin at 1")
            if taken.count(where) > 1:
                raise ValueError(f"channel {where!r} is there twice")
        return value

    @model_validator(mode="after")
    def _units(self) -> LslSignal:
        units = sorted({unit for unit, _ in KNOWN.values()})
        if self.unit not in units:
            raise ValueError(f"unit: '{self.unit}' isn't one of {', '.join(units)}")
        if self.sent is not None and factor(self.sent, self.unit) is None:
            words = ", ".join(word for word, (unit, _) in KNOWN.items() if unit == self.unit)
            raise ValueError(f"sent: '{self.sent}' isn't a known unit of '{self.unit}': {words}")
        return self

    def unit_of(self, label: str) -> str:
        """The SI unit of a channel here: a pose's quaternion has none."""
        return "1" if tuple(self.channels) == terms.POSE and label in terms.QUATERNION else self.unit

    def signal(self, name: str) -> Signal:
        """The state that it is: (n,), or (block, n) with the oldest sample first."""
        labels = tuple(self.channels)
        if self.block:
            return Signal(
                name=name, shape=(self.block, len(labels)), unit=self.unit, frame=self.frame, slots=True,
                components=(labels,),
            )  # fmt: skip
        return Signal(name=name, shape=(len(labels),), unit=self.unit, frame=self.frame, labels=labels)


class LslConfig(DeviceConfig):
    """Options of the device.

    Attributes:
        host: of `port`.
        number: the discovery port.
    """

    port: str = Field("lsl://127.0.0.1", description="lsl://HOST[:PORT], the machine that sends; PORT is discovery's")
    stream: LslStream
    rate: float = Field(ge=0, le=20000, description="Hz, as the stream states it; 0: irregular")
    count: int | None = Field(None, ge=1, le=1024, description="of all its channels; needed where a number names one")
    signals: dict[str, LslSignal] = Field(min_length=1, description="by the name it gets here")
    latency: float = Field(0.0, ge=0, le=1.0, description="s from the body to the stamp: the stream can't tell")
    silence: float = Field(1.0, ge=0.2, le=60, description="s without a new sample until it is looked for anew")
    unencrypted_network: bool = Field(
        False, description="allows the network: anybody in it can read the stream, and pretend to be it"
    )

    @field_validator("signals")
    @classmethod
    def _names(cls, value: dict[str, LslSignal]) -> dict[str, LslSignal]:
        for name in value:
            if not _NAME.match(name) or name in _OWN:
                raise ValueError(f"'{name}' can't be a signal's name: small letters, digits, _; not 'count'")
        return value

    @model_validator(mode="after")
    def _whole(self) -> LslConfig:
        match = _ADDRESS.match(self.port)
        if match is None or not 1024 <= int(match["port"] or PORT) < 65000:
            raise ValueError(f"port: '{self.port}' must read lsl://HOST or lsl://HOST:PORT, e.g. lsl://127.0.0.1")
        try:
            here = ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            raise ValueError(f"port: '{self.host}' must be an address such as 192.168.1.30, not a name") from None
        if not here and not self.unencrypted_network:
            raise ValueError(
                f"port: '{self.port}' crosses a network, and LSL has neither password nor encryption: anybody there "
                "can pretend to be the stream. Accept it with `unencrypted_network: true`, in a network of its own"
            )
        named = [
            where for entry in self.signals.values() for where in entry.channels.values() if isinstance(where, int)
        ]
        if named and self.count is None:
            raise ValueError(f"count: channel {named[0]} is named by its number, so say how many the stream has")
        if self.count is not None and any(where > self.count for where in named):
            raise ValueError(f"channels: {max(named)} is named, and the stream has {self.count}")
        if not self.rate and any(entry.block for entry in self.signals.values()):
            raise ValueError("block: samples of an irregular stream (rate: 0) are no row")
        return self

    @property
    def host(self) -> str:
        """See the class."""
        match = _ADDRESS.match(self.port)
        return match["host"] if match is not None else ""

    @property
    def number(self) -> int:
        """See the class."""
        match = _ADDRESS.match(self.port)
        return int(match["port"] or PORT) if match is not None else PORT

    @property
    def here(self) -> bool:
        """Whether the sender is on this machine."""
        return ipaddress.ip_address(self.host).is_loopback

    def states(self) -> tuple[Signal, ...]:
        """The signals, as declared by both the driver and its fake; `count` (1,) beside blocks."""
        found = tuple(entry.signal(name) for name, entry in self.signals.items())
        if any(entry.block for entry in self.signals.values()):
            found += (Signal(name="count", shape=(1,), unit="1"),)
        return found


def _quoted(text: str) -> str:
    """An XPath string; liblsl has no escape."""
    if "'" in text and '"' in text:
        raise ValueError(f"{text!r} has both kinds of quotation marks: name another property of the stream")
    return f'"{text}"' if "'" in text else f"'{text}'"
