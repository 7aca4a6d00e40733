"""Firmata 2.x on the wire: messages to a board, and the decoder of its answers. No I/O.

Source: firmata/protocol, protocol.md, as StandardFirmata 2.5 implements it. A command byte has bit 7 set, data
bytes have 7 bits, longer numbers have the low bits first, and system-exclusive messages stand between F0 and F7.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

BAUDRATE = 57600
MIN_PULSE_US = 544  # a servo value below this is an angle in degrees, not a pulse
MAX_SERVOS = 12  # number of servos that the firmware attaches on an ATmega328P
MAX_SYSEX = 4096  # bytes of one message from a board; the longest, a Mega's capabilities, has about 1400


NO_PINS: range = range(0x60, 0x80)  # pins that no board has: asked for their state, it says the number alone


class Mode(IntEnum):
    """A pin's function. A board may know modes that are not listed here."""

    INPUT = 0x00
    OUTPUT = 0x01
    ANALOG = 0x02
    PWM = 0x03
    SERVO = 0x04
    PULL_UP = 0x0B


VERSION_QUERY = b"\xf9"
FIRMWARE_QUERY = b"\xf0\x79\xf7"
CAPABILITY_QUERY = b"\xf0\x6b\xf7"
ANALOG_MAPPING_QUERY = b"\xf0\x69\xf7"
END_SYSEX = b"\xf7"  # alone it is ignored; it ends a message that was cut short
RESET = b"\xff"  # back to the state after power-up: servos detached, reports off; not recognised within sysex


def set_pin_mode(pin: int, mode: Mode) -> bytes:
    """Sets a pin's mode; on a servo pin any mode but SERVO detaches the servo."""
    return bytes((0xF4, _within(pin, 0x7F), mode))


def digital_pin_write(pin: int, high: bool) -> bytes:
    """Sets one output (protocol 2.5)."""
    return bytes((0xF5, _within(pin, 0x7F), int(high)))


def servo_config(pin: int, min_us: int, max_us: int) -> bytes:
    """Attaches a servo and sets the pulse widths (µs) the board clips to; pulses start at once."""
    return bytes((0xF0, 0x70, _within(pin, 0x7F), *_pair(min_us), *_pair(max_us), 0xF7))


def analog_write(pin: int, value: int) -> bytes:
    """Sets a PWM duty (0-255) or a servo (µs from 544, degrees below) by the shortest message for the pin."""
    if 0 <= pin <= 0x0F:
        return bytes((0xE0 | pin, *_pair(value)))
    return extended_analog_write(pin, value)


def extended_analog_write(pin: int, value: int) -> bytes:
    """Like `analog_write`, for any pin and up to 21 bits."""
    data = _pair(value & 0x3FFF) + ((_within(value >> 14, 0x7F),) if value >> 14 else ())
    return bytes((0xF0, 0x6F, _within(pin, 0x7F), *data, 0xF7))


def digital_write(port: int, mask: int) -> bytes:
    """Sets the outputs of a port of eight pins; bit i is pin 8 * port + i."""
    return bytes((0x90 | _within(port, 0x0F), *_pair(_within(mask, 0xFF))))


def report_digital(port: int, on: bool) -> bytes:
    """Starts reports of a port's inputs, at once and then at every change; or stops them."""
    return bytes((0xD0 | _within(port, 0x0F), int(on)))


def report_analog(channel: int, on: bool) -> bytes:
    """Starts reports of an analog channel at every sampling interval; or stops them."""
    return bytes((0xC0 | _within(channel, 0x0F), int(on)))


def sampling_interval(milliseconds: int) -> bytes:
    """Sets the period of analog reports."""
    return bytes((0xF0, 0x7A, *_pair(milliseconds), 0xF7))


def pin_state_query(pin: int) -> bytes:
    """Requests a pin's mode and last output."""
    return bytes((0xF0, 0x6D, _within(pin, 0x7F), 0xF7))


@dataclass(frozen=True, slots=True)
class Version:
    """The protocol's version; also a board's first message after power-up."""

    major: int
    minor: int


@dataclass(frozen=True, slots=True)
class Firmware:
    """The firmware's version and name; sent without a query only after power-up or a reset."""

    major: int
    minor: int
    name: str


@dataclass(frozen=True, slots=True)
class Capabilities:
    """For each pin from 0, its modes and their resolution in bits; {} for a pin that can't be used."""

    pins: tuple[dict[int, int], ...]


@dataclass(frozen=True, slots=True)
class AnalogMapping:
    """For each pin from 0 its analog channel, or None."""

    channels: tuple[int | None, ...]


@dataclass(frozen=True, slots=True)
class DigitalPort:
    """The inputs of a port; bit i is pin 8 * port + i, 0 for pins that aren't inputs."""

    port: int
    mask: int


