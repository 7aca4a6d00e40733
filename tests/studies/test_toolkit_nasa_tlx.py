"""NASA-TLX: scores by hand, weights that comparisons can and can't give, sheets with mistakes."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srl.studies.toolkit.errors import StudyError
from srl.studies.toolkit.nasa_tlx import PAIRS, SUBSCALES, Answer, by_subscale, check_weights, read, weights_of

RATINGS = dict(zip(SUBSCALES, (55, 90, 30, 25, 70, 40), strict=True))
WEIGHTS = dict(zip(SUBSCALES, (2, 5, 1, 3, 4, 0), strict=True))
HEADER = "subject,condition," + ",".join(SUBSCALES)


def test_scores_worked_out_by_hand() -> None:
    answer = Answer("S1", "H", RATINGS, WEIGHTS)
    assert answer.raw == pytest.approx(310 / 6)
    assert answer.weighted == pytest.approx((110 + 450 + 30 + 75 + 280 + 0) / 15)


def test_weighted_without_comparisons_says_what_to_do() -> None:
    with pytest.raises(StudyError, match=r"S1, H: .*raw score"):
        _ = Answer("S1", "H", RATINGS).weighted


@given(st.lists(st.integers(0, 1), min_size=15, max_size=15), st.lists(st.floats(0, 100), min_size=6, max_size=6))
def test_any_comparisons_give_valid_weights_and_a_score_within_the_ratings(
    sides: list[int], rated: list[float]
) -> None:
    weights = weights_of({pair: pair[side] for pair, side in zip(PAIRS, sides, strict=True)})
    check_weights(weights)
    answer = Answer("S", "C", dict(zip(SUBSCALES, rated, strict=True)), weights)
    assert min(rated) - 1e-9 <= answer.weighted <= max(rated) + 1e-9
    assert min(rated) - 1e-9 <= answer.raw <= max(rated) + 1e-9


def test_weights_are_accepted_exactly_if_some_comparisons_give_them() -> None:
    possible = set()
    for sides in itertools.product((0, 1), repeat=15):
        counts = [0] * 6
        for (a, b), side in zip(itertools.combinations(range(6), 2), sides, strict=True):
            counts[b if side else a] += 1
        possible.add(tuple(counts))
    for counts_ in itertools.product(range(6), repeat=6):
        if sum(counts_) != 15:
            continue
        weights = dict(zip(SUBSCALES, counts_, strict=True))
        if counts_ in possible:
            check_weights(weights)
        else:
            with pytest.raises(StudyError, match="no 15 comparisons"):
                check_weights(weights)


@pytest.mark.parametrize("bad", [-1, 100.5, float("nan"), float("inf")])
def test_ratings_out_of_range(bad: float) -> None:
    with pytest.raises(StudyError, match="effort is rated"):
        Answer("S1", "HR", RATINGS | {"effort": bad})


def test_missing_and_unknown_subscales() -> None:
    with pytest.raises(StudyError, match="without the subscale frustration"):
        Answer("S1", "HR", {k: v for k, v in RATINGS.items() if k != "frustration"})
    with pytest.raises(StudyError, match="no subscale 'stress'"):
        Answer("S1", "HR", RATINGS | {"stress": 3})


def test_comparisons_with_mistakes() -> None:
    chosen = {pair: pair[0] for pair in PAIRS}
    with pytest.raises(StudyError, match="without the comparison effort/frustration"):
        weights_of({pair: name for pair, name in chosen.items() if pair != ("effort", "frustration")})
    with pytest.raises(StudyError, match="twice"):
        weights_of(chosen | {("frustration", "effort"): "effort"})
    with pytest.raises(StudyError, match="'performance' was chosen of effort/frustration"):
        weights_of(chosen | {("effort", "frustration"): "performance"})
    with pytest.raises(StudyError, match="add up to 16"):
        check_weights(WEIGHTS | {"frustration": 1})
    with pytest.raises(StudyError, match="weight of effort is 6"):
        check_weights(WEIGHTS | {"effort": 6})


def test_a_sheet_of_ratings_with_weights(tmp_path: Path) -> None:
    sheet = tmp_path / "tlx.csv"
    weights = ",".join(f"weight_{name}" for name in SUBSCALES)
    sheet.write_text(f"{HEADER},{weights}\nS1,HR,55,90,30,25,70,40,2,5,1,3,4,0\n\nS1,H,1,2,3,4,5,6,5,4,3,2,1,0\n")
    one, other = read(sheet)
    assert (one.subject, one.condition, one.ratings, one.weights) == ("S1", "HR", RATINGS, WEIGHTS)
    assert other.raw == 3.5
    assert by_subscale([one, other], ("HR", "H"))["weighted"] == {"HR": [one.weighted], "H": [other.weighted]}


def test_a_sheet_of_comparisons_as_a_german_spreadsheet_writes_it(tmp_path: Path) -> None:
    sheet = tmp_path / "tlx.csv"
    columns = ";".join(f"{b}/{a}" for a, b in PAIRS)
    chosen = ";".join(a for a, _ in PAIRS)
    sheet.write_bytes(
        f"{HEADER.replace(',', ';')};{columns}\r\nS1;HR;55;90;30;25;70;40;{chosen}\r\n".encode("utf-8-sig")
    )
    assert list((read(sheet)[0].weights or {}).values()) == [5, 4, 3, 2, 1, 0]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "line 1: no column subject"),
        (HEADER, "no lines below the header"),
        (HEADER.replace("effort,", "") + "\nS1,HR,1,2,3,4,5", "no column effort"),
        (HEADER + "\nS1,HR,1,2,3,4,5", "line 2: frustration is empty"),
        (HEADER + "\nS1,HR,1,2,3,4,five,6", "line 2: effort: expected a number, got 'five'"),
        (HEADER + "\nS1,HR,1,2,3,4,5,6,7", "9 cells under 8 columns"),
        (HEADER + "\nS1,HR,1,2,3,4,5,101", "line 2: frustration is rated 101"),
        (HEADER + "\nS1,HR,1,2,3,4,5,6\nS1,HR,1,2,3,4,5,6", "line 3: S1 has answered for HR before"),
        (HEADER + "\n,HR,1,2,3,4,5,6", "line 2: subject or condition is empty"),
        (HEADER + ",effort\nS1,HR,1,2,3,4,5,6,7", "effort is there twice"),
        (HEADER + ",weight_effort\nS1,HR,1,2,3,4,5,6,5", "without the subscale mental_demand"),
    ],
)
def test_sheets_with_mistakes(tmp_path: Path, text: str, says: str) -> None:
    sheet = tmp_path / "tlx.csv"
    sheet.write_text(text)
    with pytest.raises(StudyError, match=says):
        read(sheet)


def test_a_sheet_that_is_not_there_or_is_no_text(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match="can't be read"):
        read(tmp_path / "none.csv")
    (tmp_path / "x.csv").write_bytes(b"\xff\xfe\x00s")
    with pytest.raises(StudyError, match="UTF-8"):
        read(tmp_path / "x.csv")


def test_pairs_by_subscale_keep_the_subjects_together_and_ask_for_both_conditions() -> None:
    def answer(subject: str, condition: str, effort: float) -> Answer:
        return Answer(subject, condition, RATINGS | {"effort": effort})

    answers = [answer("S2", "H", 4), answer("S1", "HR", 1), answer("S1", "H", 2), answer("S2", "HR", 3)]
    found = by_subscale([*answers, answer("S1", "training", 9)], ("HR", "H"))
    assert found["effort"] == {"HR": [3, 1], "H": [4, 2]}
    assert set(found) == {*SUBSCALES, "raw"}
    with pytest.raises(StudyError, match="S1 has no answer for HR"):
        by_subscale([answers[0], *answers[2:]], ("HR", "H"))
    with pytest.raises(StudyError, match="two answers"):
        by_subscale([*answers, answers[0]], ("HR", "H"))
    with pytest.raises(StudyError, match="no answers for A or B"):
        by_subscale(answers, ("A", "B"))
