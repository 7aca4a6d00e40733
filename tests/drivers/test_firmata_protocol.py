"""Firmata on the wire: golden vectors (from pyfirmata2 and the real firmware), cuts and garbage."""

import pickle

import pytest
from helpers.firmata import BOOT, UNO
from helpers.fuzz import fuzz, size_of
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.firmata import protocol as p
from srl.drivers.firmata.protocol import Decoder, Mode


@pytest.mark.parametrize(
    ("built", "golden"),
    [
        (p.servo_config(9, 544, 2400) + p.analog_write(9, 0), "f0 70 09 20 04 60 12 f7 e9 00 00"),
        (p.servo_config(10, 544, 2400) + p.analog_write(10, 0), "f0 70 0a 20 04 60 12 f7 ea 00 00"),
        (p.servo_config(11, 544, 2400) + p.analog_write(11, 0), "f0 70 0b 20 04 60 12 f7 eb 00 00"),
        (p.servo_config(6, 544, 2400) + p.analog_write(6, 0), "f0 70 06 20 04 60 12 f7 e6 00 00"),
        (p.analog_write(9, 45), "e9 2d 00"),
        (p.analog_write(9, 90), "e9 5a 00"),
        (p.analog_write(9, 135), "e9 07 01"),
        (p.analog_write(9, 180), "e9 34 01"),
        (p.servo_config(9, 1000, 2000) + p.analog_write(9, 90), "f0 70 09 68 07 50 0f f7 e9 5a 00"),
        (p.extended_analog_write(9, 1500), "f0 6f 09 5c 0b f7"),
        (p.set_pin_mode(2, Mode.PULL_UP) + p.report_digital(0, True), "f4 02 0b d0 01"),
        (p.set_pin_mode(5, Mode.PULL_UP) + p.report_digital(0, True), "f4 05 0b d0 01"),
        (p.set_pin_mode(7, Mode.INPUT) + p.report_digital(0, True), "f4 07 00 d0 01"),
        (p.report_digital(0, False), "d0 00"),
        (p.sampling_interval(19), "f0 7a 13 00 f7"),
        (p.sampling_interval(10), "f0 7a 0a 00 f7"),
        (p.set_pin_mode(13, Mode.OUTPUT) + p.digital_write(1, 0x20), "f4 0d 01 91 20 00"),
        (p.digital_write(1, 0), "91 00 00"),
        (p.set_pin_mode(3, Mode.PWM) + p.analog_write(3, 128), "f4 03 03 e3 00 01"),
        (p.report_analog(0, True), "c0 01"),
        (p.CAPABILITY_QUERY, "f0 6b f7"),
        (p.ANALOG_MAPPING_QUERY, "f0 69 f7"),
        (p.FIRMWARE_QUERY, "f0 79 f7"),
        (p.pin_state_query(9), "f0 6d 09 f7"),
        (p.VERSION_QUERY, "f9"),
        (p.RESET, "ff"),
        (p.digital_pin_write(9, False), "f5 09 00"),
    ],
)
def test_messages_to_the_board_are_the_golden_ones(built, golden):
    assert built == bytes.fromhex(golden)


def test_a_pin_beyond_15_needs_the_extended_message():
    assert p.analog_write(15, 1500) == bytes.fromhex("ef 5c 0b")
    assert p.analog_write(16, 1500) == p.extended_analog_write(16, 1500) == bytes.fromhex("f0 6f 10 5c 0b f7")


@pytest.mark.parametrize(
    "call",
    [
        lambda: p.analog_write(9, 0x4000),
        lambda: p.analog_write(-1, 0),
        lambda: p.set_pin_mode(128, Mode.INPUT),
        lambda: p.report_digital(16, True),
        lambda: p.digital_write(0, 256),
        lambda: p.servo_config(9, -1, 2400),
    ],
)
def test_a_number_that_does_not_fit_is_refused(call):
    with pytest.raises(ValueError, match="not within"):
        call()


