"""NatNet's bytes: golden vectors, round trips through what the twin makes, and damage."""

from __future__ import annotations

import struct
from math import sqrt

import pytest
from helpers.fuzz import mutations
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.drivers.natnet import frame, model, protocol
from srl.drivers.natnet.frame import Body, Marker, MotiveFrame
from srl.drivers.natnet.model import BodyModel, Model
from srl.drivers.natnet.protocol import MalformedError, Message, ServerInfo, Version
from srl.sim.devices.natnet import twin_frame as encode

OLD, NEW = Version(3, 1), Version(4, 1)
VERSIONS = [Version(3, 0), OLD, Version(4, 0), NEW, Version(4, 2), Version(4, 3)]
# Datagrams that the maker's own library has read: one rigid body, 12.5 s.
SMALL_OLD = bytes.fromhex(
    "070074003412000000000000000000000100000001000000cdcccc3dcdcc4c3e9a99993e0000000000000000000000000000803f17b7d139"
    "0100000000000000000000000000000000000000000000000000000000000000294040420f0000000000c8550f000000000050690f000000"
    "0000000000000000"
)
SMALL_NEW = bytes.fromhex(
    "0700a0003412000000000000000000000000000000000000010000002600000001000000cdcccc3dcdcc4c3e9a99993e0000000000000000"
    "000000000000803f17b7d1390100000000000000000000000000000000000000000000000000000000000000000000000000000000000000"
    "000000000000000000000000294040420f0000000000c8550f000000000050690f00000000000000000000000000000000000000"
)


def f32(value: float) -> float:
    (found,) = struct.unpack("<f", struct.pack("<f", value))
    return float(found)


BODY = Body(1, (f32(0.1), f32(0.2), f32(0.3)), (1.0, 0.0, 0.0, 0.0), f32(0.0004), True)
SMALL = MotiveFrame(4660, 12.5, 1000000, 1005000, 1010000, bodies=[BODY])


# -- golden vectors


@pytest.mark.parametrize(("data", "versions"), [(SMALL_OLD, VERSIONS[:3]), (SMALL_NEW, VERSIONS[3:])])
def test_the_small_frame_is_read_and_made(data, versions):
    message, payload = protocol.split(data)
    assert message == Message.FRAME
    for version in versions:
        assert frame.decode(payload, version) == SMALL
        assert encode.frame(SMALL, {}, version) == data


@pytest.mark.parametrize(("data", "version"), [(SMALL_OLD, NEW), (SMALL_NEW, OLD), (SMALL_NEW, Version(4, 0))])
def test_a_frame_of_another_version_is_refused(data, version):
    with pytest.raises(MalformedError):
        frame.decode(protocol.split(data)[1], version)


def test_requests_are_those_of_the_maker_s_library():
    assert protocol.REQUEST_MODEL.hex() == "04000400ffffffff"
    assert protocol.request("FrameRate").hex() == "02000a004672616d655261746500"
    assert protocol.value(protocol.split(bytes.fromhex("030004000000c842"))[1]) == 100.0
    connect, alive = protocol.connect("NatNetLib"), protocol.keep_alive("NatNetLib")
    assert (len(connect), len(alive)) == (273, 268)
    assert connect[:13] == bytes.fromhex("00000d01") + b"NatNetLib"
    assert connect[-9:].hex() == "040100000000000000"  # all data, in the server's own version
    assert alive[:13] == bytes.fromhex("0a000801") + b"NatNetLib"


def test_the_server_info():
    tail = bytes.fromhex("03010000040100008096980000000000e70500efff2a63")
    garbage = b"Motive\0\xfe\x07garbage".ljust(256, b"\xcc")
    info = protocol.server_info(garbage + tail)
    assert info == ServerInfo("Motive", (3, 1, 0, 0), NEW, 10_000_000, 1511, False, "239.255.42.99")
    assert protocol.server_info(protocol.split(protocol.encode_server_info(info))[1]) == info


@pytest.mark.parametrize(
    ("at", "byte", "output"),
    [(260, 2, "NatNet 2.1"), (260, 5, "NatNet 5.1"), (266, 0, "a clock of 0"), (272, 0, "port 0")],
)
def test_a_server_that_isn_t_known_is_refused_with_what_it_is(at, byte, output):
    data = bytearray(256) + bytes.fromhex("03010000 04010000 0000980000000000 e700 00 efff2a63")
    data[at] = byte
    with pytest.raises(MalformedError, match=output):
        protocol.server_info(bytes(data))
    with pytest.raises(MalformedError, match="264 bytes"):
        protocol.server_info(bytes(264))  # before 3.0


# -- round trips

