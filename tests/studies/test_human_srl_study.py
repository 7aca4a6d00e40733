"""The human-SRL study: its wearers, its independent nodes, its contacts, and what its rows say."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.control.skeleton.human import human
from srl.control.skeleton.human_srl import HumanSrl
from srl.control.skeleton.options import EnvelopeOptions
from srl.runtime.profile import profile
from srl.studies.command import _print_table
from srl.studies.human_srl import (
    goals_claims,
    matrices,
    nodes_claims,
    nodes_trial,
    reach_claims,
    reach_sweep,
    reach_trial,
    study,
)
from srl.studies.human_srl.contacts import Contacts, girths
from srl.studies.human_srl.goals_claims import LONG, STILL
from srl.studies.human_srl.intervals import most, over_wearers, share
from srl.studies.human_srl.reach_claims import OFF, ON
from srl.studies.human_srl.reaching import AVERAGE, Reaching
from srl.studies.human_srl.setting import Setting
from srl.studies.human_srl.wearers import COUNT, drawn, wearers
from srl.studies.tasks.local import LocalEngine
from srl.studies.tasks.runner import Runner
from srl.studies.tasks.task import flat, function

TEXT = profile.find("human-srl")[1]
SETTING = Setting(TEXT)
OPTIONS = EnvelopeOptions(arms=SETTING.arms)
FIGURE = HumanSrl(human(), SETTING.arms.arms)


# -- wearers


def test_the_list_is_the_one_that_its_distributions_give() -> None:
    assert drawn() == wearers()
    assert len({one.name for one in wearers()}) == COUNT == 50


def test_a_wearer_has_its_own_size_girths_and_posture() -> None:
    small, stout = replace(AVERAGE, scale=0.9), replace(AVERAGE, trunk=0.9, limbs=0.7)
    bodies = [Reaching(human(who.scale), np.random.default_rng(1), who) for who in (AVERAGE, small)]
    np.testing.assert_allclose(bodies[1].translation, 0.9 * bodies[0].translation)
    ratio = {name: girths(stout)[name] / radius for name, radius in girths(AVERAGE).items()}
    assert ratio["chest"] == pytest.approx(0.9 / 0.8)
    assert ratio["left_forearm"] == pytest.approx(0.7 / 0.8)
    assert ratio["right_hand"] == pytest.approx(1.0)
    leaning = Reaching(human(), np.random.default_rng(1), replace(AVERAGE, lean=12.0, apart=5.0))
    contacts = Contacts(FIGURE, "right", OPTIONS.envelope, AVERAGE)
    nodes = contacts.kinematics.nodes(leaning.aside(), leaning.translation, {})
    at = {name: nodes[i].copy() for i, name in enumerate(FIGURE.tree.names)}
    assert at["Head"][2] > 0.04, "the head is ahead of the hips"
    assert at["LeftFoot"][0] - at["RightFoot"][0] > 0.25, "and the feet are apart"


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), pace=st.floats(0.5, 2.0))
def test_reaches_are_smooth_and_as_quick_as_the_pace(seed: int, pace: float) -> None:
    who = replace(AVERAGE, pace=pace)
    one, slow = (Reaching(FIGURE.human, np.random.default_rng(seed), each) for each in (who, AVERAGE))
    t = np.arange(0.0, 3.0, 0.02)
    quick = np.array([one.rotation(each / pace) for each in t])
    np.testing.assert_allclose(quick, [slow.rotation(each) for each in t], atol=0.02)  # reaches end between cycles
    assert np.abs(np.diff(quick, axis=0)).max() < 0.06


# -- nodes


def one_motion(**changed: Any) -> dict[str, Any]:
    given_ = {"wearer": asdict(wearers()[2]), "wire": "text", "order": "YXZ", "frames": 5, **changed}
    return flat(nodes_trial.trial(profile.find("human-srl-two")[1], given_, 7))


@pytest.mark.parametrize(("wire", "order", "rounding"), [("text", "YXZ", 1e-5), ("binary", "ZXY", 1e-6)])
def test_ninety_nodes_are_where_plain_matrices_have_them(wire: str, order: str, rounding: float) -> None:
    row = one_motion(wire=wire, order=order)
    assert (row["nodes"], row["frames"]) == (90, 5)
    assert row["off"] < 1e-12
    assert row["vector"] < 1e-12
    assert 0.0 < row["rounding"] < rounding


@pytest.mark.parametrize("wrong", ["transposed", "mirrored", "rows"])
def test_a_wrong_convention_would_be_seen(monkeypatch: pytest.MonkeyPatch, wrong: str) -> None:
    """The matrices of the paper's eqs. (2) to (4), a left arm that isn't mirrored, a row's rotation after its step."""
    about, arm = matrices.about, matrices.arm

    def right(spine: Any, offsets: Any, q: Any, side: str) -> Any:
        return {side[0].upper() + name[1:]: frame for name, frame in arm(spine, offsets, q, "right").items()}

    if wrong == "transposed":
        monkeypatch.setattr(matrices, "about", lambda axis, angle: about(axis, -angle))
    elif wrong == "mirrored":
        monkeypatch.setattr(matrices, "arm", right)
    else:
        monkeypatch.setattr(matrices, "_ROWS", ("", "x", "z", "y", "x", "", "x", "y", ""))
    assert one_motion()["off"] > 0.01


