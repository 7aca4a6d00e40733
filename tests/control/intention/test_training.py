"""Recognisers from labelled motion: leave one person out, calibrated confidence, and what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
from helpers.intention import ACTIONS, TRUNK, of_people, own, record_of, session
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.control.intention.decision import NONE, Decision
from srl.control.intention.discriminant import fit, posterior, temperature
from srl.control.intention.features import FEATURES, FRAMES
from srl.control.intention.record import Record, RecordError, parse
from srl.control.intention.training import Thresholds, TrainingError, Trial, refusals, train, windows

PEOPLE = (1, 2, 3, 4, 5, 6)
FEW = Thresholds()


def test_leave_one_person_out_on_simulated_people() -> None:
    """Simulated people: it says nothing about people."""
    made, held = of_people(PEOPLE, Thresholds(dwell=0.3, trigger=1.0))
    assert set(made.actions) == set(ACTIONS)
    assert made.background == ("stand", "walk")
    assert held.accuracy > 0.90
    assert held.found.sum() > 0.85 * held.trials.sum()
    assert held.wrong.sum() < 0.05 * held.trials.sum()
    assert held.alarms == 0
    assert held.trials.tolist() == [12] * 10


def test_labels_that_say_nothing_are_recognised_by_chance() -> None:
    """The negative control: what is held out can't leak into what is learned."""
    rng = np.random.default_rng(1)
    trials = session(1).trials()
    names = [t.label for t in trials if t.label in ACTIONS]
    drawn = iter(rng.permutation(names).tolist())
    mixed = [Trial(next(drawn) if t.label in ACTIONS else t.label, t.group, t.frames) for t in trials]
    counts = {label: len({t.group for t in mixed if t.label == label}) for label in ACTIONS}
    kept = [t for t in mixed if counts.get(t.label, 3) == 3]
    made, held = train(kept, FEW)
    shares = np.diag(held.confusion)[: len(made.actions)] / held.confusion.sum(axis=1)[: len(made.actions)]
    assert shares.mean() < 0.5
    assert {r.place for r in refusals(made, held, FEW)}


@pytest.mark.slow
def test_confidence_is_as_sure_as_it_is_right() -> None:
    made = of_people(PEOPLE)[0]
    stranger = session(11)
    right, sure = [], []
    for trial in stranger.trials():
        distances = made.discriminant.distances(windows(trial.frames))
        best = distances.argmin(axis=1)
        right += [made.labels[k] == trial.label for k in best]
        sure += posterior(distances, made.discriminant.temperature).max(axis=1).tolist()
    assert np.mean(sure) == pytest.approx(np.mean(right), abs=0.06)
    # Without the temperature it is surer than right.
    assert made.discriminant.temperature > 1.0


def test_distances_are_mahalanobis_and_classes_gaussian() -> None:
    rng = np.random.default_rng(2)
    A = rng.normal(size=(4, 4))
    means = rng.normal(size=(3, 4)) * 10.0
    classes = np.repeat(np.arange(3), 4000)
    samples = means[classes] + rng.normal(size=(12000, 4)) @ A.T
    made = fit(samples, classes, 3)
    own_class = made.distances(samples)[np.arange(12000), classes]
    oracle = [
        (x - m) @ np.linalg.inv(made.covariance) @ (x - m)
        for x, m in zip(samples[:20], made.means[classes[:20]], strict=True)
    ]
    np.testing.assert_allclose(own_class[:20], oracle)
    np.testing.assert_allclose(np.diag(made.covariance), np.diag(A @ A.T), rtol=0.1)
    assert (made.distances(samples).argmin(axis=1) == classes).mean() > 0.99


