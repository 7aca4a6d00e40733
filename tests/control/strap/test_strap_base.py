"""A base that gives way: kinematics, the tilt from gravity, the least change of the joints, the law."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from helpers.strap import ARM, HOME
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from runtime.contracts.errors import OptionError
from runtime.contracts.rotation import exp
from runtime.control.models import ArmsModel
from runtime.control.skeleton.human import human
from runtime.control.skeleton.human_srl import HumanSrl
from runtime.control.skeleton.kinematics import Kinematics
from runtime.control.strap.axes import Axes, Axis
from runtime.control.strap.correction import Correction
from runtime.control.strap.law import StrapBase, StrapBaseConfig
from runtime.control.strap.tilt import UP_Y, UP_Z, tilt, up_in
from srl.testing import bound, check_controller

AXES = tuple(Axis.model_validate(axis) for axis in ARM.values())
LOWER, UPPER = np.array([a.lower for a in AXES]), np.array([a.upper for a in AXES])
UNIT = [1.0, 0.0, 0.0, 0.0]

share = st.lists(st.floats(0, 1), min_size=7, max_size=7)
vectors = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array)
turns = vectors.map(lambda v: Rotation.from_rotvec(3 * v))
small = vectors.map(lambda v: 0.15 * v / max(1.0, float(np.linalg.norm(v))))


def q_of(shares: list[float]) -> np.ndarray:
    return LOWER + np.array(shares) * (UPPER - LOWER)


def wxyz(turn: Rotation) -> tuple[float, float, float, float]:
    x, y, z, w = turn.as_quat()
    return (w, x, y, z)


def oracle() -> Any:
    """The same arm for pinocchio."""
    model, parent, place = pin.Model(), 0, np.zeros(3)
    for name, axis in zip(ARM, AXES, strict=True):
        along = np.array(axis.axis) / np.linalg.norm(axis.axis)
        joint = pin.JointModelPrismaticUnaligned(along) if axis.slides else pin.JointModelRevoluteUnaligned(along)
        parent = model.addJoint(parent, joint, pin.SE3(np.eye(3), place), name)
        place = np.array(axis.link)
    model.addFrame(pin.Frame("tip", parent, 0, pin.SE3(np.eye(3), place), pin.FrameType.OP_FRAME))
    return model, model.createData()


@given(share)
def test_tip_and_jacobian_are_those_of_an_independent_library(shares):
    q = q_of(shares)
    tip, columns = Axes(AXES).forward(q.tolist())
    model, data = oracle()
    pin.forwardKinematics(model, data, q)
    pin.updateFramePlacements(model, data)
    np.testing.assert_allclose(tip, data.oMf[model.getFrameId("tip")].translation, atol=1e-12)
    J = pin.computeFrameJacobian(model, data, q, model.getFrameId("tip"), pin.LOCAL_WORLD_ALIGNED)[:3]
    np.testing.assert_allclose(np.array(columns).T, J, atol=1e-12)


@given(turns, turns, turns, small, st.floats(-3, 3), st.floats(-3, 3))
def test_roll_and_pitch_of_the_base_are_found_whatever_the_yaws_are(body, on_body, on_base, tilted, yaw, other):
    """A base that has turned by t about horizontal axes, sensors mounted anyhow, with references turned anyhow."""
    up = body.inv().apply([0, 0, 1])  # in the axes of the rigid base
    horizontal = tilted - up * up.dot(tilted)
    turned = Rotation.from_rotvec(horizontal)
    references = [Rotation.from_rotvec([0, 0, angle]) for angle in (yaw, other)]
    of_base = references[0] * body * turned * on_base
    of_body = references[1] * body * on_body
    found = tilt(up_in(wxyz(on_base), wxyz(of_base), UP_Z), up_in(wxyz(on_body), wxyz(of_body), UP_Z))
    np.testing.assert_allclose(found, horizontal, atol=1e-6)


@given(turns, turns, turns, st.floats(-1, 1))
def test_yaw_of_the_base_is_not_seen(body, on_body, on_base, yaw):
    twisted = Rotation.from_rotvec([0, 0, yaw]) * body
    found = tilt(up_in(wxyz(on_base), wxyz(twisted * on_base), UP_Z), up_in(wxyz(on_body), wxyz(body * on_body), UP_Z))
    np.testing.assert_allclose(found, 0, atol=1e-7)


def test_a_suits_up_is_y():
    lying = Rotation.from_rotvec([np.pi / 2, 0, 0])  # of the suit's axes (x left, y up, z forward) in z-up axes
    assert np.allclose(up_in(wxyz(lying), tuple(UNIT), UP_Y), [0, 0, 1])


@settings(deadline=None)
@given(share.map(lambda s: [0.25 + 0.5 * v for v in s]), small)
def test_the_tip_stays_where_a_rigid_base_would_put_it(shares, tilted):
    q = q_of(shares)
    correction = Correction(AXES, 0.001)
    base = exp(*tilted)
    for _ in range(5):
        d = correction.solve(q, base)
    beyond = ((q + d < LOWER - 1e-12) | (q + d > UPPER + 1e-12)).any()
    assert not beyond
    J = np.array(Axes(AXES).forward((q + d).tolist())[1])
    at_a_limit = (np.isclose(q + d, LOWER) | np.isclose(q + d, UPPER)).any()
    if np.linalg.svd(J, compute_uv=False)[-1] > 0.1 and not at_a_limit:
        tip = Rotation.from_rotvec(tilted).apply(correction.tip(q + d))
        assert np.linalg.norm(tip - correction.tip(q)) < 1e-4
        assert correction.error < 1e-4


def test_it_is_the_least_change():
    """Of all corrections that reach the same tip, none along the null space is smaller."""
    correction = Correction(AXES, 1e-4)
    q, base = np.array(HOME), exp(0.05, -0.1, 0.02)
    for _ in range(5):
        d = correction.solve(q, base).copy()
    J = np.array(Axes(AXES).forward((q + d).tolist())[1]).T
    weight = np.array([0.01 if a.slides else 1.0 for a in AXES])
    null = np.linalg.svd(J)[2][3:]
    np.testing.assert_allclose(null @ (d / weight), 0, atol=2e-3)


def test_joints_at_their_limits_leave_the_rest_to_the_others():
    q, base = np.array(HOME), exp(0.1, 0.1, 0.0)
    free = Correction(AXES, 0.005)
    tight = [axis.model_copy(update={"lower": v - 0.01, "upper": v + 0.01}) for axis, v in zip(AXES, q, strict=True)]
    some = Correction([*AXES[:3], *tight[3:]], 0.005)
    none = Correction(tight, 0.005)
    for _ in range(5):
        d = [c.solve(q, base).copy() for c in (free, some, none)]
    assert np.abs(d[0][3:]).max() > 0.011
    assert np.abs(d[1][3:]).max() <= 0.01 + 1e-12
    assert some.error < 0.004
    assert np.abs(d[2]).max() <= 0.01 + 1e-12
    assert none.error > 0.02


def test_no_held_joint_would_rather_move_back():
    """Against an independent solver of bounded least squares, near the limits of the arm."""
    rng, held = np.random.default_rng(4), 0
    for _ in range(150):
        q = LOWER + rng.choice([0.0, 0.02, 0.5, 0.98, 1.0], 7) * (UPPER - LOWER)
        correction = Correction(AXES, 0.02)
        J = np.array(Axes(AXES).forward(q.tolist())[1]).T
        task, low, high = rng.normal(size=3) * 0.05, LOWER - q, UPPER - q
        weight = np.array([0.1 if a.slides else 1.0 for a in AXES])
        A, b = np.vstack([J / 0.02, np.diag(1 / weight)]), np.concatenate([task / 0.02, np.zeros(7)])
        low, high = np.minimum(low, 0.0), np.maximum(high, 0.0)
        least = lsq_linear(A, b, (low - 1e-12, high + 1e-12), tol=1e-12).cost
        d = correction._bounded(J, task, low, high)
        assert ((d >= low - 1e-12) & (d <= high + 1e-12)).all()
        assert 0.5 * np.sum((A @ d - b) ** 2) <= least * (1 + 1e-6) + 1e-9
        held += bool(((d == low) | (d == high)).sum() > 1)
    assert held > 50


def test_near_a_singularity_the_correction_stays_small():
    straight = np.zeros(7)  # stretched, and J5 held: the tip can't come nearer nor go further
    axes = [a.model_copy(update={"lower": -1e-6, "upper": 1e-6}) if a.slides else a for a in AXES]
    assert np.linalg.svd(np.array(Axes(tuple(axes)).forward([0.0] * 7)[1])[[0, 1, 2, 3, 5, 6]])[1][-1] < 1e-6
    correction = Correction(axes, 0.02)
    for tilted in ((0.3, 0, 0), (0, 0.3, 0), (0, 0, 0.3), (0.2, 0.2, -0.1)):
        correction.reset()
        last = correction.d.copy()
        for k in range(101):
            d = correction.solve(straight, exp(*(0.01 * k * v for v in tilted))).copy()
            assert np.isfinite(d).all()
            assert np.abs(d - last).max() < 0.05, "no jump"
            last = d
        assert np.abs(d).max() < 1.2


# The law


def law(transforms: dict[str, Any] | None = None, **options: Any) -> StrapBase:
    made = bound(StrapBase("strap", StrapBaseConfig.model_validate({"axes": ARM} | options)), transforms)
    give(made, wanted=HOME, q=HOME, orientation=UNIT)
    if "body" in made.input:
        give(made, body=UNIT)
    made.applied["command"][:] = HOME
    return made


def give(made: StrapBase, **values: Any) -> None:
    for name, value in values.items():
        made.input[name][...] = value


def run(made: StrapBase, seconds: float, dt: float = 0.01) -> np.ndarray:
    rows = []
    for _ in range(round(seconds / dt)):
        made.update(dt)
        rows.append(made.output["command"].copy())
    return np.array(rows)


def tilted_by(*rotvec: float) -> list[float]:
    return list(exp(*rotvec))


def test_it_keeps_the_contract_of_controllers():
    made = law()
    give(made, orientation=tilted_by(0.1, 0.05, 0.4))
    inputs = {name: value.copy() for name, value in made.input.items()}
    check_controller(made, inputs=inputs, start={"command": np.array(HOME)})


def test_it_holds_the_tip_and_fades_in():
    made = law(damping=0.001)
    give(made, orientation=tilted_by(0.1, 0.05, 0.0))
    made.reset()
    np.testing.assert_array_equal(made.output["command"], HOME)
    rows = run(made, 1.0)
    assert np.abs(np.diff(rows, axis=0)).max() < 0.01, "no jump"
    assert made.output["active"][0] == 1.0
    np.testing.assert_allclose(made.output["tilt"], [0.1, 0.05, 0.0], atol=1e-6)
    arm = Correction(AXES, 0.001)
    tip = Rotation.from_rotvec([0.1, 0.05, 0.0]).apply(arm.tip(rows[-1]))
    assert np.linalg.norm(tip - arm.tip(np.array(HOME))) < 1e-4


def test_a_yaw_that_drifts_changes_nothing():
    made = law()
    made.reset()
    for k in range(200):
        give(made, orientation=tilted_by(0, 0, 0.005 * k), body=tilted_by(0, 0, -0.003 * k))
        made.update(0.01)
        np.testing.assert_allclose(made.output["command"], HOME, atol=1e-9)


def test_mounts_of_both_sensors_come_from_the_tree():
    mount, worn = Rotation.from_rotvec([0.4, -1.0, 2.0]), Rotation.from_rotvec([1.0, 1.0, 0.3])
    made = law({"mount": [0.1, 0, 0, *wxyz(mount)], "body": [0, 0.2, 0, *wxyz(worn)]})
    body = Rotation.from_rotvec([0.2, 0.3, 1.0])  # the rigid base in the world
    give(made, orientation=wxyz(Rotation.from_rotvec([0, 0, 2]) * body * Rotation.from_rotvec([0, 0, 0]) * mount))
    give(made, body=wxyz(Rotation.from_rotvec([0, 0, -1]) * body * worn))
    made.reset()
    np.testing.assert_allclose(run(made, 1.0)[-1], HOME, atol=1e-9)


def test_a_suit_is_a_reference_too():
    to_base = Rotation.from_matrix([[0, 0, 1], [1, 0, 0], [0, 1, 0]])  # the suit's z, x, y are the base's x, y, z
    made = law({"body": [0, 0, 0, *wxyz(to_base)]}, reference="suit", joints=["Hips", "Spine"])
    assert made.inputs[-1].labels == ("Hips", "Spine")
    hips, spine = Rotation.from_rotvec([0.1, 2.0, 0.2]), Rotation.from_rotvec([0.3, 0.1, -0.2])
    give(made, rotation=[wxyz(hips), wxyz(spine)])
    in_suit = hips * spine * to_base.inv()  # the rigid base in the suit's world
    z_up = Rotation.from_rotvec([np.pi / 2, 0, 0])
    give(made, orientation=wxyz(z_up * in_suit))
    made.reset()
    np.testing.assert_allclose(run(made, 1.0)[-1], HOME, atol=1e-9)
    give(made, rotation=np.nan)
    run(made, 1.0)
    assert made.output["active"][0] == 0.0


@pytest.mark.parametrize("lost", [[np.nan] * 4, [0.0] * 4, [np.inf, 0, 0, 0], [0.5, 0.0, 0.0, 0.0]])
@pytest.mark.parametrize("which", ["orientation", "body"])
def test_what_is_not_measured_fades_out_and_comes_back(lost, which):
    made = law()
    give(made, orientation=tilted_by(0.1, 0.0, 0.0))
    made.reset()
    held = run(made, 2.0)[-1]
    kept = made.input[which].copy()
    give(made, **{which: lost})
    rows = run(made, 1.0)
    assert np.isfinite(rows).all()
    np.testing.assert_allclose(rows[0], held, atol=0.02)
    np.testing.assert_allclose(rows[-1], HOME, atol=1e-9)
    assert made.output["active"][0] == 0.0
    assert made.figures()["losses"] == 1
    give(made, **{which: kept})
    back = run(made, 2.0)
    np.testing.assert_allclose(back[-1], held, atol=1e-6)
    assert np.abs(np.diff(np.vstack([rows, back]), axis=0)).max() < 0.01, "no jump in either direction"


def test_a_short_gap_costs_a_little_of_the_compensation_only():
    made = law()
    give(made, orientation=tilted_by(0.1, 0.0, 0.0))
    made.reset()
    held = run(made, 2.0)[-1]
    give(made, orientation=np.nan)
    run(made, 0.05)
    assert made.output["active"][0] == pytest.approx(0.9)
    give(made, orientation=tilted_by(0.1, 0.0, 0.0))
    np.testing.assert_allclose(run(made, 1.0)[-1], held, atol=1e-6)


def test_a_reset_begins_where_the_limb_is():
    made = law()
    made.applied["command"][:] = np.array(HOME) + 0.2
    give(made, orientation=tilted_by(0.0, 0.15, 0.0))
    made.reset()
    np.testing.assert_array_equal(made.output["command"], np.array(HOME) + 0.2)
    rows = run(made, 1.0)
    assert np.abs(np.diff(rows, axis=0)).max() < 0.015
    fresh = law()
    give(fresh, orientation=tilted_by(0.0, 0.15, 0.0))
    fresh.reset()
    np.testing.assert_allclose(rows[-1], run(fresh, 1.0)[-1], atol=1e-9)


def test_without_a_wanted_posture_it_holds_the_tip_where_it_was():
    moved = np.array(HOME) + 0.1
    given, waiting = law(), law()
    for made in (given, waiting):
        made.applied["command"][:] = moved
        give(made, orientation=tilted_by(0.05, 0.1, 0.0))
    give(given, wanted=moved)
    give(waiting, wanted=np.nan)
    for made in (given, waiting):
        made.reset()
    np.testing.assert_array_equal(run(given, 1.0), run(waiting, 1.0))
    give(given, wanted=np.nan)
    np.testing.assert_allclose(run(given, 0.1)[-1], run(waiting, 0.1)[-1])


def test_a_tilt_beyond_belief_is_bounded_and_counted():
    made = law(most=0.2)
    give(made, orientation=tilted_by(0.1, 0.0, 0.0))
    made.reset()
    run(made, 0.5)
    give(made, orientation=tilted_by(1.0, 0.0, 0.0))
    run(made, 0.5)
    assert np.linalg.norm(made.output["tilt"]) == pytest.approx(0.2, abs=0.01)
    assert made.figures()["beyond_most"] == 0.5


@pytest.mark.parametrize("degrees", [25, 60, 90, 140, 179])
@pytest.mark.parametrize("which", ["orientation", "body"])
def test_a_sensor_that_is_mounted_wrong_moves_nothing_and_stops_the_limb(degrees, which):
    for axis in np.eye(3)[:2]:
        made = law()
        give(made, **{which: tilted_by(*np.deg2rad(degrees) * axis)})
        made.reset()
        rows = run(made, 0.45)
        assert not made.lost
        assert made.output["active"][0] == 0.0
        np.testing.assert_array_equal(rows, np.tile(HOME, (len(rows), 1)))
        rows = run(made, 2.0)
        assert made.lost
        np.testing.assert_array_equal(rows, np.tile(HOME, (len(rows), 1)))
        give(made, **{which: UNIT})
        made.reset()
        run(made, 1.0)
        assert not made.lost
        assert made.output["active"][0] == 1.0


def test_a_tilt_beyond_belief_for_long_counts_as_not_measured():
    """A sensor that has come off its base shows any angle: a wrong correction mustn't stay."""
    made = law(most=0.2)
    give(made, orientation=tilted_by(0.1, 0.0, 0.0))
    made.reset()
    run(made, 1.0)
    assert made.output["active"][0] == 1.0
    give(made, orientation=tilted_by(1.0, 0.0, 0.0))
    run(made, 0.4)
    assert made.output["active"][0] == 1.0
    run(made, 0.7)
    assert made.output["active"][0] == 0.0
    assert not made.output["tilt"].any()
    assert made.figures()["losses"] == 1
    give(made, orientation=tilted_by(0.1, 0.0, 0.0))
    run(made, 1.0)
    assert made.output["active"][0] == 1.0


