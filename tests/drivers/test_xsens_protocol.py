"""MVN's bytes: golden vectors, round trips, samples put together, and damage."""

from __future__ import annotations

import struct

import pytest
from helpers.fuzz import mutations
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.drivers.xsens_mvn import protocol
from srl.drivers.xsens_mvn.assembly import MOST, Assembly
from srl.drivers.xsens_mvn.protocol import CENTRE, JOINT_ENDS, JOINTS, POSES, SEGMENTS, MalformedError, Pose

HEAD = "4d5854503032000000648017000013880017000000000 2e0".replace(" ", "")
CENTRE_SHORT = bytes.fromhex("4d585450323400000064800000001388001700000000000c3dcccccd3e4ccccd3f800000")
TIME = bytes.fromhex("4d58545032350000006480010000138800170000000000100000000c31323a33343a35362e373839")
HALF = 0.7071067690849304
f32s = st.floats(-50, 50, width=32)


def f32(value: float) -> float:
    (found,) = struct.unpack(">f", struct.pack(">f", value))
    return float(found)


def standing() -> list[Pose]:
    """The golden pose: segment i at (0.1 i, -0.1 i, 1 + 0.01 i), the ninth turned."""
    return [
        Pose(i, (f32(0.1 * i), f32(-0.1 * i), f32(1 + 0.01 * i)), (HALF, 0, 0, HALF) if i == 9 else (1, 0, 0, 0))
        for i in range(1, 24)
    ]


def test_the_golden_datagram_of_poses():
    data = protocol.encode(POSES, 100, 5000, protocol.encode_poses(standing()), 23)
    assert (len(data), data[:24].hex()) == (760, HEAD)
    found = protocol.split(data)
    assert (found.kind, found.sample, found.part, found.last, found.items) == (2, 100, 0, True, 23)
    assert (found.time, found.character) == (5000, 0)
    assert protocol.poses(found.items, found.payload) == standing()


def test_golden_joints_are_found_by_their_segments():
    payload = protocol.encode_joint(257, 512, (1, 2, 3)) + protocol.encode_joint(2306, 2560, (4, 5, 6))
    payload += protocol.encode_joint(2305, 2561, (7, 8, 9))  # ergonomic, the same pair: the first counts
    found = protocol.joints(3, payload)
    assert (found[JOINT_ENDS["L5S1"]], found[JOINT_ENDS["RightElbow"]]) == ((1, 2, 3), (4, 5, 6))


def test_the_golden_centres_of_mass():
    short = protocol.split(CENTRE_SHORT)
    assert (short.kind, protocol.centre(short.payload)) == (CENTRE, (f32(0.1), f32(0.2), 1.0))
    long = struct.pack(">9f", 0.1, 0.2, 1.0, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
    assert protocol.centre(long) == protocol.centre(short.payload)
    assert protocol.split(TIME).kind == 25


def test_headers_before_2019_have_no_size():
    data = protocol.encode(POSES, 7, 0, protocol.encode_poses(standing()), 23, sized=False)
    assert data[17:24] == bytes(7)
    assert protocol.poses(23, protocol.split(data).payload) == standing()


def test_fingers_and_props_are_left_out():
    more = [Pose(i, (0.0, 0.0, 1.0), (1, 0, 0, 0)) for i in range(24, 68)]
    found = protocol.poses(67, protocol.encode_poses([*standing(), *more]))
    assert [pose.segment for pose in found] == list(range(1, 24))


def test_the_table_of_joints_is_a_tree_of_all_segments():
    children = [child for _, child in JOINT_ENDS.values()]
    assert sorted(children) == list(range(2, len(SEGMENTS) + 1))
    assert all(parent < child for parent, child in JOINT_ENDS.values())


@pytest.mark.parametrize(
    "wrong",
    [
        Pose(0, (0, 0, 1), (1, 0, 0, 0)), Pose(68, (0, 0, 1), (1, 0, 0, 0)), Pose(1, (0, 0, 1), (1.02, 0, 0, 0)),
        Pose(1, (0, float("nan"), 1), (1, 0, 0, 0)), Pose(1, (0, 0, 1), (float("inf"), 0, 0, 0)),
    ],
)  # fmt: skip
def test_no_pose_is_refused(wrong):
    with pytest.raises(MalformedError):
        protocol.poses(1, protocol.encode_poses([wrong]))


def test_sizes_that_don_t_fit_are_refused():
    payload = protocol.encode_poses(standing())
    for items, data in ((22, payload), (23, payload[:-1]), (0, payload)):
        with pytest.raises(MalformedError):
            protocol.poses(items, data)
    with pytest.raises(MalformedError):
        protocol.joints(2, bytes(20))
    with pytest.raises(MalformedError):
        protocol.centre(bytes(24))
    whole = protocol.encode(POSES, 1, 1, payload, 23)
    for end in range(len(whole)):
        with pytest.raises(MalformedError):
            protocol.split(whole[:end])


@settings(max_examples=40)
@given(
    st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1), st.integers(0, 255),
    st.lists(st.tuples(st.integers(1, 23), st.tuples(f32s, f32s, f32s)), max_size=23), st.integers(1, 5), st.randoms(),
)  # fmt: skip
def test_samples_come_back_from_datagrams_in_any_order(sample, time, character, segments, count, chance):
    made = [Pose(number, place, (1, 0, 0, 0)) for number, place in segments]
    parts = [made[i::count] for i in range(count)]
    sent = [
        protocol.encode(
            POSES, sample, time, protocol.encode_poses(part), len(part), character=character, index=i,
            last=i == count - 1,
        )
        for i, part in enumerate(parts)
    ]  # fmt: skip
    chance.shuffle(sent)
    assembly = Assembly()
    found = [assembly.take(protocol.split(data)) for data in sent]
    assert found[:-1] == [None] * (count - 1)
    whole = found[-1]
    assert whole is not None
    assert (whole.number, whole.time, whole.items) == (sample, time, len(made))
    assert protocol.poses(whole.items, whole.payload) == [pose for part in parts for pose in part]


def test_samples_that_stay_incomplete_take_no_memory():
    assembly = Assembly()
    for sample in range(1000):
        half = protocol.encode(POSES, sample, 0, b"", 0, index=0, last=False)
        assert assembly.take(protocol.split(half)) is None
    assert assembly.incomplete == 1000 - MOST
    assert assembly.take(protocol.split(protocol.encode(POSES, 999, 0, b"", 0, index=1))) is not None


def test_damage_raises_nothing_else():
    good = protocol.encode(POSES, 100, 5000, protocol.encode_poses(standing()), 23)
    good += protocol.encode(JOINTS, 100, 5000, protocol.encode_joint(257, 512, (1, 2, 3)), 1)
    assembly = Assembly()
    for data in mutations(good, seed=3, total=300_000):
        for read in (protocol.poses, protocol.joints):
            try:
                found = protocol.split(data)
                assembly.take(found)
                read(found.items, found.payload)
                protocol.centre(found.payload)
            except MalformedError:
                pass
