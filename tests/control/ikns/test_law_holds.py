"""The law while it lacks inputs: c held, by what could make it wrong, and its way back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.ikns_law import DT, follow, law, put
from helpers.null_space_arm import MIDDLE, POINTS, Arm

from srl.control.ikns.law import Ikns, matters
from srl.control.ikns.record import Record, parse


@pytest.mark.parametrize("missing", ["angles", "hand"])
def test_without_inputs_it_holds_and_comes_back_without_a_jump(file: Path, missing: str) -> None:
    arm, made = Arm(), law(file, catch_up=2.0)
    swing = arm.swing(arm.at(MIDDLE), 0.6, 41)
    c = follow(made, arm, swing[:21])[-1]
    truth = follow(law(file), arm, swing)[-1]
    assert abs(truth - c) > 0.3
    for _ in range(5):
        made.input[missing][1] = np.nan
        made.update(DT)
        assert made.output["c"] == c
        assert made.output["c_rate"] == 0.0
    assert made.metrics()["held"] == pytest.approx(5 / 25)
    assert made.metrics()["longest_hold_s"] == pytest.approx(5 * DT)
    put(made, arm, swing[-1])
    steps = []
    for _ in range(40):
        before = made.output["c"].copy()
        made.update(DT)
        steps.append(float((made.output["c"] - before)[0]))
    assert np.abs(steps).max() < 2.0 * DT + 1e-9
    assert made.output["c"] == pytest.approx(truth)


def test_a_hold_that_lasts_is_the_loss_of_the_person(file: Path) -> None:
    arm, made = Arm(), law(file, max_hold=0.1)
    put(made, arm, arm.at(MIDDLE))
    made.reset()
    made.input["hand"][0] = np.nan
    lost = []
    for _ in range(15):
        made.update(DT)
        lost.append(made.lost)
    assert lost == [False] * 10 + [True] * 5
    made.reset()
    assert not made.lost  # it may try again, as long as before
    put(made, arm, arm.at(MIDDLE))
    made.update(DT)
    assert not made.lost


@pytest.mark.exhaustive
@pytest.mark.slow
def test_holds_add_up_and_what_is_seen_between_them_is_taken_off(file: Path) -> None:
    arm, made = Arm(), law(file)
    put(made, arm, arm.at(MIDDLE))
    made.reset()

    def held(seconds: float, seen: float) -> bool:
        made.input["hand"][0] = np.nan
        for _ in range(round(seconds / DT)):
            made.update(DT)
        lost = made.lost
        put(made, arm, arm.at(MIDDLE))
        for _ in range(round(seen / DT)):
            made.update(DT)
        return lost

    assert [held(0.6, 0.2) for _ in range(5)] == [False] * 4 + [True]
    made.reset()
    assert not any(held(0.6, 0.6) for _ in range(20))
    assert "less what it was seen since" in str(type(made.config).model_fields["max_hold"].description)


def hold(law: Ikns, arm: Arm, *joints: str) -> None:
    law.input["held"][:] = [name in joints for name in arm.names]


WRIST = ("wrist_y", "wrist_x")


@pytest.mark.slow
@pytest.mark.parametrize("joints", [WRIST, ("shoulder_x",), ("elbow",), ("pronation",), ("shoulder_y", "pronation")])
def test_the_bound_by_which_it_decides(file: Path, joints: tuple[str, ...]) -> None:
    """Angles stay as they were while the person goes through the range; the hand is told as it is."""
    arm, record, wrong, bounds = Arm(), parse(file.read_bytes(), ""), [], []
    which = [arm.names.index(name) for name in joints]
    for place in POINTS:
        (point,) = [p for p in record.points if np.linalg.norm(np.array(p.site) - place) < 0.02]
        swing = arm.swing(arm.at(place), 0.6, 21)
        made = law(file, clamp=False, inset=0.0)
        truth = follow(made, arm, swing)
        put(made, arm, swing[0])
        made.reset()
        gaps = []
        for q, c in zip(swing, truth, strict=True):
            put(made, arm, q)
            made.input["angles"][which] = swing[0, which]
            made.update(DT)
            gaps.append(float(np.abs(made.output["c"] - c)[0]))
        wrong.append(max(gaps))
        span = point.upper[0] - point.lower[0]
        bounds.append(sum(abs(point.directions[0][j]) * point.travel[0][j] for j in which) / span)
    assert (np.array(wrong) < np.array(bounds) + 1e-6).all()
    assert np.mean(wrong) > 0.5 * np.mean(bounds) - 1e-9  # it isn't idle


def test_without_the_wrist_half_of_the_motion_is_unseen(file: Path, two: tuple[Path, Record]) -> None:
    """The table of docs/ikns.md: least and greatest bound over the points, of each DoF."""

    def bounds(path: Path, chain: str, *joints: str) -> list[tuple[float, float]]:
        which = [Arm(chain).names.index(name) for name in joints]
        found = matters(parse(path.read_bytes(), "").calibration())[:, :, which].sum(axis=2)
        return list(zip(found.min(axis=0).round(2).tolist(), found.max(axis=0).round(2).tolist(), strict=True))

    assert bounds(file, "arm", *WRIST) == [(0.42, 0.57)]
    assert bounds(file, "arm", "pronation") == [(0.0, 0.1)]
    assert bounds(file, "arm", "elbow") == [(0.0, 0.0)]
    assert bounds(two[0], "clavicle", *WRIST) == [(0.52, 0.82), (0.34, 1.0)]
    assert bounds(two[0], "clavicle", "pronation") == [(0.01, 0.15), (0.0, 0.21)]
    assert bounds(two[0], "clavicle", "elbow") == [(0.0, 0.02), (0.01, 0.12)]
    assert bounds(two[0], "clavicle", "elevation") == [(0.03, 0.1), (0.3, 0.57)]


def test_while_a_joint_that_matters_is_held_so_is_c(file: Path) -> None:
    arm, made = Arm(), law(file)
    swing = arm.swing(arm.at(MIDDLE), 0.6, 41)
    c = follow(made, arm, swing[:21])[-1]
    assert made.output["held"] == 0.0
    for q in swing[21:]:
        put(made, arm, q)
        hold(made, arm, *WRIST)
        made.update(DT)
        assert made.output["c"] == c
        assert made.output["c_rate"] == 0.0
        assert made.output["held"] == 1.0
    truth = follow(law(file), arm, swing)[-1]
    assert abs(truth - c) > 0.3
    hold(made, arm)
    for n in range(1, 100):
        made.update(DT)
        assert made.output["held"] == 0.0
        assert made.output["c"] == pytest.approx(c + np.clip(truth - c, -n * DT, n * DT))


def test_a_joint_that_hardly_moves_doesnt_hold_c(file: Path) -> None:
    arm, made = Arm(), law(file)
    swing = arm.swing(arm.at(MIDDLE), 0.6, 41)
    truth = follow(law(file), arm, swing)
    put(made, arm, swing[0])
    hold(made, arm, "elbow")
    made.reset()
    for q, c in zip(swing[1:], truth[1:], strict=True):
        put(made, arm, q)
        made.input["angles"][arm.names.index("elbow")] = swing[0, arm.names.index("elbow")]
        made.update(DT)
        assert made.output["held"] == 0.0
        assert made.output["c"] == pytest.approx(c, abs=0.1)
    # It comes back elsewhere, as somebody's angles might: c doesn't jump.
    hold(made, arm)
    made.input["angles"][arm.names.index("elbow")] += 0.5
    before = made.output["c"].copy()
    for _ in range(10):
        made.update(DT)
        assert np.abs(made.output["c"] - before).max() < DT + 1e-9
        before = made.output["c"].copy()


def test_each_degree_of_freedom_is_held_for_itself(two: tuple[Path, Record]) -> None:
    arm, made = Arm("clavicle"), law(two[0], unseen=0.2)
    q = arm.at(MIDDLE)
    put(made, arm, q)
    made.reset()
    hold(made, arm, "elevation")
    made.update(DT)
    assert made.output["held"].tolist() == [0.0, 1.0]
    hold(made, arm, *arm.names)
    made.update(DT)
    assert made.output["held"].tolist() == [1.0, 1.0]


def test_whether_angles_are_held_must_be_known_or_waived(file: Path) -> None:
    assert [s.name for s in law(file, held=False).inputs] == ["angles", "hand"]
    arm, made = Arm(), law(file)
    put(made, arm, arm.at(MIDDLE))
    made.input["held"][0] = np.nan
    made.reset()
    made.update(DT)
    assert made.output["held"] == 1.0
