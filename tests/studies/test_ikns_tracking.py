"""The study `ikns-tracking`: its tasks, one real trial, and what the analysis makes of rows."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from srl.studies.ikns import tracking
from srl.studies.ikns.curves import KINDS, SECONDS, curve, scores
from srl.studies.ikns.published import RMSE
from srl.studies.ikns.tracking_analysis import analysed, figure, means
from srl.studies.ikns.tracking_order import CONDITIONS, ordered
from srl.studies.ikns.tracking_trial import calibration, stillness, trial
from srl.studies.ikns.wearers import wearers
from srl.studies.tasks.task import DONE, Row, TrialTask, flat
from srl.studies.toolkit.statistics import paired_t, tost

SHIPPED = (resources.files("srl.profiles") / "ikns-finger.calibration.json").read_text()
ONE = tracking.Calibrated(replace(wearers(1)[0], stature=1.75), SHIPPED, ())


def test_every_subject_does_every_trial_once_in_an_order_of_its_own() -> None:
    orders = [list(ordered([2023, number, 1])) for number in range(1, 51)]
    everything = {(c, name, r) for c in CONDITIONS for name in KINDS for r in (1, 2, 3)}
    for order in orders:
        assert len(order) == 18
        assert set(order) == everything
        assert len({c for c, *_ in order[:9]}) == 1  # one condition, then the other
    assert len({tuple(order) for order in orders}) == 50
    assert 10 < sum(order[0][0] == "ikns" for order in orders) < 40


def test_a_wearers_tasks_differ_in_seed_and_are_plain() -> None:
    tasks = list(tracking.trials(ONE, "preview"))
    assert len({t.seed for t in tasks}) == 18
    assert [t.parameters["place"] for t in tasks] == list(range(1, 19))
    assert all(isinstance(t, TrialTask) and t.text for t in tasks)
    pursuit = {t.identity for t in tracking.trials(ONE, "pursuit")}
    assert not pursuit & {t.identity for t in tasks}
    assert {t.seed for t in tracking.trials(ONE, "pursuit")} == {t.seed for t in tasks}


def test_a_change_of_the_arm_leaves_the_gamepads_trials_and_the_other_way_round() -> None:
    plain = {t.identity for t in tracking.swept([ONE], {}, "preview")}
    for changed, condition in (({"marker_noise": 0.002}, "ikns"), ({"preload": 0.2}, "gamepad"),
                               ({"direction_error": lambda x: 2 * x}, "ikns")):  # fmt: skip
        new = [t for t in tracking.swept([ONE], changed, "preview") if t.identity not in plain]
        assert [t.parameters["condition"] for t in new] == [condition] * 3
    both = [t for t in tracking.swept([ONE], {"lag": 0.2}, "preview") if t.identity not in plain]
    assert len(both) == 6
    assert {t.parameters["tracking"]["lag"] for t in both} == {0.2}
    with pytest.raises(ValueError, match="no lagg"):
        list(tracking.swept([ONE], {"lagg": 0.2}, "preview"))


def test_a_wearer_who_is_refused_twice_is_left_out(tmp_path: Path) -> None:
    who = wearers(3)

    class Answers:
        """W01 is calibrated, W02 at its second try, W03 never."""

        def rows(self, tasks: list[TrialTask], folder: Path) -> list[Row]:
            out = []
            for t in tasks:
                name, again = t.parameters["person"], t.seed > 20_000
                content = "" if name == "W03" or (name == "W02" and not again) else SHIPPED
                values = {"calibration": content, "refused": "" if content else "the hand wasn't still"}
                out.append(Row("k", t, "", DONE, values, "", 0.0, "", {}))
            return out

    found = {one.wearer.name: one for one in tracking.calibrated(who, tmp_path, Answers())}  # type: ignore[arg-type]
    assert [len(found[f"W0{k}"].refused) for k in (1, 2, 3)] == [0, 1, 2]
    assert [bool(found[f"W0{k}"].content) for k in (1, 2, 3)] == [True, True, False]


@cache
def one_trial(condition: str, curve_name: str = "T1") -> dict[str, Any]:
    """A whole trial with the shipped calibration of a wearer of another build."""
    t = tracking.task(ONE, condition, "preview", curve_name, 1, 1)
    return flat(trial(t.text, t.parameters, t.seed))


@pytest.mark.sampled(1)
@pytest.mark.slow
@pytest.mark.parametrize("condition", CONDITIONS)
def test_a_trial_follows_the_curve_through_the_whole_profile(condition: str) -> None:
    row = one_trial(condition)
    path = np.array(json.loads(row["path"]))
    t = np.linspace(0.0, SECONDS, len(path) + 1)[1:]
    assert len(path) == 250
    assert np.corrcoef(path, curve("T1", t))[0, 1] > 0.95
    coarse = 100.0 * np.sqrt(np.mean((path - curve("T1", t)) ** 2))
    assert row["rmse"] == pytest.approx(coarse, rel=0.2)
    assert 0.3 < row["rmse"] < 12.0
    assert row["mean_error"] < row["rmse"]
    assert 0.0 < row["hand_rms"] < row["hand_p95"] <= row["hand_max"] < 0.05
    assert row["held"] == row["outside"] == 0.0


@pytest.mark.exhaustive
@pytest.mark.slow
def test_a_trial_depends_on_its_arguments_alone() -> None:
    t = tracking.task(ONE, "gamepad", "preview", "T1", 1, 1)
    assert flat(trial(t.text, t.parameters, t.seed)) == one_trial("gamepad")
    other = flat(trial(t.text, t.parameters, t.seed + 1))
    assert other["path"] != one_trial("gamepad")["path"]


@pytest.mark.exhaustive
@pytest.mark.slow
def test_a_refused_calibration_says_why_and_gives_no_file() -> None:
    given = {"person": "W01", "set": tracking.settings(ONE.wearer, "ikns", "preview"),
             "plan": {"static": 0.5, "exploration": 12.0, "trial": 0.3, "patience": 0.5, "settle": 0.1}}  # fmt: skip
    text = tracking.task(ONE, "ikns", "preview", "T1", 1, 1).text
    row = flat(calibration(text, given, 1))
    assert row["calibration"] == ""
    assert row["refused"]


def test_scores_are_those_of_the_paper() -> None:
    t = np.linspace(0.01, SECONDS, 2500)
    found = scores(t, curve("T3", t) + 0.03, "T3")
    assert found["rmse"] == pytest.approx(3.0)
    assert found["mean_error"] == pytest.approx(3.0)
    step = scores(t, curve("T3", t) + 0.2 * (t > 10), "T3")["worst_step"]
    assert step == pytest.approx(20.0, abs=1.0)


def test_stillness_is_measured_from_the_mean_place() -> None:
    hand = np.tile([1.0, 2.0, 3.0], (100, 1))
    hand[::2, 1] += 0.02
    found = stillness(hand)
    assert found == pytest.approx({"hand_rms": 0.01, "hand_p95": 0.01, "hand_max": 0.01})


def made_up(level: float = 0.0, spread: float = 0.2, subjects: int = 12, hand: float = 0.005) -> list[dict[str, Any]]:
    """Rows about the paper's means; `level`: how much worse the gamepad is."""
    rng = np.random.default_rng(4)
    rows = []
    for k in range(subjects):
        for condition in CONDITIONS:
            for name in KINDS:
                own = RMSE["ikns", name][0] + spread * rng.normal() + level * (condition == "gamepad")
                rows += [
                    {"wearer": f"P{k:02}", "condition": condition, "curve": name, "rmse": own + d, "mean_error": own,
                     "hand_rms": hand, "hand_p95": 2 * hand, "hand_max": 3 * hand, "worst_step": 1.0, "outside": 0.0,
                     "held": 0.0, "path": json.dumps(np.full(250, 0.5).tolist())}
                    for d in (-0.1, 0.0, 0.1)
                ]  # fmt: skip
    return rows


