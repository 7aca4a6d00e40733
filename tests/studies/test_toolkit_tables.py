"""The paper's Tables I and II from their own rows, what they print wrong, and tables in general."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from statistics import fmean, stdev

import pytest
from scipy import stats

from srl.studies.superman.published import (
    ACTIVITY_I,
    ACTIVITY_II,
    ERRATA_I,
    ERRATA_II,
    PRINTED_I,
    PRINTED_II,
    TABLE_I,
    TABLE_II,
    WORKLOAD_I,
    WORKLOAD_II,
)
from srl.studies.toolkit.errors import StudyError
from srl.studies.toolkit.nasa_tlx import SUBSCALES
from srl.studies.toolkit.semg import MUSCLES
from srl.studies.toolkit.tables import Difference, Measure, Printed, Table

BOTH = [(TABLE_I, PRINTED_I, ERRATA_I), (TABLE_II, PRINTED_II, ERRATA_II)]


@pytest.mark.parametrize(("table", "printed", "errata"), BOTH)
def test_the_rows_give_the_printed_figures_but_for_the_errata(
    table: Table, printed: Mapping[str, Printed], errata: Sequence[Difference]
) -> None:
    found = table.differences(printed)
    assert [(d.measure, d.condition, d.what, d.printed, round(d.computed, 2)) for d in found] == [
        (d.measure, d.condition, d.what, d.printed, d.computed) for d in errata
    ]


@pytest.mark.parametrize("table", [TABLE_I, TABLE_II])
def test_means_deviations_and_p_by_other_means(table: Table) -> None:
    for measure in table.measures:
        hr, h = measure.values["HR"], measure.values["H"]
        for condition, values in (("HR", hr), ("H", h)):
            got = measure.summary(condition)
            assert (got.mean, got.deviation) == pytest.approx((fmean(values), stdev(values)), abs=1e-12)
        more, less = sum(a > b for a, b in zip(hr, h, strict=True)), sum(a < b for a, b in zip(hr, h, strict=True))
        assert table.sign_test(measure.name).p == pytest.approx(stats.binomtest(more, more + less).pvalue)


def test_errata_of_the_text() -> None:
    # "all the participants made less or the same number of errors": two made more.
    assert TABLE_II.more("N_err") == ["S8", "S9"]
    # "Only three subjects out of 12 could complete the task" alone: that holds.
    assert sum(holes == 20 for holes in TABLE_II.measure("N_Hl").values["H"]) == 3
    assert TABLE_II.sign_test("N_err").p == pytest.approx(0.289, abs=5e-4)


def test_what_the_figures_text_says_names_all_subscales_and_muscles() -> None:
    assert set(WORKLOAD_I) == set(WORKLOAD_II) == set(SUBSCALES)
    assert set(ACTIVITY_I) == set(ACTIVITY_II) == set(MUSCLES)


def test_console_and_markdown_show_subjects_ours_and_theirs() -> None:
    text = TABLE_II.console(PRINTED_II)
    lines = text.splitlines()
    assert len({len(line) for line in lines[1:]}) == 1
    assert sum(line.startswith("S") for line in lines) == 12
    ours, theirs = (next(line for line in lines if line.startswith(name)) for name in ("mean", "published"))
    assert "13.00 (4.94)" in ours
    assert "13.00 (4.93)" in theirs
    assert "p = 0.29" in text
    markdown = TABLE_II.markdown(PRINTED_II).splitlines()
    assert {line.count("|") for line in markdown[2:]} == {8}
    assert "| S8 | 20 | 6 | 11.00 | 8.50 | 1 | 0 |" in markdown
    assert "published" not in TABLE_II.markdown()


def test_json_round_trip() -> None:
    found = json.loads(json.dumps(TABLE_I.as_json(), allow_nan=False))
    time = found["measures"][1]
    assert time["conditions"]["H"]["mean"] == pytest.approx(1556 / 12)
    assert time["sign_test"] == {"more": 12, "less": 0, "ties": 0, "p": 2 / 4096}


def test_one_subject_has_no_deviation_and_prints() -> None:
    table = Table("t", ["S1"], ("A", "B"), [Measure("x", "s", "time", {"A": [1.5], "B": [2]})])
    assert "1.50" in table.console()
    assert table.measure("x").summary("A").mean == 1.5
    assert '"deviation": null' in json.dumps(table.as_json(), allow_nan=False)


def test_a_claimed_significance_that_the_rows_lack_and_one_that_is_denied() -> None:
    table = Table("t", list("abcdefgh"), ("A", "B"), [Measure("x", "", "", {"A": [1] * 8, "B": [2] * 8})])
    metrics = {"A": (1.0, 0.0), "B": (2.0, 0.0)}
    assert table.differences({"x": Printed(metrics, 0.01)}) == []
    assert table.differences({"x": Printed(metrics, 0.001)}) == [Difference("x", "", "p", 0.001, 2 / 256)]
    assert table.differences({"x": Printed(metrics, None)}) == [Difference("x", "", "p", 1.0, 2 / 256)]


@pytest.mark.parametrize(
    ("subjects", "values", "says"),
    [
        ([], {"A": [], "B": []}, "no subjects"),
        (["S1", "S2"], {"A": [1, 2], "B": [1]}, "1 values for 2 subjects"),
        (["S1", "S1"], {"A": [1, 2], "B": [1, 2]}, "'S1' is there twice"),
        (["S1"], {"A": [1]}, "without the condition B"),
        (["S1"], {"A": [1], "B": [1], "C": [1]}, "no condition 'C'"),
        (["S1"], {"A": [1], "B": [float("nan")]}, "value 1 of 1 is nan"),
    ],
)
def test_tables_with_mistakes(subjects: list[str], values: dict[str, list[float]], says: str) -> None:
    with pytest.raises(StudyError, match=says):
        Table("t", subjects, ("A", "B"), [Measure("x", "s", "time", values)])


def test_an_unknown_measure() -> None:
    with pytest.raises(StudyError, match=r"no measure 'time'.*N_err, T"):
        TABLE_I.measure("time")
