"""The law: taught live, run, paused and resumed by presses or actions; what is lost stops it."""

import json

import numpy as np
import pytest
from helpers.operation import ACCELERATION, DT, SPEED, cycle, law, press, teach

from srl.control.operation.law import IndependentOperation, Mode
from srl.runtime.contracts.files import KeptFile

SHIFT = (-0.15, -0.3, 0.12)  # from the stretched hand's path to where the arm has room


def mode(made: IndependentOperation) -> Mode:
    return Mode(int(made.output["state"][0]))


def until(made: IndependentOperation, wanted: Mode, most: float = 60.0) -> float:
    """Cycles until it is so; the seconds."""
    for k in range(round(most / DT)):
        if mode(made) is wanted:
            return k * DT
        cycle(made)
    raise AssertionError(f"never {wanted.name}: {made.metrics()}")


def taught(**options: object) -> IndependentOperation:
    made = law(shift=SHIFT, **options)
    assert mode(made) is Mode.NO_TASK
    teach(made)
    assert mode(made) is Mode.PAUSED, made.metrics()["refused"]
    return made


def test_what_the_hand_has_shown_is_repeated_where_it_was_shifted() -> None:
    made = law(shift=SHIFT)
    places = teach(made) + SHIFT
    press(made)
    targets = []
    for _ in range(3000):
        if mode(made) is Mode.DONE:
            break
        cycle(made)
        tip = made._worn.tip(made.input["position"])[0]
        if made.output["phase"][0] > 0.0:
            targets.append(np.linalg.norm(places - tip, axis=1).min())
    assert len(targets) > 200
    assert max(targets) < 0.02
    found = made.metrics()
    assert (found["done"], found["taught"], found["refused"]) == (1, 1, None)
    assert found["error_max_mm"] < 12.0


@pytest.mark.slow
def test_commands_keep_speed_and_acceleration_from_cycle_to_cycle() -> None:
    made = taught()
    q = [made.output["q"].copy(), made.output["q"].copy()]
    rng = np.random.default_rng(3)
    for _ in range(900):
        if rng.random() < 0.01:
            made.input["press"][0] += 1.0
        q.append(cycle(made))
    v = np.diff(q, axis=0) / DT
    assert np.abs(v).max(axis=0) == pytest.approx(np.minimum(np.abs(v).max(axis=0), SPEED), abs=1e-9)
    assert (np.abs(np.diff(v, axis=0)) <= ACCELERATION * DT + 1e-9).all()
    assert made.metrics()["pauses"] > 1


def test_press_pauses_and_the_next_resumes_at_the_same_phase() -> None:
    made = taught()
    press(made)
    while made.output["phase"][0] < 1.0:
        cycle(made)
    press(made)
    for _ in range(100):
        cycle(made)
    assert mode(made) is Mode.PAUSED
    phase, q = made.output["phase"][0], made.output["q"].copy()
    assert (made.output["q_velocity"] == 0.0).all()
    cycle(made)
    assert (made.output["q"] == q).all()
    press(made)
    assert made.output["phase"][0] == pytest.approx(phase, abs=0.01)
    until(made, Mode.DONE)


@pytest.mark.slow
def test_repeats_are_counted_and_a_press_after_the_end_begins_again() -> None:
    made = taught(repeats=2)
    press(made)
    until(made, Mode.DONE)
    assert made.metrics()["done"] == 2
    press(made)
    assert mode(made) in (Mode.GOING, Mode.WAITING)
    until(made, Mode.DONE)
    assert made.metrics()["done"] == 4


def test_actions_run_and_pause_it_when_they_begin() -> None:
    made = taught(button=False, intention={"run": "wave", "pause": "point"})
    assert made.inputs[3].labels == ("wave", "point")
    made.input["action"][:] = 1.0, 0.0
    cycle(made)
    assert mode(made) in (Mode.GOING, Mode.WAITING)
    made.input["action"][:] = 0.0, 1.0
    cycle(made)
    assert mode(made) is Mode.PAUSED
    cycle(made)
    made.input["action"][:] = 1.0, 1.0
    cycle(made)
    assert mode(made) in (Mode.GOING, Mode.WAITING)


def test_action_that_holds_at_the_reset_begins_nothing() -> None:
    made = taught(button=False, intention={"run": "wave", "pause": "point"})
    made.input["action"][:] = 1.0, 0.0
    made.reset()
    cycle(made)
    assert mode(made) is Mode.PAUSED


