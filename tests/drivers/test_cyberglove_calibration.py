"""Raw bytes to angles and back, and calibration files that are wrong."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import make_interp_spline

from srl.drivers.cyberglove import calibration
from srl.drivers.cyberglove.calibration import Calibration, Fit
from srl.drivers.cyberglove.protocol import LABELS
from srl.runtime.contracts.errors import ProfileError
from srl.runtime.contracts.files import KeptFile

PLAIN = "{gain: 0.01, offset: 80}"


def text(sensors: int = 22, hand: str = "right", **lines: str | None) -> str:
    """A file with a plain line for every sensor but those given; None leaves one out."""
    chosen = {**dict.fromkeys(LABELS[sensors], PLAIN), **lines}
    rows = [f"  {name}: {line}" for name, line in chosen.items() if line is not None]
    return "\n".join(["person: P07", "date: 2026-02-17", f"hand: {hand}", "sensors:", *rows])


def write(path, content: str):
    path.write_text(content)
    return path


def angles(table: Calibration, raw: bytes) -> np.ndarray:
    out = np.empty(len(raw))
    table.angles(raw, out)
    return out


def test_points_and_gains_give_the_lines_the_sheet_describes(tmp_path):
    file = write(
        tmp_path / "p07.yaml",
        text(index_pij="{points: [[69, 0.0], [198, 1.7]]}", wrist_yaw="{gain: -0.02, offset: 128}"),
    )
    loaded = calibration.load(KeptFile.read(file), 22)
    assert (loaded.hand, loaded.person, loaded.note) == ("right", "P07", "")
    assert loaded.table.shape == (22, 256)
    raw = bytes([69] * 22)
    assert angles(loaded, raw)[5] == pytest.approx(0)
    assert angles(loaded, raw)[21] == pytest.approx(-0.02 * (69 - 128))
    assert angles(loaded, bytes([198] * 22))[5] == pytest.approx(1.7)
    assert angles(loaded, raw)[0] == pytest.approx(0.01 * (69 - 80))


@pytest.mark.parametrize("numbers", ["gain: 0.01, offset: 1.0e+300", "gain: 1.0e+308, offset: 80"])
def test_numbers_that_make_no_line_are_refused(numbers, tmp_path):
    """All counts would have the same angle, or none."""
    file = write(tmp_path / "p07.yaml", text(index_pij=f"{{{numbers}}}"))
    with pytest.raises(ProfileError, match=r"sensors\.index_pij: not every count has an angle of its own"):
        calibration.load(KeptFile.read(file), 22)


@st.composite
def broken_lines(draw):
    raw = sorted(draw(st.sets(st.integers(0, 255), min_size=2, max_size=6)))
    steps = draw(st.lists(st.floats(0.01, 1.0), min_size=len(raw), max_size=len(raw)))
    return list(zip(raw, (draw(st.sampled_from([1, -1])) * np.cumsum(steps)).tolist(), strict=True))


@given(broken_lines())
def test_a_broken_line_agrees_with_scipy_and_has_an_exact_inverse(points):
    table = Fit(points=points).angles()
    raw, rad = np.array(points).T
    oracle = make_interp_spline(raw, rad, k=1)  # degree 1 goes on beyond its ends, as ours does
    np.testing.assert_allclose(table, oracle(np.arange(256.0)), atol=1e-9)
    one = Calibration(table[None, :])
    for byte in range(1, 256):
        assert one.raw(angles(one, bytes([byte]))) == byte


@pytest.mark.parametrize("sensors", [18, 22])
def test_the_default_is_marked_plausible_and_invertible(sensors):
    usual = calibration.default(sensors)
    assert "uncalibrated" in usual.note
    flat, fist = (angles(usual, bytes([raw] * sensors)) for raw in (80, 190))
    flexion = [row for row, name in enumerate(LABELS[sensors]) if name[-3:] in ("mpj", "pij", "dij")]
    np.testing.assert_allclose(flat[flexion], 0, atol=1e-12)
    assert np.all((fist[flexion] > 0.8) & (fist[flexion] < 2.0))
    assert np.all(np.abs(usual.table[:, 1:]) < np.pi)
    every = np.arange(1, 256)
    for byte in every:
        assert np.all(usual.raw(angles(usual, bytes([byte] * sensors))) == byte)


def test_angles_out_of_the_gloves_reach_give_its_end_bytes():
    usual = calibration.default(22)
    assert set(usual.raw(np.full(22, 9.0))) == {1, 255}  # abductions fall, the others rise
    assert set(usual.raw(np.full(22, -9.0))) == {1, 255}


@given(st.sampled_from([18, 22]), st.data())
def test_quantised_angles_are_those_of_the_nearest_bytes(sensors, data):
    usual = calibration.default(sensors)
    wanted = np.array(data.draw(st.lists(st.floats(-20, 20), min_size=sensors, max_size=sensors)))
    raw, quantised = usual.raw(wanted), np.empty(sensors)
    usual.quantise(wanted, quantised)
    np.testing.assert_array_equal(quantised, angles(usual, raw.tobytes()))
    off = np.abs(usual.table[:, 1:] - wanted[:, None])
    np.testing.assert_allclose(np.abs(quantised - wanted), off.min(axis=1), rtol=1e-12, atol=1e-12)


# -- the vendor's file


def vendor(sensors: int) -> str:
    """Lines as VirtualHand writes them: word 6 the offset, word 9 the gain; here offset 100 + line."""
    lines = [f"j{line} 0 0 0 0 0 {100 + line} 0 0 {0.001 * (1 + line):.4f}" for line in range(30)]
    lines[15] = lines[15].rsplit(" ", 1)[0] + " 77.0"  # the quirk: not where its gain is
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("sensors", "name", "line"),
    [
        (22, "thumb_roll", 2),
        (22, "index_dij", 9),
        (22, "wrist_yaw", 29),
        (18, "middle_mpj", 12),
        (18, "palm_arch", 27),
    ],
)
def test_a_vendor_file(tmp_path, sensors, name, line):
    loaded = calibration.load(KeptFile.read(write(tmp_path / "right.cal", vendor(sensors))), sensors)
    row = LABELS[sensors].index(name)
    assert loaded.table[row, 150] == pytest.approx((150 - (100 + line)) * 0.001 * (1 + line))
    assert "sign" in loaded.note


@pytest.mark.parametrize("sensors", [18, 22])
def test_the_vendors_misplaced_gain_is_taken_from_line_10(tmp_path, sensors):
    loaded = calibration.load(KeptFile.read(write(tmp_path / "right.cal", vendor(sensors))), sensors)
    row = LABELS[sensors].index("middle_index_abduction")
    assert loaded.table[row, 150] == pytest.approx((150 - 115) * 0.011)


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("j4 0 0 0 0 0 104", "j4 0 0 0 0 0 x", r"line 5: word 7 isn't a number"),
        ("j29", "", "line 30"),
        ("0.0030", "0.0", "line 3: the gain of thumb_roll is 0"),
        ("0.0030", "nan", "line 3: word 10"),
    ],
)
def test_a_bad_vendor_file_names_the_line(tmp_path, old, new, match):
    with pytest.raises(ProfileError, match=match):
        calibration.load(KeptFile.read(write(tmp_path / "bad.cal", vendor(22).replace(old, new))), 22)


# -- files that are wrong


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (text(index_pij=None), r"bad\.yaml: sensors\.index_pij: the sensor is missing"),
        (text(indx_pij=PLAIN), r"sensors\.indx_pij.*Did you mean 'index_pij'"),
        (text(index_pij="{points: [[69, 0.0]]}"), r"sensors\.index_pij\.points.*at least 2"),
        (text(index_pij="{points: [[69, 0.0], [69, 1.0]]}"), r"sensors\.index_pij.*raw values must rise"),
        (text(index_pij="{points: [[6, 0], [7, 1], [9, 0]]}"), r"angles must all rise or all fall"),
        (text(index_pij="{points: [[6, 0], [300, 1]]}"), r"points\.1\.0.*less than or equal to 255"),
        (text(index_pij="{points: [[6, 0], [9, .nan]]}"), r"points\.1\.1.*finite"),
        (text(index_pij="{gain: 0, offset: 1}"), r"gain must not be 0"),
        (text(index_pij="{gain: 1}"), r"needs points, or gain and offset"),
        (text(index_pij="{gain: 1, offset: 1, points: [[1, 0], [2, 1]]}"), r"give one"),
        (text(index_pij="{gian: 1, offset: 1}"), r"sensors\.index_pij\.gian"),
        (text(hand="both"), r"bad\.yaml: hand"),
        (text() + "\n  index_pij: {gain: 1, offset: 1}", r"line \d+: .*YAML.*duplicate key"),
        ("sensors: [", r"bad\.yaml: line 1: this isn't valid YAML"),
        ("", r"bad\.yaml"),
        ("a list", r"bad\.yaml"),
        (text(18), r"sensors\.index_dij: the sensor is missing"),
    ],
)
def test_a_bad_file_names_file_key_and_what_was_expected(tmp_path, content, match):
    with pytest.raises(ProfileError, match=match):
        calibration.load(KeptFile.read(write(tmp_path / "bad.yaml", content)), 22)