# -- contacts


def test_a_contact_is_blamed_on_the_arm_only_if_the_arm_came() -> None:
    """The same end of the same gap, closed by the arm or by the person: a hanging arm, a thigh that is lifted."""
    reaching = Reaching(FIGURE.human, np.random.default_rng(0))
    contacts = Contacts(FIGURE, "right", OPTIONS.envelope, AVERAGE)
    pose, place, hang = reaching.aside(), reaching.translation, np.zeros(7)
    contacts.step(pose, place, hang, hang, 0.01)
    assert contacts.found == []
    way, q = [hang], hang
    while not contacts.found:  # the shoulder's first joint swings the arm back to the body
        q = way[-1] + [0.01, 0, 0, 0, 0, 0, 0]
        way.append(q)
        contacts.step(pose, place, way[-2], q, 0.01)
        assert len(way) < 400
    assert contacts.blamed
    assert contacts.found[0].speed > 0.1
    assert not contacts.found[0].rest
    contacts.step(pose, place, q, q, 0.01)
    assert len(contacts.found) == len(contacts.blamed), "what goes on touching doesn't begin again"
    assert contacts.pushed == len(contacts.blamed), "at rest it doesn't push"
    still = Contacts(FIGURE, "right", OPTIONS.envelope, AVERAGE)
    for k in range(40):  # both thighs are lifted against the arm at rest
        lifted, half = pose.copy(), -0.5 * 0.05 * k
        for side in ("Right", "Left"):
            lifted[reaching.names.index(f"{side}UpLeg")] = [np.cos(half), np.sin(half), 0.0, 0.0]
        still.step(lifted, place, hang, hang, 0.01)
    assert still.found
    assert all(each.rest and each.speed == pytest.approx(0.0, abs=1e-9) for each in still.found)
    assert still.blamed == []
    assert still.pushed == 0


@pytest.mark.parametrize("there", [False, True], ids=["it began slowly", "it was there at the beginning"])
def test_an_arm_that_goes_on_into_a_contact_is_told_of(there: bool) -> None:
    reaching = Reaching(FIGURE.human, np.random.default_rng(0))
    contacts = Contacts(FIGURE, "right", OPTIONS.envelope, AVERAGE)
    pose, place = reaching.aside(), reaching.translation
    way = [np.array([0.002 * k, 0, 0, 0, 0, 0, 0]) for k in range(2000)]
    touching = [len(contacts._touches(pose, place, q)) for q in way]
    first = next(k for k, n in enumerate(touching) if n)
    n = touching[first]
    assert touching[first - 1 : first + 3] == [0, n, n, n]

    def step(before: int, after: int, dt: float = 0.002) -> tuple[int, int, int]:
        contacts.step(pose, place, way[before], way[after], dt)
        return len(contacts.found), len(contacts.blamed), contacts.pushed

    if there:
        assert step(first, first) == (0, 0, 0)
    else:
        step(first - 1, first - 1)
        assert step(first - 1, first, dt=1.0) == (n, 0, 0)
    began = len(contacts.found)
    assert step(first, first + 1) == (began, 0, n)
    assert step(first + 1, first + 2) == (began, 0, n), "one contact counts once"
    assert step(first + 2, first - 1) == (began, 0, n), "out of it isn't into it"
    assert step(first - 1, first) == (began + n, n, 2 * n), "a new one"


