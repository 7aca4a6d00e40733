"""The BNO085's frames: the datasheet's example, damage, and which axes its angles turn about."""

from __future__ import annotations

from itertools import pairwise
from math import degrees

import numpy as np
import pytest
from helpers.fuzz import fuzz
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from srl.drivers.bno085.protocol import SIZE, Parser, Record, encode
from srl.drivers.bno085.reading import Reading

# BNO08X datasheet 1000-3927 v1.17, section 1.2.5.2
EXAMPLE = bytes.fromhex("aaaade010092ff25088dfeecffd1030000 00e7")
RECORD = Record(222, 1, -110, 2085, -371, -20, 977)

short = st.integers(-32768, 32767)
angles = st.tuples(st.integers(-18000, 18000), st.integers(-9000, 9000), st.integers(-18000, 18000))
records = st.builds(
    lambda index, ypr, xyz: Record(index, *ypr, *xyz), st.integers(0, 255), angles, st.tuples(short, short, short)
)


def parsed(data: bytes) -> list[Record]:
    return Parser().feed(data)


def read(record: Record, order: str = "ZXY") -> dict[str, np.ndarray]:
    states = {"orientation": np.full(4, np.nan), "acceleration": np.full(3, np.nan)}
    assert Reading(order).fill(record, states)
    return states


def test_the_datasheets_example():
    assert parsed(EXAMPLE) == [RECORD]
    assert encode(RECORD) == EXAMPLE
    # its own decoding: -3.638, -0.196 and 9.581 m/s^2
    np.testing.assert_allclose(read(RECORD)["acceleration"], [-3.638, -0.196, 9.581], atol=5e-4)


@pytest.mark.parametrize(
    ("frame", "record"),
    [
        ("aaaa0128236ceed20400000000e80300000067", Record(1, 9000, -4500, 1234, 0, 0, 1000)),
        ("aaaaffb0b92723b1b90080ff7fffff00000018", Record(255, -18000, 8999, -17999, -32768, 32767, -1)),
    ],
)
def test_vectors_of_the_protocol_sheet(frame, record):
    """Adafruit's library decodes them with these values."""
    assert parsed(bytes.fromhex(frame)) == [record]


def test_a_payload_full_of_the_header_is_refused_by_its_range_and_loses_nothing_behind_it():
    assert parsed(bytes.fromhex("aaaaaaaaaa00000000000000000000000000fe") + EXAMPLE) == [RECORD]


def test_the_axes_follow_from_the_examples_own_gravity():
    """At rest the specific force points up: to 1 mg with the right axes, far off with the other ones."""
    force = np.array([RECORD.x, RECORD.y, RECORD.z], float)
    up = {}
    for order in ("ZXY", "ZYX"):
        w, x, y, z = read(RECORD, order)["orientation"]
        up[order] = Rotation.from_quat([x, y, z, w]).apply(force / np.linalg.norm(force))
    assert np.linalg.norm(up["ZXY"][:2]) < 1.5e-3
    assert degrees(np.arccos(up["ZYX"][2])) > 25


@given(records, st.sampled_from(["ZXY", "ZYX"]))
def test_an_independent_reading_of_the_angles(record, order):
    wanted = Rotation.from_euler(order, [record.yaw / 100, record.pitch / 100, record.roll / 100], degrees=True)
    states = read(record, order)
    w, x, y, z = states["orientation"]
    assert (wanted.inv() * Rotation.from_quat([x, y, z, w])).magnitude() < 1e-9
    np.testing.assert_allclose(states["acceleration"], np.array(record[4:]) * 9.80665e-3)


@given(st.lists(records, max_size=5), st.lists(st.integers(0, 200), max_size=8))
def test_records_do_not_depend_on_how_the_bytes_are_cut(sent, cuts):
    data = b"".join(map(encode, sent))
    edges = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    parser = Parser()
    found = [record for a, b in pairwise(edges) for record in parser.feed(data[a:b])]
    assert found == sent
    assert (parser.frames, parser.errors, parser.resyncs) == (len(sent), 0, 0)


@given(records, st.integers(0, SIZE - 1), st.integers(1, 255))
def test_one_wrong_byte_never_passes(record, at, by):
    frame = bytearray(encode(record))
    frame[at] ^= by
    parser = Parser()
    assert record not in parser.feed(bytes(frame))
    assert parser.frames == 0


@given(st.lists(records, min_size=3, max_size=6), st.data())
def test_after_a_cut_frame_the_next_ones_are_found(sent, data):
    frames = [encode(record) for record in sent]
    cut = data.draw(st.integers(0, len(frames) - 3))
    size = data.draw(st.integers(0, SIZE - 1))
    frames[cut] = frames[cut][:size]
    parser = Parser()
    found = parser.feed(b"".join(frames))
    # What was cut may take the next frame along, where its rest looks like a header.
    assert found[:cut] == sent[:cut]
    assert found[-1] == sent[-1]


def test_text_and_noise_before_a_frame_are_skipped():
    parser = Parser()
    assert parser.feed(b"%SW Ver 3.2.7\n\r\xaa" + EXAMPLE + EXAMPLE) == [RECORD, RECORD]
    assert (parser.frames, parser.resyncs) == (2, 1)


def test_angles_beyond_their_range_are_no_frame():
    for wrong in (RECORD._replace(yaw=18001), RECORD._replace(pitch=-9001), RECORD._replace(roll=-18001)):
        parser = Parser()
        assert parser.feed(encode(wrong)) == []
        assert parser.errors == 1


def test_a_bno086_fills_the_reserved_bytes():
    frame = bytearray(EXAMPLE)
    frame[15:17] = 1, 2
    frame[-1] = sum(frame[2:-1]) % 256
    assert parsed(bytes(frame)) == [RECORD]


def test_fuzz_is_survived():
    fuzz(Parser().feed, b"".join(encode(RECORD._replace(number=k)) for k in range(20)))


def feed(reading: Reading, record: Record, count: int) -> list[bool]:
    states = {"orientation": np.zeros(4), "acceleration": np.zeros(3)}
    return [reading.fill(record, states) for _ in range(count)]


def test_angles_that_gravity_contradicts_are_refused_after_seconds():
    wrong = Reading("ZYX")
    used = feed(wrong, RECORD, 700)
    assert all(used[:400])
    assert not any(used[500:])
    assert "order: ZXY" in wrong.trouble()
    assert all(feed(Reading("ZXY"), RECORD, 700))


def test_a_walkers_shaking_is_no_contradiction():
    reading, states = Reading("ZXY"), {"orientation": np.zeros(4), "acceleration": np.zeros(3)}
    for k in range(2000):
        sway = 500 * np.array([np.sin(0.12 * k), np.cos(0.06 * k), np.sin(0.11 * k)])  # half a g, at 1 to 2 Hz
        x, y, z = np.rint(sway).astype(int).tolist()
        assert reading.fill(Record(0, 0, 0, 0, x, y, z + 1000), states)
    assert degrees(reading.disagrees) < 6


@pytest.mark.parametrize("order", ["ZXY", "ZYX"])
def test_no_force_at_all_is_a_broken_sensor(order):
    assert not any(feed(Reading(order), Record(0, 0, 0, 0, 0, 0, 0), 600)[500:])
