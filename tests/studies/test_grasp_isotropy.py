"""The closing hand, the finger that follows, and the study made of them."""

from __future__ import annotations

from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from srl.runtime.contracts.signals import Array
from srl.runtime.models.human_hand import FINGERS, RANGES
from srl.runtime.profile import profile
from srl.studies.grasp import isotropy
from srl.studies.grasp.cell import PARTIAL, TOUCH, GraspCell
from srl.studies.grasp.closing import CLEAR, CLOSINGS, MOTIONS, Motion, follow, start
from srl.studies.grasp.isotropy_analysis import as_radius, claims, records, statistics, table
from srl.studies.grasp.isotropy_figure import figure
from srl.studies.grasp.isotropy_trial import AUGMENTED, PROFILE, SEEN, UNITS, _null, length, trial
from srl.studies.grasp.measures import isotropy as isotropy_of
from srl.studies.grasp.things import SHAPES, Thing
from srl.studies.tasks.local import LocalEngine
from srl.studies.tasks.runner import Runner
from srl.studies.tasks.task import Row

WHOLE_TURN = (1.0, 0.0, 0.0, 0.0)


@cache
def cell_of(shape: str, size: float, seed: int = 0) -> GraspCell:
    thing = Thing(shape, size)  # type: ignore[arg-type]
    return GraspCell(profile.find(PROFILE)[1], thing, thing.place(np.random.default_rng([seed, 1])))


def started(cell: GraspCell) -> Array:
    begin = start(cell)
    assert begin is not None
    return begin


@pytest.mark.parametrize("shape", SHAPES)
def test_the_start_is_clear_of_the_object_and_within_the_joints(shape: str) -> None:
    cell = cell_of(shape, 0.08)
    q = started(cell)
    cell.pose(q)
    assert cell.apart().min() > CLEAR
    assert (cell.limits[:, 0] - 1e-9 <= q).all()
    assert (q <= cell.limits[:, 1] + 1e-9).all()


@pytest.mark.parametrize("closing", CLOSINGS)
@pytest.mark.parametrize("shape", SHAPES)
def test_a_hand_closes_until_it_touches_and_not_into_the_object(shape: str, closing: str) -> None:
    cell = cell_of(shape, 0.08)
    begin = started(cell)
    motion = MOTIONS[closing](cell, begin, FINGERS)
    assert (motion.postures >= RANGES[:, 0] - 1e-9).all()
    assert (motion.postures <= RANGES[:, 1] + 1e-9).all()
    for hand in motion.postures[::10]:
        cell.pose(np.append(hand, begin[20:]))
        assert cell.gaps()[:20].min() >= 0.0
    cell.pose(np.append(motion.postures[-1], begin[20:]))
    assert len(cell.contacts(FINGERS)) >= 4
    assert np.abs(motion.measured[0] - motion.intended[0]).max() < 1e-12
    # Without the object the tips would have gone on.
    ahead = np.linalg.norm(motion.intended[-1] - motion.measured[-1], axis=1)
    assert np.sum(ahead > 0.01) >= 4


def test_fingers_that_are_inactive_stay() -> None:
    cell = cell_of("sphere", 0.08)
    begin = started(cell)
    motion = MOTIONS["curl"](cell, begin, PARTIAL)
    still = cell.digits["thumb"] + cell.digits["index"]
    assert (motion.postures[:, still] == begin[still]).all()
    assert np.abs(motion.postures[-1] - begin[:20]).max() > 0.1


def test_contacts_are_where_the_sphere_is_and_one_a_link() -> None:
    cell, radius = cell_of("sphere", 0.08), 0.04
    begin = started(cell)
    cell.pose(np.append(MOTIONS["curl"](cell, begin, FINGERS).postures[-1], begin[20:]))
    found = cell.contacts(FINGERS)
    distance = np.linalg.norm(found.points, axis=1)
    assert np.abs(distance - radius).max() <= TOUCH
    assert found.normals == pytest.approx(-found.points / distance[:, None], abs=1e-6)
    assert len(found) == sum(len(cell.contacts([digit])) for digit in FINGERS)
    assert len(found) <= 15


def test_contacts_of_a_turned_cube_are_in_its_own_axes() -> None:
    cell = cell_of("cube", 0.06, 2)
    begin = started(cell)
    cell.pose(np.append(MOTIONS["converge"](cell, begin, FINGERS).postures[-1], begin[20:]))
    found = cell.contacts(FINGERS)
    assert np.abs(np.abs(found.points).max(axis=1) - 0.03).max() <= TOUCH
    at_face = np.abs(found.normals).max(axis=1) > 0.999  # others are at an edge
    assert at_face.sum() >= 3
    faces = np.abs(found.points[at_face]).argmax(axis=1)
    into = -np.sign(found.points[at_face, faces])
    assert found.normals[at_face, faces] == pytest.approx(into, abs=1e-3)


