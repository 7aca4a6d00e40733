"""The controller: start, oracles through both controllers, lag, drift, noise, wiring."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.control import (
    FIST,
    HOME,
    RELAXED,
    WORN,
    adroit_hand,
    bound,
    finger_tip,
    glove,
    hand_tips,
    mapping,
    step,
)
from helpers.shared import shared
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from srl.control.hand.extra_finger import ExtraFinger
from srl.control.hand.object_mapping import ObjectMapping, ObjectMappingConfig
from srl.runtime.contracts.errors import ProfileError
from srl.runtime.contracts.signals import Array
from srl.runtime.models.human_hand import FINGERS
from srl.runtime.models.models import FingerModel

TIPS = hand_tips(RELAXED)
PARTIAL = ("middle", "ring", "little")


def closing(u: float) -> Array:
    """Fingertips from relaxed (0) to a fist (1)."""
    return hand_tips(RELAXED + u * (FIST - RELAXED))


def test_first_output_and_a_still_hand_are_the_applied() -> None:
    controller = mapping(TIPS)
    np.testing.assert_array_equal(controller.output["q"], HOME)
    np.testing.assert_array_equal(controller.output["q_velocity"], 0.0)
    for _ in range(5):
        np.testing.assert_array_equal(step(controller, TIPS), HOME)
        np.testing.assert_array_equal(controller.output["q_velocity"], 0.0)


def test_documented_shapes_are_true() -> None:
    two = (
        ExtraFinger(name="a"),
        ExtraFinger(name="b", model=FingerModel(rows=((0.0, 0.05),) * 2, lower=(-1, -1), upper=(1, 1))),
    )
    controller = mapping(TIPS, np.r_[HOME, 0.2, 0.3], fingers=two)
    step(controller, TIPS + 1e-3)
    for signal in controller.outputs:
        assert controller.output[signal.name].shape == signal.shape
        assert len(signal.labels) in (0, signal.shape[0])
    skeleton, target = controller.output["skeleton"], controller.output["target"]
    links = {s.name: s for s in controller.outputs}["skeleton"].links
    assert [len(link) for link in links] == [5, 3]
    assert sorted(sum(links, ())) == list(range(len(skeleton)))
    step(controller, TIPS + 1e-3)
    np.testing.assert_allclose(skeleton[links[0][-1]], target[0], atol=1e-4)
    sphere, cloud = controller.output["sphere"], np.concatenate([TIPS + 1e-3, skeleton[[4, 7]]])
    assert np.linalg.norm(cloud - sphere[:3], axis=1).max() == pytest.approx(sphere[3], rel=1e-9)


@given(
    arrays(float, 3, elements=st.floats(-1, 1)), st.floats(-0.2, 0.1), arrays(float, 3, elements=st.floats(-0.02, 0.02))
)
@settings(max_examples=30)
def test_an_object_that_only_scales_moves_and_shrinks_with_the_fingertips_and_doesnt_turn(
    w: Array, shrink: float, shift: Array
) -> None:
    """The tip's target is that of the same motion without its rotation."""
    controller = mapping(TIPS, deformation="scaling", max_following_error=1.0)
    start, centre = finger_tip(HOME), TIPS.mean(axis=0)
    for u in np.linspace(0.05, 1.0, 20):
        R, scale = Rotation.from_rotvec(0.3 * u * w).as_matrix(), np.exp(u * shrink)
        step(controller, centre + u * shift + scale * (TIPS - centre) @ R.T)
        expected = centre + u * shift + scale * (start - centre)
        np.testing.assert_allclose(controller.output["target"][0], expected, rtol=0, atol=3e-5)


