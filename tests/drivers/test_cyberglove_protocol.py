"""Framing: the sheet's golden vectors, every way of cutting them, and what damage costs."""

from __future__ import annotations

import pytest
from helpers.fuzz import fuzz, size_of
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.drivers.cyberglove.protocol import LABELS, SAMPLE, START, Parser, Record, Reply, assign, query

RAW = bytes(range(10, 230, 10))  # 22 sensors, as in §8
WHOLE = b"S" + RAW + b"\0"


def record_bytes(sensors: bytes, status: int | None = 7) -> bytes:
    return b"S" + sensors + (b"" if status is None else bytes([status])) + b"\0"


def parse(data: bytes, sensors: int = 22, **layout: bool) -> list[Record | Reply]:
    return Parser(sensors, **layout).feed(data)


# -- golden vectors (sheet §8)


@pytest.mark.parametrize(
    ("command", "host"),
    [
        (query("K"), "3f 4b"),
        (query("S"), "3f 53"),
        (assign("M", 0xFF, 0xFF, 0x3F), "4d ff ff 3f"),
        (assign("N", 22), "4e 16"),
        (assign("U", 1), "55 01"),
        (assign("D", 1), "44 01"),
        (assign("T", 0x04, 0x80, 0x00, 0x01), "54 04 80 00 01"),
        (SAMPLE, "47"),
        (START, "53"),
    ],
)
def test_commands_are_the_sheets(command, host):
    assert command == bytes.fromhex(host)


REPLIES = [
    ("3f 4b ff ff 3f 00", Reply(b"?K", b"\xff\xff\x3f")),
    ("4d 00", Reply(b"M")),
    ("3f 53 16 00", Reply(b"?S", b"\x16")),
    ("4e 00", Reply(b"N")),
    ("3f 55 00 00", Reply(b"?U", b"\x00")),
    ("3f 44 00 00", Reply(b"?D", b"\x00")),
    ("55 00", Reply(b"U")),
    ("44 00", Reply(b"D")),
    ("3f 56 02 01 01 03 00", Reply(b"?V", b"\x02\x01\x01\x03")),
    ("3f 56 02 00", Reply(b"?V", b"\x02")),
    ("54 00", Reply(b"T")),
    ("3f 54 04 80 00 01 00", Reply(b"?T", b"\x04\x80\x00\x01")),
    ("3f 47 03 00", Reply(b"?G", b"\x03")),
    ("3f 52 01 00", Reply(b"?R", b"\x01")),
    ("5e 49 0d 0a 00", Reply(b"^I")),
    ("65 3f 00", Reply(b"e?")),
]


@pytest.mark.parametrize(("wire", "reply"), REPLIES)
def test_replies(wire, reply):
    assert parse(bytes.fromhex(wire)) == [reply]


def test_a_sample():
    wire = bytes.fromhex("47 0a141e28323c46505a646e78828c96a0aab4bec8d2dc 00")
    assert parse(wire) == [Record(RAW, streamed=False)]


def test_a_sample_with_status():
    (record,) = parse(b"G" + RAW + b"\x07\0", status=True)
    assert record.status == 7
    assert record.switch
    assert record.light
    assert not record.unplugged


def test_a_sample_with_time_stamp_and_status():
    wire = b"G" + RAW + bytes.fromhex("01 00 12 34 56 07 00")
    (record,) = parse(wire, time_stamp=True, status=True)
    assert record == Record(RAW, 7, b"\x00\x12\x34\x56", streamed=False)


def test_a_stamp_byte_sent_in_place_of_zero_is_read_as_zero():
    (record,) = parse(b"G" + RAW + bytes.fromhex("05 01 12 01 56 00"), time_stamp=True)
    assert record.time_stamp == b"\x00\x12\x00\x56"


def test_the_stream_of_an_18_sensor_glove():
    assert parse((b"S" + RAW[:18] + b"\0") * 3, sensors=18) == [Record(RAW[:18])] * 3
    assert len(LABELS[18]) == 18
    assert not [label for label in LABELS[18] if label.endswith("dij")]


@pytest.mark.parametrize(
    ("inserted", "slow", "unplugged"),
    [(b"es", True, False), (b"eg", False, True), (b"eseg", True, True), (b"", False, False)],
)
def test_remarks_before_the_final_zero(inserted, slow, unplugged):
    first, second = parse((b"S" + RAW + b"\x01" + inserted + b"\0") * 2, status=True)
    assert first == second
    assert (first.slow, first.unplugged) == (slow, unplugged)


def test_status_without_the_plugged_bit_is_unplugged_also_when_it_is_zero():
    assert [record.unplugged for record in parse(record_bytes(RAW, 0) * 2, status=True)] == [True, True]
    assert not parse(record_bytes(RAW, 1), status=True)[0].unplugged


# -- any bytes, cut anyhow

