"""Hand, finger and objects in a cell: documented shapes, contacts that stop, bits that repeat."""

import numpy as np
import pytest
from helpers.sim import MS, WORN, world
from pydantic import ValidationError

from srl.runtime.contracts.signals import Signal
from srl.runtime.models.human_hand import FINGERS
from srl.sim.world.cell import CellConfig

BALL = {
    "part": "object",
    "shape": "sphere",
    "size": [0.07],
    "mass": 0.1,
    "at": {"position": [0, 0.085, -0.055]},
    "held_until": None,
}
CAN = {
    "part": "object",
    "shape": "ycb",
    "code": "D",
    "at": {"position": [0, 0.09, -0.06], "quaternion": [0.70710678, 0, 0.70710678, 0]},
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
    w = world(parts={"ball": BALL}, fingers=[{}, {"name": "other", "at": WORN | {"position": [0.03, -0.02, -0.03]}}])
    shapes = {signal.name: (signal.shape, signal.unit, signal.frame) for signal in w.truth}
    assert shapes == {
        "hand_position": ((20,), "rad", None),
        "hand_tips": ((5, 3), "m", "hand"),
        "hand_pose": ((7,), "m", None),
        **{
            f"{finger}_{name}": form
            for finger in ("finger", "other")
            for name, form in {
                "position": ((4,), "rad", None),
                "velocity": ((4,), "rad/s", None),
                "effort": ((4,), "N m", None),
                "tip": ((3,), "m", "hand"),
                "contact": ((1,), "N", None),
            }.items()
        },
        "ball_position": ((3,), "m", None),
        "ball_pose": ((7,), "m", None),
    }
    assert all(isinstance(signal, Signal) for signal in w.truth)
    w.set_servo(5, 0.7)
    w.advance(400 * MS)
    assert w.truth_arrays["other_position"][1] == pytest.approx(0.7, abs=0.05)
    with pytest.raises(IndexError):
        w.set_servo(8, 0.0)


def test_the_hand_follows_the_wearer_closely():
    w = world()
    off = []
    for _ in range(450):
        w.advance(w.time + 10 * MS)
        off.append(w.truth_arrays["hand_position"] - w.hand.wearer.target(w.time * 1e-9))
    assert np.abs(off).max() < np.deg2rad(6)
    closed = np.array(off)
    assert np.sqrt((closed**2).mean()) < np.deg2rad(1.5)


def test_fingers_stop_on_an_object_and_their_grip_is_bounded():
    free, held = run(world(), 2000), run(world(parts={"ball": BALL}), 2000)
    outside = np.linalg.norm(held["hand_tips"] - BALL["at"]["position"], axis=2) - 0.035
    assert outside.min() > -0.002  # tips' sites lie on the bone's end, the skin around them touches
    inside = np.linalg.norm(free["hand_tips"] - BALL["at"]["position"], axis=2) - 0.035
    assert inside.min() < -0.002  # without the ball they would have gone through that place
    middle = FINGERS.index("middle")
    assert held["hand_position"][-1, 4 * middle + 1] < free["hand_position"][-1, 4 * middle + 1] - 0.1


def test_the_extra_finger_stops_on_an_object_with_a_bounded_force():
    w = world(parts={"ball": BALL}, wearer={"period": 1000.0})
    close_finger(w)
    rows = run(w, 1500)
    force = rows["finger_contact"][:, 0]
    assert force[0] == 0.0
    assert 0.3 < force[-1] < 15.0
    assert force.max() < 60.0  # the blow of arriving at 8 rad/s
    assert rows["finger_position"][-1, 1] < 0.9  # stopped on the way to 1.0
    assert np.abs(rows["finger_effort"][-1]).max() < 0.145  # pushed back slowly, it resists a little more
    np.testing.assert_allclose(rows["ball_position"], [BALL["at"]["position"]] * 150)


def test_a_free_object_falls_and_a_held_one_waits():
    held = CAN | {"held_until": 0.2, "at": CAN["at"] | {"position": [0, 0.09, -0.12]}}
    w = world(parts={"can": held}, gravity=(0, 0, -9.81), wearer={"period": 1000.0})
    rows = run(w, 500)["can_position"]
    np.testing.assert_allclose(rows[:20], [held["at"]["position"]] * 20, atol=3e-4)
    fall = 0.5 * 9.81 * 0.3**2
    assert rows[-1, 2] - rows[19, 2] == pytest.approx(-fall, rel=0.15)


def scene(seed=3):
    w = world(seed=seed, parts={"can": CAN | {"held_until": 1.2}})
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
    index = 2 + len(straight.parts) + 1 + 21  # header, MuJoCo's time, and a servo's angle
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
        record[w.time] = w.hand.position()
    for back in (0, 1, 5, 10, 14, 137, 600):
        at = w.time - back * MS
        np.testing.assert_allclose(w.hand.position(at), record[at], atol=np.deg2rad(0.15))
    np.testing.assert_array_equal(w.hand.position(1300 * MS), record[1300 * MS])
    np.testing.assert_array_equal(w.hand.position(0), w.hand.position(w.time - 640 * MS))  # the oldest there is


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"part": "object", "shape": "box", "size": [0.1], "mass": 1}, "3 positive"),
        ({"part": "object", "shape": "ycb", "code": "J"}, "code"),
        ({"part": "object", "shape": "ycb"}, "code"),
        ({"part": "robotic-finger", "model": "thum"}, "no finger called 'thum'"),
        ({"part": "robotic-finger", "links": []}, "links"),
        ({"part": "human-hand", "side": "left"}, "side"),
    ],
)
def test_wrong_options_are_refused(options, words):
    with pytest.raises(ValidationError, match=words):
        CellConfig.model_validate({"parts": {"thing": options}})


def test_the_run_ends_with_the_wearers_recording(tmp_path):
    path = tmp_path / "grasp.csv"
    names = ["index_mcp_flexion", "index_pip_flexion", "middle_mcp_flexion", "ring_mcp_flexion", "little_mcp_flexion"]
    rows = [",".join(map(str, [0.1 * k, *[0.05 * k] * 5])) for k in range(13)]
    path.write_text("\n".join([",".join(["time", *names]), *rows, ""]))
    assert world(wearer={"recording": str(path)}).duration == pytest.approx(1.2)
    assert world(wearer={"recording": str(path), "speed": 2.0}).duration == pytest.approx(0.6)
    assert world(wearer={"recording": str(path), "loop": True}).duration is None
    assert world(wearer={"recording": str(path)}, duration=0.5).duration == 0.5
    assert world().duration is None


def test_two_hands_follow_wearers_of_their_own():
    w = world(parts={"left": {"part": "human-hand", "at": {"position": [0.3, 0, 0]}, "wearer": {"period": 1000.0}}})
    run(w, 1000)
    assert np.abs(w.truth_arrays["hand_position"] - w.truth_arrays["left_position"]).max() > 0.3


def test_forces_stay_after_a_restore_without_a_step():
    a, b = (world(parts={"ball": BALL}, wearer={"period": 1000.0}) for _ in range(2))
    close_finger(a)
    run(a, 900)
    b.restore(a.save())
    b.advance(a.time)
    assert a.truth_arrays["finger_contact"][0] > 0.1
    for name, values in a.truth_arrays.items():
        np.testing.assert_array_equal(b.truth_arrays[name], values, name)
