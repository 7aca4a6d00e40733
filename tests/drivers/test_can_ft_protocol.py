"""The RFT's frames: the sheet's golden vectors, pairing, and a flood of garbage."""

import pytest
from helpers.fuzz import fuzz, size_of
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.can_ft.protocol import CUTOFFS, RATES, Command, Parser, Record, Response, command, record, response

int16 = st.integers(-32768, 32767)
GOLDEN = Record((617, -250, 4935, 1000, -500, 200))
HALVES = bytes.fromhex("0B0269FF06134703"), bytes.fromhex("E8FE0C00C8000000")
EXTREME = Record((-32768, 32767, -1, 1, 0, -2000), 0x20, True)
EXTREME_HALVES = bytes.fromhex("0A80007FFFFFFF00"), bytes.fromhex("010000F830200000")


def pair(halves, parser=None):
    parser = parser or Parser()
    return parser.feed(1, halves[0]) + parser.feed(2, halves[1])


@pytest.mark.parametrize(
    ("frame", "golden"),
    [
        (command(Command.START), "0B00000000000000"),
        (command(Command.STOP), "0C00000000000000"),
        (command(Command.READ_ONCE), "0A00000000000000"),
        (command(Command.BIAS, 1), "1101000000000000"),
        (command(Command.SET_RATE, RATES.index(1000)), "0F08000000000000"),
    ],
)
def test_commands_are_the_sheet_s(frame, golden):
    assert frame.hex().upper() == golden


def test_records_are_the_sheet_s():
    assert pair(HALVES) == [GOLDEN]
    assert record(GOLDEN) == HALVES
    assert pair(EXTREME_HALVES) == [EXTREME]
    assert record(EXTREME) == EXTREME_HALVES
    assert EXTREME.overloaded == ("Fx",)
    assert Record((0,) * 6, 0b000101).overloaded == ("Tx", "Tz")


def test_the_answer_to_the_rate_is_the_sheet_s():
    halves = bytes.fromhex("0F01000000000000"), bytes(8)
    assert response(Command.SET_RATE, b"\1\0") == halves
    (found,) = pair(halves)
    assert (found.command, found.values[:2]) == (Command.SET_RATE, b"\1\0")


def test_tables_are_the_manual_s():
    assert [CUTOFFS[i] for i in (0, 1, 5, 14)] == [0, 500, 100, 1]
    assert [RATES[i] for i in (0, 1, 6, 8)] == [200, 10, 333, 1000]


@given(st.tuples(*[int16] * 6), st.integers(0, 63), st.booleans())
def test_any_record_comes_back(counts, overload, polled):
    assert pair(record(Record(counts, overload, polled))) == [Record(counts, overload, polled)]


@given(st.sampled_from([c for c in Command if c not in (Command.READ_ONCE, Command.START)]), st.binary(max_size=15))
def test_any_response_comes_back(code, values):
    assert pair(response(code, values)) == [Response(code, values.ljust(15, b"\0"))]


def test_text_ends_at_its_zero():
    (found,) = pair(response(Command.MODEL, b"RFT64-SB01\0junk"))
    assert found.text == "RFT64-SB01"


def test_halves_without_their_other_half_are_dropped():
    parser = Parser()
    assert parser.feed(2, HALVES[1]) == []  # no first
    assert parser.feed(1, EXTREME_HALVES[0]) == []
    assert pair(HALVES, parser) == [GOLDEN]  # a first replaces a first
    assert (parser.frames, parser.errors, parser.resyncs) == (1, 2, 1)


def test_short_frames_and_other_ids():
    parser = Parser(5, 6)
    assert parser.feed(1, HALVES[0]) == parser.feed(0x7FF, b"") == []
    assert parser.errors == 0
    parser.feed(5, HALVES[0])
    assert parser.feed(6, HALVES[1][:7]) == []
    assert parser.feed(6, HALVES[1]) == []
    assert (parser.frames, parser.errors) == (0, 2)


def test_a_million_damaged_bytes():
    """The damaged bytes, cut into frames: an id, a length, data."""
    parser = Parser()

    def feed(data: bytes) -> None:
        while len(data) > 2:
            size = min(data[1] % 10, 8)
            parser.feed(data[0] % 4, data[2 : 2 + size])
            data = data[2 + size :]

    fuzz(feed, (b"\1\x08" + HALVES[0] + b"\2\x08" + HALVES[1]) * 5)
    assert parser.frames > 1000
    assert parser.errors > 1000
    assert size_of(parser) < 2000
    parser.feed(2, HALVES[1])
    assert pair(HALVES, parser) == [GOLDEN]
