"""NASA-TLX: perceived workload by six subscales (Hart and Staveland, 1988).

Ratings go from 0 to 100. More is worse on every subscale; on performance, 0 is a perfect result and 100 a
failure. The raw score is the mean of the ratings. The weighted score counts each rating as often as the subject
chose its subscale in the 15 comparisons of two.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Final

from srl.studies.toolkit import sheets
from srl.studies.toolkit.errors import StudyError, exactly

SUBSCALES: Final = ("mental_demand", "physical_demand", "temporal_demand", "performance", "effort", "frustration")
PAIRS: Final = tuple(combinations(SUBSCALES, 2))
HIGHEST: Final = 100.0
RAW: Final = "raw"
WEIGHTED: Final = "weighted"
_WEIGHT: Final = "weight_"  # a sheet's columns of weights
_VERSUS: Final = "/"  # and of comparisons: effort/frustration


@dataclass(frozen=True)
class Answer:
    """A subject's answers after one condition.

    Attributes:
        subject, condition: e.g. "S1", "HR".
        ratings: 0 to 100 by subscale.
        weights: 0 to 5 by subscale, 15 in total; None if there were no comparisons.
        place: the source, for errors.
    """

    subject: str
    condition: str
    ratings: Mapping[str, float]
    weights: Mapping[str, int] | None = None
    place: str = ""

    def __post_init__(self) -> None:
        """Raises StudyError: a subscale is missing or unknown, or a rating or weight isn't possible."""
        object.__setattr__(self, "place", self.place or f"NASA-TLX of {self.subject}, {self.condition}")
        exactly(self.place, self.ratings, SUBSCALES, "subscale")
        for name, rating in self.ratings.items():
            if not (math.isfinite(rating) and 0 <= rating <= HIGHEST):
                raise StudyError(self.place, f"{name} is rated {rating:g}, expected 0 to 100", "Correct the rating")
        if self.weights is not None:
            check_weights(self.weights, self.place)

    @property
    def raw(self) -> float:
        """The raw score, 0 to 100."""
        return math.fsum(self.ratings.values()) / len(SUBSCALES)

    @property
    def weighted(self) -> float:
        """The weighted score, 0 to 100; raises StudyError without weights."""
        if self.weights is None:
            raise StudyError(self.place, "there are no comparisons to weigh with", "Take the raw score")
        return math.fsum(self.weights[name] * self.ratings[name] for name in SUBSCALES) / len(PAIRS)


def weights_of(chosen: Mapping[tuple[str, str], str], place: str = "NASA-TLX") -> dict[str, int]:
    """Returns the subscales' weights from the 15 comparisons: how often each was chosen.

    Args:
        chosen: for each pair, in any order within it, the subscale that mattered more.
        place: for errors.

    Raises:
        StudyError: a pair is missing, unknown or given twice, or the choice isn't one of the two.
    """
    known = {frozenset(pair): _VERSUS.join(pair) for pair in PAIRS}
    given = [known.get(frozenset(pair), _VERSUS.join(pair)) for pair in chosen]
    exactly(place, given, tuple(known.values()), "comparison")
    weights = dict.fromkeys(SUBSCALES, 0)
    for pair, winner in chosen.items():
        if winner not in pair:
            raise StudyError(place, f"'{winner}' was chosen of {_VERSUS.join(pair)}", "Choose one of the two")
        weights[winner] += 1
    return weights


def check_weights(weights: Mapping[str, int], place: str = "NASA-TLX") -> None:
    """Checks whether 15 comparisons can give these weights.

    Raises:
        StudyError: they can't, or a subscale is missing.
    """
    exactly(place, weights, SUBSCALES, "subscale")
    if wrong := [name for name in SUBSCALES if weights[name] not in range(len(SUBSCALES))]:
        problem = f"the weight of {wrong[0]} is {weights[wrong[0]]}, expected a whole number from 0 to 5"
        raise StudyError(place, problem, "Count how often the subscale was chosen")
    total = sum(weights.values())
    if total != len(PAIRS):
        raise StudyError(place, f"the weights add up to {total}, expected {len(PAIRS)}", "Count the choices again")
    # Among themselves any k subscales decide k (k - 1) / 2 comparisons, so the k least have at least that sum.
    least = sorted(weights.values())
    for k in range(2, len(least)):
        if sum(least[:k]) < k * (k - 1) // 2:
            problem = f"no 15 comparisons give the weights {', '.join(str(w) for w in weights.values())}"
            raise StudyError(place, problem, "Count the choices again")