def free_cell() -> GraspCell:
    """A cell whose object is out of reach."""
    return GraspCell(profile.find(PROFILE)[1], Thing("sphere", 0.04), (np.array([0.0, 0.6, 0.0]), WHOLE_TURN))


def test_where_nothing_is_in_the_way_the_finger_goes_with_the_virtual_object() -> None:
    """Fingertips that scale about a point take the finger's tip with them, as equation (4) says."""
    cell = free_cell()
    begin = np.append(np.tile([0.0, 0.2, 0.2, 0.1], 5), cell.home)
    cell.pose(begin)
    tips, tip, about = cell.tips(), cell.tip(), np.array([0.0, 0.06, -0.06])
    scales = np.linspace(1.0, 0.8, 60)
    moved = about + scales[:, None, None] * (tips - about)
    motion = Motion(np.tile(begin[:20], (60, 1)), moved, moved)
    cell.pose(follow(cell, "whole", begin, motion, moved)[-1])
    assert cell.tip() == pytest.approx(about + 0.8 * (tip - about), abs=1e-3)


def test_an_obstacle_stops_the_finger_and_not_for_good() -> None:
    thing = Thing("sphere", 0.04)
    cell = free_cell()
    begin = np.append(np.tile([0.0, 0.2, 0.2, 0.1], 5), cell.home)
    cell.pose(begin)
    tips, tip, about = cell.tips(), cell.tip(), np.array([0.0, 0.06, -0.06])
    there = tip + 0.045 * (about - tip) / np.linalg.norm(about - tip)
    blocked = GraspCell(profile.find(PROFILE)[1], thing, (there, WHOLE_TURN))
    scales = np.concatenate([np.linspace(1.0, 0.6, 80), np.linspace(0.6, 1.0, 80)])
    moved = about + scales[:, None, None] * (tips - about)
    path = follow(blocked, "whole", begin, Motion(np.tile(begin[:20], (160, 1)), moved, moved), moved)
    gaps = []
    for q in path:
        blocked.pose(q)
        gaps.append(blocked.gaps()[20:].min())
    assert min(gaps) >= 0.0
    assert gaps[79] < TOUCH
    assert gaps[-1] > 0.005


def given(shape: str = "sphere", size: float = 0.08, **changed: Any) -> dict[str, Any]:
    plain = {"shape": shape, "size": size, "set": {}, "grasps": list(AUGMENTED), "closings": list(CLOSINGS)}
    return plain | changed


@cache
def row_of(shape: str, size: float, seed: int) -> dict[str, Any]:
    return dict(trial(profile.find(PROFILE)[1], given(shape, size), seed))


@pytest.mark.slow
def test_a_trial_depends_on_its_seed_alone() -> None:
    once, again = row_of("sphere", 0.08, 3), trial(profile.find(PROFILE)[1], given(), 3)
    assert again == once
    assert (
        trial(profile.find(PROFILE)[1], given(closings=["converge"], grasps=["whole"]), 4)["distal"] != once["distal"]
    )


@pytest.mark.slow
def test_a_row_has_what_the_analysis_needs_and_adds_up() -> None:
    row = row_of("sphere", 0.06, 1)
    assert row["usable"]
    for grasp in AUGMENTED:
        for seen in ("measured", "intended"):
            name = f"converge_{grasp}_{seen}"
            if grasp != "partial":
                assert row[f"{name}_n"] == row["converge_human_n"] + row[f"{name}_touch"]
            if not row[f"{name}_touch"] and grasp != "partial":
                assert row[f"{name}_gii_l"] == row["converge_human_gii_l"]
            assert (row[f"{name}_epsilon"] > 0.0) is row[f"{name}_closed"]
    assert 0.0 < row["converge_human_null_l"] < 1.0
    assert row["converge_human_raised_l"] > 0.5


def test_a_finger_that_cannot_begin_gives_no_grasp() -> None:
    inside = {"frames.finger.position": [0.0, 0.06, -0.05]}
    row = trial(profile.find(PROFILE)[1], given(set=inside), 0)
    assert row["usable"] is False
    assert not [name for name in row if name.startswith(CLOSINGS)]


