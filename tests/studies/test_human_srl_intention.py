"""The claims on intentions: what the analysis makes of rows, and what a session's scores are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.shared import shared
from helpers.trial_rows import Here, row

from srl.control.intention.features import FRAMES
from srl.control.intention.training import BACKGROUND
from srl.studies.human_srl import intention_claims
from srl.studies.human_srl.intention_trial import UNRELATED, Played, other_motion, recorded, scores, trial
from srl.studies.intention.people import ACTIONS, DT, JOINTS, Session
from srl.studies.tasks.task import Row, flat

PEOPLE = range(1, 7)


def values(number: int, right: float, found: float, **alarms: int) -> dict[str, float]:
    made: dict[str, float] = {"unseen_rejected": 0.5, "unseen_taken": 0.5, "dwell": 0.6, "trigger": 0.4}
    for label in (*ACTIONS, *BACKGROUND):
        made |= {f"{label}_right": right + 0.001 * number, f"{label}_rejected": 0.01}
        made |= {f"{label}_found": found, f"{label}_another": 0.0, f"{label}_delay": 1.2} if label in ACTIONS else {}
        made |= {f"{label}_found_held": found, f"{label}_delay_held": 1.6} if label in ACTIONS else {}
    made |= {f"{kind}_activations_held": 0 for kind in UNRELATED}
    return made | {f"{kind}_activations": alarms.get(kind, 0) for kind in UNRELATED}


def rows(right: float = 0.97, found: float = 0.95, **alarms: int) -> list[Row]:
    return [row(intention_claims.task(n, PEOPLE), values(n, right, found, **alarms)) for n in PEOPLE]


def test_nobody_is_in_the_training_of_the_own_recogniser() -> None:
    tasks = [intention_claims.task(n, PEOPLE) for n in PEOPLE]
    assert all(t.parameters["person"] not in t.parameters["others"] for t in tasks)
    assert all(len(t.parameters["others"]) == len(PEOPLE) - 1 for t in tasks)
    assert len({t.parameters["left_out"] for t in tasks}) == len(PEOPLE)


def test_accuracy_holds_by_the_lower_end_of_the_interval_over_people_of_windows_and_of_actions() -> None:
    def holds(right: float, found: float) -> bool:
        return intention_claims.analysed(rows(right, found)).claims[0].holds

    assert holds(0.97, 0.95)
    assert not holds(0.97, 0.85)
    assert not holds(0.945, 0.95)
    claim = intention_claims.analysed(rows(0.97, 0.95)).claims[0]
    assert claim.measured == pytest.approx(97.35)
    assert "simulated" in claim.text


def test_no_false_activation_is_bounded_by_the_time_that_was_tried_and_many_by_the_spread_over_people() -> None:
    part = intention_claims.analysed(rows(reach=20))
    by = {claim.id.removeprefix("false-activations-"): claim for claim in part.claims[1:]}
    assert set(by) == set(UNRELATED)
    assert by["walk"].measured == 0.0
    assert by["walk"].holds  # the rule of three: 3.7 in 6 minutes
    assert not by["reach"].holds
    assert by["reach"].measured == 20.0
    (line,) = (line for line in part.table if line["label"] == "unrelated: walk")
    assert line["per_minute_high"] == pytest.approx(3.689 / 6, rel=1e-3)
    assert not intention_claims.analysed(rows()[:2]).claims[1].holds  # two minutes bound it by 1.8


def test_one_false_activation_never_bounds_them_tighter_than_none() -> None:
    """Student's interval of five zeros and a one does: 0.6 a minute, as against 0.61 of none."""
    ends = []
    for alarms in range(4):
        first = row(intention_claims.task(1, PEOPLE), values(1, 0.97, 0.95, walk=alarms))
        part = intention_claims.analysed([first, *rows()[1:]])
        (line,) = (line for line in part.table if line["label"] == "unrelated: walk")
        ends.append(line["per_minute_high"])
    assert ends == sorted(set(ends))
    assert ends[1] == pytest.approx(5.572 / 6, rel=1e-3), "Garwood's of one in six minutes"


def test_without_rows_nothing_is_measured_and_nothing_holds() -> None:
    part = intention_claims.analysed([])
    assert all(claim.measured is None and not claim.holds for claim in part.claims)


