"""Axis Neuron's frames: the sheet's vectors, damage, and an independent reading of the rotations."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
import pytest
from helpers.fuzz import fuzz, size_of
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from srl.drivers.noitom.protocol import COUNTS, BinaryParser, TextParser, encode_binary, encode_text
from srl.drivers.noitom.skeleton import Skeleton
from srl.runtime.contracts.rotation import EulerQuaternions, euler_angles, matrices

HEADER = (
    "ffdd0000010162010100000000004368617230300000000000000000000000000000000000000000000000000000"
    "07000000000000000000000000000000ffee"
)
DIGESTS = {
    354: "875c7218c1b5f96fd2e6dbedcd4214bee30f9aa7f905a11e6d6987d83fe26a7a",
    180: "9662bb57ef8003f7d9d709d28c0998ae1b200bcca4076652df9f0cc4ff1e960f",
    360: "b225dff598e275ee37b6db1c88f33805277475eca2c0f57dfee461eeb05d0517",
    186: "bf4923bb83a3d240a8c77a0494c4066b23fa6c1fca6ddd5ce0675de319c8eeb4",
}


def pose(count: int) -> np.ndarray[Any, Any]:
    """The sheet's test pose (§10)."""
    rows = np.zeros((59, 6))
    rows[:, :3] = np.arange(59)[:, None] + [0, 0.25, 0.5]
    rows[0, :3] = 1, 95.5, -2
    rows[[0, 16], 3:] = 10, 20, 30
    displacement, reference = COUNTS[count]
    values = rows.ravel() if displacement else np.concatenate([rows[0], rows[1:, 3:].ravel()])
    return np.concatenate([np.zeros(6 * reference), values])


@pytest.mark.parametrize("count", COUNTS)
def test_the_sheets_packets(count: int) -> None:
    data = encode_binary(pose(count), 7)
    assert hashlib.sha256(data).hexdigest() == DIGESTS[count]
    if count == 354:
        assert data[:64].hex() == HEADER
    frame = BinaryParser().feed(data)
    assert frame is not None
    assert (frame.avatar, frame.name, frame.number) == (0, "Char00", 7)
    places, angles = frame.split()
    assert places[0].tolist() == [1, 95.5, -2]
    assert angles[16].tolist() == [10, 20, 30]
    assert len(places) == (59 if COUNTS[count][0] else 1)


@pytest.mark.parametrize("count", COUNTS)
def test_text_and_binary_say_the_same(count: int) -> None:
    text = encode_text(pose(count))
    if count == 354:
        assert text.startswith(b"0 Char00 1.0000 95.5000 -2.0000 10.0000 20.0000 30.0000 1.0000 1.2500 1.5000 ")
        assert text.endswith(b" ||\r\n")
    frame = TextParser().feed(text)
    assert frame is not None
    np.testing.assert_array_equal(frame.values, pose(count))
    assert (frame.number, frame.name) == (-1, "Char00")


@pytest.mark.parametrize("words", ["+1", ".5", "1.", "1e1", "-0.0", "\t2"])
def test_numbers_that_json_doesnt_know_are_read(words: str) -> None:
    values = ["0.0"] * 179 + [words]
    frame = TextParser().feed(f"0 A {' '.join(values)} ||".encode())
    assert frame is not None
    assert frame.values[-1] == float(words)


@pytest.mark.slow
@given(st.lists(st.one_of(st.floats(-1e6, 1e6), st.integers(-3, 3)), min_size=180, max_size=180))
def test_four_decimals_are_read_as_floats_are(values: list[float]) -> None:
    words = [f"{value:.4f}" for value in values]
    frame = TextParser().feed(f"0 A {' '.join(words)} ||".encode())
    assert frame is not None
    assert frame.values.tolist() == [float(word) for word in words]


ODD = [
    "1-2.0000",
    "--1.0000",
    "1.00-0",
    "1..000",
    "1.000",
    "1.00000",
    "1e3.0000",
    "-",
    "",
    "0x1.0000",
    "1.0000-",
    "1 .0000",
]


@pytest.mark.parametrize("odd", [*ODD, "123456789012345678901.0000", "-.5000", ".5000"])
@pytest.mark.parametrize("at", [0, 90, 179])
def test_what_isnt_regular_is_read_as_float_reads_it_or_is_an_error(odd: str, at: int) -> None:
    words = ["12.3456"] * 180
    words[at] = odd
    frame = TextParser().feed(f"0 A {' '.join(words)} ||".encode())
    try:
        expected = [float(word) for word in " ".join(words).split()]
    except ValueError:
        expected = []
    found = frame.values.tolist() if frame is not None else []
    assert found == (expected if len(expected) in COUNTS else [])