PIN_D = {0: 1, 11: 1, 1: 1, 4: 14}
ANSWERS = [
    (BOOT, [p.Version(2, 5), p.Firmware(2, 5, "StandardFirmata.ino")]),
    (bytes.fromhex("90 3c 00"), [p.DigitalPort(0, 0b0011_1100)]),
    (bytes.fromhex("90 38 00"), [p.DigitalPort(0, 0b0011_1000)]),
    (bytes.fromhex("91 00 01"), [p.DigitalPort(1, 0b1000_0000)]),
    (bytes.fromhex("e0 7f 07"), [p.AnalogValue(0, 1023)]),
    (
        b"\xf0\x6a" + b"\x7f" * 14 + bytes(range(6)) + b"\xf7",
        [p.AnalogMapping((None,) * 14 + tuple(range(6)))],
    ),
    (bytes.fromhex("f0 6e 09 04 5c 0b f7"), [p.PinState(9, 4, 1500)]),
    (bytes.fromhex("f0 71 4d 00 61 00 78 00 f7"), [p.Text("Max")]),
]


@pytest.mark.parametrize(("answer", "messages"), ANSWERS)
def test_answers_of_the_board_are_decoded(answer, messages):
    decoder = Decoder()
    assert decoder.feed(answer) == messages
    assert (decoder.frames, decoder.errors, decoder.resyncs) == (len(messages), 0, 0)


def test_capabilities_of_an_uno():
    (answer,) = Decoder().feed(b"\xf0\x6c" + UNO + b"\xf7")
    assert isinstance(answer, p.Capabilities)
    assert len(answer.pins) == 20
    assert answer.pins[0] == answer.pins[1] == {}
    assert answer.pins[2] == PIN_D
    assert answer.pins[9] == PIN_D | {3: 8}
    assert answer.pins[14] == PIN_D | {2: 10}


wire = st.lists(st.one_of(st.sampled_from([answer for answer, _ in ANSWERS]), st.binary(max_size=12)), max_size=12).map(
    b"".join
)


@given(wire, st.data())
def test_the_same_messages_however_the_bytes_are_cut(data, draw):
    whole = Decoder()
    expected = whole.feed(data)
    cuts = sorted(draw.draw(st.lists(st.integers(0, len(data)), max_size=8)))
    pieces = Decoder()
    found = [
        message
        for start, end in zip([0, *cuts], [*cuts, len(data)], strict=True)
        for message in pieces.feed(data[start:end])
    ]
    assert found == expected
    assert (pieces.frames, pieces.errors, pieces.resyncs) == (whole.frames, whole.errors, whole.resyncs)


@given(st.binary(max_size=200), st.sampled_from(ANSWERS))
def test_after_any_garbage_the_next_message_is_understood(garbage, answer):
    decoder = Decoder()
    assert decoder.feed(garbage + answer[0])[-len(answer[1]) :] == answer[1]


@pytest.mark.parametrize(
    ("data", "errors", "resyncs"),
    [
        ("f9 02 f9 02 05", 1, 0),  # cut short by the next
        ("f0 79 02 f9 02 05", 1, 0),  # within sysex
        ("12 34 56 f9 02 05", 0, 1),  # one run of stray data
        ("c5 12 f3 f9 02 05", 0, 1),  # what a board never sends
        ("90 00 02 f9 02 05", 1, 0),  # a port has eight pins
        ("f0 71 4d f7 f9 02 05", 1, 0),  # half a character
        ("f0 6c 00 f7 f9 02 05", 1, 0),  # half a pin
        ("f0 6e 09 f7 f9 02 05", 1, 0),  # a pin without state
    ],
)
def test_errors_and_resyncs_are_counted(data, errors, resyncs):
    decoder = Decoder()
    assert decoder.feed(bytes.fromhex(data)) == [p.Version(2, 5)]
    assert (decoder.frames, decoder.errors, decoder.resyncs) == (1, errors, resyncs)


def test_an_endless_message_takes_no_memory():
    decoder = Decoder()
    decoder.feed(b"\xf0" + b"\x01" * 1_000_000)
    assert decoder.errors == 1
    assert len(pickle.dumps(decoder)) < 2 * p.MAX_SYSEX
    assert decoder.feed(BOOT) == ANSWERS[0][1]


def test_a_million_damaged_bytes() -> None:
    decoder = Decoder()
    good = BOOT + bytes.fromhex("f0 6c") + UNO + bytes.fromhex("f7 91 05 00 e0 10 02 f0 71 68 00 69 00 f7")
    fuzz(decoder.feed, good)
    assert size_of(decoder) < 50_000
    decoder.feed(b"\xf7")
    assert decoder.feed(bytes.fromhex("91 05 00"))[-1:] == [p.DigitalPort(1, 5)]
