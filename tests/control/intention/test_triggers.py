"""When an action counts as meant: chosen on what was held out, on unknown actions, and on everyday motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.intention import DT, law_of, of_people, onsets, own, play, record_of, session, unrelated
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from srl.control.intention.decision import NONE, Decision
from srl.control.intention.discriminant import Discriminant
from srl.control.intention.features import FRAMES, features, frames, moved
from srl.control.intention.training import EVERYDAY, Thresholds, Trial, refusals, train
from srl.control.intention.triggers import choose, least
from srl.studies.intention.people import everyday

PEOPLE = (1, 2, 3, 4)
LINE = Discriminant(np.array([[0.0], [4.0], [8.0]]), np.eye(1), np.array([2.0, 2.0, 2.0]), 1.0)


def squares(places: list[float]) -> np.ndarray:
    return LINE.distances(np.array(places)[:, None])


@given(st.lists(st.floats(-1.0, 9.0), min_size=1, max_size=40), st.sampled_from([0.1, 0.3, 0.6]), st.floats(0.05, 1.0))
def test_least_is_where_the_decision_would_just_begin(places: list[float], dwell: float, share: float) -> None:
    """The oracle is the law's own decision, look by look."""
    distances = squares(places)
    reached = least(LINE, distances, 2, 0.6, dwell)
    decision, begun = Decision(dwell, 1e9), set()
    for row in distances:
        best = int(row.argmin())
        likely = np.exp((row.min() - row) / 2.0)
        counts = best < 2 and row[best] / 2.0 <= share and 1.0 / likely.sum() >= 0.6
        begun.add(decision.next(best if counts else NONE, DT))
    assert begun - {NONE} == {k for k in range(2) if reached[k] <= share}


def test_everyday_motion_lowers_the_limit_of_the_action_that_it_looks_like() -> None:
    trials = [(0, squares([0.1] * 20)), (1, squares([4.1] * 20))]
    daily = [squares([0.8] * 20)]
    without = choose(LINE, 2, trials, [], confidence=0.6, cost=1.0, slack=1.3)
    chosen = choose(LINE, 2, trials, daily, confidence=0.6, cost=1.0, slack=1.3)
    assert without.limits[0] > 0.32  # 0.8^2 / 2
    assert chosen.limits[0] == pytest.approx(0.32 / 1.3)
    assert chosen.limits[1] == without.limits[1]
    assert (chosen.missed, without.alarms) == (0.0, np.inf)
    assert chosen.alarms == pytest.approx(180.0 / 1.0 * 0.99858, rel=1e-3)  # -60 ln 0.05 / 1 s


def test_the_cost_of_a_wrong_trigger_decides_between_missing_and_being_wrong() -> None:
    # Half of the first action's trials lie at 1.1 (share 0.6); unknown ones of the second at 5.4 are the third's.
    trials = [(0, squares([0.1] * 20)), (0, squares([1.1] * 20)), (1, squares([1.0] * 20))]
    cheap = choose(LINE, 2, trials, [], confidence=0.6, cost=0.0, slack=1.3)
    dear = choose(LINE, 2, trials, [], confidence=0.6, cost=10.0, slack=1.3)
    assert cheap.missed < dear.missed
    assert cheap.unknown > dear.unknown


def test_unknown_actions_and_everyday_motion_trigger_less_than_before() -> None:
    """Simulated people, each tried action unknown to the recogniser; it says nothing about people."""
    before, after, everydays = [], [], []
    for left_out in ("forward", "reach-right", "wave", "turn-left"):
        trials = [t for n in PEOPLE for t in session(n, 2).trials(group=n) if t.label != left_out]
        stranger = session(11, 2)
        daily = everyday(11, 185.0)
        for rows, thresholds, more in (
            (before, Thresholds(dwell=0.3, trigger=1.0), []), (after, Thresholds(), [daily]),
        ):  # fmt: skip
            made = train([*trials, *more], thresholds)
            law = law_of(record_of(made))
            played = play(law, stranger.rotation, stranger.translation)["action"]
            for begin, end, label, _ in stranger.labels:
                if label == left_out:
                    at = (stranger.times >= begin) & (stranger.times < end + 0.6)
                    rows.append(bool(played[at].any()))
            if more:
                everydays.append(len(onsets(play(law, *unrelated("reach", 60.0, 5))["action"])))
    assert np.mean(after) < 0.5 * np.mean(before)
    assert np.mean(everydays) < 1.0


def test_too_short_an_everyday_motion_shows_too_little() -> None:
    trials = [t for n in PEOPLE for t in session(n, 2).trials(group=n)]
    made, held = train([*trials, everyday(11, 60.0)], Thresholds())
    problem = next(each for each in refusals(made, held, Thresholds()) if each.place == EVERYDAY)
    assert "Record 90 s or more" in problem.remedy
    assert made.triggers.everyday == pytest.approx(60.0 - FRAMES * DT + DT)


def test_an_action_like_everyday_motion_is_refused_by_this_reason() -> None:
    trials = session(1).trials()
    same = next(t for t in trials if t.label == "wave")
    long = Trial(EVERYDAY, 0, np.tile(same.frames, (80, 1)))
    made, held = train([*trials, long], Thresholds())
    problems = {each.place: each for each in refusals(made, held, Thresholds())}
    assert "the everyday motion looks like it" in problems["action wave"].problem
    assert set(problems) == {"action wave"}


def test_an_old_file_counts_within_the_whole_limit() -> None:
    text = record_of(own(1)).model_dump()
    for each in text["classes"]:
        del each["trigger"]
    del text["everyday"]
    again = type(record_of(own(1))).model_validate(text)
    assert {each.trigger for each in again.classes} == {None}
    assert set(law_of(again)._trigger) == {1.0}


