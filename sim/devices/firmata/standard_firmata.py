"""StandardFirmata 2.5 on an Arduino Uno: its effect on the pins and its answers. No I/O.

Source: protocol sheet firmata, §2 and §3; the tests compare it with the real firmware running in simavr.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Final

from srl.sim.devices.firmata.twin_input import Input, Received

PINS: Final = 20
MAX_SERVOS: Final = 12
NEUTRAL_US: Final = 1500  # pulse width of a servo after power-up until its first command
SHORTEST_US, LONGEST_US = 544, 2400  # the Servo library's own bounds
INTERVAL_MS: Final = 19

INPUT, OUTPUT, ANALOG, PWM, SERVO, I2C, SERIAL, PULL_UP = 0x00, 0x01, 0x02, 0x03, 0x04, 0x06, 0x0A, 0x0B
_MODES: Final = (INPUT, OUTPUT, ANALOG, PWM, SERVO, I2C, SERIAL, PULL_UP)
_SERIAL_PINS: Final = (0, 1)
_PWM_PINS: Final = (3, 5, 6, 9, 10, 11)
_FIRST_ANALOG: Final = 14
_I2C_PINS: Final = (18, 19)

VERSION: Final = b"\xf9\x02\x05"
FIRMWARE: Final = b"\xf0\x79\x02\x05" + b"".join(bytes((ord(c), 0)) for c in "StandardFirmata.ino") + b"\xf7"
BOOT: Final = VERSION + FIRMWARE


class Wires:
    """What is connected to the board's pins; nothing. Pins are Arduino numbers, pulse widths whole microseconds."""

    def servo_attached(self, pin: int, min_us: int, max_us: int, pulse_us: int) -> None:
        """Called when pulses begin, of width `pulse_us`; from now on the firmware keeps them within the bounds."""

    def servo_pulse(self, pin: int, pulse_us: int) -> None:
        """Called when the pulse width changes to `pulse_us`."""

    def servo_detached(self, pin: int) -> None:
        """Called when pulses end."""

    def duty(self, pin: int, value: int) -> None:
        """Called when a pin's PWM changes to `value` of 255; 0 also when the pin gets another mode."""

    def level(self, pin: int, pull_up: bool) -> bool:
        """The level that a digital input reads."""
        return pull_up

    def reading(self, pin: int) -> int:
        """What an analog input reads, 0 to 1023."""
        return 0


class _Slot:
    """One servo of the Servo library; it keeps its last width while it is detached.

    Its bounds are stored as one signed byte each, in units of 4 us, relative to 544 and to 2400. So bounds above
    1056 or below 1892 wrap around.
    """

    def __init__(self) -> None:
        self.pin: int | None = None
        self.width = NEUTRAL_US
        self.low, self.high = SHORTEST_US, LONGEST_US

    def bound(self, low: int, high: int) -> None:
        self.low = SHORTEST_US - 4 * _signed_byte(int((SHORTEST_US - low) / 4))
        self.high = LONGEST_US - 4 * _signed_byte(int((LONGEST_US - high) / 4))

    def pulse(self, value: int) -> int:
        """Sets the width from a value, which is in degrees if below 544 and in microseconds otherwise."""
        if value < SHORTEST_US:
            degrees = min(max(value, 0), 180)
            value = int(degrees * (self.high - self.low) / 180) + self.low
        # The order matters if the bounds have wrapped around and crossed.
        self.width = self.low if value < self.low else min(value, self.high)
        return self.width


