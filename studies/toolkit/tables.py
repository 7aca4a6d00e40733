"""A study's results: one value for each subject, measure and condition; printed beside published figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from srl.studies.toolkit.errors import StudyError, exactly, numbers
from srl.studies.toolkit.statistics import SignTest, Summary, level, sign_test, summary, words


@dataclass(frozen=True)
class Measure:
    """A measured quantity.

    Attributes:
        name: short, as in the paper ("T").
        unit: of the values.
        meaning: in words.
        values: (n,) by condition, in the order of the table's subjects.
        decimals: number printed for means and deviations.
    """

    name: str
    unit: str
    meaning: str
    values: Mapping[str, Sequence[float]]
    decimals: int = 2

    def summary(self, condition: str) -> Summary:
        """Returns mean and standard deviation under a condition."""
        return summary(self.values[condition], f"{self.name}, {condition}")


@dataclass(frozen=True)
class Printed:
    """A publication's figures of a measure.

    Attributes:
        metrics: mean and standard deviation by condition, as printed.
        significant: the level below which p is said to be; None: said not to be significant.
        decimals: number printed for means and deviations.
    """

    metrics: Mapping[str, tuple[float, float]]
    significant: float | None
    decimals: int = 2


@dataclass(frozen=True)
class Difference:
    """A printed figure that differs from the one of the subjects' rows.

    Attributes:
        measure, condition: the place; the condition is "" for the test.
        what: "mean", "deviation", or "p": then `printed` is the level below which p is said to be (1: none).
        printed, computed: the two figures.
    """

    measure: str
    condition: str
    what: str
    printed: float
    computed: float


@dataclass(frozen=True)
class Table:
    """Rows per subject, columns per measure and condition.

    Attributes:
        title: the line above the table.
        subjects: (n,) names.
        conditions: two of them; the first is compared with the second.
        measures: in their order.
    """

    title: str
    subjects: Sequence[str]
    conditions: tuple[str, str]
    measures: Sequence[Measure]

    def __post_init__(self) -> None:
        """Raises StudyError: no subject, a condition missing or unknown, unequal lengths, a value not finite."""
        if not self.subjects or not self.measures:
            raise StudyError(self.title, "there are no subjects or no measures", "Give at least one of each")
        exactly(self.title, self.subjects, tuple(dict.fromkeys(self.subjects)), "subject")
        names = [measure.name for measure in self.measures]
        exactly(self.title, names, tuple(dict.fromkeys(names)), "measure")
        for measure in self.measures:
            place = f"{self.title}: {measure.name}"
            exactly(place, measure.values, self.conditions, "condition")
            for condition, values in measure.values.items():
                found = len(numbers(f"{place}, {condition}", values))
                if found != len(self.subjects):
                    problem = f"{found} values for {len(self.subjects)} subjects"
                    raise StudyError(f"{place}, {condition}", problem, "Give one value for each subject")

    def measure(self, name: str) -> Measure:
        """Returns the measure of that name; raises StudyError if there is none."""
        for measure in self.measures:
            if measure.name == name:
                return measure
        names = ", ".join(measure.name for measure in self.measures)
        raise StudyError(self.title, f"there is no measure '{name}'", f"The measures are {names}")

    def sign_test(self, name: str) -> SignTest:
        """Tests the first condition against the second."""
        values = self.measure(name).values
        return sign_test(values[self.conditions[0]], values[self.conditions[1]], f"{self.title}: {name}")

    def more(self, name: str) -> list[str]:
        """Returns the subjects with a larger value under the first condition than under the second."""
        one, other = (self.measure(name).values[condition] for condition in self.conditions)
        return [subject for subject, a, b in zip(self.subjects, one, other, strict=True) if a > b]

    def differences(self, printed: Mapping[str, Printed]) -> list[Difference]:
        """Returns the printed figures that differ from those of this table's rows, to the decimals printed.

        Raises:
            StudyError: a measure isn't in this table, or a condition has no figures.
        """
        found = []
        for name, says in printed.items():
            measure = self.measure(name)
            exactly(f"{self.title}: {name}, as printed", says.metrics, self.conditions, "condition")
            for condition in self.conditions:
                ours = measure.summary(condition)
                for what, theirs, computed in zip(
                    ("mean", "deviation"), says.metrics[condition], (ours.mean, ours.deviation), strict=True
                ):
                    # Half a unit of the last decimal; both ways of rounding a half are allowed.
                    if not abs(theirs - computed) <= 0.5 * 10.0**-says.decimals * (1 + 1e-9):
                        found.append(Difference(name, condition, what, theirs, computed))
            p = self.sign_test(name).p
            significant = level(p) is not None if says.significant is None else p >= says.significant
            if significant:
                stated_p = 1.0 if says.significant is None else says.significant
                found.append(Difference(name, "", "p", stated_p, p))
        return found

    def markdown(self, beside: Mapping[str, Printed] | None = None) -> str:
        """Returns a markdown table, with the published figures below ours if given."""
        rows = [[cell.replace("|", "\\|") for cell in row] for row in self._rows(beside)]
        rule = [":--", *("--:" for _ in rows[0][1:])]
        lines = [f"| {' | '.join(row)} |" for row in (rows[0], rule, *rows[1:])]
        return "\n".join([f"**{self.title}**", "", *lines]) + "\n"

    def console(self, beside: Mapping[str, Printed] | None = None) -> str:
        """Returns aligned text, with the published figures below ours if given."""
        rows = self._rows(beside)
        widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
        lines = [
            "  ".join(
                cell.ljust(w) if i == 0 else cell.rjust(w) for i, (cell, w) in enumerate(zip(row, widths, strict=True))
            )
            for row in rows
        ]
        rule = "-" * len(lines[0])
        subjects = 1 + len(self.subjects)
        return "\n".join([self.title, rule, lines[0], rule, *lines[1:subjects], rule, *lines[subjects:], rule]) + "\n"

    def as_json(self) -> dict[str, Any]:
        """Returns subjects, values, means, deviations and sign tests for `--json`."""
        one, other = self.conditions
        measures = []
        for measure in self.measures:
            test = self.sign_test(measure.name)
            metrics = {}
            for condition in self.conditions:
                got = measure.summary(condition)
                deviation = got.deviation if got.n > 1 else None  # JSON has no nan
                values = [float(v) for v in measure.values[condition]]
                metrics[condition] = {"values": values, "mean": got.mean, "deviation": deviation}
            measures.append(
                {
                    "name": measure.name,
                    "unit": measure.unit,
                    "meaning": measure.meaning,
                    "conditions": metrics,
                    "sign_test": {"more": test.more, "less": test.less, "ties": test.ties, "p": test.p},
                }
            )
        return {"title": self.title, "subjects": list(self.subjects), "compared": [one, other], "measures": measures}

    def _rows(self, beside: Mapping[str, Printed] | None) -> list[list[str]]:
        columns = [(measure, condition) for measure in self.measures for condition in self.conditions]
        rows = [["subject", *(f"{m.name} {c} ({m.unit})" for m, c in columns)]]
        for i, subject in enumerate(self.subjects):
            rows.append([subject, *(_plain(m, c, i) for m, c in columns)])
        rows.append(["mean (sd)", *(_mean(m, c) for m, c in columns)])
        if beside is not None:
            rows.append(["published", *(_published(beside.get(m.name), c) for m, c in columns)])
        first = self.conditions[0]
        tests = {m.name: self.sign_test(m.name) for m in self.measures}
        rows.append(["sign test", *(words(tests[m.name].p) if c == first else "" for m, c in columns)])
        if beside is not None:
            rows.append(["published", *(_level(beside.get(m.name)) if c == first else "" for m, c in columns)])
        return rows


def _plain(measure: Measure, condition: str, subject: int) -> str:
    values = measure.values[condition]
    decimals = 0 if all(float(v).is_integer() for v in values) else measure.decimals
    return f"{values[subject]:.{decimals}f}"


def _mean(measure: Measure, condition: str) -> str:
    got, d = measure.summary(condition), measure.decimals
    return f"{got.mean:.{d}f} ({got.deviation:.{d}f})" if got.n > 1 else f"{got.mean:.{d}f}"


def _published(printed: Printed | None, condition: str) -> str:
    if printed is None or condition not in printed.metrics:
        return "-"
    mean, deviation = printed.metrics[condition]
    return f"{mean:.{printed.decimals}f} ({deviation:.{printed.decimals}f})"


def _level(printed: Printed | None) -> str:
    if printed is None:
        return "-"
    return "n.s." if printed.significant is None else f"p < {printed.significant:g}"