@pytest.mark.parametrize("deformation", ["isotropic", "scaling", "concentric"])
def test_a_fingertip_that_isnt_a_number_moves_nothing_and_ends(deformation: str) -> None:
    controller = mapping(TIPS, deformation=deformation)
    lost = TIPS.copy()
    lost[1, 0] = np.nan
    start = controller.output["target"].copy()
    np.testing.assert_allclose(step(controller, lost), HOME, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(controller.output["target"], start)
    assert np.isfinite(step(controller, 1.01 * TIPS)).all()  # measured again, it goes on
    assert (controller.output["target"] != start).any()


@pytest.mark.parametrize("lost", [[2], [0], [0, 3], [0, 1, 2, 3, 4]])
@pytest.mark.parametrize("deformation", ["isotropic", "scaling", "concentric"])
def test_a_hand_that_isnt_measured_at_a_reset_becomes_the_reference_once_it_is(
    deformation: str, lost: list[int]
) -> None:
    controller = mapping(TIPS, deformation=deformation)
    start = controller.output["q"].copy()
    controller.input["tips"][lost] = np.nan
    controller.reset()
    assert np.isfinite(controller.output["sphere"]).all()
    assert np.isnan(controller.metrics()["noise_gain"])  # the run may end here
    for _ in range(3):
        np.testing.assert_allclose(step(controller, controller.input["tips"].copy()), start, rtol=0, atol=1e-12)
    np.testing.assert_allclose(step(controller, TIPS), start, rtol=0, atol=1e-12)  # no jump to what it is by now
    step(controller, 0.95 * TIPS)
    assert np.abs(controller.output["q"] - start).max() > 1e-4
    assert np.isfinite(controller.output["target"]).all()


@given(arrays(float, 3, elements=st.floats(-1, 1)), st.sampled_from(["move", "turn", "scale"]))
@settings(max_examples=40)
def test_the_robotic_tip_follows_the_objects_motion(w: Array, kind: str) -> None:
    """In 20 steps, with the default drift pull and damping: target exact, joints to their linearisation."""
    controller, start, centre = mapping(TIPS), finger_tip(HOME), TIPS.mean(axis=0)
    for u in np.linspace(0.05, 1.0, 20):
        R = Rotation.from_rotvec(0.1 * u * w).as_matrix() if kind == "turn" else np.eye(3)
        s = 1.0 + 0.05 * u * w[0] if kind == "scale" else 1.0
        shift = 0.005 * u * w if kind == "move" else 0.0

        def transform(p: Array, R: Array = R, s: float = s, shift: Array | float = shift) -> Array:
            return s * (p - centre) @ R.T + centre + shift

        step(controller, transform(TIPS))
        np.testing.assert_allclose(controller.output["target"][0], transform(start), atol=1e-9)
    q = [step(controller, transform(TIPS)) for _ in range(20)][-1]
    np.testing.assert_allclose(finger_tip(q), transform(start), atol=1e-6)


def test_a_closing_hand_closes_the_finger_and_opening_returns_it() -> None:
    controller = mapping(TIPS)
    distance = [np.linalg.norm(finger_tip(HOME) - TIPS, axis=1)]
    for u in (1 - np.cos(np.linspace(0, 2 * np.pi, 300))) / 2:
        q = step(controller, closing(0.7 * u))
        distance.append(np.linalg.norm(finger_tip(q) - closing(0.7 * u), axis=1))
    mean = np.mean(distance, axis=1)
    assert mean[150] < 0.75 * mean[0]
    assert mean[-1] == pytest.approx(mean[0], abs=0.005)


def test_velocity_is_the_derivative_of_the_command() -> None:
    """For a steady motion, at the glove's rate and at ten times it, where the glove's samples are held."""
    for dt, held in ((0.01, 1), (0.001, 10)):
        controller = mapping(TIPS)
        u = np.repeat(np.arange(60) * 0.005, held)
        q = np.array([step(controller, closing(x), dt) for x in u])
        expected = (q[-1] - q[-20 * held]) / ((20 * held - 1) * dt)
        np.testing.assert_allclose(controller.output["q_velocity"], expected, atol=0.35 * np.abs(expected).max())


@pytest.mark.parametrize("speed", [0.2, 1.0])
def test_motion_held_back_by_the_guard_is_made_up_for(speed: float) -> None:
    """A guard slower than the hand: no wind-up, and the finger ends where the free one does."""
    free, slow = mapping(TIPS), mapping(TIPS)
    for u in np.r_[np.linspace(0, 0.15, 30), np.full(200, 0.15)]:
        expected = step(free, closing(u))
        before = slow.applied["q"].copy()
        slow.input["tips"][:] = closing(u)
        slow.update(0.01)
        ahead = np.linalg.norm(slow.output["target"][0] - finger_tip(before))
        assert ahead <= slow._max_following_error + 1e-12
        slow.applied["q"][:] = before + np.clip(slow.output["q"] - before, -speed * 0.01, speed * 0.01)
    np.testing.assert_allclose(finger_tip(slow.applied["q"]), finger_tip(expected), atol=1e-4)


def test_a_blocked_finger_does_not_wind_up() -> None:
    controller = mapping(TIPS)
    for u in np.linspace(0.0, 0.8, 200):
        controller.input["tips"][:] = closing(u)
        controller.update(0.01)  # applied stays at home
        assert np.linalg.norm(controller.output["target"][0] - finger_tip(HOME)) <= 0.03 + 1e-12
        assert np.abs(controller.output["q"] - HOME).max() < 1.5
    assert controller.metrics()["error_limited"] > 50


def loop(radius: float = 1.0, samples: int = 200) -> Array:
    """Fingertips (samples, 5, 3) on a closed way that isn't retraced: closing spread, opening together."""
    phase = np.linspace(0, 2 * np.pi, samples + 1)[1:]
    spread = np.zeros(20)
    spread[[0, 4, 12, 16]] = [-0.5, 0.2, -0.2, -0.4]
    flex = 0.5 * (FIST - RELAXED) * radius
    return np.array([hand_tips(RELAXED + flex * (1 - np.cos(t)) / 2 + radius * spread * np.sin(t)) for t in phase])


def drift_per_loop(pull: float, points: tuple[str, ...], loops: int = 6) -> tuple[Array, float]:
    """m: how far each loop leaves the target from the loop before, and the last from the start."""
    way = loop()
    controller = mapping(way[-1], points=points)
    controller.param["drift_pull"][()] = pull
    ends = [controller.output["target"][0].copy()]
    for _ in range(loops):
        for tips in way:
            step(controller, tips)
        ends.append(controller.output["target"][0].copy())
    return np.linalg.norm(np.diff(ends, axis=0), axis=1), float(np.linalg.norm(ends[-1] - ends[0]))


@pytest.mark.parametrize(("points", "bound"), [(FINGERS, 0.008), (PARTIAL, 0.030)])
def test_closed_loops_drift_and_the_pull_bounds_it(points: tuple[str, ...], bound: float) -> None:
    """(2)-(5) are not holonomic: each loop adds its drift, for ever. With the pull, loop ends converge."""
    law, total_law = drift_per_loop(0.0, points)
    pulled, total = drift_per_loop(5.0, points)
    assert pulled[-1] < 0.2 * law[-1]
    assert total < 0.5 * total_law
    assert total < bound


def test_a_similarity_leaves_the_pull_nothing_to_do() -> None:
    ends = []
    for pull in (0.0, 100.0):
        controller = mapping(TIPS)
        controller.param["drift_pull"][()] = pull
        for t in np.linspace(0, 1, 50):
            step(controller, (1 - 0.1 * t) * TIPS + [0, 0, 0.01 * t])
        ends.append(controller.output["target"].copy())
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-9)