def made() -> list[Row]:
    """Rows with invented grasps: the finger adds 0.1 where it touches, which it does in all but the first."""
    rng, rows = np.random.default_rng(1), []
    for i, task in enumerate(isotropy.trials((0.06, 0.10), 3, shapes=["sphere"])):
        values: dict[str, Any] = {"usable": True}
        for closing in CLOSINGS:
            human = {"n": 5, "closed": True, "epsilon": 0.1}
            for unit in UNITS:
                human |= {f"gii_{unit}": rng.uniform(0.1, 0.3), f"null_{unit}": 0.3}
                human |= {f"raised_{unit}": 0.8, f"better_{unit}": 0.6}
            values |= {f"{closing}_human_{k}": v for k, v in human.items()}
            for grasp, seen in product(AUGMENTED, SEEN):
                own = {"n": 6, "touch": int(i > 0), "closed": True, "epsilon": 0.2}
                own |= {f"gii_{unit}": human[f"gii_{unit}"] + 0.1 * (i > 0) for unit in UNITS}
                values |= {f"{closing}_{grasp}_{seen}_{k}": v for k, v in own.items()}
        rows.append(Row("", task, "", "done", values, "", 0.0, "", {}))
    rows.append(Row("", task, "", "done", {"usable": False}, "", 0.0, "", {}))
    rows.append(Row("", task, "", "failed", {}, "why", 0.0, "", {}))
    return rows


def test_the_analysis_counts_what_the_rows_say() -> None:
    found = records(made())
    assert len(found) == 6 * len(CLOSINGS)  # neither what can't begin nor what failed
    by_id = {claim.id: claim for claim in claims(found)}
    assert by_id["finger-improves-gii"].measured == pytest.approx(0.5 / 6)
    assert by_id["finger-improves-gii"].holds
    assert by_id["partial-above-human-mm"].measured == pytest.approx(5 / 6)
    assert not by_id["partial-above-human-mm"].holds, "5 of 6 may be chance"
    assert not by_id["partial-below-whole"].holds, "they are the same"
    wanted = {"finger-improves-gii", "more-for-large-objects", "partial-below-whole", "partial-above-human"}
    assert {f"{name}{unit}" for name in wanted for unit in ("", "-mm", "-m")} <= by_id.keys()
    condition = statistics(found)["converge, measured"]
    whole, touching = condition["finger-improves-gii"], condition["finger-improves-gii-touching"]
    assert whole["low"] < whole["value"] < whole["high"]
    assert touching["value"] == pytest.approx(0.1)
    assert condition["partial-above-human-touching-mm"]["value"] == 1.0
    lines = table(found)
    assert [line["grasps"] for line in lines[:5]] == [6, 6, 6, 6, 3]
    assert lines[0]["touch whole"] == pytest.approx(5 / 6)
    assert lines[0]["gain"] == pytest.approx(0.5 / 6)


def test_sizes_as_radii_take_the_round_things_that_are_twice_as_large() -> None:
    found: list[dict[str, Any]] = [
        {"shape": shape, "size": size} for shape in SHAPES for size in (0.04, 0.06, 0.08, 0.12, 0.28)
    ]
    sized = as_radius(found, [0.04, 0.06, 0.14])
    assert [(one["shape"], round(one["size"], 3)) for one in sized] == [
        ("sphere", 0.04), ("sphere", 0.06), ("sphere", 0.14),
        ("cube", 0.04), ("cube", 0.06),
        ("cylinder", 0.04), ("cylinder", 0.06), ("cylinder", 0.14),
    ]  # fmt: skip


def test_a_gain_that_grows_with_the_object_is_seen_and_one_that_falls() -> None:
    found = records(made())
    for sign, holds in ((1.0, True), (-1.0, False)):
        line = [one | {"whole_measured_gii_l": one["human_gii_l"] + sign * (one["size"] - 0.05)} for one in found]
        claim = next(claim for claim in claims(line) if claim.id == "more-for-large-objects")
        assert claim.measured == pytest.approx(0.1 * sign)  # per 100 mm
        assert claim.holds is holds


def test_small_and_large_objects_are_told_apart() -> None:
    found = [
        one | {"partial_measured_gii_l": one["human_gii_l"] + 0.1 * (one["size"] - 0.08)} for one in records(made())
    ]
    condition = statistics(found)["converge, measured"]
    shares = [condition[f"partial-above-human-touching-{size}"]["value"] for size in ("small", "large")]
    assert shares == [0.0, 1.0]


@pytest.mark.parametrize("touch", [0, 1, 2])
def test_chance_has_as_many_contacts_as_the_finger(touch: int) -> None:
    """Against the index of each grasp with its random contacts, one by one."""
    thing, extra = Thing("cube", 0.06), max(touch, 1)
    human = thing.surface(np.random.default_rng(1), 5)
    bare = isotropy_of(human.points, thing.length)
    row = {f"human_gii_{unit}": isotropy_of(human.points, length(unit, thing)) for unit in UNITS}
    row |= {"whole_measured_touch": touch, "whole_measured_n": 5 + touch}
    row |= {f"whole_measured_gii_{unit}": 1.1 * row[f"human_gii_{unit}"] for unit in UNITS}
    found = _null(human, thing, row, np.random.default_rng(2))
    drawn = thing.surface(np.random.default_rng(3), 1000 * extra).points.reshape(1000, extra, 3)
    several = np.array([isotropy_of(np.vstack([human.points, points]), thing.length) for points in drawn])
    single = np.array([isotropy_of(np.vstack([human.points, points[:1]]), thing.length) for points in drawn])
    assert found["human_null_l"] == pytest.approx(several.mean(), rel=0.03)
    assert found["human_raised_l"] == pytest.approx((single > bare).mean(), abs=0.08)
    assert found["human_better_l"] == pytest.approx((1.1 * bare > several).mean(), abs=0.08)


