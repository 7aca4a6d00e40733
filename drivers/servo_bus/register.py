"""A register of a servo."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Register:
    """One register.

    Attributes:
        address, size: bytes.
        writable: whether a host may write it.
        eeprom: non-volatile; can be written only while the torque is off.
        signed: two's complement.
        default: as delivered (eeprom), or after power-up.
        low, high: range of values that may be written; None: any value that fits.
    """

    address: int
    size: int
    writable: bool = True
    eeprom: bool = False
    signed: bool = False
    default: int = 0
    low: int | None = None
    high: int | None = None

    @property
    def end(self) -> int:
        """The address after it."""
        return self.address + self.size

    def encode(self, value: int) -> bytes:
        """Encodes a value."""
        return value.to_bytes(self.size, "little", signed=self.signed)

    def decode(self, data: bytes | bytearray, base: int = 0) -> int:
        """Decodes the value from bytes that begin at address `base`."""
        at = self.address - base
        return int.from_bytes(data[at : at + self.size], "little", signed=self.signed)
