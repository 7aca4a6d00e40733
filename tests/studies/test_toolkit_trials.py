"""Touches, holds, and trials gathered into tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from srl.studies.superman.published import TABLE_II
from srl.studies.toolkit.errors import StudyError
from srl.studies.toolkit.trials import Trial, each, holds, read, table, touches

MEASURES = {"T": ("s", "completion time"), "N_err": ("errors", "touches")}


def test_touches_that_bounce_count_once() -> None:
    time = np.arange(0, 10, 0.01)
    force = np.zeros(len(time))
    for start, end in ((1.0, 1.5), (1.6, 1.8), (1.95, 2.0), (5.0, 5.02)):
        force[(time >= start - 1e-9) & (time < end - 1e-9)] = -3.0
    assert touches(time, force, 0.5) == pytest.approx([1.0, 5.0])
    assert touches(time, force, 0.5, apart=0.0) == pytest.approx([1.0, 1.6, 1.95, 5.0])
    assert touches(time, force, 4.0) == []


def test_a_contact_at_the_start_counts() -> None:
    assert touches([0, 1, 2], [1, 0, 0], 0.5) == [0.0]


@given(st.lists(st.booleans(), min_size=1, max_size=200), st.integers(0, 30))
def test_touches_against_a_walk_through_the_samples(contact: list[bool], apart: int) -> None:
    count, left = 0, -(10**9)
    for i, there in enumerate(contact):
        if there:
            count += i - left > max(apart, 1)
            left = i
    assert len(touches(range(len(contact)), contact, 0.5, apart)) == count


def test_holes_are_held_long_enough_without_a_break() -> None:
    time = np.arange(0, 30, 0.1)
    inside = ((time > 1) & (time < 7)) | ((time > 10) & (time < 14.5)) | (time > 24)
    found = holds(time, inside, 5.0)
    assert [span[0] for span in found] == pytest.approx([1.1, 24.1], abs=0.11)
    assert holds([0, 1, 2], [1, 1, 1], 2.0) == [(0, 2)]
    assert holds([0, 1, 2], [0, 0, 0], 0.0) == []
    assert each(120, 12) == 10


def test_wrong_series() -> None:
    with pytest.raises(StudyError, match="rise"):
        touches([0, 1, 1], [0, 0, 0], 1)
    with pytest.raises(StudyError, match="pair"):
        holds([0, 1], [1], 1)
    with pytest.raises(StudyError, match="threshold"):
        touches([0, 1], [0, 0], 0)
    with pytest.raises(StudyError, match="0 holes in 60 s"):
        each(60, 0)


def test_the_papers_table_from_a_sheet_of_trials(tmp_path: Path) -> None:
    sheet = tmp_path / "trials.csv"
    lines = ["Subject,Condition,N_Hl,T,N_err,remark"]
    for i in reversed(range(12)):
        for condition in ("H", "HR"):
            values = ",".join(str(measure.values[condition][i]) for measure in TABLE_II.measures)
            lines.append(f"S{i + 1},{condition},{values},fine")
    sheet.write_text("\n".join(lines))
    measures = {m.name: (m.unit, m.meaning) for m in TABLE_II.measures}
    found = table("drilling", read(sheet, list(measures)), ("HR", "H"), measures)
    assert found.subjects == [f"S{i}" for i in range(12, 0, -1)]
    for measure in TABLE_II.measures:
        assert found.sign_test(measure.name) == TABLE_II.sign_test(measure.name)
        assert list(found.measure(measure.name).values["H"]) == list(measure.values["H"])[::-1]


def _trial(subject: str, condition: str, **values: float) -> Trial:
    return Trial(subject, condition, {"T": 1.0, "N_err": 0.0} | values)


def test_trials_that_do_not_make_a_table() -> None:
    good = [_trial("S1", "HR"), _trial("S1", "H"), _trial("S1", "training")]
    assert table("t", good, ("HR", "H"), MEASURES).subjects == ["S1"]
    for trials, says in (
        ([*good, _trial("S2", "H")], "S2 has no trial of HR"),
        ([*good, _trial("S1", "H")], "S1 has H twice"),
        ([*good, Trial("S2", "H", {"T": 1.0})], "S2, H: no N_err"),
        ([*good, _trial("S2", "H"), _trial("S2", "HR", T=float("inf"))], "value 2 of 2 is inf"),
        ([], "no subjects"),
    ):
        with pytest.raises(StudyError, match=says):
            table("t", trials, ("HR", "H"), MEASURES)