sensor_bytes = st.binary(min_size=22, max_size=22).map(lambda raw: bytes(byte or 255 for byte in raw))
tricky = st.sampled_from([b"S", b"G", b"?", b"e", b"\x01"]).map(lambda byte: byte * 22)
records = st.tuples(sensor_bytes | tricky, st.integers(0, 7)).map(lambda drawn: record_bytes(*drawn))
replies = st.sampled_from([bytes.fromhex(wire) for wire, _ in REPLIES])
garbage = st.binary(max_size=60)
streams = st.lists(records | replies | garbage, max_size=12).map(b"".join)


@pytest.mark.slow
@given(streams, st.data())
@settings(max_examples=300)
def test_the_result_does_not_depend_on_the_cuts(stream, data):
    whole = Parser(22, status=True)
    expected = whole.feed(stream)
    cut = Parser(22, status=True)
    found = []
    at = 0
    while at < len(stream):
        size = data.draw(st.integers(1, 40))
        found += cut.feed(stream[at : at + size])
        at += size
    assert found == expected
    assert (cut.frames, cut.errors, cut.resyncs) == (whole.frames, whole.errors, whole.resyncs)


@given(st.lists(sensor_bytes | tricky, min_size=1, max_size=20), st.booleans(), st.booleans())
def test_every_record_of_a_clean_stream_is_found(sensors, time_stamp, status):
    extra = b"\x10\x01\x02\x03\x04" * time_stamp + b"\x01" * status
    parser = Parser(22, time_stamp=time_stamp, status=status)
    found = parser.feed(b"".join(b"S" + raw + extra + b"\0" for raw in sensors))
    assert [record.sensors for record in found] == sensors
    assert (parser.errors, parser.resyncs) == (0, 0)


@pytest.mark.slow
@given(st.lists(sensor_bytes | tricky, min_size=12, max_size=12), st.integers(0, 249), st.integers(0, 60))
@settings(max_examples=300)
def test_lost_bytes_never_make_a_record_that_was_not_sent(sensors, start, count):
    """Except a loss of just one record's length (25 bytes), or two, which no rule can find: the sheet has
    no checksum."""
    stream = b"".join(record_bytes(raw, 1) for raw in sensors)
    found = Parser(22, status=True).feed(stream[:start] + stream[start + count :])
    if count % 25:
        assert all(record.sensors in sensors for record in found)
    assert len(found) >= 12 - count // 25 - 4


@given(st.lists(sensor_bytes | tricky, min_size=10, max_size=10), st.integers(0, 249), st.integers(0, 255))
def test_one_changed_byte_costs_three_records_at_most(sensors, at, value):
    """Three where it was the final 0: its own record, the one behind, and the one that proves the place."""
    stream = bytearray(b"".join(record_bytes(raw, 1) for raw in sensors))
    stream[at] = value
    found = parse(bytes(stream), status=True)
    assert len(found) >= 7
    altered = [record for record in found if record.sensors not in sensors]
    assert len(altered) <= (1 <= at % 25 <= 22)  # a sensor byte may change unseen: there is no checksum


@given(garbage.filter(lambda noise: WHOLE not in noise), st.lists(sensor_bytes, min_size=6, max_size=6))
def test_after_any_garbage_the_stream_is_found_again(noise, sensors):
    found = parse(noise + b"\0" + b"".join(record_bytes(raw, 1) for raw in sensors), status=True)
    good = [message.sensors for message in found if isinstance(message, Record)]
    assert good[-3:] == sensors[-3:]


@given(st.binary(max_size=3000), st.integers(1, 500))
def test_memory_is_bounded(noise, size):
    parser = Parser(22, time_stamp=True, status=True)
    for at in range(0, len(noise), size):
        parser.feed(noise[at : at + size])
        assert len(parser._buffer) <= 3 * (1 + 22 + 5 + 1 + 4 + 1)


# -- what damage costs, exactly


def test_a_zero_among_the_sensors_drops_that_record_only():
    parser = Parser(22)
    damaged = bytearray(WHOLE)
    damaged[7] = 0
    assert parser.feed(WHOLE + bytes(damaged) + WHOLE) == [Record(RAW)] * 2
    assert (parser.frames, parser.errors, parser.resyncs) == (2, 1, 0)


def test_a_lost_byte_drops_its_record_and_the_one_that_proves_the_place():
    parser = Parser(22)
    assert parser.feed(WHOLE[:9] + WHOLE[10:] + WHOLE * 3) == [Record(RAW)] * 2
    assert (parser.frames, parser.errors, parser.resyncs) == (2, 1, 1)


def test_one_good_looking_record_in_noise_is_not_believed():
    parser = Parser(22)
    assert parser.feed(b"\xf9\x02\x05\0" + WHOLE + b"\xf0\x79\0" * 30) == []
    assert (parser.frames, parser.resyncs) == (0, 1)


def test_a_million_damaged_bytes() -> None:
    parser = Parser(22, status=True)
    fuzz(parser.feed, (record_bytes(RAW) + b"?S\x16\0" + record_bytes(RAW[::-1])) * 5)
    assert size_of(parser) < 50_000
    found = parser.feed(record_bytes(RAW) * 20)
    assert isinstance(found[-1], Record)
    assert found[-1].sensors == RAW
    assert parser.frames > 10_000