def test_holding_still_confirms() -> None:
    """While the arm still moves nothing begins; a wave never holds still."""
    made, told = record_of(own(1)), session(1, seed=7)
    free, held = (play(law_of(made, confirm=c), told.rotation, told.translation)["action"] for c in (None, "hold"))
    names = made.actions
    found = {name for name, on in zip(names, held.any(axis=0), strict=True) if on}
    assert found == set(names) - {"wave"}
    poses = frames(told.rotation, told.translation)
    level = np.array([moved(features(poses[at - FRAMES + 1 : at + 1])) for at in range(FRAMES - 1, len(poses))])
    starts = np.flatnonzero(np.diff(held.any(axis=1).astype(int)) == 1) + 1
    assert len(starts) > 10
    assert all(level[at - FRAMES + 1 - 5 : at - FRAMES + 2].max() <= 0.06 for at in starts)
    assert held.any(axis=1).sum() < free.any(axis=1).sum()


@pytest.mark.parametrize(
    ("presses", "begins"),
    [
        ([(0.0, 0.0)], False),  # never
        ([(0.0, 1.0)], False),  # held down from the beginning
        ([(0.0, 0.0), (2.2, 1.0)], True),  # while the action is done
        ([(0.0, 0.0), (0.1, 1.0), (0.2, 0.0)], False),  # too early
        ([(0.0, 0.0), (1.0, np.nan), (2.2, 1.0)], False),  # what was no number may have been pressed all the time
        ([(0.0, 1.0), (2.0, 0.0), (2.05, 1.0)], False),  # a stuck button that drops for a cycle
        ([(0.0, 0.4), (2.2, 0.55)], False),  # noise about the level
        ([(0.0, 0.0), (2.2, np.inf)], False),
    ],
)
def test_a_press_confirms(presses: list[tuple[float, float]], begins: bool) -> None:
    made, told = record_of(own(1)), session(1, seed=7)
    begin = next(begin for begin, _, label, _ in told.labels if label == "overhead")
    law = law_of(made, confirm="press", press_time=1.0)
    law.input["confirm"][0] = presses[0][1]
    at = np.flatnonzero((told.times >= begin) & (told.times < begin + 3.0))
    law.input["rotation"][:], law.input["translation"][:] = told.rotation[at[0]], told.translation[at[0]]
    law.reset()
    found = False
    for k in at:
        since = told.times[k] - begin
        law.input["confirm"][0] = next(level for t, level in reversed(presses) if since >= t - 1e-9)
        law.input["rotation"][:], law.input["translation"][:] = told.rotation[k], told.translation[k]
        law.update(DT)
        found |= bool(law.output["action"].any())
    assert found is begins


def test_a_late_cycle_a_frozen_suit_and_a_lost_sample_begin_nothing_and_end_what_holds() -> None:
    made, told = record_of(own(1)), session(1, seed=7)
    begin = next(begin for begin, _, label, _ in told.labels if label == "overhead")
    there = int(np.flatnonzero(told.times >= begin + 2.6)[0])

    def shown(*poses: tuple[int, float]) -> np.ndarray:
        law = law_of(made, confirm="hold")
        law.reset()
        rows = []
        for k, dt in poses:
            law.input["rotation"][:], law.input["translation"][:] = told.rotation[k], told.translation[k]
            if k < 0:
                law.input["rotation"][0, 0] = np.nan
            law.update(dt)
            rows.append(bool(law.output["action"].any()))
        return np.array(rows)

    before = [(k, DT) for k in range(there - 60, there + 1)]
    assert shown(*before)[-1]
    assert not shown(*before, (there + 1, 0.6))[-1], "nobody knows what the body did meanwhile"
    assert not shown((there - 40, DT), (there, 1.05), (there, DT))[-1], "one pose isn't a second of holding still"
    frozen = shown(*before, *[(there, DT)] * 25)
    assert not frozen[-1], "a suit that repeats itself to the bit isn't worn"
    short = [*before, (-1, 0.01), (there + 1, 0.01)]
    assert not shown(*short)[-1], "also between two looks"


def test_the_bound_counts_each_limit_that_everyday_motion_set() -> None:
    """Upper ends of Gamma distributions by scipy."""
    for lowered in (0, 1, 2, 5):
        bound = replace(own(1)[0].triggers, everyday=60.0, lowered=lowered).alarms
        assert bound == pytest.approx(stats.gamma.ppf(0.95, max(lowered, 1)), rel=1e-6)


def test_one_press_confirms_one_action() -> None:
    made, told = record_of(own(1)), session(1, seed=7)
    law = law_of(made, confirm="press", press_time=30.0)
    law.input["confirm"][0] = 0.0
    law.reset()
    rows = []
    for k, t in enumerate(told.times):
        law.input["confirm"][0] = float(t > 5.5)
        law.input["rotation"][:], law.input["translation"][:] = told.rotation[k], told.translation[k]
        law.update(DT)
        rows.append(law.output["action"].copy())
    assert len(onsets(np.array(rows))) == 1


def test_an_action_that_is_seen_no_more_ends_though_others_flicker() -> None:
    decision = Decision(0.3, 0.3)
    for _ in range(3):
        decision.next(0, 0.1)
    assert decision.action == 0
    for seen in (NONE, 1, NONE):
        decision.next(seen, 0.1)
    assert decision.action == NONE


def test_a_limit_of_nothing_triggers_nothing() -> None:
    made = own(1)
    none = replace(made[0], triggers=replace(made[0].triggers, limits=np.zeros(len(made[0].actions))))
    told = session(1)
    assert not play(law_of(record_of((none, made[1]))), told.rotation, told.translation)["action"].any()
    assert of_people(PEOPLE)[0].triggers.dwell >= 0.3
