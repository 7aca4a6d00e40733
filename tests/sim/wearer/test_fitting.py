"""A recorded hand in its wearer's ranges: shifted, scaled or clipped, told, and refused where too little is left."""

from __future__ import annotations

import re

import numpy as np
import pytest
from helpers import ROOT
from helpers.run import call
from helpers.shared import shared
from hypothesis import given
from hypothesis import strategies as st

from srl.runtime.cli import main
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.models.human_hand import JOINTS, RANGES, hand_geometry
from srl.runtime.models.models import HandModel
from srl.runtime.models.point_series import PointSeries
from srl.runtime.profile import profile, wiring
from srl.sim.wearer import bvh_hand, load_wearer, tables, topics
from srl.sim.wearer.fitting import Fitted, fit

LOWER, UPPER = RANGES.T
TIME = np.linspace(0.0, 2.0, 400)
WAVE = np.sin(2 * np.pi * TIME)
THUMB, PIP, SPREAD = (JOINTS.index(j) for j in ("thumb_tm_abduction", "index_pip_flexion", "ring_mcp_abduction"))


def motion(**joints):
    """(400, 20) rad: waves of `name=(middle, amplitude)`, degrees; the others stand still at zero."""
    q = np.zeros((len(TIME), 20))
    for name, (middle, amplitude) in joints.items():
        q[:, JOINTS.index(name)] = np.deg2rad(middle + amplitude * WAVE)
    return q


def test_an_offset_joint_is_shifted_as_a_whole_by_the_least():
    q = motion(thumb_tm_abduction=(43, 10), index_pip_flexion=(40, 30))
    fitted = fit(q)
    assert list(fitted.shifts) == ["thumb_tm_abduction"]
    assert np.rad2deg(fitted.shifts["thumb_tm_abduction"]) == pytest.approx(30 - 53, abs=0.1)
    np.testing.assert_allclose(np.ptp(fitted.position[:, THUMB] - q[:, THUMB]), 0.0, atol=1e-3)
    np.testing.assert_array_equal(fitted.position[:, PIP], q[:, PIP])
    assert (fitted.clipped.joint, fitted.clipped.share) == ("thumb_tm_abduction", 1.0)
    assert fitted.clipped.variation == pytest.approx(1.0)
    assert fitted.lost.share == 0.0
    assert fitted.lost.variation < 0.01
    assert fitted.doubtful


def test_a_flipped_sign_is_named_where_a_joint_is_shifted():
    fitted = fit(motion(index_pip_flexion=(-40, 15), thumb_tm_abduction=(43, 10)))
    assert set(fitted.shifts) == {"index_pip_flexion", "thumb_tm_abduction"}
    assert "index_pip_flexion" in fitted.mirrored
    assert any(
        line.startswith("index_pip_flexion would fit without a shift if it were negated") for line in fitted.lines()
    )
    wide = fit(motion(index_pip_flexion=(120, 10)))
    assert wide.shifts
    assert not wide.mirrored  # negated it fits even less


def test_a_hand_that_all_but_stands_still_is_doubted():
    assert fit(np.deg2rad(motion(index_pip_flexion=(50, 40)))).still
    slight = fit(motion(index_pip_flexion=(20, 2.0)))
    assert slight.doubtful
    assert any("radian" in line for line in slight.lines())
    assert not fit(motion(index_pip_flexion=(20, 2.6))).still


def test_a_motion_wider_than_its_range_is_scaled_on_the_side_that_leaves_it():
    q = motion(ring_mcp_abduction=(10, 40))  # -30 to 50 degrees; the range is -20 to 15
    fitted = fit(q)
    assert list(fitted.scales) == ["ring_mcp_abduction"]
    below, above = fitted.scales["ring_mcp_abduction"]
    assert below == pytest.approx(20 / 30, rel=0.01)
    assert above == pytest.approx(15 / 50, rel=0.01)
    was, made = q[:, SPREAD], fitted.position[:, SPREAD]
    inside = (made > LOWER[SPREAD]) & (made < UPPER[SPREAD])
    np.testing.assert_allclose(made[inside], (np.where(was < 0, below, above) * was)[inside])
    assert inside.mean() > 0.85  # the top 1% of a sine at either end is flat, and long


