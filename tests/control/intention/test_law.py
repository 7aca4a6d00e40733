"""The law `intention`: what it recognises, what it doesn't, and what it does without its input."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.intention import (
    ACTIONS,
    DT,
    JOINTS,
    SKELETON,
    TRUNK,
    law_of,
    of_people,
    onsets,
    own,
    play,
    put,
    record_of,
    session,
    unrelated,
)
from helpers.shared import shared

from srl.control.intention.features import FRAMES, joints
from srl.control.intention.law import Intention, IntentionConfig
from srl.control.intention.training import train
from srl.runtime.contracts.errors import SrlError
from srl.runtime.contracts.files import KeptFile
from srl.sim.parts.body.motion import Recorded, Script
from srl.testing import check_controller

PEOPLE = (1, 2, 3, 4, 5, 6)


@pytest.mark.slow
def test_it_finds_the_actions_of_another_session() -> None:
    """The suit sits otherwise, the actions come in another order, and none is quite as it was."""
    rows = []
    for number in (1, 2):
        law, other = law_of(record_of(own(number))), session(number, seed=7)
        rows += other.held(play(law, other.rotation, other.translation)["action"], law.outputs[0].labels)
    assert len(rows) == 60
    assert sum(label in names for label, names in rows) >= 54
    assert [names - {label} for label, names in rows if names - {label}] == []


def test_outputs_go_together() -> None:
    law = law_of(record_of(own(1)))
    made = session(1, seed=7)
    out = play(law, made.rotation, made.translation)
    assert set(out["action"].sum(axis=1)) == {0.0, 1.0}
    assert law.outputs[0].labels == law.outputs[1].labels == record_of(own(1)).actions
    assert set(law.outputs[0].labels) == set(ACTIONS)
    assert ((out["confidence"] >= 0) & (out["confidence"] <= 1)).all()
    assert ((out["distance"][:, 0] > 1.0) == (out["rejected"][:, 0] == 1.0)).all()
    assert (out["posterior"].sum(axis=1) <= 1.0 + 1e-9).all()
    assert not out["action"][: FRAMES - 1].any()
    assert (out["confidence"][: FRAMES - 1] == 0.0).all()
    metrics = law.metrics()
    assert sum(metrics["actions"].values()) == len(onsets(out["action"]))  # type: ignore[attr-defined]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["still", "walk"])
def test_unrelated_motion_of_people_it_never_saw_sets_nothing_off(kind: Script) -> None:
    """The scripts know nothing of the actions. Reaches and a T-pose are related: docs/intention.md."""
    law = law_of(record_of(of_people(PEOPLE)))
    for seed in (1, 2):
        assert onsets(play(law, *unrelated(kind, 60.0, seed))["action"]) == []


@pytest.mark.parametrize("left_out", ["overhead", "squat", "turn-left", "wave"])
def test_an_action_that_it_never_saw_is_rejected(left_out: str) -> None:
    known = [t for t in session(1).trials() if t.label != left_out]
    law = law_of(record_of(train(known, record_of(own(1)).thresholds)))
    other = session(1, seed=7)
    out = play(law, other.rotation, other.translation)
    for a, b, label, _ in other.labels:
        if label == left_out:  # once the body is there
            at = (other.times >= a + 1.6) & (other.times < b)
            assert out["rejected"][at].mean() > 0.9
            assert not out["action"][at].any()


def test_signs_and_a_turned_person_change_nothing() -> None:
    law = law_of(record_of(own(1)))
    made = session(1, seed=7)
    q, p = made.rotation[:600].copy(), made.translation[:600].copy()
    plain = play(law, q, p)
    flips = np.random.default_rng(1).choice([-1.0, 1.0], q.shape[:2])[..., None]
    again = play(law, flips * q, p)
    assert all((again[name] == plain[name]).all() for name in plain)
    turn = np.array([np.cos(1.0), 0.0, np.sin(1.0), 0.0])
    w, x, y, z = q[:, 0].T
    a, _, b, _ = turn
    q[:, 0] = np.stack([a * w - b * y, a * x + b * z, a * y + b * w, a * z - b * x], axis=1)
    R = np.array([[np.cos(2.0), 0, np.sin(2.0)], [0, 1, 0], [-np.sin(2.0), 0, np.cos(2.0)]])
    p[:, 0] = p[:, 0] @ R.T + [5.0, 0.0, -3.0]
    other = play(law, q, p)
    assert (other["action"] == plain["action"]).all()
    np.testing.assert_allclose(other["posterior"], plain["posterior"], atol=1e-6)


@pytest.mark.parametrize("rate", [20.0, 60.0, 100.0, 333.0, 1000.0])
def test_the_loops_rate_doesnt_matter(rate: float) -> None:
    made = session(1, seed=7)
    law, plain = law_of(record_of(own(1))), law_of(record_of(own(1)))
    seconds = 30.0
    at = np.floor(np.arange(round(seconds * rate)) / rate / DT + 1e-9).astype(int)
    fast = onsets(play(law, made.rotation[at], made.translation[at], 1.0 / rate)["action"])
    some = round(seconds / DT)
    slow = onsets(play(plain, made.rotation[:some], made.translation[:some])["action"])
    assert len(slow) >= 3
    assert fast == slow


def test_a_loop_slower_than_the_frames_still_recognises() -> None:
    made = session(1, seed=7)
    law = law_of(record_of(own(1)))
    slow = play(law, made.rotation[::2], made.translation[::2], 0.1)["action"]
    rows = made.held(np.repeat(slow, 2, axis=0)[: len(made.times)], law.outputs[0].labels)
    assert sum(label in names for label, names in rows) >= 24


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_holds_ends_with_its_input_and_a_whole_second_must_come_again(value: float) -> None:
    law = law_of(record_of(own(1)))
    made = session(1, seed=7)
    play(law, made.rotation[:1], made.translation[:1])
    at = 0
    while not law.output["action"].any():
        put(law, made.rotation[at], made.translation[at])
        law.update(DT)
        at += 1
    law.input["rotation"][3, 1] = value
    law.update(DT)
    assert not any(law.output[name].any() for name in law.output)
    for k in range(FRAMES):
        assert not law.output["confidence"].any()
        put(law, made.rotation[at + k], made.translation[at + k])
        law.update(DT)
    assert law.output["confidence"][0] > 0.0
    assert law.metrics()["gaps"] == 1


def test_a_reset_forgets_the_window() -> None:
    law = law_of(record_of(own(1)))
    made = session(1, seed=7)
    play(law, made.rotation[:400], made.translation[:400])
    law.reset()
    assert not any(law.output[name].any() for name in law.output)
    put(law, made.rotation[400], made.translation[400])
    law.update(DT)
    assert not law.output["confidence"].any()


@pytest.mark.slow
def test_a_longer_dwell_is_later_and_an_unreachable_confidence_finds_nothing() -> None:
    made = session(1, seed=7)
    first = {}
    for dwell in (0.0, 0.5, 1.0):
        out = play(law_of(record_of(own(1)), dwell=dwell), made.rotation[:200], made.translation[:200])
        first[dwell] = int(out["action"].any(axis=1).argmax())
    assert first[0.5] - first[0.0] == 9  # the first of ten frames is seen at once
    assert first[1.0] - first[0.5] == 10
    people = law_of(record_of(of_people(PEOPLE)), confidence=1.0)
    sure = play(people, made.rotation, made.translation)
    assert len(onsets(sure["action"])) < 30


def test_it_keeps_the_contract_of_controllers() -> None:
    made = session(1)
    at = {"rotation": made.rotation[50], "translation": made.translation[50]}
    check_controller(law_of(record_of(own(1))), inputs=at, start={})


def test_large_and_zero_numbers_give_finite_outputs() -> None:
    law = law_of(record_of(own(1)))
    made = session(1)
    for size in (0.0, 1e150, 1e300, -1e300):
        law.reset()
        for row in range(2 * FRAMES):
            put(law, made.rotation[row], made.translation[row] * (size if row % 2 else 1.0))
            law.update(DT)
            assert all(np.isfinite(value).all() for value in law.output.values())
        put(law, made.rotation[0] * size, made.translation[0])
        law.update(DT)
        assert all(np.isfinite(value).all() for value in law.output.values())


def test_the_port_names_the_joints_that_it_needs() -> None:
    law = law_of(record_of(own(1)))
    assert law.inputs[0].labels == law.inputs[1].labels == joints(TRUNK)
    assert set(joints(TRUNK)) <= set(SKELETON.names)
    assert law.inputs[0].naming_fault() == ""


def test_a_file_that_isnt_one_is_refused_with_its_place() -> None:
    with pytest.raises(SrlError, match=r"p07\.json"):
        Intention("i", IntentionConfig(recogniser=KeptFile(Path("p07.json"), b"{}")))


@pytest.mark.parametrize("name", ["fullbody_walk_yxz.bvh", "fullbody_xyz.bvh"])
def test_a_real_persons_recording_is_taken_whatever_it_shows(name: str) -> None:
    """It isn't labelled, so it says nothing of accuracy: only that real motion gives finite, bounded outputs."""
    motion = Recorded(shared(f"data/axis_neuron_bvh/{name}"), SKELETON, 1.0, False)
    poses = [motion.at(t) for t in np.arange(0.0, min(motion.duration, 10.0), DT).tolist()]
    translation = np.tile(motion.offsets, (len(poses), 1, 1))
    translation[:, 0] = [hips for hips, _ in poses]
    rotation = np.array([q for _, q in poses])
    out = play(law_of(record_of(of_people(PEOPLE))), rotation[:, JOINTS], translation[:, JOINTS])
    assert all(np.isfinite(value).all() for value in out.values())
    assert out["confidence"][FRAMES:].min() > 0.0
