"""Packets, blocks and datagrams: the sheet's golden vectors both ways, and a flood of damaged bytes."""

import struct

import numpy as np
import pytest
from helpers.fuzz import fuzz, size_of
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from srl.drivers.capture import axes
from srl.drivers.capture.names import Marker, Segment, Subject
from srl.drivers.vicon import blocks, geometry, objects, protocol
from srl.drivers.vicon.blocks import MalformedError
from srl.drivers.vicon.objects import TrackedObject
from srl.drivers.vicon.protocol import Block, Parser
from srl.sim.devices.vicon import twin_blocks as encode

HELLO = bytes.fromhex(
    "01002b1a64000000a18601005c0000001600000001000000020000000500000006000000070000000800000009000000170000001a000000"
    "1c0000001d000000240000002500000027000000280000002a00000085030000616d0000a2860100a3860100a4860100a8860100"
)
SEGMENTS_AND_MARKERS = bytes.fromhex(
    "01002b1a48000000a1860100400000000f000000010000000200000005000000060000000800000009000000170000001a0000001c000000"
    "1d000000250000002700000028000000616d0000a4860100"
)
SUBJECT = bytes.fromhex(
    "020000008c000000010000000300000041726d020000000000000001000000000000000000000000000000000000000000000000000000"
    "04000000426173650100000002000000000080bf000080bf000080bf0000803f0000803f0000803f050000004c696e6b31020000000100"
    "0000020000004d3102000000020000004d320200000001000000010000000200000002000000"
)
TIMECODE = bytes.fromhex("17000000110000000c2238070300040001000000efbeadde01")
LATENCY = bytes.fromhex(
    "1a0000002b000000020000000600000043616d657261fca9f1d24d62603f090000004c6162656c6c696e67fa7e6abc7493583f"
)
MARKERS = bytes.fromhex(
    "06000000780000000100000001000000010000000000000000001c40000000000000f83f00000000000004c00000000000428f40"
    + "00" * 72
    + "0b000000"
)
_TURNED = "0000000000000000000000000000f0bf0000000000000000000000000000f03f" + "00" * 32 + "000000000000f03f"
GLOBAL = bytes.fromhex(
    "09000000d0000000010000000200000001000000000000000000244000000000000034400000000000003e40"
    + _TURNED
    + "02000000000000000000244000000000000034400000000000406040"
    + _TURNED
)
STREAM_INFO = bytes.fromhex("01000000080000007099140000000000")
FRAME_1 = bytes.fromhex("050000000400000000000000")
CONTENTS_1 = bytes.fromhex(
    "a486010030000000050000000100000001000000020000000100000005000000010000000600000001000000090000000100000000000000"
)
CONTENTS_2 = bytes.fromhex(
    "a48601002800000003000000050000000100000006000000010000000900000001000000020000000100000002000000"
)
WHOLE = protocol.packet(CONTENTS_1, STREAM_INFO, SUBJECT, FRAME_1, MARKERS, GLOBAL)
ARM = Subject(1, "Arm", (Segment(1, "Base", 0), Segment(2, "Link1", 1)), (Marker(1, "M1"), Marker(2, "M2")))
OFFERED = {1, 2, 5, 6, 7, 8, 9, 23, 26, 28, 29, 36, 37, 39, 40, 42, 901, 28001, 100002, 100003, 100004, 100008}

ONE_OBJECT = bytes.fromhex(
    "341200000100480061726d5f6261736500000000000000000000000000000000000000000000f83f00000000000004c00000000000428f40"
    "00000000000000000000000000000000182d4454fb21f93f"
)
TWO_OBJECTS = bytes.fromhex(
    "351200000200480061726d5f6261736500000000000000000000000000000000000000000000f83f00000000000004c00000000000428f40"
    "00000000000000000000000000000000182d4454fb21f93f004800746970" + "00" * 21 + "0000000000002440000000000000344000"
    "00000000003e409a9999999999b93f9a9999999999c93f333333333333d33f"
)
BASE_OBJECT = TrackedObject("arm_base", (1.5, -2.5, 1000.25, 0.0, 0.0, np.pi / 2))
TIP_OBJECT = TrackedObject("tip", (10.0, 20.0, 30.0, 0.1, 0.2, 0.3))


