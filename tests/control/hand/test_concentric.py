"""An object that closes about its own centre: exact, without drift, and its finger comes to meet the hand."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.control import FIST, HOME, RELAXED, finger_tip, hand_tips, mapping, step
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from srl.control.hand.concentric import ConcentricObject
from srl.control.hand.sphere import MinimumSphere
from srl.runtime.contracts.errors import ProfileError
from srl.runtime.contracts.signals import Array

TIPS, ROBOT = hand_tips(RELAXED), finger_tip(HOME)[None]
CENTRE = np.array(MinimumSphere().around(np.concatenate([TIPS, ROBOT]).tolist()))[:3]


@given(st.floats(0.2, 2.0), st.floats(-0.5, 0.5))
def test_a_size_is_carried_on_exactly_and_a_turn_about_the_centre_not_at_all(scale: float, turn: float) -> None:
    held = ConcentricObject(TIPS, ROBOT, CENTRE)
    R = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    tips = CENTRE + scale * (TIPS - CENTRE) @ R.T
    np.testing.assert_allclose(held.carry(tips), CENTRE + scale * (ROBOT - CENTRE), rtol=0, atol=1e-12)


def test_fingertips_that_come_toward_the_finger_are_met() -> None:
    """The published law takes the common motion for the object's, and the finger away with it."""
    toward = (ROBOT[0] - TIPS.mean(axis=0)) / np.linalg.norm(ROBOT[0] - TIPS.mean(axis=0))
    ways = {}
    for deformation in ("isotropic", "concentric"):
        controller = mapping(TIPS, deformation=deformation, max_following_error=1.0)
        for u in np.linspace(0.0, 0.03, 20):
            step(controller, TIPS + u * toward)
        ways[deformation] = float((controller.output["target"][0] - ROBOT[0]) @ toward)
    assert ways["isotropic"] == pytest.approx(0.03, rel=1e-3)
    assert -0.04 < ways["concentric"] < -0.01


def test_it_begins_at_the_applied_and_a_closed_motion_ends_there() -> None:
    controller = mapping(TIPS, deformation="concentric")
    np.testing.assert_array_equal(controller.output["q"], HOME)
    np.testing.assert_array_equal(step(controller, TIPS), HOME)
    start = controller.output["target"].copy()
    for u in np.r_[np.linspace(0, 1, 60), np.linspace(1, 0, 60)]:
        step(controller, hand_tips(RELAXED + u * (FIST - RELAXED)))
    np.testing.assert_allclose(controller.output["target"], start, rtol=0, atol=1e-9)


def test_psi_has_nothing_to_choose() -> None:
    with pytest.raises(ProfileError, match=r"psi: an object that only grows"):
        mapping(TIPS, deformation="concentric", psi="minimum-norm")


@given(arrays(float, (5, 3), elements=st.floats(-0.03, 0.03)))
def test_its_noise_gain_is_that_of_its_differences(shift: Array) -> None:
    held, tips = ConcentricObject(TIPS, ROBOT, CENTRE), TIPS + shift
    h, columns = 1e-7, []
    for i in range(15):
        d = np.zeros(15)
        d[i] = h
        columns.append((held.carry(tips + d.reshape(5, 3)) - held.carry(tips - d.reshape(5, 3)))[0] / (2 * h))
    assert held.noise_gain(tips) == pytest.approx(np.linalg.norm(columns) / np.sqrt(3.0), rel=1e-5)


def test_points_in_the_centre_tell_no_size() -> None:
    held = ConcentricObject(np.tile(CENTRE, (5, 1)), ROBOT, CENTRE)
    np.testing.assert_allclose(held.carry(TIPS), ROBOT, rtol=0, atol=1e-15)
    assert held.noise_gain(TIPS) == 0.0


@pytest.mark.parametrize(
    ("points", "gain"), [(("thumb", "index", "middle", "ring", "little"), 0.27), (("middle", "ring", "little"), 0.33)]
)
def test_the_noise_gain_of_the_figures(points: tuple[str, ...], gain: float) -> None:
    controller = mapping(TIPS, deformation="concentric", points=points)
    assert controller.metrics()["noise_gain"] == pytest.approx(gain, rel=0.05)
