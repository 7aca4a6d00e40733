"""Boxplots: what is drawn, in each format, and what can't be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from srl.studies.toolkit.boxplots import draw
from srl.studies.toolkit.errors import StudyError
from srl.studies.toolkit.statistics import box

RNG = np.random.default_rng(1)
GROUPS = {
    name: {"HR": list(RNG.uniform(0, 60, 12).round(-1)), "H": list(RNG.uniform(50, 100, 12).round(-1))}
    for name in ("mental_demand", "physical_demand", "effort")
}


@pytest.mark.parametrize("ending", ["png", "svg", "pdf"])
def test_draws_each_format_and_says_what(tmp_path: Path, ending: str) -> None:
    file = tmp_path / f"tlx.{ending}"
    drawn = draw(GROUPS, ("HR", "H"), file, title="NASA-TLX", unit="rating", limits=(0, 100))
    assert file.stat().st_size > 1000
    assert drawn == {(g, c): box(values) for g, by in GROUPS.items() for c, values in by.items()}


def test_stars_names_and_every_point_are_in_the_picture(tmp_path: Path) -> None:
    file = tmp_path / "emg.svg"
    rising = [float(i) for i in range(12)]
    groups = {"biceps": {"HR": rising, "H": [v + 1 for v in rising]}, "triceps": {"HR": rising, "H": rising}}
    draw(groups, ("HR", "H"), file, title="sEMG", unit="% MVC", names={"biceps": "BC", "triceps": "TR"})
    text = file.read_text()
    assert "<!-- *** -->" in text
    assert text.count("<!-- *") == 1
    assert "<!-- BC -->" in text
    points = [part.split("</g>")[0].count("<use ") for part in text.split('id="PathCollection_')[1:]]
    assert points == [12, 12, 12, 12]


def test_the_same_values_beside_each_other_and_a_single_one(tmp_path: Path) -> None:
    draw({"a": {"HR": [3.0] * 12, "H": [3.0] * 12}}, ("HR", "H"), tmp_path / "a.png", title="t", unit="")
    draw({"a": {"HR": [3.0], "H": [4.0]}}, ("HR", "H"), tmp_path / "a.png", title="t", unit="")


def test_mistakes(tmp_path: Path) -> None:
    def attempt(groups: dict[str, dict[str, list[float]]], name: str = "x.png") -> None:
        draw(groups, ("HR", "H"), tmp_path / name, title="t", unit="s")

    with pytest.raises(StudyError, match="nothing to draw"):
        attempt({})
    with pytest.raises(StudyError, match="t: a: without the condition H"):
        attempt({"a": {"HR": [1.0]}})
    with pytest.raises(StudyError, match="2 values don't pair with 1"):
        attempt({"a": {"HR": [1.0, 2.0], "H": [1.0]}})
    good = {"a": {"HR": [1.0], "H": [2.0]}}
    with pytest.raises(StudyError, match="can't be written"):
        attempt(good, "none/x.png")
    with pytest.raises(StudyError, match="can't be written"):
        attempt(good, "x.docx")