def test_what_clipping_costs_little_is_clipped_and_told():
    q = motion(index_pip_flexion=(50, 53))  # from -3 degrees; the range begins at 0
    fitted = fit(q)
    assert not fitted.shifts
    assert not fitted.scales
    np.testing.assert_array_equal(fitted.position, np.clip(q, LOWER, UPPER))
    assert fitted.doubtful
    assert fitted.lost.share == pytest.approx((q[:, PIP] < np.deg2rad(-2)).mean())
    assert "index_pip_flexion loses" in fitted.lines()[0]


def test_a_few_outliers_move_no_joint_and_raise_no_doubt():
    q = motion(index_pip_flexion=(50, 40))
    q[7, PIP], q[9, PIP] = 3.0, -3.0
    fitted = fit(q)
    assert not fitted.shifts
    assert not fitted.doubtful
    assert fitted.lost.share == pytest.approx(2 / len(q))


def test_joints_that_stand_still_are_named_and_lose_nothing():
    fitted = fit(motion(thumb_tm_abduction=(0, 10), ring_mcp_abduction=(80, 0.01)))
    assert set(fitted.constant) == set(JOINTS) - {"thumb_tm_abduction"}
    assert fitted.lost.joint == ""
    assert fitted.lost.share == 1.0  # and yet it stands where the ring finger can't be
    assert fitted.doubtful


@given(st.integers(0, 10_000), st.floats(0.0, 3.0), st.floats(0.01, 3.0))
def test_whatever_is_recorded_the_hand_stays_in_its_ranges_and_what_fits_stays_as_it_is(seed, off, size):
    rng = np.random.default_rng(seed)
    q = rng.normal(size=20) * off + np.cumsum(rng.normal(size=(80, 20)), axis=0) * size / 10
    fitted = fit(q)
    assert (fitted.position >= LOWER).all()
    assert (fitted.position <= UPPER).all()
    for j, joint in enumerate(JOINTS):
        if joint not in {*fitted.shifts, *fitted.scales}:
            np.testing.assert_array_equal(fitted.position[:, j], np.clip(q[:, j], LOWER[j], UPPER[j]))
        # A fitted joint rises where the recorded one rises: no sign is turned, and nothing is reordered.
        order = np.argsort(q[:, j])
        assert (np.diff(fitted.position[order, j]) >= -1e-12).all()
    again = fit(fitted.position)
    np.testing.assert_allclose(again.position, fitted.position, atol=1e-12)
    assert again.clipped.share == 0.0


def csv(path, q):
    rows = [",".join(("time", *JOINTS)), *(",".join(map(repr, row)) for row in np.column_stack([TIME, q]).tolist())]
    path.write_text("\n".join(rows) + "\n")
    return path


def test_degrees_for_radian_and_joints_of_another_meaning_are_refused(tmp_path, capsys):
    degrees = csv(tmp_path / "a.csv", np.rad2deg(motion(index_pip_flexion=(40, 30))))
    with pytest.raises(RecordingError, match=r"joint 'index_pip_flexion'.*doesn't fit") as caught:
        load_wearer(degrees)
    assert "_deg" in caught.value.remedy
    turned = csv(tmp_path / "b.csv", motion(index_pip_flexion=(-120, 20)))
    with pytest.raises(RecordingError, match=r"shifted by \+140 degrees"):
        load_wearer(turned)
    assert main(["run", "sixth-finger", "--sim", "--wearer", str(turned)]) == 2
    said = capsys.readouterr().err.strip()
    assert "b.csv, joint 'index_pip_flexion'" in said
    assert len(said.splitlines()) == 1


def test_the_wearers_own_ranges_hold_for_the_recording_the_world_and_the_law(tmp_path):
    path = csv(tmp_path / "wide.csv", motion(thumb_tm_abduction=(43, 10)))
    wide = f"models.hand.upper={{thumb_tm_abduction: {np.deg2rad(55)}}}"
    recorded = f"sim.parts.hand.wearer.recording={path}"
    narrow = wiring.build(*profile.load("sixth-finger", [recorded]), [])
    graph = wiring.build(*profile.load("sixth-finger", [recorded, wide]), [])
    assert any("thumb_tm_abduction is shifted by -23" in doubt for doubt in narrow.warnings)
    assert graph.warnings == []
    assert any("loses" in remark or "no joint loses" in remark for remark in graph.remarks)
    assert any("not measured" in remark and "index_pip_flexion" in remark for remark in graph.remarks)
    joint = graph.world.model.joint("hand/thumb_tm_abduction")
    assert joint.range[1] == pytest.approx(np.deg2rad(55))
    peak = float(TIME[np.argmax(WAVE)])
    assert graph.world.parts["hand"].wearer.target(peak)[THUMB] == pytest.approx(np.deg2rad(53), abs=1e-3)
    for built, reached in ((narrow, 30), (graph, 53)):
        law = next(each.controller for each in built.laws if each.controller.name == "hand")
        law.input["angles"][:] = 0.0
        law.input["angles"][3] = np.deg2rad(53)  # the sensor of the thumb's abduction
        law.update(0.01)
        assert law.output["angles"][THUMB] == pytest.approx(np.deg2rad(reached))
        assert law.metrics()["beyond_range"] == (1.0 if reached == 30 else 0.0)


