"""The world: documented shapes, contacts that stop, bits that repeat."""

import numpy as np
import pytest
from helpers.sim import MS, world
from pydantic import ValidationError

from runtime.contracts.signals import Signal
from runtime.control.hand.human_hand import FINGERS
from sim.augmented_hand import AugmentedHandConfig

BALL = {"shape": "sphere", "size": [0.07], "mass": 0.1, "position": [0, 0.085, -0.055], "held_until": None}
CAN = {
    "shape": "ycb",
    "code": "D",
    "position": [0, 0.09, -0.06],
    "quaternion": [0.70710678, 0, 0.70710678, 0],
}


def run(w, milliseconds, period=10):
    """Truth after each period, by name."""
    rows = {signal.name: [] for signal in w.truth}
    for _ in range(milliseconds // period):
        w.advance(w.time + period * MS)
        for name, values in rows.items():
            values.append(w.truth_arrays[name].copy())
    return {name: np.array(values) for name, values in rows.items()}


def close_finger(w, q=(0.0, 1.0, 1.0, 0.8)):
    for i, target in enumerate(q):
        w.set_servo(i, target, at=w.time)


def test_truth_has_the_documented_signals():
    w = world(objects=[BALL], fingers=[{}, {"name": "other", "origin": [0.03, -0.02, -0.03]}])
    shapes = {signal.name: (signal.shape, signal.unit, signal.frame) for signal in w.truth}
    assert shapes == {
        "hand_position": ((20,), "rad", None),
        "finger_position": ((8,), "rad", None),
        "finger_velocity": ((8,), "rad/s", None),
        "finger_effort": ((8,), "N m", None),
        "hand_tips": ((5, 3), "m", "hand"),
        "finger_tip": ((2, 3), "m", "hand"),
        "contact_force": ((2,), "N", None),
        "object_position": ((1, 3), "m", "hand"),
    }
    assert all(isinstance(signal, Signal) for signal in w.truth)
    w.set_servo(5, 0.7)
    w.advance(400 * MS)
    assert w.finger_position()[5] == pytest.approx(0.7, abs=0.05)
    with pytest.raises(IndexError):
        w.set_servo(8, 0.0)


def test_the_hand_follows_the_wearer_closely():
    w = world()
    off = []
    for _ in range(450):
        w.advance(w.time + 10 * MS)
        off.append(w.truth_arrays["hand_position"] - w.wearer.target(w.time * 1e-9))
    assert np.abs(off).max() < np.deg2rad(6)
    closed = np.array(off)
    assert np.sqrt((closed**2).mean()) < np.deg2rad(1.5)


def test_fingers_stop_on_an_object_and_their_grip_is_bounded():
    free, held = run(world(), 2000), run(world(objects=[BALL]), 2000)
    outside = np.linalg.norm(held["hand_tips"] - BALL["position"], axis=2) - 0.035
    assert outside.min() > -0.002  # tips' sites lie on the bone's end, the skin around them touches
    inside = np.linalg.norm(free["hand_tips"] - BALL["position"], axis=2) - 0.035
    assert inside.min() < -0.002  # without the ball they would have gone through that place
    middle = FINGERS.index("middle")
    assert held["hand_position"][-1, 4 * middle + 1] < free["hand_position"][-1, 4 * middle + 1] - 0.1


def test_the_extra_finger_stops_on_an_object_with_a_bounded_force():
    w = world(objects=[BALL], wearer={"period": 1000.0})
    close_finger(w)
    rows = run(w, 1500)
    force = rows["contact_force"][:, 0]
    assert force[0] == 0.0
    assert 0.3 < force[-1] < 15.0
    assert force.max() < 60.0  # the blow of arriving at 8 rad/s
    assert rows["finger_position"][-1, 1] < 0.9  # stopped on the way to 1.0
    assert np.abs(rows["finger_effort"][-1]).max() < 0.142  # creeping back, it resists a little more
    np.testing.assert_allclose(rows["object_position"], [[BALL["position"]]] * 150)


def test_a_free_object_falls_and_a_held_one_waits():
    held = CAN | {"held_until": 0.2, "position": [0, 0.09, -0.12]}
    w = world(objects=[held], gravity=(0, 0, -9.81), wearer={"period": 1000.0})
    rows = run(w, 500)["object_position"][:, 0]
    np.testing.assert_allclose(rows[:20], [held["position"]] * 20, atol=3e-4)
    fall = 0.5 * 9.81 * 0.3**2
    assert rows[-1, 2] - rows[19, 2] == pytest.approx(-fall, rel=0.15)


def scene(seed=3):
    w = world(seed=seed, objects=[CAN | {"held_until": 1.2}])
    close_finger(w)
    w.set_servo(3, 0.3, at=1307 * MS)
    return w


def test_two_runs_give_the_same_bits_and_another_seed_others():
    a, b, c = scene(), scene(), scene(seed=4)
    for w in (a, b, c):
        run(w, 1800)
    assert a.save().tobytes() == b.save().tobytes()
    assert a.save().tobytes() != c.save().tobytes()


def test_the_loops_period_does_not_change_the_physics():
    a, b = scene(), scene()
    run(a, 1800, period=10)
    run(b, 1800, period=3)
    a.advance(1_800_000_000)
    b.advance(1_800_000_000)
    np.testing.assert_array_equal(a.save(), b.save())


@pytest.mark.parametrize("cut", [700, 1195, 1203, 1600])
def test_a_restored_world_goes_on_bit_for_bit(cut):
    straight, other = scene(), scene(seed=3)
    run(straight, cut, period=1 if cut % 10 else 10)
    state = straight.save()
    run(other, 40)
    other.restore(state)
    assert other.time == straight.time
    for name, values in straight.truth_arrays.items():
        np.testing.assert_array_equal(other.truth_arrays[name], values)
    np.testing.assert_array_equal(other.save(), state)
    expected, found = run(straight, 600), run(other, 600)
    for name in expected:
        np.testing.assert_array_equal(found[name], expected[name])
    assert straight.save().tobytes() == other.save().tobytes()


def test_a_perturbed_state_goes_elsewhere():
    straight, other = scene(), scene()
    run(straight, 1300)
    state = straight.save()
    index = 2 + 1 + 21  # header, MuJoCo's time, and a servo's angle
    state[index] += 1e-9
    other.restore(state)
    run(straight, 100)
    run(other, 100)
    assert straight.save().tobytes() != other.save().tobytes()


def test_the_hands_past_can_be_asked_for():
    w = world()
    record = {}
    for _ in range(1500):
        w.advance(w.time + MS)
        record[w.time] = w.hand_position()
    for back in (0, 1, 5, 10, 14, 137, 600):
        at = w.time - back * MS
        np.testing.assert_allclose(w.hand_position(at), record[at], atol=np.deg2rad(0.15))
    np.testing.assert_array_equal(w.hand_position(1300 * MS), record[1300 * MS])
    np.testing.assert_array_equal(w.hand_position(0), w.hand_position(w.time - 630 * MS))  # the oldest there is


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"objects": [{"shape": "box", "size": [0.1], "mass": 1, "position": [0, 0, 0]}]}, "3 positive"),
        ({"objects": [{"shape": "ycb", "code": "J", "position": [0, 0, 0]}]}, "code"),
        ({"objects": [{"shape": "ycb", "position": [0, 0, 0]}]}, "code"),
        ({"fingers": [{}, {}]}, "name"),
        ({"fingers": []}, "fingers"),
        ({"timestep": 0.1}, "timestep"),
        ({"windspeed": 1}, "windspeed"),
    ],
)
def test_wrong_options_are_refused(options, words):
    with pytest.raises(ValidationError, match=words):
        AugmentedHandConfig.model_validate(options)
