"""Interleaved pairs: their order, and what the ratio and the control are of."""

from __future__ import annotations

import pytest

from bench import pairs
from bench.pairs import LEAST, measure


def test_ours_and_the_others_take_turns_and_the_control_is_ours_before_and_after_them() -> None:
    order: list[str] = []
    mine = iter((8.0, 4.0, 2.0, 1.0))

    def ours() -> dict[str, float]:
        order.append("ours")
        return {"p50": next(mine)}

    def other(name: str) -> dict[str, float]:
        order.append(name)
        return {"p50": 4.0}

    found = measure(ours, {"one": lambda: other("one"), "two": lambda: other("two")}, 3)
    assert order == ["ours", "one", "two"] * 3 + ["ours"]
    row = found.row("id", "what", "p50", "two", "us")
    assert (row.ours, row.other, row.ratio, row.control, row.pairs) == (4.0, 4.0, 1.0, 2.0, 3)


def test_where_the_time_is_up_the_least_number_of_pairs_is_still_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pairs, "LONG", -1.0)
    monkeypatch.delenv(pairs.QUICK, raising=False)
    found = measure(lambda: {"p50": 1.0}, {"one": lambda: {"p50": 2.0}})
    assert found.row("id", "what", "p50", "one", "us").pairs == LEAST