@pytest.mark.parametrize("name", ["rotation", "translation", "position", "press", "teach"])
def test_what_is_missing_brakes_pauses_and_is_a_loss_after_the_patience(name: str) -> None:
    made = taught()
    press(made)
    until(made, Mode.GOING)
    for _ in range(30):
        cycle(made)
    keep = made.input[name].copy()
    v = made.output["q_velocity"].copy()
    made.input[name][..., 0] = np.nan
    for _k in range(10):
        before = v
        made.update(DT)
        v = made.output["q_velocity"].copy()
        assert np.isfinite(made.output["q"]).all()
        assert (np.abs(v - before) <= ACCELERATION * DT + 1e-9).all()
        assert np.abs(v).max() <= np.abs(before).max()
        assert mode(made) is Mode.PAUSED
        assert not made.lost
        made.applied["q"][:] = made.output["q"]
    made.update(DT)
    assert made.lost
    made.input[name][:] = keep
    cycle(made)
    assert not made.lost
    # Nothing goes on by itself.
    assert mode(made) is Mode.PAUSED


def test_reset_holds_the_limb_and_keeps_the_phase() -> None:
    made = taught()
    press(made)
    while made.output["phase"][0] < 1.0:
        cycle(made)
    phase = made.output["phase"][0]
    made.applied["q"][:] = made.input["position"][:] = made.output["q"] + 0.1
    made.reset()
    assert (made.output["q"] == made.applied["q"]).all()
    assert (made.output["q_velocity"] == 0.0).all()
    before = made.output["q"].copy()
    cycle(made)
    assert mode(made) is Mode.PAUSED
    assert (made.output["q"] == before).all()
    assert made.output["phase"][0] == phase


def test_demonstration_out_of_reach_is_refused_and_the_earlier_task_stays() -> None:
    made = taught()
    path = made._replay.path
    made._teaching._shift[:] = 0.0, 0.0, 2.0
    teach(made)
    assert "doesn't reach" in str(made.metrics()["refused"])
    assert mode(made) is Mode.PAUSED
    assert made._replay.path is path


def test_teaching_pauses_the_task_and_a_press_meanwhile_starts_nothing() -> None:
    made = taught()
    press(made)
    until(made, Mode.GOING)
    made.input["teach"][0] = 1.0
    cycle(made)
    assert mode(made) is Mode.TEACHING
    press(made)
    for _ in range(50):
        cycle(made)
    assert (made.output["q_velocity"] == 0.0).all()


@pytest.mark.slow
def test_arm_that_is_held_makes_the_task_wait() -> None:
    made = taught()
    press(made)
    until(made, Mode.GOING)
    for _ in range(50):
        cycle(made)
    held = made.input["position"].copy()
    for _ in range(300):
        made.update(DT)
        made.applied["q"][:] = made.input["position"][:] = held
    assert mode(made) is Mode.WAITING
    phase = made.output["phase"][0]
    made.update(DT)
    assert made.output["phase"][0] == phase
    until(made, Mode.DONE)


@pytest.mark.slow
def test_file_gives_the_task(tmp_path) -> None:
    first = taught()
    points = (first._replay.path.points - SHIFT).tolist()
    record = {
        "format": "srl-task-1", "person": "P07", "date": "2026-01-02", "simulated": True, "frame": "Spine",
        "hand": "RightHand", "thresholds": {}, "points": points,
    }  # fmt: skip
    file = KeptFile(tmp_path / "p07.task.json", json.dumps(record).encode())
    made = law(task=file, teach=False, shift=SHIFT)
    assert mode(made) is Mode.PAUSED
    press(made)
    until(made, Mode.DONE)
    assert made.metrics()["person"] == "P07"
    assert made.metrics()["simulated"] is True
    with pytest.raises(ValueError, match="frame"):
        law(task=KeptFile(file.path, json.dumps(record | {"frame": "Hips"}).encode()), teach=False)
    with pytest.raises(ValueError, match="points"):
        law(task=KeptFile(file.path, json.dumps(record | {"points": [[0, 0, 0]]}).encode()), teach=False)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"teach": False}, "none can be taught"),
        ({"button": False}, "nothing could start"),
        ({"hand": "RightPaw"}, "RightPaw"),
        ({"intention": {"run": "wave", "pause": "wave"}}, "one action"),
        ({"lower": {"J1": 0.0}}, "lower: 'J2' is missing"),
    ],
)
def test_options_that_do_not_fit_are_refused(options: dict[str, object], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        law(**options)