@pytest.mark.parametrize(
    "record", ["0 A 1 2 3 ||", "0 A " + "nan " * 180 + "||", "0 A " + "1e999 " * 180 + "||", "x ||", "0 A [1] ||"]
)
def test_broken_text_is_counted_and_skipped(record: str) -> None:
    parser = TextParser()
    assert parser.feed(record.encode()) is None
    assert (parser.frames, parser.errors) == (0, 1)
    assert parser.feed(encode_text(pose(180))) is not None


def test_a_frame_that_isnt_finite_is_an_error() -> None:
    values = pose(354)
    values[100] = np.nan
    parser = BinaryParser()
    assert parser.feed(encode_binary(values, 1)) is None
    assert (parser.frames, parser.errors) == (0, 1)


@pytest.mark.parametrize("make", [BinaryParser, TextParser])
def test_only_the_newest_frame_of_a_backlog_is_taken_and_other_avatars_left_out(make: Any) -> None:
    stream = b""
    for k in range(10):
        for avatar in (0, 1):
            values = pose(354) + k
            stream += encode_binary(values, k, avatar) if make is BinaryParser else encode_text(values, avatar)
    parser = make(1)
    frame = parser.feed(stream)
    assert frame is not None
    np.testing.assert_allclose(frame.values, pose(354) + 9, rtol=1e-6)
    assert (parser.frames, parser.others, frame.avatar) == (10, 10, 1)


@given(st.lists(st.integers(1, 900), min_size=1, max_size=40), st.booleans())
def test_cuts_lose_nothing(cuts: list[int], binary: bool) -> None:
    one = encode_binary(pose(180), 3) if binary else encode_text(pose(180))
    stream, at = one * 5, 0
    parser = BinaryParser() if binary else TextParser()
    for cut in [*cuts, len(stream)]:
        parser.feed(stream[at : at + cut])
        at += cut
    assert (parser.frames, parser.errors, parser.resyncs) == (5, 0, 0)


@pytest.mark.parametrize("make", [BinaryParser, TextParser])
def test_a_million_damaged_bytes(make: Any) -> None:
    parser = make()
    good = encode_binary(pose(354), 5) * 3 if make is BinaryParser else encode_text(pose(354)) * 3
    fuzz(parser.feed, good)
    assert size_of(parser) < 100_000
    found = [parser.feed(good) for _ in range(20)]
    assert found[-1] is not None
    np.testing.assert_allclose(found[-1].values, pose(354), rtol=1e-6)


@pytest.mark.parametrize("order", ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"])
def test_rotations_agree_with_an_independent_library(order: Any) -> None:
    rng = np.random.default_rng(3)
    angles = rng.uniform(-np.pi, np.pi, (59, 3))
    out = np.empty((59, 4))
    EulerQuaternions(order, 59).fill(angles, out)
    expected = Rotation.from_euler(order, angles).as_quat()[:, [3, 0, 1, 2]]
    np.testing.assert_allclose(np.abs((out * expected).sum(axis=1)), 1.0, atol=1e-12)
    back = np.empty((59, 4))
    EulerQuaternions(order, 59).fill(euler_angles(matrices(out), order), back)
    np.testing.assert_allclose(np.abs((out * back).sum(axis=1)), 1.0, atol=1e-12)
    locked = np.array([[0.3, np.pi / 2, 0.4], [0.3, -np.pi / 2, -0.2]])
    one, two = np.empty((2, 4)), np.empty((2, 4))
    EulerQuaternions(order, 2).fill(locked, one)
    EulerQuaternions(order, 2).fill(euler_angles(matrices(one), order), two)
    np.testing.assert_allclose(np.abs((one * two).sum(axis=1)), 1.0, atol=1e-9)


def test_the_vendors_library_reads_the_rotation_so() -> None:
    out = np.empty((1, 4))
    EulerQuaternions("YXZ", 1).fill(np.deg2rad([[10.0, 20.0, 30.0]]), out)
    np.testing.assert_allclose(out[0], [0.95155, 0.18931, 0.03813, 0.23930], atol=1e-5)


@pytest.mark.parametrize("kind", ["axis-neuron", "axis-studio"])
def test_the_skeletons_order(kind: Any) -> None:
    skeleton = Skeleton(kind)
    assert len(skeleton.names) == len(set(skeleton.names)) == 59
    assert all(parent < i for i, parent in enumerate(skeleton.parents))
    where = {0: "Hips", 6: "LeftFoot", 12: "Head", 13: "RightShoulder", 16: "RightHand", 20: "RightInHandIndex",
             36: "LeftShoulder", 39: "LeftHand", 58: "LeftHandPinky3"}  # fmt: skip
    assert {i: skeleton.names[i] for i in where} == where
    assert skeleton.parents[20] == 16
    assert skeleton.parents[13] == (10 if kind == "axis-neuron" else 9)