class StandardFirmata:
    """One board from power-up on; `receive` and `loop` return its answers.

    Attributes:
        seen: numbers of commands received, by kind, for tests.
        input: the parser, with its counts.
    """

    def __init__(self, wires: Wires) -> None:
        self._wires = wires
        self.input = Input()
        self.seen: dict[str, int] = {}
        self._out = bytearray()
        self._slots = [_Slot() for _ in range(MAX_SERVOS)]
        self._slot_of: dict[int, int] = {}
        self._mode = [INPUT] * PINS
        self._state = [0] * PINS
        self._interval = INTERVAL_MS
        self._analog_due = 0
        self._reset()

    def receive(self, data: bytes) -> bytes:
        """Carries out the received bytes and returns the answers."""
        for command in self.input.feed(data):
            self._obey(command)
        return self._flush()

    def loop(self, milliseconds: int) -> bytes:
        """Runs the main loop once, at `milliseconds` of the board's time; returns changed inputs and analog reports."""
        for port, reported in enumerate(self._reported):
            if reported:
                self._report_port(port, always=False)
        if milliseconds - self._analog_due > self._interval:
            late = milliseconds - self._analog_due - 1
            self._analog_due += late - late % self._interval
            for channel in sorted(self._analog_reported):
                if self._mode[_FIRST_ANALOG + channel] == ANALOG:
                    self._send_analog(channel)
        return self._flush()

    # -- commands

    def _obey(self, command: Received) -> None:
        self._note(_NAMES[command.kind] if command.kind != 0xF0 else "sysex")
        data = command.data
        match command.kind:
            case 0xE0:
                self._analog_write(command.channel, data[0] | data[1] << 7)
            case 0x90:
                self._write_port(command.channel, data[0] | data[1] << 7)
            case 0xC0:
                self._report_analog(command.channel, data[0] != 0)
            case 0xD0:
                self._report_digital(command.channel, data[0] != 0)
            case 0xF4:
                self._set_mode(data[0], data[1])
            case 0xF5:
                self._write_pin(data[0], data[1])
            case 0xF9:
                self._out += VERSION
            case 0xFF:
                self._reset()
            case 0xF0 if data:
                self._obey_sysex(data[0], data[1:])

    def _obey_sysex(self, kind: int, data: bytes) -> None:
        answers: dict[int, Callable[[], bytes]] = {
            0x79: lambda: FIRMWARE,
            0x6B: _capabilities,
            0x69: _analog_mapping,
        }
        if kind in answers:
            self._out += answers[kind]()
        elif kind == 0x6D and data:
            self._tell_state(data[0])
        elif kind == 0x6F and len(data) > 1:
            value = sum(bits << 7 * i for i, bits in enumerate(data[1:4]))
            self._analog_write(data[0], _signed_word(value))
        elif kind == 0x70 and len(data) > 4:
            self._configure_servo(data[0], data[1] | data[2] << 7, data[3] | data[4] << 7)
        elif kind == 0x7A and len(data) > 1:
            self._interval = max(data[0] | data[1] << 7, 1)

    def _reset(self) -> None:
        self._reported = [False] * 3
        self._sent = [0] * 3  # port masks as last reported
        self._inputs = [0] * 3
        self._analog_reported: set[int] = set()
        for pin in list(self._slot_of):
            self._detach(pin)
        for pin in range(PINS):
            self._state[pin] = 0
            if self._mode[pin] == PWM:
                self._wires.duty(pin, 0)
            if pin not in _SERIAL_PINS:
                self._mode[pin] = ANALOG if pin >= _FIRST_ANALOG else OUTPUT
        self._used = 0  # slots taken so far; slots given back are reused, and this count never falls
        self._free: list[int] = []

    def _set_mode(self, pin: int, mode: int) -> None:
        if mode not in _MODES:
            self._text("Unknown pin mode")
        if pin in _SERIAL_PINS or pin >= PINS:
            return
        if mode != SERVO and pin in self._slot_of:
            self._detach(pin)
        if self._mode[pin] == PWM:
            self._wires.duty(pin, 0)
        if pin >= _FIRST_ANALOG:
            self._report_analog(pin - _FIRST_ANALOG, mode == ANALOG)
        port, bit = pin // 8, 1 << pin % 8
        self._inputs[port] &= ~bit
        if mode in (INPUT, PULL_UP):
            self._inputs[port] |= bit
        self._state[pin] = 0
        if mode in (INPUT, OUTPUT):
            self._mode[pin] = mode
        elif mode == PULL_UP:
            self._mode[pin], self._state[pin] = mode, 1
        elif mode == ANALOG:
            if pin >= _FIRST_ANALOG:
                self._mode[pin] = mode
        elif mode == PWM:
            if pin in _PWM_PINS:
                self._mode[pin] = mode
        elif mode == SERVO:
            self._mode[pin] = mode
            if pin not in self._slot_of:
                self._attach(pin, SHORTEST_US, LONGEST_US)
        elif mode == I2C and pin in _I2C_PINS:
            self._mode[pin] = mode

    # -- servos

    def _configure_servo(self, pin: int, low: int, high: int) -> None:
        if pin in _SERIAL_PINS or pin >= PINS:
            return
        if pin in self._slot_of:
            self._detach(pin)
        self._attach(pin, *((low, high) if low and high else (SHORTEST_US, LONGEST_US)))
        self._set_mode(pin, SERVO)

    def _attach(self, pin: int, low: int, high: int) -> None:
        if self._used >= MAX_SERVOS:
            self._text("Max servos attached")
            return
        if self._free:
            number = self._free.pop()
        else:
            number = self._used
            self._used += 1
        slot = self._slots[number]
        slot.bound(low, high)
        self._slot_of[pin] = number
        self._wires.servo_attached(pin, slot.low, slot.high, slot.width)

    def _detach(self, pin: int) -> None:
        self._free.append(self._slot_of.pop(pin))
        self._wires.servo_detached(pin)

    # -- outputs

    def _analog_write(self, pin: int, value: int) -> None:
        if pin >= PINS:
            return
        if self._mode[pin] == SERVO:
            if pin in self._slot_of:  # otherwise the firmware writes to an arbitrary place in its memory
                self._wires.servo_pulse(pin, self._slots[self._slot_of[pin]].pulse(value))
            self._state[pin] = value
        elif self._mode[pin] == PWM:
            self._state[pin] = value
            self._wires.duty(pin, value & 0xFF if value > 255 else max(value, 0))

    def _write_pin(self, pin: int, value: int) -> None:
        if pin < PINS and self._mode[pin] == OUTPUT and pin not in _SERIAL_PINS:
            self._state[pin] = value

    def _write_port(self, port: int, mask: int) -> None:
        for pin in range(8 * port, min(8 * port + 8, PINS)):
            if self._mode[pin] in (INPUT, OUTPUT) and pin not in _SERIAL_PINS:
                self._state[pin] = mask >> pin % 8 & 1  # writing 1 to an input is the old way to enable its pull-up

    # -- inputs

    def _report_digital(self, port: int, on: bool) -> None:
        if port < len(self._reported):
            self._reported[port] = on
            if on:
                self._report_port(port, always=True)

    def _report_port(self, port: int, always: bool) -> None:
        mask = 0
        for pin in range(8 * port, min(8 * port + 8, PINS)):
            if self._inputs[port] >> pin % 8 & 1:
                mask |= self._wires.level(pin, bool(self._state[pin])) << pin % 8
        if always or mask != self._sent[port]:
            self._sent[port] = mask
            self._out += bytes((0x90 | port, mask & 0x7F, mask >> 7))

    def _report_analog(self, channel: int, on: bool) -> None:
        if channel >= PINS - _FIRST_ANALOG:
            return
        if on:
            self._analog_reported.add(channel)
            self._send_analog(channel)
        else:
            self._analog_reported.discard(channel)

    def _send_analog(self, channel: int) -> None:
        reading = self._wires.reading(_FIRST_ANALOG + channel)
        self._out += bytes((0xE0 | channel, reading & 0x7F, reading >> 7))

    # -- answers

    def _tell_state(self, pin: int) -> None:
        self._out += bytes((0xF0, 0x6E, pin))
        if pin < PINS:
            state = self._state[pin] & 0xFFFF
            self._out += bytes((self._mode[pin], state & 0x7F))
            if state & 0xFF80:
                self._out.append(state >> 7 & 0x7F)
            if state & 0xC000:
                self._out.append(self._state[pin] >> 14 & 0x7F)  # with its sign, like the firmware
        self._out.append(0xF7)

    def _text(self, text: str) -> None:
        self._out += b"\xf0\x71" + b"".join(bytes((ord(c) & 0x7F, ord(c) >> 7)) for c in text) + b"\xf7"

    def _flush(self) -> bytes:
        out = bytes(self._out)
        self._out.clear()
        return out

    def _note(self, name: str) -> None:
        self.seen[name] = self.seen.get(name, 0) + 1