numbers = st.floats(-50, 50, width=32)
points = st.tuples(numbers, numbers, numbers)
turns = st.sampled_from([(1.0, 0.0, 0.0, 0.0), (f32(sqrt(0.5)), 0.0, f32(-sqrt(0.5)), 0.0)])
bodies = st.builds(Body, st.integers(0, 2**31 - 1), points, turns, numbers, st.booleans())
markers = st.builds(
    Marker, st.integers(0, 2**15 - 1), st.integers(0, 2**16 - 1), points, numbers, st.integers(0, 255), numbers
)
names = st.text(st.characters(exclude_characters="\0", exclude_categories=("Cs",)), max_size=8)
ticks = st.integers(0, 2**64 - 1)
frames = st.builds(
    MotiveFrame, st.integers(-(2**31), 2**31 - 1), st.floats(0, 1e6), ticks, ticks, ticks, st.integers(0, 15),
    st.lists(bodies, max_size=3), st.dictionaries(st.integers(0, 99), st.lists(bodies, max_size=3), max_size=2),
    st.lists(markers, max_size=3), st.lists(points, max_size=2),
)  # fmt: skip
models = st.builds(
    BodyModel, names, st.integers(0, 999), st.integers(1, 99), points, st.lists(names, max_size=3).map(tuple)
)
some = st.lists(models, max_size=2).map(tuple)


@settings(max_examples=40)
@given(frames, st.dictionaries(names, st.lists(points, max_size=3), max_size=2), st.sampled_from(VERSIONS))
def test_frames_come_back_in_every_version(seen, sets, version):
    data = encode.frame(seen, sets, version, ptp=(1700000000, 5))
    assert frame.decode(protocol.split(data)[1], version) == seen
    assert frame.number(protocol.split(data)[1]) == seen.number


@settings(max_examples=40)
@given(
    st.dictionaries(names, st.lists(names, max_size=3).map(tuple), max_size=2), some,
    st.lists(st.tuples(names, st.integers(0, 99), some), max_size=2).map(tuple), st.sampled_from(VERSIONS[2:]),
)  # fmt: skip
def test_definitions_come_back(sets, rigid, skeletons, version):
    made = Model(sets, rigid, skeletons)
    assert model.decode(protocol.split(encode.model(made, {}, version))[1], version) == made


def test_what_isn_t_needed_is_read_over_where_its_size_isn_t_said():
    def text(name):
        return name.encode() + b"\0"

    plate = (
        struct.pack("<ii", 3, 1) + text("FP") + bytes(4 * (2 + 3 + 144 + 12 + 2)) + struct.pack("<i", 1) + text("Fx")
    )
    device = struct.pack("<ii", 4, 2) + text("DAQ") + text("7") + bytes(8) + struct.pack("<i", 1) + text("ch")
    camera = struct.pack("<i", 5) + text("Cam") + bytes(28)
    body = struct.pack("<i", 1) + text("Arm") + struct.pack("<ii3fi", 7, -1, 0, 0, 0, 0)
    found = model.decode(struct.pack("<i", 4) + plate + device + camera + body, OLD)
    assert [(b.name, b.id) for b in found.bodies] == [("Arm", 7)]
    assert found.subjects()[0].segments == ((7, "Arm", 0),)
    with pytest.raises(MalformedError, match="type 99"):
        model.decode(struct.pack("<ii", 1, 99), OLD)


def test_what_a_later_version_adds_to_sections_is_left_out():
    """In 4.1 and later by the byte counts: here a body set of 38 bytes whose section says 42."""
    payload = bytearray(protocol.split(SMALL_NEW)[1])
    at = 4 + 8 + 8 + 4
    assert struct.unpack_from("<i", payload, at)[0] == 38
    struct.pack_into("<i", payload, at, 42)
    payload[at + 4 + 38 : at + 4 + 38] = b"new!"
    assert frame.decode(bytes(payload), Version(4, 9)) == SMALL


def test_names_of_markers_come_from_the_set_of_the_asset_s_name():
    made = Model(
        {"Arm": ("elbow", "wrist")},
        (BodyModel("Arm", 1, 0, (0, 0, 0), ("x", "y")), BodyModel("B", 2, 0, (0, 0, 0), ("",))),
        (),
    )
    assert [[m.name for m in s.markers] for s in made.subjects()] == [["elbow", "wrist"], ["Marker1"]]


# -- damage


@pytest.mark.parametrize("version", VERSIONS)
def test_a_cut_frame_is_refused_at_every_byte(version):
    seen = MotiveFrame(1, skeletons={3: [BODY]}, markers=[Marker(1, 2, (0, 0, 0), 0.01, 2, 0.0)], bodies=[BODY])
    payload = protocol.split(encode.frame(seen, {"all": [(1, 2, 3)]}, version))[1]
    for end in range(len(payload)):
        with pytest.raises(MalformedError):
            frame.decode(payload[:end], version)


def test_damage_raises_nothing_else():
    seen = MotiveFrame(1, skeletons={3: [BODY] * 2}, markers=[Marker(1, 2, (0, 0, 0), 0.01, 2, 0.0)], bodies=[BODY] * 2)
    made = Model({"Arm": ("a",)}, (BodyModel("Arm", 1, 0, (0, 0, 0), ("x",)),), (("P", 3, ()),))
    for version in (OLD, NEW):
        for good in (encode.frame(seen, {"all": [(1, 2, 3)]}, version), encode.model(made, {}, version)):
            for data in mutations(good, seed=5, total=100_000):
                for read in (frame.decode, model.decode):
                    try:
                        read(data[4:], version)
                        protocol.split(data)
                        protocol.server_info(data)
                    except MalformedError:
                        pass


def test_a_count_of_millions_takes_no_memory():
    for count in (2**31 - 1, -1):
        with pytest.raises(MalformedError):
            frame.decode(struct.pack("<iii", 1, 0, count) + bytes(100), OLD)