@given(st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_a_posterior_is_one_and_a_class_counts_the_same_however_often_it_is_seen(seed: int) -> None:
    rng = np.random.default_rng(seed)
    distances = rng.uniform(0.0, 500.0, (20, 5))
    for t in (1.0, 7.0, 100.0):
        np.testing.assert_allclose(posterior(distances, t).sum(axis=1), 1.0)
        assert (posterior(distances, t).argmax(axis=1) == distances.argmin(axis=1)).all()
    samples, classes = rng.normal(size=(60, 3)), np.repeat([0, 1], 30)
    once, twice = fit(samples, classes, 2), fit(
        np.concatenate([samples, samples[:30]]), np.concatenate([classes, classes[:30]]), 2
    )  # fmt: skip
    np.testing.assert_allclose(once.covariance, twice.covariance)
    assert 1.0 <= temperature(distances, rng.integers(0, 5, 20)) <= 100.0


def test_a_decision_dwells_and_releases() -> None:
    decision = Decision(0.3, 0.5)
    seen = [0] * 2 + [1] * 1 + [0] * 4 + [NONE] * 3 + [0] + [NONE] * 6
    held = [decision.next(k, 0.1) for k in seen]
    assert held == [NONE] * 5 + [0] * 2 + [0] * 3 + [0] + [0] * 4 + [NONE] * 2


@given(st.lists(st.integers(-1, 3), max_size=60))
def test_a_decision_never_holds_what_wasnt_seen_for_its_dwell(seen: list[int]) -> None:
    decision = Decision(0.3, 0.3)
    held = [decision.next(k, 0.1) for k in seen]
    for at, (before, now) in enumerate(zip([NONE, *held], held, strict=False)):
        if now == NONE and before != NONE:
            assert before not in seen[at - 2 : at + 1]
        elif now != before:
            assert seen[at - 2 : at + 1] == [now] * 3


def test_a_file_gives_the_same_recogniser() -> None:
    made = record_of(own(1))
    again = parse(made.model_dump_json(indent=1).encode(), "p07.json")
    assert again == made
    before, after = own(1)[0].discriminant, again.discriminant()
    for name in ("means", "covariance", "limits"):
        assert (getattr(before, name) == getattr(after, name)).all()
    assert len(made.model_dump_json(indent=1)) < 500_000  # each segment of a recording holds it


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rate": 30.0}, "its windows are 20 frames at 30.0 Hz"),
        ({"temperature": 0.0}, "temperature"),
        ({"format": "srl-ikns-1"}, "format"),
        ({"covariance": [[0.0] * (i + 1) for i in range(FEATURES)]}, "the covariance isn't that of samples"),
        ({"covariance": [[1.0]]}, "the covariance must have"),
        ({"classes": None}, "classes"),
    ],
)
def test_a_broken_file_is_refused(change: dict[str, object], words: str) -> None:
    values = record_of(own(1)).model_dump(mode="json") | change
    with pytest.raises(RecordError, match=words):
        parse(json.dumps(values).encode(), "p07.json")
    with pytest.raises(RecordError):
        parse(b"\xff", "p07.json")
    assert Record.model_fields.keys() >= change.keys()


def test_too_little_is_refused_with_its_place() -> None:
    trials = session(1).trials()
    with pytest.raises(TrainingError, match="action wave: it was done 2 times, 3 are needed"):
        train([t for t in trials if (t.label, t.group) != ("wave", 1)], FEW)
    with pytest.raises(TrainingError, match="actions: there are 1, 2 are needed"):
        train([t for t in trials if t.label in ("wave", "stand")], FEW)
    with pytest.raises(TrainingError, match="walk: it was done 1 times, 2 are needed"):
        train([t for t in trials if t.label != "walk" or t.group == 0], FEW)
    short = [Trial(t.label, t.group, t.frames[: FRAMES - 1]) if t.label == "bend" else t for t in trials]
    with pytest.raises(TrainingError, match=r"action bend: repetition 1 has 0\.9 s, 1\.0 s needed"):
        train(short, FEW)


def test_an_action_that_wasnt_done_is_refused_by_name() -> None:
    """The person stood still instead of squatting."""
    trials = session(1).trials()
    still = [t for t in trials if t.label == "stand" and len(t.frames) > 50]
    lazy = [Trial("squat", t.group, still[t.group].frames[:50]) if t.label == "squat" else t for t in trials]
    reasons = refusals(*train(lazy, FEW), FEW)
    assert [r.place for r in reasons] == ["action squat"]
    assert "stand" in reasons[0].problem
    assert refusals(*own(1), FEW) == ()


def test_the_trunk_of_a_record_names_the_skeleton() -> None:
    assert record_of(own(1)).trunk == TRUNK == ("Spine", "Spine1", "Spine2", "Spine3")