_NAMES: Final = {
    0xE0: "analog_write",
    0x90: "digital_write",
    0xC0: "report_analog",
    0xD0: "report_digital",
    0xF4: "pin_mode",
    0xF5: "pin_write",
    0xF9: "version",
    0xFF: "reset",
}


def _capabilities() -> bytes:
    out = bytearray(b"\xf0\x6c")
    for pin in range(PINS):
        if pin not in _SERIAL_PINS:
            out += bytes((INPUT, 1, PULL_UP, 1, OUTPUT, 1))
            if pin >= _FIRST_ANALOG:
                out += bytes((ANALOG, 10))
            if pin in _PWM_PINS:
                out += bytes((PWM, 8))
            out += bytes((SERVO, 14))
            if pin in _I2C_PINS:
                out += bytes((I2C, 1))
        out.append(0x7F)
    return bytes(out) + b"\xf7"


def _analog_mapping() -> bytes:
    channels = bytes(0x7F if pin < _FIRST_ANALOG else pin - _FIRST_ANALOG for pin in range(PINS))
    return b"\xf0\x6a" + channels + b"\xf7"


def _signed_byte(value: int) -> int:
    return int(struct.unpack("b", bytes((value & 0xFF,)))[0])


def _signed_word(value: int) -> int:
    return int(struct.unpack("<h", struct.pack("<H", value & 0xFFFF))[0])
