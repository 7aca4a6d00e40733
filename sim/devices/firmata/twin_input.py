"""How StandardFirmata splits received bytes into commands. No I/O.

Source: firmata/protocol and the behaviour of StandardFirmata 2.5; the tests compare it with the real firmware
running in simavr. These details matter to a driver that abandons an incomplete frame and begins a new one:

* Outside sysex, a data byte that no command expects is skipped.
* A command without data (F9) or a sysex message between a command and its data doesn't cancel the command: the
  data that follow still complete it. Another command with data, or FF, cancels it.
* Inside sysex every byte except F7 is data, including command bytes and FF. Bytes beyond the buffer are lost.
* An empty sysex message (F0 F7) is read as what the buffer still holds.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

MAX_SYSEX: Final = 64  # bytes of one message that the firmware stores
_DATA: Final = {0xE0: 2, 0x90: 2, 0xF4: 2, 0xF5: 2, 0xC0: 1, 0xD0: 1}


@dataclass(frozen=True, slots=True)
class Received:
    """One command.

    Attributes:
        kind: E0, 90, C0, D0 (without the channel), F4, F5, F9, FF, or F0 for sysex.
        channel: port, pin or analog channel of the first four.
        data: data bytes in the order they were sent; for sysex, all bytes between F0 and F7.
    """

    kind: int
    channel: int = 0
    data: bytes = b""


class Input:
    """Takes bytes and yields commands.

    Attributes:
        too_long: number of sysex messages longer than 64 bytes.
    """

    def __init__(self) -> None:
        self.too_long = 0
        self._stored = bytearray(MAX_SYSEX)  # one buffer for sysex and for commands' data, as in the firmware
        self.clear()

    def clear(self) -> None:
        """Discards an incomplete command."""
        self._kind = self._channel = self._waiting = self._length = 0
        self._sysex = False

    def feed(self, data: bytes) -> Iterator[Received]:
        """Yields the commands that `data` completes; obey each one before taking the next."""
        for byte in data:
            command = self._take(byte)
            if command is not None:
                if command.kind == 0xFF:
                    self.clear()
                yield command

    def _take(self, byte: int) -> Received | None:
        if self._sysex:
            return self._in_sysex(byte)
        if self._waiting and byte < 0x80:
            self._waiting -= 1
            self._stored[self._waiting] = byte
            if self._waiting or not self._kind:
                return None
            kind, self._kind = self._kind, 0
            return Received(kind, self._channel, bytes(self._stored[_DATA[kind] - 1 :: -1]))
        kind = byte
        if byte < 0xF0:
            kind, self._channel = byte & 0xF0, byte & 0x0F
        if kind in _DATA:
            self._kind, self._waiting = kind, _DATA[kind]
        elif kind == 0xF0:
            self._sysex, self._length = True, 0
        elif kind in (0xF9, 0xFF):
            return Received(kind)
        return None

    def _in_sysex(self, byte: int) -> Received | None:
        if byte != 0xF7:
            if self._length < MAX_SYSEX:
                self._stored[self._length] = byte
            self._length += 1
            return None
        self._sysex = False
        self.too_long += self._length > MAX_SYSEX
        return Received(0xF0, 0, bytes(self._stored[: self._length or MAX_SYSEX]))