@dataclass(frozen=True, slots=True)
class AnalogValue:
    """A reading of an analog channel, 14 bits at most."""

    channel: int
    value: int


@dataclass(frozen=True, slots=True)
class PinState:
    """A pin's mode and its last output, or its pull-up flag for an input; mode -1 for a pin that the board hasn't."""

    pin: int
    mode: int
    state: int


@dataclass(frozen=True, slots=True)
class Text:
    """A text message of the firmware, mostly an error."""

    text: str


Message = Version | Firmware | Capabilities | AnalogMapping | DigitalPort | AnalogValue | PinState | Text


class Decoder:
    """Decodes a board's bytes one by one; the messages don't depend on how the bytes are split.

    Attributes:
        frames: whole messages, including those of unknown kinds.
        errors: messages discarded: cut short, too long, of invalid content.
        resyncs: runs of bytes skipped in search of the next command byte.
    """

    def __init__(self) -> None:
        self.frames = 0
        self.errors = 0
        self.resyncs = 0
        self._command = 0  # 0: no message begun
        self._data = bytearray()
        self._searching = False

    def feed(self, data: bytes) -> list[Message]:
        """Takes any bytes and returns the messages they complete, oldest first. Never raises."""
        messages: list[Message] = []
        for byte in data:
            message = self._byte(byte)
            if message is not None:
                messages.append(message)
        return messages

    def _byte(self, byte: int) -> Message | None:
        if byte == 0xF7 and self._command == 0xF0:
            return self._sysex()
        if byte & 0x80:
            self._begin(byte)
            return None
        if not self._command:
            self._search()
            return None
        if len(self._data) == MAX_SYSEX:
            self.errors += 1
            self._command = 0
            self._search()
            return None
        self._data.append(byte)
        if self._command == 0xF0 or len(self._data) < 2:
            return None
        return self._short()

    def _begin(self, command: int) -> None:
        if self._command:
            self.errors += 1  # cut short by the next one
        self._data.clear()
        if command in (0xF0, 0xF9) or command & 0xF0 in (0x90, 0xE0):
            self._command = command
            self._searching = False
        else:
            self._command = 0
            self._search()

    def _search(self) -> None:
        self.resyncs += not self._searching
        self._searching = True

    def _short(self) -> Message | None:
        """Decodes F9, 9p or Ep with its two data bytes."""
        command, (low, high) = self._command, self._data
        self._command = 0
        self._data.clear()
        if command == 0xF9:
            self.frames += 1
            return Version(low, high)
        value = low | high << 7
        if command & 0xF0 == 0xE0:
            self.frames += 1
            return AnalogValue(command & 0x0F, value)
        if value > 0xFF:
            self.errors += 1
            return None
        self.frames += 1
        return DigitalPort(command & 0x0F, value)

    def _sysex(self) -> Message | None:
        data = bytes(self._data)
        self._command = 0
        self._data.clear()
        try:
            message = _SYSEX[data[0]](data[1:]) if data and data[0] in _SYSEX else None
        except ValueError:
            self.errors += 1
            return None
        self.frames += 1
        return message


def _firmware(data: bytes) -> Firmware:
    if len(data) < 2:
        raise ValueError
    return Firmware(data[0], data[1], _text(data[2:]).text)


def _text(data: bytes) -> Text:
    if len(data) % 2:
        raise ValueError
    return Text("".join(chr(low | high << 7) for low, high in zip(data[::2], data[1::2], strict=True)))


def _capabilities(data: bytes) -> Capabilities:
    if data and data[-1] != 0x7F:
        raise ValueError
    pins = []
    for pin in data.split(b"\x7f")[:-1]:
        if len(pin) % 2:
            raise ValueError
        pins.append(dict(zip(pin[::2], pin[1::2], strict=True)))
    return Capabilities(tuple(pins))


def _analog_mapping(data: bytes) -> AnalogMapping:
    return AnalogMapping(tuple(None if channel == 0x7F else channel for channel in data))


def _pin_state(data: bytes) -> PinState:
    if len(data) == 1 and data[0] in NO_PINS:
        return PinState(data[0], -1, 0)
    if len(data) < 3:
        raise ValueError
    return PinState(data[0], data[1], sum(bits << 7 * i for i, bits in enumerate(data[2:])))


_SYSEX: dict[int, Callable[[bytes], Message]] = {
    0x79: _firmware,
    0x6C: _capabilities,
    0x6A: _analog_mapping,
    0x6E: _pin_state,
    0x71: _text,
}


def _within(value: int, most: int) -> int:
    if not 0 <= value <= most:
        raise ValueError(f"{value} is not within 0 to {most}")
    return value


def _pair(value: int) -> tuple[int, int]:
    """Returns 14 bits as two data bytes, low first."""
    _within(value, 0x3FFF)
    return value & 0x7F, value >> 7