@settings(deadline=None, max_examples=30)
@given(st.lists(st.tuples(turns, turns, share), min_size=2, max_size=6))
def test_outputs_are_finite_and_within_the_limits_whatever_comes(inputs):
    made = law()
    made.reset()
    run(made, 0.6)  # the difference at the reset has melted away
    for base, body, shares in inputs:
        give(made, orientation=wxyz(base), body=wxyz(body), wanted=q_of(shares))
        rows = run(made, 0.1)
        assert np.isfinite(rows).all()
        assert (rows >= LOWER - 1e-9).all()
        assert (rows <= UPPER + 1e-9).all()


def test_wrong_axes_are_refused():
    for wrong in ({"axis": [0, 0, 0]}, {"lower": 1.0, "upper": 0.0}):
        with pytest.raises(ValidationError):
            Axis.model_validate(wrong)


def worn(side: str = "right", arms: ArmsModel | None = None, **axes: Any) -> StrapBaseConfig:
    model = arms or ArmsModel.model_validate({"sides": ["right", "left"]})
    given = {f"J{i + 1}": {} for i in range(7)} | axes
    return StrapBaseConfig.model_validate({"axes": given, "arms": model, "side": side})


@pytest.mark.parametrize("side", ["right", "left"])
@given(q=st.lists(st.floats(-0.08, 0.08), min_size=7, max_size=7).map(np.array), far=st.floats(-15, 15))
def test_the_profiles_arms_are_those_of_the_skeleton(side, q, far):
    q = q * np.where(np.arange(7) == 4, 1.0, far)
    config = worn(side)
    axes, first = config.arm()
    kinematics = Kinematics(HumanSrl(human(), config.arms.arms))
    rotation = np.tile(UNIT, (59, 1))
    other = {"left": "right", "right": "left"}[side]
    nodes = kinematics.nodes(rotation, np.zeros((59, 3)), {side: q, other: np.zeros(7)})
    names = HumanSrl(human(), config.arms.arms).tree.names
    letter = side[0].upper()
    wanted = nodes[names.index(f"{letter}End")] - nodes[names.index(f"{letter}Base")]
    np.testing.assert_allclose(Correction(axes, 0.02, first).tip(q), wanted, atol=1e-9)


def test_arms_that_do_not_fit_are_refused():
    with pytest.raises((ValidationError, OptionError), match="described under"):
        worn(J3={"slides": True})
    with pytest.raises((ValidationError, OptionError), match="no left one"):
        worn("left", ArmsModel())
    with pytest.raises((ValidationError, OptionError), match="8 axes"):
        worn(J8={})