def read(path: Path) -> list[Answer]:
    """Reads answers from a sheet with the columns subject, condition and the six subscales.

    Weights come from columns `weight_<subscale>`, or from the comparisons themselves: columns such as
    `effort/frustration` that contain the chosen name. Without either there are no weights.

    Raises:
        StudyError: the sheet or an answer in it is invalid.
    """
    answers = []
    seen: dict[tuple[str, str], str] = {}
    for line in sheets.read(path, ("subject", "condition", *SUBSCALES)):
        subject, condition = line.cells.get("subject", ""), line.cells.get("condition", "")
        if not subject or not condition:
            raise StudyError(line.place, "subject or condition is empty", "Fill it in")
        if (subject, condition) in seen:
            problem = f"{subject} has answered for {condition} before ({seen[subject, condition]})"
            raise StudyError(line.place, problem, "Keep one of them")
        seen[subject, condition] = line.place
        ratings = {name: line.number(name) for name in SUBSCALES}
        answers.append(Answer(subject, condition, ratings, _weights(line), line.place))
    return answers


def by_subscale(answers: Iterable[Answer], conditions: Sequence[str]) -> dict[str, dict[str, list[float]]]:
    """Returns ratings by subscale and condition, subjects in the same order, for the tests and boxplots.

    Also `raw`, and `weighted` if all answers have weights.

    Raises:
        StudyError: there are no answers, or a subject lacks a condition.
    """
    wanted = [answer for answer in answers if answer.condition in conditions]
    found = {(answer.subject, answer.condition): answer for answer in wanted}
    subjects = list(dict.fromkeys(answer.subject for answer in wanted))
    if not subjects:
        raise StudyError("NASA-TLX", f"no answers for {' or '.join(conditions)}", "Check the conditions' names")
    if len(found) < len(wanted):
        raise StudyError("NASA-TLX", "a subject has two answers for one condition", "Keep one of them")
    for subject in subjects:
        if missing := [condition for condition in conditions if (subject, condition) not in found]:
            problem = f"{subject} has no answer for {', '.join(missing)}"
            raise StudyError("NASA-TLX", problem, "Add it, or leave the subject out")

    def each(score: str, answer: Answer) -> float:
        if score in SUBSCALES:
            return answer.ratings[score]
        return answer.raw if score == RAW else answer.weighted

    weighted = all(answer.weights is not None for answer in wanted)
    scores = (*SUBSCALES, RAW, *((WEIGHTED,) if weighted else ()))
    return {
        score: {condition: [each(score, found[subject, condition]) for subject in subjects] for condition in conditions}
        for score in scores
    }


def _weights(line: sheets.Line) -> dict[str, int] | None:
    pairs = {
        (parts[0], parts[1]): cell.strip().lower()
        for column, cell in line.cells.items()
        if len(parts := [part.strip() for part in column.split(_VERSUS)]) == 2  # other columns are the lab's own
    }
    columns = [column for column in line.cells if column.startswith(_WEIGHT)]
    if pairs and columns:
        raise StudyError(line.place, "there are both weights and comparisons", "Keep one of them")
    if pairs:
        return weights_of(pairs, line.place)
    if not columns:
        return None
    exactly(line.place, [column.removeprefix(_WEIGHT) for column in columns], SUBSCALES, "subscale")
    weights = {}
    for name in SUBSCALES:
        weight = line.number(_WEIGHT + name)
        if weight != int(weight):
            problem = f"the weight of {name} is {weight:g}, expected a whole number from 0 to 5"
            raise StudyError(line.place, problem, "Count how often the subscale was chosen")
        weights[name] = int(weight)
    return weights
