"""The claim on straps: what the analysis makes of tips, and a few seconds of the quick set."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.trial_rows import Here, row

from srl.studies.human_srl import strap_claims
from srl.studies.human_srl.strap_trial import Trial, trial
from srl.studies.tasks.task import Row


def rows(errors: dict[tuple[str, str], float], wearers: int = 4) -> list[Row]:
    """Tips that are off by so many mm in one direction; a little more from wearer to wearer."""
    path = np.random.default_rng(1).normal(0.0, 100.0, (50, 3))
    made = []
    for n in range(1, 1 + wearers):
        for (strap, way), error in {("rigid", "none"): 0.0, **errors}.items():
            tip = path + n + [error * (1.0 + 0.02 * n), 0.0, 0.0]
            values = {"tip": json.dumps(tip.tolist()), "shift": 0.008, "tilt": 0.04, "yaw": 0.005, "left": 0.0}
            made.append(row(strap_claims.task(n, strap, way), values))  # type: ignore[arg-type]
    return made


def test_errors_are_distances_from_the_same_wearers_tip_on_a_weld() -> None:
    part = strap_claims.analysed(rows({("medium", "none"): 30.0, ("medium", "roll-pitch"): 12.0}))
    lines = {line["way"]: line for line in part.table}
    assert lines["none"]["error_mm"] == pytest.approx(30.0 * 1.05)
    assert lines["roll-pitch"]["error_mm"] == pytest.approx(12.0 * 1.05)
    assert lines["none"]["shift_mm"] == pytest.approx(8.0)
    assert lines["none"]["tilt_deg"] == pytest.approx(2.29, abs=0.01)
    assert lines["none"]["error_mm_low"] < lines["none"]["error_mm"] < lines["none"]["error_mm_high"]
    (claim,) = part.claims
    assert claim.holds
    assert claim.measured == pytest.approx(40.0)


def test_one_strap_on_which_it_does_not_help_is_enough_to_fail() -> None:
    good = {("soft", "none"): 80.0, ("soft", "roll-pitch"): 30.0}
    assert strap_claims.analysed(rows(good)).claims[0].holds
    bad = {("hard", "none"): 15.0, ("hard", "roll-pitch"): 15.5}
    (claim,) = strap_claims.analysed(rows(good | bad)).claims
    assert not claim.holds
    assert claim.measured == pytest.approx(100.0 * 15.5 / 15.0)


def test_a_wearer_without_a_reference_is_left_out_and_nothing_is_claimed_of_one() -> None:
    made = rows({("medium", "none"): 30.0, ("medium", "roll-pitch"): 12.0}, 2)
    part = strap_claims.analysed([r for r in made if r.task.parameters["firmness"] != "rigid" or r.task.seed == 1])
    assert {line["n"] for line in part.table} == {1}
    assert not part.claims[0].holds
    (claim,) = strap_claims.analysed([]).claims
    assert claim.measured is None
    assert not claim.holds


def test_wearers_differ_and_ways_of_one_wearer_do_not() -> None:
    one, same, other = (strap_claims.task(n, "soft", way) for n, way in ((1, "none"), (1, "perfect"), (2, "none")))
    assert one.parameters["options"] == same.parameters["options"] != other.parameters["options"]
    assert one.seed == same.seed != other.seed


@pytest.mark.exhaustive
@pytest.mark.slow
def test_a_mount_that_is_told_wrong_costs_its_sine_times_the_lever() -> None:
    """On a weld there is nothing to compensate: what the law does is its mistake."""
    seconds, wrong = 4.0, 0.07
    reference = Trial("rigid", "none").run(seconds)

    def error(*mount: float) -> float:
        return Trial("rigid", "roll-pitch", mount=mount).run(seconds).error(reference)  # type: ignore[arg-type]

    assert error(0.0, 0.0, 0.0) < 0.003
    assert 0.02 < error(0.0, wrong, 0.0) < 0.58 * wrong * 1.1
    assert error(0.0, 0.0, wrong) < 0.004, "which way its x points is of no account while the base is level"


@pytest.mark.exhaustive
@pytest.mark.slow
def test_quick_set_and_its_sweep_are_whole(tmp_path: Path) -> None:
    here = Here({"human-srl-strap": trial})
    (claim,) = strap_claims.claims(here, tmp_path, True).claims  # type: ignore[arg-type]
    assert claim.holds
    assert claim.measured is not None
    assert claim.measured < 70.0
