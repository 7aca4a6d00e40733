"""The law of a base that gives way: resets, losses, tilts beyond belief, and the arms that it takes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.strap import ARM, AXES, HOME, LOWER, UNIT, UPPER, q_of, share, turns, wxyz
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from srl.control.skeleton.human import human
from srl.control.skeleton.human_srl import HumanSrl
from srl.control.skeleton.kinematics import Kinematics
from srl.control.strap.axes import Axis
from srl.control.strap.correction import Correction
from srl.control.strap.law import StrapBase, StrapBaseConfig
from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.rotation import exp
from srl.runtime.models.models import ArmsModel
from srl.testing import bound, check_controller


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
    assert made.metrics()["losses"] == 1
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
    assert made.metrics()["beyond_most"] == 0.5


@pytest.mark.parametrize("degrees", [25, 60, 90, 140, 180])
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
        assert f"tilted by {degrees} degrees" in made.why
        np.testing.assert_array_equal(rows, np.tile(HOME, (len(rows), 1)))
        give(made, **{which: UNIT})
        made.reset()
        run(made, 1.0)
        assert (made.lost, made.why) == (False, "")
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
    assert made.metrics()["losses"] == 1
    give(made, orientation=tilted_by(0.1, 0.0, 0.0))
    run(made, 1.0)
    assert made.output["active"][0] == 1.0


@pytest.mark.slow
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
