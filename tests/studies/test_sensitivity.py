"""The study sensitivity: its points, what it finds of rows whose mechanism is known, a short run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from srl.studies.superman import sensitivity
from srl.studies.superman.assumptions import assumed
from srl.studies.superman.sensitivity_design import NAMES, points, tasks

A = assumed(sensitivity.STUDY)
RANGES = {**A["person"], **A["task"]}


def test_points_cover_the_ranges_evenly() -> None:
    found = points(A["points"])
    assert [p.number for p in found] == list(range(1, A["points"] + 1))
    for name, ranged in RANGES.items():
        values = np.array([p.values[name] for p in found])
        low, high = ranged["low"], ranged["high"]
        share = np.log(values / low) / np.log(high / low) if ranged.get("log") else (values - low) / (high - low)
        assert sorted((share * 8).astype(int)) == sorted(list(range(8)) * (A["points"] // 8)), name
    assert found[:2] == points(2)


def test_a_point_is_a_person_and_a_task() -> None:
    point = points(1)[0]
    assert point.person.knowledge == point.values["knowledge"]
    assert np.hypot(point.person.bias_x, point.person.bias_y) == pytest.approx(point.values["beside"])
    assert np.hypot(point.person.tilt_x, point.person.tilt_y) == pytest.approx(point.values["tilted"])
    asked = tasks(points(2))
    assert len(asked) == 2 * len(NAMES)
    assert len({task.identity for task in asked}) == len(asked)
    assert asked[0].parameters["changed"].keys() == A["task"].keys()


def rows(beside: float, knowledge: float, *, lost: bool = False) -> dict[str, dict[str, Any]]:
    """Kairos is stopped by whoever aims far beside; who knows the robot isn't slower with it."""
    peg = {"force": 20.0, "withdrew": True, "stop": ""}
    force = 60.0 + 5e4 * beside
    bare = {"force": force, "withdrew": False, "stop": "device fault" if force > 160.0 else ""}
    wire = {"finished": 1.0, "N_err": 0.0, "moving": 40.0}
    drilling = {"N_Hl": 3.0, "N_err": 0.0, "T": 9.0}
    load = {
        "placed": 40.0, "lifted": 10.0, "stands": True, "stop": "", "off": 0.01, "tilt": 0.0, "force_z": -98.0,
        "touches": 0, "least": 0.1, "manipulation": 10.0, "locomotion": 10.0,
    }  # fmt: skip
    found: dict[str, dict[str, Any]] = dict.fromkeys(NAMES, peg) | {
        "peg Kairos as published": bare, "wire H": wire, "wire HR": wire | {"moving": 60.0 - 25.0 * knowledge},
        "drilling HR": drilling, "drilling H": drilling | {"N_Hl": 20.0}, "load": load,
    }  # fmt: skip
    return {name: row for name, row in found.items() if not (lost and name == "load")}


def test_it_finds_what_decides_and_nothing_else() -> None:
    chosen = points(A["points"])
    found = [rows(p.values["beside"], p.values["knowledge"], lost=k == 0) for k, p in enumerate(chosen)]
    table, shown = sensitivity.analysed(chosen, found)
    by = {(row["claim"], row["hinges on"]): row for row in table}
    kairos = by["peg-in-hole: kairos-exceeds-payload", "beside"]
    assert kairos["rank correlation"] > 0.9
    assert (kairos["holds, lower half"], kairos["holds, upper half"]) == ("8 of 16", "16 of 16")
    slower = by["wire-path: robot-slower", "knowledge"]
    assert slower["rank correlation"] < -0.9
    assert ("peg-in-hole: moca-inserts", "nothing that is significant") in by
    assert by["load-carrying: load-carried", "nothing that is significant"]["holds at"] == f"{len(chosen) - 1} of 31"
    assert set(shown) == set(sensitivity.CLAIMS)


@pytest.mark.slow
def test_the_picture(tmp_path: Path) -> None:
    chosen = points(8)
    _, shown = sensitivity.analysed(chosen, [rows(p.values["beside"], p.values["knowledge"]) for p in chosen])
    sensitivity.draw(tmp_path / "s.png", shown, list(chosen[0].values))
    assert (tmp_path / "s.png").stat().st_size > 10000
