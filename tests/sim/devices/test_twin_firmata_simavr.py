"""The board's twin against StandardFirmata 2.5 in simavr: same bytes in, same answers and pulses out."""

import os
import random
import tty

import pytest
from simavr.board import Board

from srl.drivers.firmata.protocol import Decoder, DigitalPort, Message
from srl.sim.devices.firmata.standard_firmata import StandardFirmata, Wires

SCRIPTS = 60
USED = (2, 3, 6, 9, 10, 11, 14, 18, 0, 22)  # pins


class Remembered(Wires):
    """Nothing but pull-ups and remembered pulse widths."""

    def __init__(self) -> None:
        self.pulses: dict[int, int] = {}

    def servo_attached(self, pin: int, min_us: int, max_us: int, pulse_us: int) -> None:
        self.pulses[pin] = pulse_us

    def servo_pulse(self, pin: int, pulse_us: int) -> None:
        self.pulses[pin] = pulse_us

    def servo_detached(self, pin: int) -> None:
        self.pulses.pop(pin, None)


def script(rng: random.Random) -> bytes:
    """Commands with good, odd and cut-short parts; none whose answer depends on the time.

    No mode that a servo's pin lacks: the firmware then takes the servo away but thinks the pin is still one,
    and the next value for it goes to some place in its memory. No inputs without a pull-up: they float.
    """

    def command() -> bytes:
        bounds = *_pair(rng.randrange(500, 1100)), *_pair(rng.randrange(1850, 2450))
        pin, low, high = rng.choice(USED), rng.randrange(128), rng.randrange(24)
        return rng.choice(
            (
                bytes((0xE0 | pin & 15, low, high)),
                bytes((0xE0 | pin & 15, low, high)),
                bytes((0xF4, pin, rng.choice((1, 4, 4, 4, 11)))),
                bytes((0xF4, *rng.choice(((3, 3), (9, 3), (18, 6), (7, 10), (7, 33), (22, 33), (0, 33))))),
                bytes((0xF0, 0x70, pin, *bounds, 0xF7)),
                bytes((0xF0, 0x6F, pin, low, high, *rng.choice(((), (1,), (2,))), 0xF7)),
                bytes((0xF0, 0x6D, pin, 0xF7)),
                bytes((0xF5, pin, low & 1)),
                bytes((0x90 | rng.randrange(3), low, high & 1)),
                bytes((0xD0 | rng.randrange(4), low & 1)),
                b"\xf9",
                b"\xf0\x79\xf7",
                b"\xf0\x69\xf7",
                rng.choice((b"\xff", b"\xf9", b"\xf9", b"\xf9")),
                bytes((low,)),
                b"\xf7",
            )
        )

    parts = []
    for _ in range(12):
        part = command()
        # A cut-short sysex would swallow what follows; the driver's own remedy is an F7.
        if len(part) > 2 and part[0] != 0xF4 and rng.random() < 0.15:
            part = part[: rng.randrange(2, len(part))] + (b"\xf7" if part[0] == 0xF0 else b"")
        parts.append(part)
    return b"".join(parts)


def _pair(value: int) -> tuple[int, int]:
    return value & 0x7F, value >> 7


def measured(real: Board, pin: int, expected: int) -> float:
    """The pulse width (µs); an interrupt may lengthen a single one by some microseconds, so of several."""
    for _ in range(10):
        width = real.pin(pin).last_us
        if abs(width - expected) < 3.0:
            break
        real.wait(0.02)
    return width


def split(messages: list[Message], ports: dict[int, int]) -> list[Message]:
    """Takes the ports' masks out: changes are reported when the main loop comes round, which takes its time."""
    ports.update({m.port: m.mask for m in messages if isinstance(m, DigitalPort)})
    return [m for m in messages if not isinstance(m, DigitalPort)]


@pytest.mark.slow
def test_answers_and_pulses_are_the_real_firmware_s(tmp_path):
    rng = random.Random(20)
    wires = Remembered()
    twin = StandardFirmata(wires)
    pulses = 0
    reported, heard = Decoder(), Decoder()
    ours: dict[int, int] = {}
    theirs: dict[int, int] = {}
    with Board(tmp_path) as real:
        fd = os.open(real.port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(fd)
        real.wait(2.2)
        os.read(fd, 4096)
        for number in range(SCRIPTS):
            sent = script(rng)
            os.write(fd, sent)
            real.wait(0.1)
            expected = b""
            while True:
                try:
                    expected += os.read(fd, 4096)
                except BlockingIOError:
                    break
            answered = [m for byte in sent for m in reported.feed(twin.receive(bytes((byte,))) + twin.loop(0))]
            assert split(answered, ours) == split(heard.feed(expected), theirs), f"{number}: {sent.hex(' ')}"
            assert ours == theirs, f"{number}: {sent.hex(' ')}"
            for pin, width in wires.pulses.items():
                seen = measured(real, pin, width)
                assert seen == pytest.approx(width, abs=3.0), f"script {number}, pin {pin}"
                pulses += 1
        os.close(fd)
    assert pulses > SCRIPTS
    assert reported.frames > 3 * SCRIPTS
    assert (reported.errors, reported.resyncs) == (heard.errors, heard.resyncs)