def claims(rows: list[dict[str, Any]]) -> dict[str, bool]:
    """Which claims hold."""
    return {claim.id: claim.holds for claim in analysed({"preview": rows}, simulated=True)[0]}


def test_the_papers_own_figures_hold() -> None:
    assert claims(made_up()) == dict.fromkeys(
        ("rmse-t1", "rmse-t2", "rmse-t3", "order-t2-t3-t1", "no-difference-from-gamepad", "hand-still"), True
    )


@pytest.mark.parametrize(
    ("changed", "fails"),
    [({"level": -2.0}, {"no-difference-from-gamepad"}), ({"level": 0.95}, {"no-difference-from-gamepad"}),
     ({"hand": 0.011}, {"hand-still"}), ({"spread": 6.0}, {"no-difference-from-gamepad", "order-t2-t3-t1"})],
)  # fmt: skip
def test_each_claim_can_fail(changed: dict[str, float], fails: set[str]) -> None:
    found = claims(made_up(**changed))
    assert fails <= {name for name, holds in found.items() if not holds}


def test_the_order_is_shown_beside_the_papers_means() -> None:
    found = {claim.id: claim for claim in analysed({"preview": made_up()}, simulated=True)[0]}["order-t2-t3-t1"]
    assert (found.paper, found.measured) == ("5.43, 4.50, 3.35", 100.0)


def test_levels_far_from_the_papers_fail() -> None:
    rows = [{**row, "rmse": row["rmse"] - 2.5} for row in made_up()]
    found = claims(rows)
    assert not any(found[f"rmse-{name.lower()}"] for name in KINDS)
    assert found["no-difference-from-gamepad"]


def test_tests_are_made_on_subjects_means_not_on_trials() -> None:
    rows = made_up(level=0.3)
    arm, pad = means(rows, "ikns"), means(rows, "gamepad")
    assert len(arm) == 12
    statistics = analysed({"preview": rows}, simulated=True)[2]["preview"]
    assert statistics["tost"] == vars(tost(arm, pad, 1.0))
    assert statistics["paired_t"]["freedom"] == 11
    every = [np.concatenate([means(rows, c, name) for name in KINDS]) for c in CONDITIONS]
    assert statistics["paired_t_as_published"] == vars(paired_t(every[0], every[1]))
    assert statistics["paired_t_as_published"]["freedom"] == 35


def test_who_lacks_a_trial_is_left_out_of_both_conditions_and_named() -> None:
    rows = made_up(level=0.3)
    lacking = [row for row in rows if (row["wearer"], row["condition"]) != ("P01", "ikns")]
    lacking.remove(next(row for row in lacking if (row["wearer"], row["curve"]) == ("P08", "T2")))
    found, _, statistics = analysed({"preview": lacking}, simulated=True)
    whole = [row for row in rows if row["wearer"] not in ("P01", "P08")]
    assert statistics["left_out"] == {"preview": ["P01", "P08"]}
    assert statistics["preview"] == analysed({"preview": whole}, simulated=True)[2]["preview"]
    assert all("10 simulated wearers (2 left out" in claim.text for claim in found)


@pytest.mark.slow
def test_two_people_give_a_table_and_no_claims(tmp_path: Path) -> None:
    rows = made_up(subjects=2)
    found, table, _ = analysed({"person": rows}, simulated=False)
    assert found == []
    assert [(line["condition"], line["curve"]) for line in table] == [(c, n) for c in CONDITIONS for n in KINDS]
    figure(rows, tmp_path / "f.png", "made up")
    assert (tmp_path / "f.png").stat().st_size > 10_000