def test_what_touches_is_what_mujoco_s_distances_say() -> None:
    """The sliding joint's link, too, is as long as it is."""
    reaching = Reaching(FIGURE.human, np.random.default_rng(4))
    contacts = Contacts(FIGURE, "right", OPTIONS.envelope, replace(AVERAGE, limbs=1.0, ends=1.0))
    model, data = contacts.kinematics.model, contacts.kinematics.data
    rng, both = np.random.default_rng(5), [0, 0]
    names = FIGURE.tree.names
    for k in range(60):
        q = rng.uniform(SETTING.lower, SETTING.upper)
        found = contacts._touches(reaching.rotation(0.2 * k), reaching.translation, q)
        for two in contacts._pairs:
            gap = mujoco.mj_geomDistance(model, data, *two, 0.5, None)
            assert (two in found) == (gap <= 0.0)
            both[two in found] += 1
        geom = model.geom("arm/RJ5").id
        half = data.geom_xmat[geom].reshape(3, 3)[:, 2] * model.geom_size[geom, 1]
        ends = [data.geom_xpos[geom] + half, data.geom_xpos[geom] - half]
        nodes = [data.xpos[1 + names.index(name)] for name in ("RJ5", "RJ6")]
        assert min(np.abs(np.subtract(ends, nodes)).max(), np.abs(np.subtract(ends[::-1], nodes)).max()) < 1e-9
    assert min(both) > 20


# -- one trial


def reached(seconds: float = 0.6, motion: int = 1, **attack: Any) -> dict[str, Any]:
    given_ = {"wearer": asdict(wearers()[motion - 1]), "attack": attack, "seconds": seconds}
    return flat(reach_trial.trial(TEXT, given_, motion))


@pytest.mark.slow
def test_a_trial_depends_on_its_arguments_alone() -> None:
    assert reached() == reached()
    assert reached(motion=2) != reached()


@pytest.mark.slow
def test_the_person_moves_alike_whatever_the_arm_does() -> None:
    rows = [reached(), reached(guarded=False), reached(drop=0.5), reached(servo=3.0)]
    assert len({row["acceleration"] for row in rows}) == 1
    assert reached(pace=2.0)["acceleration"] > 3.0 * rows[0]["acceleration"]
    assert reached(bias=10.0)["acceleration"] == rows[0]["acceleration"], "the suit is off, the person isn't"


def test_a_wearer_who_sways_or_marches_moves_trunk_or_legs() -> None:
    def swept(node: str, **motion: float) -> float:
        body = Reaching(FIGURE.human, np.random.default_rng(1), AVERAGE, **motion)
        kinematics = Contacts(FIGURE, "right", OPTIONS.envelope, AVERAGE).kinematics
        i = FIGURE.tree.names.index(node)
        at = [kinematics.nodes(body.rotation(t), body.translation, {})[i].copy() for t in np.arange(0.0, 4.0, 0.02)]
        assert np.linalg.norm(np.diff(at, axis=0), axis=1).max() < 0.05, "without a jump"
        return float(np.ptp(at, axis=0).max())

    assert swept("Head") < 1e-9
    assert swept("Head", sway=0.35) > 0.15
    assert swept("LeftFoot", sway=0.35) < 1e-9
    assert swept("LeftLeg", march=0.9) > 0.25, "the knee"
    assert swept("Head", march=0.9) < 1e-9


@pytest.mark.exhaustive
@pytest.mark.slow
def test_the_arm_runs_into_the_wearer_only_without_a_clearance() -> None:
    off, on = ([reached(12.0, motion, guarded=guarded) for motion in (1, 4, 5)] for guarded in (False, True))
    assert sum(row["blamed"] for row in off) >= 3
    assert sum(row["blamed"] + row["blamed_left_out"] for row in on) == 0
    assert sum(row["reached"] for row in off) > sum(row["reached"] for row in on)
    assert all(row["held"] == 0.0 for row in off)
    assert all(0.05 < row["held"] < 1.0 for row in on)
    times = [time for row in off for time in json.loads(row["times"])]
    assert all(0.5 < time < reach_trial.TIMEOUT for time in times if time is not None)


