"""Options of a sensor that sends numbers over a serial line."""

from __future__ import annotations

import re
import struct
from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from srl.drivers.numbers.signals import NumbersConfig, NumberSignal

CODES: Final = "bBhHiIqQfd"
_FIELDS: Final = re.compile(f"^[<>][{CODES}]+$")
Column = Annotated[int, Field(ge=1, le=256)]


class SerialLinesConfig(NumbersConfig):
    """Options of the device.

    Attributes:
        head: the bytes of `header`.
    """

    port: str = Field(description="serial port, tcp://HOST:PORT, spy:FILE:URL")
    baudrate: int = Field(115200, gt=0, le=4_000_000, description="bit/s")
    format: Literal["text", "binary"] = Field("text", description="lines of numbers, or frames of bytes")
    separator: str = Field(",", max_length=4, description="text: between numbers; a space stands for any blanks")
    prefix: str = Field("", max_length=32, description="text: with which a line begins; others aren't looked at")
    columns: int = Field(ge=1, le=256, description="numbers in a line or frame; one with more or fewer is none")
    header: str = Field("", pattern="^([0-9A-Fa-f]{2}){0,8}$", description="binary: the first bytes, in hex: AA55")
    fields: str = Field(
        "", description="binary: type of each number, as Python's struct has it: <hhf (< low byte first)"
    )
    checksum: Literal["none", "xor", "sum"] = Field(
        "none",
        description="text: *HH at the end, of all before it but a first $ (NMEA: xor); binary: one byte at the end, of "
        "all after the header",
    )
    counter: int | None = Field(None, ge=1, le=256, description="column that grows by 1 with each sample")
    counter_modulus: int = Field(256, ge=2, le=1 << 32, description="at which it begins again at 0")
    start: float = Field(3.0, gt=0, le=30, description="s until the first sample: many boards restart when opened")
    signals: dict[str, NumberSignal[Column]] = Field(min_length=1, description="by the name it gets here")

    @model_validator(mode="after")
    def _whole(self) -> SerialLinesConfig:
        used = [column for entry in self.signals.values() for column in entry.elements.values()]
        used += [self.counter] if self.counter is not None else []
        if (most := max(used)) > self.columns:
            raise ValueError(f"columns: column {most} is named, and there are {self.columns}")
        if self.format == "text":
            if self.header or self.fields:
                raise ValueError("header, fields: they are for the binary format")
            if not self.separator or any(c.isdigit() or c in "+-.eE*\r\n" for c in self.separator):
                raise ValueError(f"separator: {self.separator!r} could be part of a number")
            return self
        if not _FIELDS.match(self.fields):
            raise ValueError(f"fields: '{self.fields}' isn't < or > and letters of {', '.join(CODES)}, e.g. <hhf")
        if len(self.fields) - 1 != self.columns:
            raise ValueError(f"fields: it has {len(self.fields) - 1} numbers, and columns says {self.columns}")
        if not self.header:
            raise ValueError("header: without one nothing says where a frame begins")
        if self.checksum == "none" and len(set(self.head)) < 2:
            raise ValueError("header: without a checksum it must have two bytes that differ, or numbers look like one")
        return self

    @property
    def head(self) -> bytes:
        """See the class."""
        return bytes.fromhex(self.header)

    @property
    def size(self) -> int:
        """Bytes of a binary frame."""
        return len(self.head) + struct.calcsize(self.fields) + (self.checksum != "none")
