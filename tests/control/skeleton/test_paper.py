"""The 540-number vector: its layout, both ways, and that it mixes two conventions."""

import numpy as np
from helpers.shared import shared
from helpers.skeleton import FOLDER, THREE, TWO, human_srl, tip
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from srl.control.skeleton.paper import PaperVector
from srl.drivers.servo_bus.models import COUNTS, PER_COUNT
from srl.runtime.contracts.rotation import matrices
from srl.runtime.models.skeleton import bvh

STILL = np.tile([1.0, 0.0, 0.0, 0.0], (59, 1))
Q = np.array([0.1, 0.2, 0.3, 0.4, 0.05, 0.6, 0.7])


def _written(rotation: np.ndarray, translation: np.ndarray, arms: dict) -> np.ndarray:
    figure = human_srl()
    out = np.empty((len(figure.tree), 6))
    PaperVector(figure).write(rotation, translation, arms, out)
    return out


def test_540_numbers_of_which_108_are_the_arms() -> None:
    figure = human_srl()
    vector = _written(STILL, np.zeros((59, 3)), {"right": Q, "left": Q})
    assert vector.size == 540
    arms = [vector[figure.arm[side]].size for side in ("right", "left")]
    assert (sum(arms), vector.size - sum(arms)) == (108, 432)


def test_the_right_arms_rows_are_equations_6_to_9() -> None:
    rows = _written(STILL, np.zeros((59, 3)), {"right": Q})[human_srl().arm["right"]]
    q = np.rad2deg(Q)
    expected = [
        *([0, 0, 0], [0, 0, 0], [0, q[0], 0], [q[1], 0, 0], [0, 0, q[2]]),
        *([0, q[3], 0], [0, 0, 0], [0, q[5], 0], [0, 0, q[6]]),
    ]
    np.testing.assert_allclose(rows[:, 3:], expected)
    np.testing.assert_allclose(rows[6, :3], [0.0, -13.0 - 5.0, 0.0])  # row 7: l + q5 f, f = -1 here


def test_a_humans_row_is_the_suits_own() -> None:
    turn = Rotation.from_euler("ZXY", [10.0, 20.0, 30.0], degrees=True)  # capitals: about moving axes
    x, y, z, w = turn.as_quat()
    rotation = STILL.copy()
    figure = human_srl()
    j = figure.labels.index("LeftArm")
    rotation[j] = w, x, y, z
    translation = np.zeros((59, 3))
    translation[j] = 0.131, 0.01, -0.02
    vector = _written(rotation, translation, {})
    np.testing.assert_allclose(
        vector[figure.tree.index("LeftArm")], [13.1, 1.0, -2.0, 10.0, 20.0, 30.0], rtol=0, atol=1e-9
    )
    np.testing.assert_array_equal(vector[figure.sites], 0.0)


@given(st.integers(0, 2**32 - 1))
def test_what_is_written_is_read_back(seed: int) -> None:
    random = np.random.default_rng(seed)
    rotation = random.normal(size=(59, 4))
    rotation /= np.linalg.norm(rotation, axis=1)[:, None]
    translation = random.normal(size=(59, 3))
    arms = {"right": random.uniform(-3, 3, 7), "left": random.uniform(-3, 3, 7)}
    found = PaperVector(human_srl()).read(_written(rotation, translation, arms))
    # Angles aren't unique near X = +-90 degrees, so rotations are compared.
    np.testing.assert_allclose(matrices(found[0]), matrices(rotation), rtol=0, atol=2e-7)
    np.testing.assert_allclose(found[1], translation, rtol=0, atol=1e-12)
    for side, q in arms.items():
        np.testing.assert_allclose(found[2][side], q, rtol=0, atol=1e-12)


def test_real_frames_are_read_back() -> None:
    figure = human_srl()
    turns, places = bvh.read(shared(f"{FOLDER}/fullbody_walk_yxz.bvh")).pose(figure.labels)
    for turn, place in zip(turns[::20], places[::20], strict=True):
        rotation, translation, _ = PaperVector(figure).read(_written(turn, place, {"right": TWO}))
        np.testing.assert_allclose(matrices(rotation), matrices(turn), rtol=0, atol=1e-9)
        np.testing.assert_allclose(translation, place, rtol=0, atol=1e-12)


def _tip(rows: np.ndarray, own_first: bool) -> np.ndarray:
    """The last row's place, each row by eq. (1) or as BVH, with matrices of scipy's."""
    place, turn = np.zeros(3), np.eye(3)
    for row in rows:
        own = Rotation.from_euler("ZXY", row[3:], degrees=True).as_matrix()
        turn = turn @ own if own_first else turn
        place = place + turn @ row[:3] / 100.0
        turn = turn if own_first else turn @ own
    return place


def test_an_arms_rows_mean_equation_1_and_not_bvh() -> None:
    figure = human_srl()
    for q in (TWO, THREE):
        rows = _written(STILL, np.zeros((59, 3)), {"right": q})[figure.arm["right"]]
        np.testing.assert_allclose(_tip(rows, own_first=True), tip(q), rtol=0, atol=1e-12)
        assert np.linalg.norm(_tip(rows, own_first=False) - tip(q)) > 0.02


def test_the_servos_counts_differ_from_the_papers_by_less_than_a_tenth_of_a_degree() -> None:
    counts = np.arange(COUNTS)
    ours = np.rad2deg((counts - COUNTS // 2) * PER_COUNT)
    papers = counts / (COUNTS - 1) * 360.0 - 180.0
    assert 0.08 < np.abs(ours - papers).max() < 0.09
