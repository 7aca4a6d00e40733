"""The qbrobotics serial protocol (sheet qbhand, 1 to 4). No I/O."""

from __future__ import annotations

import struct
from enum import IntEnum
from functools import reduce
from operator import xor
from typing import Final, NamedTuple

BAUDRATE: Final = 2_000_000
HEADER: Final = b"::"
SHORTEST, LONGEST = 2, 128  # limits of the length byte, which counts command, data, checksum
PARAMETER: Final = 50  # bytes per parameter slot
_FLAG, _INT32 = 0, 5  # types of parameters
FLUSH: Final = bytes(16)  # completes a frame of ours that was cut short: none of our frames is longer


class Cmd(IntEnum):
    """Commands; a reply repeats its command."""

    PING = 0
    STORE = 3
    GET_INFO = 6
    PARAMETERS = 12
    ACTIVATE = 128  # no reply
    GET_ACTIVATE = 129
    SET_INPUTS = 130  # no reply
    GET_INPUTS = 131
    GET_MEASUREMENTS = 132
    GET_CURRENTS = 133
    GET_BOTH = 134
    GET_VELOCITIES = 137
    SET_WATCHDOG = 143
    SET_BAUDRATE = 144


class Frame(NamedTuple):
    """A request or a reply: both have the same form.

    Attributes:
        id: the hand's id.
        command: see `Cmd`.
        data: the bytes after the command.
    """

    id: int
    command: int
    data: bytes = b""


def checksum(body: bytes) -> int:
    """Returns the XOR of the command and all data."""
    return reduce(xor, body, 0)


def frame(hand: int, command: int, data: bytes = b"") -> bytes:
    """Returns a frame's bytes."""
    body = bytes((command,)) + data
    return HEADER + bytes((hand, len(body) + 1)) + body + bytes((checksum(body),))


def activate(hand: int, on: bool) -> bytes:
    """Switches the motor on or off; when switched on, it takes its present position as reference."""
    return frame(hand, Cmd.ACTIVATE, b"\x03" if on else b"\x00")


def set_inputs(hand: int, reference: int, second: int = 0) -> bytes:
    """Sets the motor's reference, ticks -32768..32767; `second`: for a hand with two motors."""
    return frame(hand, Cmd.SET_INPUTS, struct.pack(">hh", reference, second))


