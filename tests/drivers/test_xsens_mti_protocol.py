"""The MTi's messages: vectors of the protocol sheet, damage, number formats, local frames."""

from __future__ import annotations

from itertools import pairwise
from struct import pack
from typing import Any

import numpy as np
import pytest
from helpers.fuzz import fuzz
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from srl.drivers.xsens_mti import XsensMtiConfig, data
from srl.drivers.xsens_mti.protocol import Id, Message, Parser, configuration, configure, encode

# Of the protocol sheet; another parser (ethz-asl's mtdevice.py) decodes it with these values.
DATA = bytes.fromhex(
    "faff364410200200071060040001e2402010103f3504f300000000000000003f3504f340200c3f000000be800000411d0000"
    "80200c3e000000bf8000003f000000e0200400000007e7"
)
messages = st.builds(
    Message, st.integers(0, 255), st.one_of(st.binary(max_size=40), st.binary(min_size=250, max_size=300))
)


def test_what_the_host_sends_is_byte_for_byte_the_sheets() -> None:
    assert encode(Message(Id.GO_TO_CONFIG, b"")).hex() == "faff3000d1"
    assert encode(Message(Id.GO_TO_MEASUREMENT, b"")).hex() == "faff1000f1"
    assert encode(Message(Id.REQ_DEVICE, b"")).hex() == "faff000001"
    assert encode(Message(Id.CONFIGURATION, b"")).hex() == "faffc00041"
    wanted = XsensMtiConfig(port="/dev/null").items()
    assert configure(wanted).hex() == "faffc0181020ffff1060ffff201000644020006480200064e020ffff33"
    (sent,) = Parser().feed(configure(wanted))
    assert configuration(sent.data) == wanted
    assert configuration(b"\x10\x20\xff") is None


def test_the_sheets_measurement() -> None:
    (message,) = Parser().feed(DATA)
    sample = data.decode(message.data)
    assert sample is not None
    assert (sample.counter, sample.fine, sample.status) == (7, 123456, 7)
    assert sample.orientation == pytest.approx((0.5**0.5, 0.0, 0.0, 0.5**0.5))
    assert sample.acceleration == (0.5, -0.25, 9.8125)
    assert sample.turn == (0.125, -1.0, 0.5)
    items = {
        data.COUNTER: 7, data.FINE: 123456, data.QUATERNION: (0.70710678, 0.0, 0.0, 0.70710678),
        data.ACCELERATION: (0.5, -0.25, 9.8125), data.TURN: (0.125, -1.0, 0.5), data.STATUS: 7,
    }  # fmt: skip
    assert encode(Message(Id.DATA, data.encode(items))) == DATA


@given(st.lists(messages, max_size=4), st.lists(st.integers(0, 900), max_size=8))
def test_messages_do_not_depend_on_how_the_bytes_are_cut(sent: list[Message], cuts: list[int]) -> None:
    stream = b"".join(map(encode, sent))
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    parser = Parser()
    assert [m for a, b in pairwise(edges) for m in parser.feed(stream[a:b])] == sent
    assert (parser.frames, parser.errors, parser.resyncs) == (len(sent), 0, 0)


@given(st.integers(1, len(DATA) - 1), st.integers(1, 255))
def test_one_wrong_byte_never_passes(at: int, by: int) -> None:
    damaged = bytearray(DATA)
    damaged[at] ^= by
    assert Message(Id.DATA, DATA[4:-1]) not in Parser().feed(bytes(damaged))


@given(st.binary(max_size=60))
def test_behind_noise_messages_are_found_again(noise: bytes) -> None:
    parser = Parser()
    found = parser.feed(noise + DATA * 40)  # noise may look like the head of a long message, which is waited for
    assert found[-1] == Message(Id.DATA, DATA[4:-1])


def test_fuzz_is_survived() -> None:
    fuzz(Parser().feed, DATA * 5)
    for message in Parser().feed(DATA):
        for cut in range(len(message.data)):
            data.decode(message.data[:cut])


@pytest.mark.parametrize(
    ("form", "packed"),
    [
        (0, pack(">3f", 1.5, -2.25, 9.75)),
        (1, pack(">3i", *(round(v * 2**20) for v in (1.5, -2.25, 9.75)))),
        (2, b"".join(pack(">Ih", round((v % 1) * 2**32), int(v // 1)) for v in (1.5, -2.25, 9.75))),
        (3, pack(">3d", 1.5, -2.25, 9.75)),
    ],
)
def test_every_number_format_is_read(form: int, packed: bytes) -> None:
    sample = data.decode((data.ACCELERATION | form).to_bytes(2, "big") + bytes((len(packed),)) + packed)
    assert sample is not None
    assert sample.acceleration == (1.5, -2.25, 9.75)
    assert sample.orientation is None


@given(st.tuples(*[st.floats(-3, 3)] * 3))
def test_each_local_frame_becomes_one_with_z_up(turn: Any) -> None:
    """A sensor's axes in the room are the same, whichever local frame it was told to use."""
    in_enu = Rotation.from_rotvec(turn)
    axes = {0x0: np.eye(3), 0x4: [[0, 1, 0], [1, 0, 0], [0, 0, -1]], 0x8: [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]}
    for bits, rows in axes.items():  # rows: what the frame's x, y, z are in ENU
        local = Rotation.from_matrix(np.array(rows)) * in_enu
        w, x, y, z = np.roll(local.as_quat(), 1)
        value = pack(">4d", w, x, y, z)
        sample = data.decode((data.QUATERNION | bits | 3).to_bytes(2, "big") + bytes((32,)) + value)
        assert sample is not None
        assert sample.orientation is not None
        w, x, y, z = sample.orientation
        assert (in_enu.inv() * Rotation.from_quat([x, y, z, w])).magnitude() < 1e-9


def test_items_of_another_length_are_refused_and_unknown_ones_skipped() -> None:
    known = data.encode({data.COUNTER: 3})
    assert data.decode(b"\x0c\x10\x04abcd" + known) == data.Sample(counter=3)
    for wrong in (
        b"\x10\x20\x04abcd",
        b"\x20\x10\x0cabcdabcdabcd",
        b"\x40\x20\x0dabcdabcdabcda",
        b"\x40\x20\x0cabc",
        b"\x40",
    ):
        assert data.decode(wrong) is None


def test_a_rate_that_the_line_does_not_carry_is_refused() -> None:
    with pytest.raises(ValidationError, match="115200 bit/s carry 142 messages a second, not 200"):
        XsensMtiConfig(port="/dev/null", rate=200)
    XsensMtiConfig(port="/dev/null", rate=400, baudrate=921600)


def test_a_hold_that_does_not_reach_over_two_messages_is_refused() -> None:
    with pytest.raises(ValidationError, match=r"'hold' of 0\.05 s is less than 2 messages at 11 Hz") as caught:
        XsensMtiConfig(port="/dev/null", rate=11)
    assert "Set 'hold' to 0.182 or more" in str(caught.value)
    XsensMtiConfig(port="/dev/null", rate=11, hold=0.182)