@pytest.mark.exhaustive
@pytest.mark.slow
def test_a_suit_that_is_off_breaks_no_blame_by_itself_unless_the_clearance_is_told() -> None:
    """One of the motions after those of the sweep, the first eight, in which it does."""
    untold = reached(12.0, 9, bias=10.0)
    assert untold["blamed"] > 0
    assert untold["fastest"] > 0.03
    assert untold["beyond"] < 1.0, "and the wearer is slower than the clearance takes for possible"
    reported = reached(12.0, 9, bias=20.0, clear={"uncertainty": 0.05, "noise": 0.0})
    assert reported["blamed"] == reported["pushed"] == 0


# -- what the rows say


def rows(blamed: int, reached_: int, motions: int = 200, **more: Any) -> list[dict[str, Any]]:
    """Rows of 50 wearers; the first `blamed` have a contact to be blamed."""
    return [
        {
            "motion": k, "wearer": f"W{k % 50}", "contacts": 5, "rest": 4, "blamed": int(k < blamed), "left_out": 0,
            "blamed_left_out": 0, "pushed": 2 * int(k < blamed), "fastest": 0.1, "tried": 4, "reached": reached_,
            "times": "[2.0, null]", "held": 0.1, "acceleration": 3.0, "beyond": 0.5 + (k % 2), "seconds": 12.0,
            "open": "[0.5, 0.0]", "stands": 1.5, "jerk": 100.0, **more,
        }
        for k in range(motions)
    ]  # fmt: skip


def judged(on: list[dict[str, Any]], off: list[dict[str, Any]]) -> dict[str, Any]:
    return {claim.id: claim for claim in reach_claims.analysed({OFF: off, ON: on}).claims}


def test_no_blame_holds_without_a_single_contact_and_says_what_that_bounds() -> None:
    found = judged(rows(0, 3), rows(80, 4))
    assert found["no-blame"].holds
    assert "at most 1.5 %" in found["no-blame"].text
    assert "80 contacts in 80 motions, into 160 then or later" in found["no-blame"].text
    assert "100 of them quicker" in found["no-blame"].text
    one = judged(rows(1, 3), rows(80, 4))["no-blame"]
    assert (one.holds, one.measured) == (False, 1.0)
    hidden = judged([row | {"blamed_left_out": 1} for row in rows(0, 3)], rows(80, 4))["no-blame"]
    assert not hidden.holds, "pairs that the clearance doesn't watch count, too"


def test_goals_reached_is_the_ratio_of_the_shares() -> None:
    good, bad = judged(rows(0, 3), rows(80, 4)), judged(rows(0, 1), rows(80, 4))
    assert good["goals-reached"].measured == pytest.approx(0.75)
    assert good["goals-reached"].holds
    assert bad["goals-reached"].measured == pytest.approx(0.25)
    assert not bad["goals-reached"].holds
    slower = judged(rows(0, 3, times="[4.0]"), rows(80, 4, times="[2.0]"))["goals-reached"]
    assert "of 200 first goals that both reach, it takes 2.00 times as long" in slower.text


def test_goals_in_time_are_shares_of_what_an_arm_without_a_clearance_reaches() -> None:
    off, on, long, still = rows(80, 4), rows(0, 3), rows(0, 4, 100), rows(0, 3, 100)
    part = reach_claims.analysed({OFF: off, ON: on, LONG: long, STILL: still})
    found = {claim.id: claim for claim in part.claims}
    assert {name: found[name].measured for name in goals_claims.LEAST} == {
        "goals-in-6-s": 0.75, "goals-in-18-s": 1.0, "goals-beside-still": 0.75
    }  # fmt: skip
    assert [found[name].holds for name in goals_claims.LEAST] == [True, True, False]
    assert "could rest at 50 % of these goals in some look, in 25 % of the looks" in found["goals-in-6-s"].text
    assert "stand-still of a motion 1.5 s" in found["goals-in-6-s"].text
    assert found["no-blame"].holds
    hurt = reach_claims.analysed({OFF: off, ON: on, LONG: rows(1, 4, 100), STILL: still})
    assert not {claim.id: claim for claim in hurt.claims}["no-blame"].holds, "those motions count, too"