def test_a_claim_fails_when_the_finger_makes_it_worse() -> None:
    found = [one | {"whole_measured_gii_l": 0.5 * one["human_gii_l"]} for one in records(made())]
    by_id = {claim.id: claim for claim in claims(found)}
    assert not by_id["finger-improves-gii"].holds
    assert by_id["finger-improves-gii-mm"].holds


@pytest.mark.slow
def test_the_figure_is_drawn(tmp_path: Path) -> None:
    figure(records(made()), tmp_path / "one.png", "converge")
    assert (tmp_path / "one.png").stat().st_size > 10_000


def test_each_trial_and_each_change_is_a_task_of_its_own() -> None:
    tasks = [*isotropy.trials((0.06,), 3)]
    for _, changed in isotropy._changes():
        if changed:
            tasks += isotropy.trials((0.06,), 1, changed, ["whole"])
    assert len({task.identity for task in tasks}) == len(tasks)


@pytest.mark.parametrize(
    "label", ["worn +20 mm distal", "links of 50 mm", "home of 20/20/20 degrees", "two fingers 40 mm apart"]
)
def test_a_change_of_the_sweep_reaches_the_cell(label: str) -> None:
    thing = Thing("sphere", 0.06)
    place = thing.place(np.random.default_rng(0))
    text, changed = profile.find(PROFILE)[1], dict(isotropy._changes())[label]
    tips = []
    for overrides in ({}, changed):
        cell = GraspCell(text, thing, place, overrides)
        cell.pose(np.append(np.zeros(20), cell.home))
        assert cell.n == 20 + 4 * len(cell.extra)
        tips.append(cell.tip())
    assert np.linalg.norm(tips[1] - tips[0]) > 0.01


def test_a_deformation_of_the_sweep_is_the_laws() -> None:
    """Tips that stretch along the hand's y take the tip along only if the object may stretch so."""
    changed = dict(isotropy._changes())["a non-isotropic object"]
    far = (np.array([0.0, 0.6, 0.0]), WHOLE_TURN)
    errors = []
    for overrides in ({}, changed):
        cell = GraspCell(profile.find(PROFILE)[1], Thing("sphere", 0.04), far, overrides)
        begin = np.append(np.tile([0.0, 0.2, 0.2, 0.1], 5), cell.home)
        begin[4:8] += 0.5  # off the plane that the fingertips lie near
        cell.pose(begin)
        tips, tip = cell.tips(), cell.tip()
        stretch = np.linspace(1.0, 0.92, 60)[:, None, None] ** [0.0, 1.0, 0.0]
        hand = np.tile(begin[:20], (60, 1))
        cell.pose(follow(cell, "whole", begin, Motion(hand, stretch * tips, stretch * tips), stretch * tips)[-1])
        errors.append(float(np.linalg.norm(cell.tip() - tip * [1.0, 0.92, 1.0])))
    assert errors[1] < 0.5 * errors[0]


def test_two_fingers_close_and_keep_apart() -> None:
    thing = Thing("sphere", 0.08)
    place = thing.place(np.random.default_rng([0, 1]))
    changed = dict(isotropy._changes())["two fingers 40 mm apart"]
    cell = GraspCell(profile.find(PROFILE)[1], thing, place, changed)
    begin = started(cell)
    motion = MOTIONS["converge"](cell, begin, FINGERS)
    path = follow(cell, "whole", begin, motion, motion.measured)
    for q in path[::5]:
        cell.pose(q)
        assert cell.apart()[20:].min() >= 0.0
    cell.pose(path[-1])
    assert all(len(cell.contacts([name])) for name in cell.extra)


@pytest.mark.exhaustive
@pytest.mark.slow
def test_the_quick_study_runs_resumes_and_leaves_its_files(tmp_path: Path) -> None:
    result = isotropy.run(tmp_path, True, Runner(LocalEngine(1)))
    assert all((tmp_path / name).stat().st_size > 1000 for name in result.files)
    rows = (tmp_path / "trials.journal").read_bytes()
    again = isotropy.run(tmp_path, True, Runner(LocalEngine(1)))
    assert (tmp_path / "trials.journal").read_bytes() == rows
    assert again.claims == result.claims
