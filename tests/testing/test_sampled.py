"""The sample of a product's cases that CI runs."""

from __future__ import annotations

from itertools import product

import pytest
from helpers import ROOT
from helpers.sampled import sampled, third


@pytest.mark.parametrize("sizes", [(1,), (4,), (2, 5), (3, 2, 5)])
def test_each_value_of_each_parameter_occurs_and_few_cases_do(sizes: tuple[int, ...]) -> None:
    cases = [dict(enumerate(indices)) for indices in product(*map(range, sizes))]
    taken = sampled([{str(name): value for name, value in case.items()} for case in cases])
    for name, size in enumerate(sizes):
        assert {cases[i][name] for i in taken} == set(range(size))
    assert len(taken) == max(sizes)


@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_so_many_are_taken_from_end_to_end(count: int) -> None:
    taken = sampled([{"a": i} for i in range(7)], count)
    assert len(taken) == count
    assert min(taken) == 0
    assert count == 1 or max(taken) == 6


def test_the_slow_tests_are_in_three_parts_and_none_is_lost() -> None:
    files = [path for path in (ROOT / "tests").rglob("test_*.py") if "mark.slow" in path.read_text()]
    parts = [third(path.relative_to(ROOT).as_posix()) for path in files]
    assert set(parts) == {0, 1, 2}
    assert all(len(files) / 5 < parts.count(part) < len(files) / 2 for part in range(3))