def test_motions_that_one_arm_of_the_study_lacks_are_left_out_of_both() -> None:
    part = reach_claims.analysed({OFF: rows(80, 4), ON: rows(0, 3)[10:]})
    assert [line["motions"] for line in part.table[:2]] == [190, 190]
    assert part.table[0]["blamed"] == 70
    assert [claim.holds for claim in reach_claims.analysed({OFF: [], ON: rows(0, 3)}).claims] == 5 * [False]


def test_the_interval_over_wearers_is_that_of_their_shares() -> None:
    rng = np.random.default_rng(1)
    p = rng.uniform(0.2, 0.8, 50)
    many = [{"wearer": k, "k": rng.binomial(40, p[k]), "n": 40} for k in range(50)]
    low, high = over_wearers(many, ("k", "n"), share)
    spread = np.std([row["k"] / 40 for row in many]) / np.sqrt(50)
    assert high - low == pytest.approx(2 * 1.96 * spread, rel=0.1)
    assert np.isnan(over_wearers(many[:1], ("k", "n"), share)).all()
    assert most(0, 200) == pytest.approx(1 - 0.05 ** (1 / 200))


def test_a_frame_that_was_lost_or_a_node_that_is_off_fails_the_claim() -> None:
    task = nodes_claims.tasks(1, "text", "YXZ")[0]

    def found(**values: Any) -> bool:
        from srl.studies.tasks.task import DONE, Row

        whole = {"nodes": 90, "frames": 50, "off": 1e-15, "vector": 1e-15, "rounding": 1e-6, **values}
        return nodes_claims.analysed([Row("", task, "", DONE, whole, "", 0.0, "", {})], 1).claims[0].holds

    assert found()
    assert not found(off=1e-6)
    assert not found(vector=1e-6)
    assert not found(frames=49)
    assert not found(nodes=89)


def test_every_trial_of_study_and_sweep_is_a_task_of_its_own() -> None:
    made = [task for arm in reach_claims.ARMS.values() for task in reach_claims.tasks(reach_claims.MOTIONS, arm)]
    assert len({task.identity for task in made}) == len(made) >= 400
    assert len({task.parameters["wearer"]["name"] for task in made}) == COUNT
    swept = [attack for _, _, attack in reach_sweep.conditions()]
    assert len({json.dumps(attack) for attack in swept}) == len(swept)
    for attack in swept:
        reach_trial.Attack(**attack)
    assert function("human-srl-nodes") is nodes_trial.trial
    assert function("human-srl-reach") is reach_trial.trial


@pytest.mark.slow
@pytest.mark.exhaustive  # the quick set of each part has a test of its own
@pytest.mark.timeout(300)
def test_the_quick_study_has_all_its_claims(tmp_path: Path) -> None:
    runner = Runner(LocalEngine(1))
    result = study.run(tmp_path, True, runner)
    assert runner.failed == 0
    assert {"nodes-match", "no-blame", "goals-reached"} <= {claim.id for claim in result.claims}
    absent = {"false-activations-recorded", "no-activation-recorded"}  # where SRL_SHARED has no recordings
    assert all(claim.measured is not None for claim in result.claims if claim.id not in absent)
    assert {row["part"] for row in result.table} == {"nodes", "reach", "intention", "operation", "strap"}


def test_each_part_of_a_study_is_printed_with_its_own_columns(capsys: pytest.CaptureFixture[str]) -> None:
    same: list[dict[str, Any]] = [{"part": "a", "x": 1.0}, {"part": "a", "x": None}, {"part": "a"}]
    _print_table([*same, {"part": "a", "z": 2}, {"part": "b", "y": "more"}])
    words = [printed.split() for printed in capsys.readouterr().out.splitlines()]
    assert words == [
        ["part", "x"], ["a", "1.00"], ["a", "-"], ["a", "-"], ["part", "z"], ["a", "2"], ["part", "y"], ["b", "more"]
    ]  # fmt: skip