def set_watchdog(hand: int, milliseconds: int) -> bytes:
    """Sets the time without a command after which the motor switches off; 0: never. In steps of 2 ms up to 510."""
    return frame(hand, Cmd.SET_WATCHDOG, bytes((min(milliseconds // 2, 255),)))


def int16s(data: bytes) -> tuple[int, ...]:
    """Returns the numbers in a reply; a last odd byte is ignored."""
    return struct.unpack(f">{len(data) // 2}h", data[: len(data) // 2 * 2])


class Parser:
    """Cuts a byte stream into frames; after any input it finds the next whole frame with a correct checksum.

    Attributes:
        frames: good frames. errors: number of times bytes were discarded. resyncs: number of times sync was lost.
    """

    def __init__(self) -> None:
        self.frames = self.errors = self.resyncs = 0
        self._buffer = bytearray()
        self._lost = False

    def reset(self) -> None:
        """Forgets a partly read frame. Counts stay."""
        self._buffer.clear()
        self._lost = False

    def feed(self, data: bytes) -> list[Frame]:
        """Returns the frames that `data` completes, in order. Keeps less than one frame's bytes."""
        buffer = self._buffer
        buffer += data
        found: list[Frame] = []
        at = 0
        while True:
            start = buffer.find(HEADER, at)
            if start < 0:  # a final colon may be the first half of a header
                start = len(buffer) - (buffer[-1:] == b":" and len(buffer) > at)
                self._skip(start - at)
                at = start
                break
            self._skip(start - at)
            at = start
            if len(buffer) < at + 4:
                break
            length = buffer[at + 3]
            if not SHORTEST <= length <= LONGEST:
                self._skip(1)
                at += 1
                continue
            end = at + 4 + length
            if len(buffer) < end:
                break
            body = bytes(buffer[at + 4 : end])
            if checksum(body) != 0:  # with the checksum's own byte the XOR is zero
                self._skip(1)
                at += 1
                continue
            found.append(Frame(buffer[at + 2], body[0], body[1:-1]))
            self.frames += 1
            self._lost = False
            at = end
        del buffer[:at]
        return found

    def _skip(self, count: int) -> None:
        if count > 0 and not self._lost:
            self._lost = True
            self.errors += 1
            self.resyncs += 1


class Limits(NamedTuple):
    """The motor's range, ticks."""

    open: int
    closed: int


class Settings(NamedTuple):
    """What a hand keeps that a driver needs.

    Attributes:
        limits: its range; None if it isn't told.
        control: its control mode, an index of `CONTROL`; None if it isn't told.
    """

    limits: Limits | None
    control: int | None


CONTROL: Final = ("position", "PWM", "current", "current and position")


def parse_settings(raw: bytes, hand: int) -> Settings | None:
    """Returns what is in the answer to PARAMETERS; None if `raw` has none.

    The answer is too long for its length byte. This byte counts single bytes or, in newer firmware, units of 32. The
    answer is accepted only if the checksum fits one of the two. Each parameter has a slot: type, number of values, the
    values, a description. The limits are the pair of 32-bit integers described as "Pos. limits". The control mode is
    the flag described as "Control mode".
    """
    at = raw.find(HEADER + bytes((hand,)))
    while at >= 0:
        for size in (raw[at + 3], raw[at + 3] * 32) if len(raw) > at + 5 else ():
            body = raw[at + 4 : at + 4 + size]
            if size >= SHORTEST and len(body) == size and body[0] == Cmd.PARAMETERS and checksum(body) == 0:
                return Settings(_limits(body[2:-1], body[1]), _control(body[2:-1], body[1]))
        at = raw.find(HEADER + bytes((hand,)), at + 1)
    return None


def _limits(slots: bytes, count: int) -> Limits | None:
    data = _slot(slots, count, (_INT32, 2), 8, b"pos. lim")
    if data is None:
        return None
    low, high = struct.unpack(">ii", data)
    return Limits(low, high) if -32768 <= low < high <= 32767 else None


def _control(slots: bytes, count: int) -> int | None:
    data = _slot(slots, count, (_FLAG, 1), 1, b"control mode")
    return data[0] if data is not None else None


def _slot(slots: bytes, count: int, kind: tuple[int, int], size: int, text: bytes) -> bytes | None:
    """The values of the first parameter of this type and number with this text in its description."""
    for number in range(count):
        slot = slots[number * PARAMETER : (number + 1) * PARAMETER]
        if len(slot) >= 2 + size and tuple(slot[:2]) == kind and text in slot[2 + size :].lower():
            return slot[2 : 2 + size]
    return None


def parameters(hand: int, limits: Limits, control: int = 0) -> bytes:
    """Returns an answer to PARAMETERS as newer firmware sends it, with the parameters that a driver reads."""
    entries = [
        (2, struct.pack(">B", hand), "1 - Device ID:"),
        (_FLAG, bytes((control,)), "6 - Control mode:"),
        (_FLAG, b"\x01", "10 - Pos. limit active:"),
        (_INT32, struct.pack(">ii", *limits), "11 - Pos. limits [inf, sup]:"),
        (3, struct.pack(">h", 1500), "13 - Current limit:"),
    ]
    sizes = {_FLAG: 1, 2: 1, 3: 2, _INT32: 4}
    body = bytes((Cmd.PARAMETERS, len(entries)))
    for kind, values, text in entries:
        body += (bytes((kind, len(values) // sizes[kind])) + values + text.encode("ascii")).ljust(PARAMETER, b"\0")
    blocks = -(-(len(body) + 1) // 32)
    body = body.ljust(32 * blocks - 1, b"\0")
    return HEADER + bytes((hand, blocks)) + body + bytes((checksum(body),))
