"""The guided procedure: what counts, when a step is over, what ends it as it is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.commissioning.calibration.ikns.marks import EXPLORATION, IDLE, STATIC, VOID, left_out, mark_of
from srl.commissioning.calibration.ikns.procedure import Plan, Procedure
from srl.commissioning.calibration.ikns.samples import Samples
from srl.commissioning.calibration.ikns.steps import Kind, Step
from srl.control.ikns.calibration import CalibrationError
from srl.control.ikns.thresholds import Thresholds
from srl.runtime.contracts.signals import Array

PLAN = Plan(static=1.0, exploration=3.0, trial=1.0, settle=0.2, patience=2.0)
FEW = Thresholds(samples=50)
SIZE = np.array([0.3, 0.4, 0.3])  # m, of the workspace


class Feeder:
    """Feeds made samples of two joints, 100 a second, on one clock."""

    def __init__(self, procedure: Procedure) -> None:
        self.procedure, self.t = procedure, 0.0

    def feed(self, hand: Array, joints: Array | None = None, mark: int | None = None) -> None:
        """`hand` (k, 3) m, `joints` (k, 2) rad."""
        k = len(hand)
        times = self.t + 0.01 * np.arange(1, k + 1)
        self.t = times[-1]
        marks = np.full(k, self.procedure.step.mark if mark is None else mark)
        self.procedure.feed(Samples(times, np.zeros((k, 2)) if joints is None else joints, hand, marks))

    def stay(self, seconds: float, place: Array | None = None, swing: float = 0.0) -> None:
        """The hand at a place, a joint swinging by +-`swing` rad; until the step is another."""
        step = self.procedure.step
        place = np.zeros(3) if place is None else place
        for _ in range(round(seconds * 10)):
            t = self.t + 0.01 * np.arange(1, 11)
            self.feed(np.tile(place, (10, 1)), np.column_stack([swing * np.sin(6.3 * t), np.zeros(10)]))
            if self.procedure.step is not step:
                return

    def explore(self, size: Array, seconds: float = 3.2) -> None:
        for _ in range(round(seconds * 10)):
            t = self.t + 0.01 * np.arange(1, 11)
            self.feed(0.5 * size * np.sin(np.outer(t, (5.0, 7.0, 3.0))))
            if self.procedure.step.kind is not Kind.EXPLORATION:
                return


def started(dofs: tuple[str, ...] = ("swivel",)) -> Feeder:
    """A procedure whose workspace is explored."""
    feeder = Feeder(Procedure(dofs, FEW, PLAN))
    feeder.stay(1.2)
    assert feeder.procedure.step == Step(Kind.EXPLORATION)
    feeder.explore(SIZE)
    assert feeder.procedure.step == Step(Kind.GO, 0, 0)
    return feeder


def point(feeder: Feeder, swing: float = 0.5) -> None:
    """Goes to the present point and does its trial."""
    target = feeder.procedure.target
    assert target is not None
    feeder.stay(2.0, target)
    assert feeder.procedure.step.kind is Kind.TRIAL
    feeder.stay(4.0, target, swing)


@pytest.mark.parametrize("dofs", [("swivel",), ("swivel", "shrug")])
def test_every_point_has_a_trial_of_each_dof(dofs: tuple[str, ...]) -> None:
    feeder = started(dofs)
    done = []
    while feeder.procedure.step.kind is not Kind.DONE:
        done.append((feeder.procedure.step.point, feeder.procedure.step.dof))
        point(feeder)
    assert done == [(i, j) for i in range(10) for j in range(len(dofs))]
    view = feeder.procedure.view()
    assert set(view.states) == {"done"}
    assert view.task == "All points are done"


def test_the_points_are_near_the_corners_and_where_the_hand_has_been() -> None:
    feeder = started()
    points = feeder.procedure.points
    assert points is not None
    assert len(points) == 10
    assert len(np.unique(np.sign(points[:8]), axis=0)) == 8
    assert points[8][2] < 0.0 < points[9][2]
    t = np.arange(1, 321) * 0.01 + 1.0
    explored = 0.5 * SIZE * np.sin(np.outer(t, (5.0, 7.0, 3.0)))
    assert (np.linalg.norm(explored[:, None] - points, axis=2).min(axis=0) < 0.01).all()


@pytest.mark.slow
@given(st.integers(1, 40), st.integers(1, 40))
@settings(max_examples=20)
def test_what_is_fed_matters_and_not_in_how_many_pieces(first: int, second: int) -> None:
    found = []
    for sizes in ((40,), (first, second)):
        feeder = started()
        feeder.stay(2.0, feeder.procedure.target)
        t = np.arange(1, 41) * 0.01
        assert feeder.procedure.target is not None
        hand = np.tile(feeder.procedure.target, (40, 1))
        joints = np.column_stack([np.sin(t), t])
        at = 0
        while at < 40:
            k = min(sizes[at % len(sizes)], 40 - at)
            feeder.feed(hand[at : at + k], joints[at : at + k])
            at += k
        found.append(feeder.procedure.progress())
    assert found[0].kept == found[1].kept > 0
    assert found[0].range == pytest.approx(found[1].range)
    assert found[0].step == found[1].step


def test_samples_with_another_mark_dont_count() -> None:
    feeder = started()
    feeder.stay(2.0, feeder.procedure.target)
    assert feeder.procedure.step == Step(Kind.TRIAL, 0, 0)
    target = feeder.procedure.target
    assert target is not None
    for mark in (IDLE, mark_of(0, 1), mark_of(1, 0), STATIC, EXPLORATION):
        feeder.feed(np.tile(target, (300, 1)), mark=mark)
    assert feeder.procedure.progress().kept == 0
    assert feeder.procedure.step == Step(Kind.TRIAL, 0, 0)


def test_a_trial_goes_on_until_enough_is_kept_and_not_merely_for_its_time() -> None:
    feeder = started()
    target = feeder.procedure.target
    assert target is not None
    feeder.stay(2.0, target)
    shaking = np.tile(target, (150, 1)) + 0.02 * np.sin(30.0 * np.arange(150) * 0.01)[:, None]
    feeder.feed(shaking, np.outer(np.linspace(0, 1, 150), [1.0, 0.0]))
    view = feeder.procedure.view()
    assert view.step == Step(Kind.TRIAL, 0, 0)
    assert feeder.procedure.progress().share == 1.0
    assert feeder.procedure.progress().kept < 50
    assert "hold the hand stiller" in view.lack
    feeder.stay(1.0, target, 0.5)
    assert feeder.procedure.step == Step(Kind.GO, 1, 0)
    assert feeder.procedure.view().states[0] == "done"


@pytest.mark.parametrize(
    ("hand", "swing", "why"),
    [("still", 0.01, "move farther"), ("moving", 0.5, "hold the hand stiller"), ("hidden", 0.5, "markers are missing")],
)
def test_a_trial_that_goes_nowhere_ends_and_says_why(hand: str, swing: float, why: str) -> None:
    feeder = started()
    target = feeder.procedure.target
    assert target is not None
    feeder.stay(2.0, target)
    for i in range(31):
        t = 0.1 * i + 0.01 * np.arange(10)
        place = {"still": np.zeros(10), "moving": 0.1 * np.sin(8.0 * t), "hidden": np.full(10, np.nan)}[hand]
        feeder.feed(target + place[:, None], np.column_stack([swing * np.sin(t), np.zeros(10)]))
    assert feeder.procedure.step == Step(Kind.GO, 1, 0)
    state = feeder.procedure.view().states[0]
    assert state.startswith("weak: ")
    assert why in state


def test_a_point_that_isnt_reached_exactly_is_taken_where_the_hand_holds_still() -> None:
    feeder = started()
    assert feeder.procedure.target is not None
    beside = feeder.procedure.target + 0.05
    feeder.stay(1.5, beside)
    assert feeder.procedure.step.kind is Kind.GO
    assert "isn't still at the point" in feeder.procedure.view().lack
    feeder.stay(2.0, beside)
    assert feeder.procedure.step == Step(Kind.TRIAL, 0, 0)


def test_a_point_at_which_the_hand_never_is_still_is_taken_too_but_later() -> None:
    feeder = started()
    assert feeder.procedure.target is not None
    begin = feeder.t
    while feeder.procedure.step.kind is Kind.GO:
        t = feeder.t + 0.01 * np.arange(1, 11)
        feeder.feed(feeder.procedure.target + 0.2 * np.sin(9.0 * t)[:, None])
    assert feeder.t - begin == pytest.approx(PLAN.settle + 2.0 * PLAN.patience, abs=0.15)


def test_a_person_who_doesnt_sit_still_and_a_flat_workspace_are_refused() -> None:
    feeder = Feeder(Procedure(("swivel",), FEW, PLAN))
    t = 0.01 * np.arange(400)
    with pytest.raises(CalibrationError, match="static: the hand isn't still"):
        feeder.feed(0.3 * np.sin(9.0 * t)[:, None] * np.ones(3))
    feeder = Feeder(Procedure(("swivel",), FEW, PLAN))
    feeder.stay(1.2)
    feeder.explore(np.array([0.3, 0.4, 0.05]), 4.0)
    assert "up and down explored" in feeder.procedure.go_on()
    with pytest.raises(CalibrationError, match=r"exploration: only .* mm up and down explored, 120 are needed"):
        feeder.explore(np.array([0.3, 0.4, 0.05]), 4.0)


def test_no_hand_at_all_is_named() -> None:
    feeder = Feeder(Procedure(("swivel",), FEW, PLAN))
    with pytest.raises(CalibrationError, match="static: 100% of the samples lack angles or hand"):
        feeder.feed(np.full((400, 3), np.nan))
    assert np.isnan(feeder.procedure.progress().speed)
    assert feeder.procedure.progress().lost == 1.0


def test_a_point_is_done_again_next_and_then_it_goes_on_where_it_was() -> None:
    feeder = started(("swivel", "shrug"))
    for _ in range(5):
        point(feeder)
    assert feeder.procedure.step == Step(Kind.GO, 2, 1)
    assert feeder.procedure.redo(1) == ""
    order = []
    for _ in range(4):
        order.append((feeder.procedure.step.point, feeder.procedure.step.dof))
        point(feeder)
    assert order == [(0, 0), (0, 1), (2, 1), (3, 0)]
    assert feeder.procedure.redo(11) == "the points are 1 to 10"
    while feeder.procedure.step.kind is not Kind.DONE:
        point(feeder)
    assert feeder.procedure.redo(4) == ""
    assert feeder.procedure.view().states[3] == "now"
    point(feeder)
    point(feeder)
    assert feeder.procedure.step.kind is Kind.DONE


def states(feeder: Feeder) -> tuple[str, ...]:
    return feeder.procedure.view().states


def test_a_point_with_two_dofs_is_done_after_the_second() -> None:
    feeder = started(("swivel", "shrug"))
    point(feeder)
    assert states(feeder)[:2] == ("now", "waiting")
    assert feeder.procedure.redo(4) == ""
    assert states(feeder)[:4] == ("waiting", "waiting", "waiting", "now")
    point(feeder)
    point(feeder)
    assert states(feeder)[:4] == ("now", "waiting", "waiting", "done")
    point(feeder)
    assert states(feeder)[:4] == ("done", "now", "waiting", "done")
    while feeder.procedure.step.kind is not Kind.DONE:
        point(feeder)
    assert set(states(feeder)) == {"done"}


def test_each_dof_of_a_weak_point_has_its_reason_until_it_is_done_again() -> None:
    feeder = started(("swivel", "shrug"))
    point(feeder, 0.01)
    feeder.stay(2.0, feeder.procedure.target)
    assert feeder.procedure.step == Step(Kind.TRIAL, 0, 1)
    assert feeder.procedure.go_on() == ""
    assert states(feeder)[0].startswith("weak: swivel: range 0.0")
    assert states(feeder)[0].endswith("move farther; shrug: nothing was seen")
    assert feeder.procedure.redo(1) == ""
    point(feeder)
    point(feeder, 0.01)
    assert states(feeder)[0].startswith("weak: shrug: range 0.0")
    assert feeder.procedure.redo(1) == ""
    point(feeder)
    point(feeder)
    assert states(feeder)[:2] == ("done", "now")


def test_the_present_point_can_be_done_again() -> None:
    feeder = started(("swivel", "shrug"))
    point(feeder)
    assert feeder.procedure.step == Step(Kind.GO, 0, 1)
    assert feeder.procedure.redo(1) == ""
    assert feeder.procedure.step == Step(Kind.GO, 0, 0)
    point(feeder)
    point(feeder)
    assert feeder.procedure.step == Step(Kind.GO, 1, 0)


def test_two_points_can_be_left_out_and_no_more() -> None:
    feeder = started()
    assert [feeder.procedure.skip() for _ in range(3)] == ["", "", "8 points are needed"]
    assert feeder.procedure.step == Step(Kind.GO, 2, 0)
    assert feeder.procedure.view().states[:3] == ("left out", "left out", "now")


def test_what_is_broken_off_or_left_out_is_said_by_the_next_mark() -> None:
    feeder = started()
    assert feeder.procedure.step.mark == IDLE
    feeder.stay(2.0, feeder.procedure.target)
    assert feeder.procedure.step == Step(Kind.TRIAL, 0, 0)
    assert feeder.procedure.redo(1) == ""
    assert feeder.procedure.step.mark == VOID
    assert feeder.procedure.redo(1) == ""
    assert feeder.procedure.step.mark == IDLE
    point(feeder)
    assert feeder.procedure.step.mark == IDLE
    assert feeder.procedure.skip() == ""
    assert feeder.procedure.step.mark == left_out(1)
    while feeder.procedure.step.point < 9:
        point(feeder)
    assert feeder.procedure.skip() == ""
    assert feeder.procedure.step.kind is Kind.DONE
    assert feeder.procedure.step.mark == left_out(9)


def test_keys_that_come_too_early_are_answered() -> None:
    procedure = Procedure(("swivel",), FEW, PLAN)
    assert procedure.redo(1) == "the points aren't chosen yet"
    assert procedure.skip() == "only a point can be left out"
    assert procedure.go_on() == ""
    assert procedure.go_on() == "the hand wasn't seen yet"


def test_only_points_are_done_again_after_an_earlier_exploration() -> None:
    feeder = started()
    t = np.arange(320) * 0.01
    explored = 0.5 * SIZE * np.sin(np.outer(t, (5.0, 7.0, 3.0)))
    again = Procedure(("swivel",), FEW, PLAN, explored)
    assert again.step.kind is Kind.DONE
    assert again.points is not None
    assert len(again.points) == 10
    assert again.redo(3) == ""
    assert again.step == Step(Kind.GO, 2, 0)
    point(Feeder(again))
    assert again.step.kind is Kind.DONE
    with pytest.raises(CalibrationError, match="the earlier exploration: the hand wasn't seen"):
        Procedure(("swivel",), FEW, PLAN, np.empty((0, 3)))
    assert feeder.procedure.points is not None


def test_the_task_says_which_way_to_go() -> None:
    feeder = started()
    target = feeder.procedure.target
    assert target is not None
    feeder.feed(np.tile(target + np.array([0.05, -0.03, 0.0]), (3, 1)))
    assert feeder.procedure.view().task == "Take the hand to point 1 of 10 and hold it there: 5 cm back, 3 cm left"