def body(golden: bytes) -> bytes:
    """A block without its head, whose length must be true."""
    assert struct.unpack_from("<I", golden, 4)[0] == len(golden) - 8
    return golden[8:]


def parsed(data: bytes):
    """The only packet in `data`, as (type, bytes)."""
    (packet,) = Parser().feed(data)
    return [(item.type, bytes(item.body)) for item in packet]


# -- golden vectors


def test_requests_are_those_captured_from_the_vendors_client():
    assert protocol.object_enums(OFFERED) == HELLO
    wanted = {1, 2, 5, 6, 8, 9, 23, 26, 28, 29, 37, 39, 40, 28001, 100004}
    assert protocol.object_enums(wanted) == SEGMENTS_AND_MARKERS
    assert protocol.request_frame(False) == bytes.fromhex("01002b1a09000000a28601000100000000")
    assert protocol.request_frame(True) == bytes.fromhex("01002b1a09000000a28601000100000001")
    assert protocol.request_next_frame() == bytes.fromhex("01002b1a0c000000a88601000400000001000000")
    assert protocol.ping(1) == bytes.fromhex("01002b1a100000002a000000080000000100000000000000")


def test_the_greeting_is_read():
    ((kind, content),) = parsed(HELLO)
    assert kind == Block.OBJECT_ENUMS
    assert blocks.enums(content) == OFFERED