@pytest.mark.slow
def test_a_run_says_what_it_does_with_a_recording(tmp_path):
    path = csv(tmp_path / "offset.csv", motion(thumb_tm_abduction=(43, 10)))
    run = call(tmp_path, "run", "sixth-finger", "--sim", "--fast", "--duration", "0.2", "--wearer", str(path))
    for words in (
        "100.0% of the samples are more than 2 degrees outside",
        "thumb_tm_abduction is shifted by -23.0 degrees",
        "so fitted, 0.0% of the samples",
        "probably not measured: thumb_tm_flexion, thumb_mcp_flexion",
        "models:",
    ):
        assert words in run.stderr


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"upper": {"thumb_abduction": 1.0}}, "no joint 'thumb_abduction'"),
        ({"upper": {"thumb_tm_abduction": -1.2}}, "thumb_tm_abduction: the lower limit"),
        ({"lower": {"thumb_tm_abduction": float("nan")}}, "finite"),
    ],
)
def test_wrong_ranges_are_refused(limits, words):
    with pytest.raises(ValueError, match=words):
        HandModel(**limits)


def recorded(name):
    path = shared(f"data/{name}")
    parts = {".npz": tables.read_npz, ".bvh": bvh_hand.read}.get(path.suffix, lambda p: [topics.read(p)])(path)
    return np.concatenate([position for _, position in parts])


def tips(q, every=3):
    points = PointSeries(*hand_geometry())
    return np.array([points.at(row)[3::4] for row in q[::every]])


def error(q, used):
    """Rms over time and fingertips, mm: of the tips' places, and of their motion about their mean places."""
    away = tips(used) - tips(q)
    return tuple(1e3 * np.sqrt((d**2).sum(axis=2).mean()) for d in (away, away - away.mean(axis=0)))


def row(name, fitted: Fitted, q):
    """The row of the table in docs/simulation.md, as numbers in its order."""
    clipped = np.clip(q, LOWER, UPPER)
    (place, moved), (place_2, moved_2) = error(q, clipped), error(q, fitted.position)
    every = fit(q, much=0.0)
    return [
        100 * fitted.clipped.share, 100 * (1 - fitted.clipped.variation), 100 * (1 - fitted.lost.variation),
        len(fitted.shifts) + len(fitted.scales), place, place_2, moved, moved_2, error(q, every.position)[1],
    ]  # fmt: skip


@pytest.mark.parametrize(
    "name",
    [
        "cyberglove_adroit_door/door_demos.npz",
        "axis_neuron_bvh/left_arm_fingers_yxz.bvh",
        "axis_neuron_bvh/fullbody_walk_yxz.bvh",
        "sensor_glove/floete_07022021_01",
        "sensor_glove/sax_07022021_01",
    ],
)
def test_the_documented_figures_of_real_recordings(name):
    q = recorded(name)
    assert fit(q, much=0.22).shifts == fit(q).shifts == fit(q, much=0.6).shifts
    assert not fit(q).scales
    found = row(name, fit(q), q)
    page = (ROOT / "docs/simulation.md").read_text()
    line = next((line for line in page.splitlines() if line.startswith(f"| `{name}`")), "")
    documented = [float(n) for n in re.findall(r"-?\d+(?:\.\d+)?", line.split("|", 2)[2])] if line else []
    assert len(documented) == len(found), "| ".join(f"{v:.2f} " for v in found)
    np.testing.assert_allclose(documented, found, atol=0.06, err_msg="| ".join(f"{v:.2f} " for v in found))