@pytest.mark.parametrize("points", [("middle", "ring"), ("index",), PARTIAL, ("little", "thumb", "index", "ring")])
def test_any_choice_of_points(points: tuple[str, ...]) -> None:
    controller, other = mapping(TIPS, points=points), mapping(TIPS, points=points)
    idle = [i for i, f in enumerate(FINGERS) if f not in points]
    for u in np.linspace(0.0, 1.0, 100):
        q = step(controller, closing(u))
        assert np.all(np.isfinite(q))
        assert np.all(np.abs(q) <= np.pi / 2 + 1e-12)
        tips = closing(u)
        tips[idle] += 0.01 * np.sin(50 * u)
        np.testing.assert_array_equal(step(other, tips), q)
    assert np.abs(q - HOME).max() > 0.05


@given(arrays(float, (6, 5, 3), elements=st.floats(-0.3, 0.3)), st.sampled_from([5, 3, 2, 1]))
@settings(max_examples=60)
def test_any_fingertips_give_finite_commands_within_limits(ways: Array, n_h: int) -> None:
    names = ("thumb", "index", "middle", "ring", "little")[:n_h]
    controller = mapping(TIPS, points=names)
    for tips in (*ways, np.zeros((5, 3)), *ways):
        q = step(controller, tips)
        assert np.all(np.isfinite(q))
        assert np.all(np.isfinite(controller.output["q_velocity"]))
        assert np.all(np.abs(q) <= np.pi / 2 + 1e-12)
        assert np.all(np.isfinite(controller.output["sphere"]))


