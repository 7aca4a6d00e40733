"""Samples with marks: which belong to which trial, and the law that says so in every row."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from srl.commissioning.calibration.ikns.marks import VOID, Marks, MarksConfig, left_out, mark_of, of_trial
from srl.commissioning.calibration.ikns.samples import Samples, joined, seen, trials, whole
from srl.commissioning.calibration.marks import ended, stretch_of
from srl.control.ikns.calibration import Recording


def samples(marks: list[int], start: float = 0.0) -> Samples:
    k = len(marks)
    numbers = np.arange(k, dtype=float)
    return Samples(
        start + 0.01 * numbers, np.column_stack([numbers, -numbers]), np.tile(numbers[:, None], 3), np.array(marks)
    )


@given(st.lists(st.tuples(st.sampled_from([0, 1, 101, 102, 201]), st.integers(1, 5)), max_size=12))
def test_a_stretch_is_the_last_run_of_a_mark(runs: list[tuple[int, int]]) -> None:
    marks = [mark for mark, count in runs for _ in range(count)]
    at = stretch_of(np.array(marks, np.intp), 101)
    assert all(mark == 101 for mark in marks[at])
    assert 101 not in marks[at.stop :]
    if at.start > 0 and at.stop > at.start:
        assert marks[at.start - 1] != 101
    assert (at.stop > at.start) == (101 in marks)


@given(st.lists(st.integers(0, 6), min_size=1, max_size=4), st.lists(st.floats(-100, 100), min_size=4, max_size=4))
def test_joined_samples_ascend_in_time_and_keep_their_steps(sizes: list[int], starts: list[float]) -> None:
    parts = [samples([0] * size, start) for size, start in zip(sizes, starts, strict=False)]
    together = joined(parts)
    assert len(together) == sum(sizes)
    assert (np.diff(together.times) > 0.0).all()
    at = 0
    for part in parts:
        own = together.times[at : at + len(part)]
        assert np.diff(own) == pytest.approx(np.diff(part.times))
        at += len(part)


def test_each_point_has_a_number_and_the_last_trial_counts() -> None:
    marks = [1, 2]
    for point in (0, 1, 2, 4, 5, 6, 7, 8):
        marks += [0, *[mark_of(point, 0)] * 2, 0, *[mark_of(point, 1)] * 3]
    marks += [mark_of(3, 0)] * 4  # its second DoF is missing
    marks += [0, *[mark_of(1, 0)] * 5]  # again
    made, numbers = trials(samples(marks), 2)
    assert numbers == (1, 2, 3, 5, 6, 7, 8, 9)
    assert made.point is not None
    assert [int((made.point[made.dof == 0] == i).sum()) for i in range(8)] == [2, 5, 2, 2, 2, 2, 2, 2]
    assert (np.diff(made.times) > 0.0).all()
    again = (made.point == 1) & (made.dof == 0)
    assert made.angles[again][:, 0].tolist() == [len(marks) - 5 + i for i in range(5)]


def all_points(dofs: int = 1) -> list[int]:
    """Marks of a whole calibration, two samples a trial."""
    return [mark for i in range(10) for j in range(dofs) for mark in (0, mark_of(i, j), mark_of(i, j))] + [0]


def at_point(made: Recording, numbers: tuple[int, ...], number: int) -> list[float]:
    assert made.point is not None
    found: list[float] = made.angles[made.point == numbers.index(number)][:, 0].tolist()
    return found


def test_a_trial_that_was_broken_off_doesnt_count() -> None:
    done = all_points()
    good, numbers = trials(samples(done), 1)
    # Point 3 again, broken off; the one before it counts on.
    made, same = trials(samples([*done, *[mark_of(2, 0)] * 5, VOID, 0]), 1)
    assert same == numbers
    assert at_point(made, numbers, 3) == at_point(good, numbers, 3)
    # Done again after that.
    made, _ = trials(samples([*done, *[mark_of(2, 0)] * 5, VOID, 0, *[mark_of(2, 0)] * 3, 0]), 1)
    assert at_point(made, numbers, 3) == [len(done) + 7 + i for i in range(3)]


def test_a_point_that_is_left_out_has_none_of_its_trials() -> None:
    done = all_points(2)
    made, numbers = trials(samples([*done, mark_of(2, 0), left_out(2), 0]), 2)
    assert numbers == (1, 2, 4, 5, 6, 7, 8, 9, 10)
    assert made.point is not None
    assert len(made.times) == 2 * 2 * 9
    again = [0, *[mark_of(2, 0)] * 3, 0, *[mark_of(2, 1)] * 3, 0]
    made, numbers = trials(samples([*done, left_out(2), *again]), 2)
    assert numbers == tuple(range(1, 11))
    assert at_point(made, numbers, 3) == [len(done) + 2 + i for i in (0, 1, 2, 4, 5, 6)]


@given(st.integers(0, 5))
def test_a_recording_that_ends_in_a_trial_has_only_the_whole_ones(count: int) -> None:
    done = all_points()
    made, _ = trials(ended(samples([*done, *[mark_of(2, 0)] * count]), of_trial), 1)
    assert made.angles[:, 0].tolist() == trials(samples(done), 1)[0].angles[:, 0].tolist()
    for last in (0, VOID, left_out(2)):
        assert ended(samples([*done, last]), of_trial).marks.tolist() == [*done, last]
    assert len(ended(samples([]), of_trial)) == 0


def test_what_wasnt_observed_isnt_seen() -> None:
    made = samples([2] * 6)
    made.angles[1, 0], made.hand[3, 2] = np.nan, np.inf
    assert seen(made, slice(0, 6))[:, 0].tolist() == [0.0, 2.0, 4.0, 5.0]
    assert whole(made).dof.tolist() == [0] * 6


def test_the_law_has_one_parameter_and_computes_nothing() -> None:
    options = {
        "person": "P07",
        "dofs": ["swivel", "shrug"],
        "angles": {"elbow": "arm.angles[elbow]"},
        "hand": "arm.hand",
    }
    law = Marks("marks", MarksConfig.model_validate(options))
    (mark,) = law.parameters
    assert (mark.default, mark.lower, mark.upper) == (0.0, 0.0, mark_of(9, 1))
    assert law.inputs == law.outputs == ()
    law.reset()
    law.update(0.01)
    with pytest.raises(ValueError, match="pattern"):
        MarksConfig.model_validate(options | {"person": "Ada Lovelace"})