def test_recordings_that_are_not_there_are_said_to_be_absent(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("SRL_SHARED", str(tmp_path))
    assert not list(intention_claims._recordings(PEOPLE))
    for claim in intention_claims._real([]):
        assert claim.measured is None
        assert not claim.holds
        assert "none" in claim.text


def test_real_recordings_are_read_at_the_recognisers_rate() -> None:
    rotation, translation = recorded(shared("data/axis_neuron_bvh/fullbody_walk_yxz.bvh"))
    assert rotation.shape == (len(translation), len(JOINTS), 4)
    assert (len(rotation) - 1) * DT == pytest.approx(208 * 0.017, abs=DT)  # 209 frames, 0.017 s
    assert np.allclose(np.linalg.norm(rotation, axis=2), 1.0)
    assert np.linalg.norm(np.ptp(translation[:, 0], axis=0)) > 0.5  # walks


def played(made: Session, taken: dict[str, str], **given: float) -> Played:
    """What a law would say that takes each label for another at once; `given`: confidence and rejected."""
    action, posterior = np.zeros((2, len(made.times), len(ACTIONS)))
    confidence = np.full(len(made.times), given.get("confidence", 0.9))
    for begin, end, label, _ in made.labels:
        at = (made.times >= begin) & (made.times < end)
        if taken.get(label, label) in ACTIONS:
            k = ACTIONS.index(taken.get(label, label))  # type: ignore[arg-type]
            posterior[at, k] = confidence[at]
            action[at & (made.times >= begin + 1.2), k] = 1.0
    return Played(action, posterior, confidence, np.full(len(made.times), given.get("rejected", 0.0)))


@pytest.fixture(scope="module")
def made() -> Session:
    labels = (*BACKGROUND, *ACTIONS, *ACTIONS)
    output = tuple((5.0 * i, 5.0 * i + 3.0, label, 0) for i, label in enumerate(labels))
    times = np.arange(0.0, 5.0 * len(labels), DT)
    return Session(times, np.empty(0), np.empty(0), output)


def test_scores_of_a_law_that_is_always_right(made: Session) -> None:
    found = scores(made, played(made, {}), ACTIONS, 0.6, 0.4)
    assert all(found[f"{label}_right"] == 1.0 for label in (*ACTIONS, *BACKGROUND))
    assert all(found[f"{label}_found"] == 1.0 and found[f"{label}_another"] == 0.0 for label in ACTIONS)
    assert found["wave_delay"] == pytest.approx(1.2, abs=DT)


def test_scores_of_one_that_takes_one_action_for_another_and_standing_for_a_third(made: Session) -> None:
    found = scores(made, played(made, {"carry": "forward", "stand": "wave"}), ACTIONS, 0.6, 0.4)
    assert (found["carry_right"], found["carry_found"], found["carry_another"]) == (0.0, 0.0, 1.0)
    assert np.isnan(found["carry_delay"])
    assert found["stand_right"] == 0.0
    assert found["walk_right"] == found["forward_right"] == 1.0


@pytest.mark.parametrize("given", [{"confidence": 0.5}, {"rejected": 1.0}])
def test_what_is_not_sure_or_rejected_is_not_right(made: Session, given: dict[str, float]) -> None:
    found = scores(made, played(made, {}, **given), ACTIONS, 0.6, 0.4)
    assert not any(found[f"{label}_right"] for label in ACTIONS)
    assert found["stand_right"] == 1.0 - given.get("rejected", 0.0)


def test_only_windows_within_a_label_count(made: Session) -> None:
    """A law that is right but for the first second of each label has all windows right."""
    late = played(made, {})
    for begin, *_ in made.labels:
        late.posterior[(made.times >= begin) & (made.times < begin + (FRAMES - 1) * DT - 1e-6)] = 0.0
    assert all(scores(made, late, ACTIONS, 0.6, 0.0)[f"{label}_right"] == 1.0 for label in ACTIONS)


def test_unrelated_motion_differs_by_kind_and_person() -> None:
    still, walk, again = (other_motion(kind, n, 4.0, 4.0) for kind, n in (("stand", 1), ("walk", 1), ("walk", 2)))
    moved = [float(np.linalg.norm(np.ptp(p[:, 0], axis=0))) for _, p in (still, walk)]
    assert moved[0] < 0.05 < 0.5 < moved[1]
    assert not np.allclose(walk[0], again[0])


@pytest.mark.slow
def test_a_person_who_is_held_out_gives_a_whole_row() -> None:
    task = intention_claims.task(2, range(1, 6), unrelated=20.0)
    found = flat(trial(task.text, task.parameters, task.seed))
    assert set(found) == set(values(1, 1.0, 1.0))
    assert found == flat(trial(task.text, task.parameters, task.seed))
    assert np.mean([found[f"{label}_right"] for label in ACTIONS]) > 0.8
    assert found["stand_activations"] == found["walk_activations"] == 0


@pytest.mark.slow
def test_quick_set_with_the_recordings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SRL_SHARED", str(shared("data/axis_neuron_bvh").parents[1]))
    part = intention_claims.claims(Here({"human-srl-intention": trial}), tmp_path, True)  # type: ignore[arg-type]
    ids = [claim.id for claim in part.claims]
    kinds = (*UNRELATED, "recorded")
    assert ids == ["intention-accuracy", *(f"false-activations-{kind}" for kind in kinds), "no-activation-recorded"]
    assert part.claims[0].measured is not None
    assert part.claims[0].measured > 85.0
    assert sum(line["label"].startswith("recorded") for line in part.table) == 3
    assert not part.claims[-2].holds, "24 s bound nothing"
    assert part.claims[-1].holds == (part.claims[-1].measured == 0.0)