def test_same_inputs_give_the_same_bits() -> None:
    runs = []
    for _ in range(2):
        controller = mapping(TIPS)
        runs.append([np.concatenate([step(controller, t), controller.output["q_velocity"]]) for t in loop(1.0, 80)])
    assert np.array(runs[0]).tobytes() == np.array(runs[1]).tobytes()


def test_reset_forgets_the_past() -> None:
    used, fresh = mapping(TIPS), mapping(closing(0.5), HOME + 0.1)
    for tips in loop(1.0, 40):
        step(used, tips)
    used.input["tips"][:] = closing(0.5)
    used.applied["q"][:] = HOME + 0.1
    used.reset()
    for u in np.linspace(0.5, 0.6, 10):
        np.testing.assert_array_equal(step(used, closing(u)), step(fresh, closing(u)))
    assert used.metrics() == fresh.metrics()


def test_partial_mapping_reports_its_noise_gain_before_and_after() -> None:
    metrics = mapping(closing(0.4), points=PARTIAL).metrics()
    assert metrics["noise_gain"] < 3.0 < metrics["noise_gain_undamped"]
    whole = mapping(closing(0.4)).metrics()
    assert whole["noise_gain"] == whole["noise_gain_undamped"] < 2.0


def test_two_fingers_share_one_object() -> None:
    """Each of two extra fingers moves as it would alone."""
    pair, places = (ExtraFinger(name="first"), ExtraFinger(name="second")), {"second": (0.03, *WORN[1:])}
    both = mapping(TIPS, np.r_[HOME, HOME], places, fingers=pair)
    alone = [mapping(TIPS, HOME, {n: p for n, p in places.items() if n == f.name}, fingers=(f,)) for f in pair]
    for u in np.linspace(0.0, 0.3, 30):
        q = step(both, closing(u))
        np.testing.assert_allclose(q, np.concatenate([step(c, closing(u)) for c in alone]), atol=1e-12)


def test_recorded_hands_drive_the_finger() -> None:
    """A person's door openings, from glove angles on through both controllers."""
    data = np.load(shared("data/cyberglove_adroit_door/door_demos.npz"))
    angles = data["hand_position"][data["episode"] == 3].astype(float)
    hand, controller = glove(), None
    order = [1, 2, 3, 0, 5, 6, 7, 9, 10, 11, 4, 13, 14, 15, None, 17, 18, 19, None]
    steps = []
    for position in angles:
        q = adroit_hand(position)
        for sensor, joint in enumerate(order):
            hand.input["angles"][sensor] = 0.0 if joint is None else q[joint]
        hand.update(0.01)
        controller = controller or mapping(hand.output["tips"])
        steps.append(step(controller, hand.output["tips"]))
    assert np.all(np.isfinite(steps))
    assert np.ptp(steps, axis=0).max() > 0.3  # it does follow
    metrics = controller.metrics()
    assert metrics["nearest_to_thumb_m"] < np.linalg.norm(finger_tip(HOME) - hand_tips(np.zeros(20))[0])


@pytest.mark.parametrize("options", [{"points": ("thumb", "thumb")}, {"fingers": (ExtraFinger(), ExtraFinger())}])
def test_doubled_names_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(ProfileError, match="more than once"):
        ObjectMapping("mapping", ObjectMappingConfig(**options))


def test_without_a_device_it_goes_on_from_its_own_output() -> None:
    controller = bound(ObjectMapping("mapping", ObjectMappingConfig()), finger=WORN)
    controller.applied = {}
    controller.output["q"][:] = HOME
    controller.input["tips"][:] = TIPS
    controller.reset()
    reference = mapping(TIPS)
    for u in np.linspace(0, 0.2, 20):
        controller.input["tips"][:] = closing(u)
        controller.update(0.01)
        np.testing.assert_array_equal(controller.output["q"], step(reference, closing(u)))