def test_blocks_are_read():
    assert blocks.frame_period(body(STREAM_INFO)) == 1_350_000
    assert blocks.whole(body(FRAME_1)) == 0
    assert blocks.subject_info(body(SUBJECT)) == ARM
    assert blocks.latency(body(LATENCY)) == pytest.approx(0.0035)
    assert blocks.contents(body(CONTENTS_1)) == ({1: 1, 2: 1, 5: 1, 6: 1, 9: 1}, frozenset())
    assert blocks.contents(body(CONTENTS_2)) == ({5: 1, 6: 1, 9: 1}, {1, 2})
    assert blocks.segments_of(body(GLOBAL)) == 1
    turned = (0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    assert blocks.find_segments(body(GLOBAL), {2: 7}) == [(7, (10.0, 20.0, 130.0, *turned))]
    assert blocks.find_segments(body(GLOBAL), {1: 0, 2: 1})[0] == (0, (10.0, 20.0, 30.0, *turned))
    assert blocks.find_labeled(body(MARKERS), {(1, 1): 0, (1, 2): 1}) == [(0, (1.5, -2.5, 1000.25))]


def test_the_twin_writes_the_same_blocks():
    half_turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    t, R = np.array([[10.0, 20, 30], [10, 20, 130]]), np.stack([half_turn, half_turn])
    assert encode.stream_info(100.0) == STREAM_INFO
    assert encode.number(Block.FRAME_INFO, 0) == FRAME_1
    assert encode.subject_info(ARM, {2: (-1, -1, -1, 1, 1, 1)}, [(1, 1), (2, 2)]) == SUBJECT
    assert encode.timecode(12, 34, 56, 7, 3, 4, 1, 0xDEADBEEF, 1) == TIMECODE
    assert encode.latency({"Camera": 0.002, "Labelling": 0.0015}) == LATENCY
    assert encode.labeled([(1, 1)], np.array([[1.5, -2.5, 1000.25]]), [11]) == MARKERS
    assert encode.segments(Block.GLOBAL_SEGMENTS, 1, [1, 2], t, R) == GLOBAL
    assert encode.frame_rates({"System": 100.0}).hex() == (
        "2700000016000000010000000600000053797374656d0000000000005940"
    )
    assert encode.subject_health(1, 0.25, 0.9).hex() == "1d0000001400000001000000000000000000d03fcdccccccccccec3f"
    assert encode.object_quality(1, 0.8).hex() == "280000000c000000010000009a9999999999e93f"
    assert encode.number(Block.HARDWARE_FRAME_INFO, 5000).hex() == "240000000400000088130000"
    assert encode.contents({5: 1, 6: 1, 9: 1}, {1, 2}) == CONTENTS_2
    assert encode.contents({1: 1, 2: 1, 5: 1, 6: 1, 9: 1}, ()) == CONTENTS_1


def test_a_whole_frame_has_its_blocks_in_order():
    assert len(WHOLE) == 584
    assert [kind for kind, _ in parsed(WHOLE)] == [100004, 1, 2, 5, 6, 9]


def test_objects_of_the_datagrams():
    assert objects.decode(ONE_OBJECT.ljust(256, b"\0")) == (4660, (BASE_OBJECT,))
    assert objects.decode(TWO_OBJECTS.ljust(1024, b"\0")) == (4661, (BASE_OBJECT, TIP_OBJECT))
    assert objects.encode(4660, [BASE_OBJECT]) == ONE_OBJECT.ljust(256, b"\0")
    assert objects.encode(4661, [BASE_OBJECT, TIP_OBJECT]) == TWO_OBJECTS.ljust(256, b"\0")
    assert [len(objects.encode(0, [TIP_OBJECT] * n)) for n in (3, 4, 6, 7, 13)] == [256, 512, 512, 1024, 1024]
    with pytest.raises(ValueError, match="14 objects"):
        objects.encode(0, [TIP_OBJECT] * 14)


def test_other_items_are_skipped_by_their_size_and_a_name_may_fill_its_field():
    other = struct.pack("<BH", 9, 4) + b"abcd"
    name = "a" * 24
    datagram = objects.encode(7, [TrackedObject(name, TIP_OBJECT.pose)])
    mixed = struct.pack("<IB", 7, 2) + other + datagram[5:]
    assert objects.decode(mixed) == (7, (TrackedObject(name, TIP_OBJECT.pose),))


@pytest.mark.parametrize("cut", [0, 4, 6, 7, 30, 79])
def test_a_datagram_shorter_than_its_items_is_malformed(cut):
    with pytest.raises(MalformedError):
        objects.decode(ONE_OBJECT[:cut])


@given(st.binary(max_size=300))
def test_any_datagram_is_an_object_frame_or_malformed(data):
    try:
        objects.decode(data)
    except MalformedError:
        pass


# -- the stream


def test_blocks_that_have_grown_and_unknown_ones_are_read_by_their_lengths():
    grown = b"".join(row + b"extra___" for row in (GLOBAL[16:116], GLOBAL[116:216]))
    content = GLOBAL[8:16] + grown
    assert [row for row, _ in blocks.find_segments(content, {1: 0, 2: 1})] == [0, 1]
    unknown = protocol.block(777, b"whatever")
    assert [kind for kind, _ in parsed(protocol.packet(unknown, FRAME_1))] == [777, 5]
    assert blocks.frame_period(body(STREAM_INFO) + b"more") == 1_350_000


@pytest.mark.parametrize(
    ("read", "golden"),
    [
        (blocks.frame_period, STREAM_INFO),
        (blocks.whole, FRAME_1),
        (blocks.subject_info, SUBJECT),
        (blocks.latency, LATENCY),
        (blocks.contents, CONTENTS_2),
        (blocks.y_up, bytes(8) + b"\1"),
        (lambda content: blocks.find_segments(content, {1: 0}), GLOBAL),
        (lambda content: blocks.find_labeled(content, {(1, 1): 0}), MARKERS),
        (lambda content: blocks.unlabeled(content, 9), encode.unlabeled(np.ones((3, 3)), [1, 2, 3])),
        (blocks.enums, HELLO[8:]),
    ],
)
def test_every_body_that_was_cut_short_is_malformed(read, golden):
    content = golden[8:]
    read(content)
    for size in range(len(content)):
        with pytest.raises(MalformedError):
            read(content[:size])


@given(st.binary(max_size=200), st.sampled_from(range(7)))
def test_any_body_is_read_or_malformed(content, which):
    reads = (
        blocks.subject_info,
        blocks.latency,
        blocks.contents,
        lambda b: blocks.find_segments(b, {0: 0}),
        lambda b: blocks.find_labeled(b, {(0, 0): 0}),
        lambda b: blocks.unlabeled(b, 3),
        blocks.enums,
    )
    try:
        reads[which](content)
    except MalformedError:
        pass


def test_a_count_of_empty_elements_takes_no_time():
    assert blocks.find_segments(struct.pack("<II", 1, 0), {1: 0}) == []
    with pytest.raises(MalformedError):
        blocks.find_segments(struct.pack("<II", 1, 0xFFFFFFFF) + bytes(90), {1: 0})


@given(st.lists(st.integers(1, 700), max_size=30), st.integers(1, 4))
def test_packets_don_t_depend_on_how_the_bytes_are_cut(cuts, repeats):
    data = (HELLO + WHOLE + protocol.packet()) * repeats
    parser, found, at = Parser(), [], 0
    for cut in [*cuts, len(data)]:
        found += parser.feed(data[at : at + cut])
        at += cut
    assert [len(packet) for packet in found] == [1, 6, 0] * repeats
    assert (parser.frames, parser.errors, parser.resyncs) == (3 * repeats, 0, 0)


@given(st.binary(min_size=1, max_size=100))
def test_the_next_good_packet_is_found_after_garbage(noise):
    parser = Parser()
    found = parser.feed(noise) + parser.feed(WHOLE * 2)
    assert [item.type for item in found[-1]] == [100004, 1, 2, 5, 6, 9]


@pytest.mark.parametrize("at", [4, 5, 6, 12, 13, 68, 69])
def test_a_wrong_length_costs_no_more_than_its_packet(at):
    broken = bytearray(WHOLE)
    broken[at] ^= 0x40
    parser = Parser()
    found = parser.feed(WHOLE) + parser.feed(bytes(broken)) + parser.feed(WHOLE) + parser.feed(WHOLE)
    assert len(found) >= 3
    assert parser.errors == parser.resyncs == 1


def test_a_million_damaged_bytes_and_then_good_ones():
    parser = Parser()
    fuzz(parser.feed, HELLO + WHOLE, total=1_000_000)
    assert size_of(parser) < 2 * protocol.LARGEST + 10_000
    assert parser.errors >= parser.resyncs > 100
    parser.feed(WHOLE)  # may end in what the noise began
    assert len(parser.feed(WHOLE * 3)) == 3


@given(st.integers(0, protocol.LARGEST), st.integers(0, protocol.LARGEST))
def test_a_length_that_promises_too_much_ends_with_the_next_whole_packet(packet, block):
    head = WHOLE[:4] + struct.pack("<III", packet, 9, block)
    parser = Parser()
    parser.feed(head + WHOLE)
    assert [item.type for item in parser.feed(WHOLE)[-1]] == [100004, 1, 2, 5, 6, 9]


# -- rotations


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_quaternions_of_matrices(q):
    turned = Rotation.from_quat(q)
    found = geometry.from_matrix(turned.as_matrix().ravel().tolist())
    expected = turned.as_quat()[[3, 0, 1, 2]]
    assert abs(abs(np.dot(found, expected)) - 1.0) < 1e-12
    assert np.linalg.norm(found) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    "r", [[0.0] * 9, [float("nan")] * 9, [1.0, 0, 0, 0, 1, 0, 0, 0, -1], [2.0, 0, 0, 0, 1, 0, 0, 0, 0.5]]
)
def test_what_is_no_rotation_is_none(r):
    assert geometry.from_matrix(r) is None


@given(st.tuples(*[st.floats(-4, 4)] * 3))
def test_angles_are_of_rx_ry_rz(angles):
    expected = Rotation.from_euler("XYZ", angles).as_quat()[[3, 0, 1, 2]]
    assert abs(abs(np.dot(geometry.from_euler_xyz(*angles), expected)) - 1.0) < 1e-12
    assert geometry.from_euler_xyz(float("nan"), 0.0, 0.0) is None


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_a_y_up_server_s_axes_are_renamed_of_world_and_body(q):
    C = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    turned = Rotation.from_quat(q).as_matrix()
    found = axes.z_up_quaternion(geometry.from_matrix(turned.ravel().tolist()))
    np.testing.assert_allclose(Rotation.from_quat([*found[1:], found[0]]).as_matrix(), C @ turned @ C.T, atol=1e-12)
