"""The part `upper-body`: its chain, what the wearer does when it is told, and that it comes back to every bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.upper_body import POINT, STEADY, cell, run
from pydantic import ValidationError

from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.rotation import exp, product
from srl.runtime.contracts.wearer import Dof, Explore, Follow, Hold, Instruction, Rest, Wearer
from srl.sim.parts.body.wearer import NAMES


def test_mujoco_has_the_body_s_chain() -> None:
    world, part = cell()
    part.wearer.instruct(Hold(POINT, "swivel"))
    truth = run(world, 2.0)
    q = np.zeros(len(part.body.joints))
    q[part._turns] = truth["position"][-1]
    poses = part.body.forward(q)
    for segment, pose in poses.items():
        found = world.data.body(f"wearer/{segment}").xpos - [0.1, -0.2, 1.1]
        assert found == pytest.approx(pose[:3, 3], abs=1e-6)
    for label, at in zip(part.body.markers.items(), truth["markers"][-1], strict=True):
        pose = poses[label[1].segment]
        assert at - [0.1, -0.2, 1.1] == pytest.approx(pose[:3, :3] @ label[1].at + pose[:3, 3], abs=1e-6)


@pytest.mark.slow
def test_a_steady_wearer_moves_each_dof_and_nothing_else() -> None:
    world, part = cell(**STEADY)
    for i, name in enumerate(NAMES):
        dof: Dof = name  # type: ignore[assignment]
        part.wearer.instruct(Hold(POINT))
        run(world, 2.0)
        assert part.wearer.done
        part.wearer.instruct(Hold(POINT, dof))
        truth = run(world, 8.0)
        assert truth["hand"][:, :3] == pytest.approx(np.tile(POINT, (800, 1)), abs=1e-4)
        assert np.ptp(truth["hand"][:, 3:], axis=0).max() < 1e-3
        moved = np.ptp(truth["dofs"], axis=0)
        assert moved[i] > (1.3, 0.4, 0.4)[i]
        assert np.delete(moved, i).max() < 1e-5


@pytest.mark.slow
def test_the_elbow_goes_where_it_is_told_and_the_hand_stays_or_is_carried() -> None:
    world, part = cell(**STEADY)
    part.wearer.instruct(Hold(POINT, swivel=1.0))
    run(world, 4.0)
    assert part.wearer.done
    high = world.truth_arrays["wearer_dofs"][0]
    part.wearer.instruct(Hold(POINT, swivel=0.0))
    run(world, 0.5)
    assert not part.wearer.done
    truth = run(world, 3.0)
    assert part.wearer.done
    assert truth["hand"][:, :3] == pytest.approx(np.tile(POINT, (300, 1)), abs=1e-4)
    assert high - truth["dofs"][-1, 0] > 1.2
    # At its mean pace; half a second of it was before.
    assert np.ptp(truth["dofs"][:, 0]) > 0.9
    part.wearer.instruct(Hold((0.30, -0.10, -0.12), swivel=0.0))
    carried = run(world, 3.0)
    assert carried["hand"][-1, :3] == pytest.approx((0.30, -0.10, -0.12), abs=1e-4)
    assert np.ptp(carried["dofs"][:, 0]) < 0.1


@pytest.mark.slow
def test_the_errors_of_a_reach_can_be_less_than_those_of_null_space_motion() -> None:
    def leaks(carried: float) -> tuple[float, float]:
        world, part = cell(**STEADY | {"direction_error": 0.15}, carried=carried)
        part.wearer.instruct(Hold(POINT, swivel=1.0))
        run(world, 4.0)
        part.wearer.instruct(Hold((0.34, -0.04, -0.12), swivel=1.0))
        reach = run(world, 4.0)["leak"].max()
        part.wearer.instruct(Hold((0.34, -0.04, -0.12), swivel=0.0))
        return float(reach), float(run(world, 4.0)["leak"].max())

    whole, part, none = leaks(1.0), leaks(0.2), leaks(0.0)
    assert max(none[0], part[0]) < 0.4 * whole[0]
    assert whole[1] > 0.003
    assert none[1] == pytest.approx(whole[1], rel=0.2)


def test_the_motion_is_smooth_for_what_is_worn() -> None:
    """Between two ticks the joints neither jump nor lag: steps of a millisecond differ little from each other."""
    world, part = cell(**STEADY)
    part.wearer.instruct(Hold(POINT, "swivel"))
    q = run(world, 3.0, step=1)["position"]
    v = np.diff(q, axis=0) / 0.001
    assert np.abs(v).max() > 0.5
    assert np.abs(np.diff(v, axis=0)).max() < 0.05


@pytest.mark.slow
def test_a_real_wearer_wanders_and_leaks_but_stays() -> None:
    world, part = cell()
    part.wearer.instruct(Hold(POINT))
    run(world, 3.0)
    still = run(world, 5.0)["leak"]
    part.wearer.instruct(Hold(POINT, "swivel"))
    run(world, 2.0)
    leak = run(world, 8.0)["leak"]
    assert 0.0005 < np.sqrt((still**2).mean()) < 0.005
    assert 0.002 < np.sqrt((leak**2).mean()) < 0.01
    assert leak.max() < 0.02
    print(f"simulated: still {1e3 * still.mean():.1f} mm, swinging {1e3 * leak.mean():.1f}, max {1e3 * leak.max():.1f}")


@pytest.mark.slow
def test_exploration_covers_the_workspace_with_the_trunk_still() -> None:
    world, part = cell()
    part.wearer.instruct(Explore(10.0))
    truth = run(world, 10.0)
    assert not part.wearer.done
    rest = run(world, 3.0)
    assert part.wearer.done
    hand = np.concatenate([truth["hand"], rest["hand"]])[300:, :3]
    assert (np.ptp(hand, axis=0) > [0.18, 0.22, 0.18]).all()
    torso = [i for i, n in enumerate(world.truth[0].labels) if n.startswith("torso")]
    assert np.ptp(truth["position"][:, torso], axis=0).max() < 1e-6


@pytest.mark.parametrize(
    ("model", "sense"),
    [
        ("preview", -1.0), ("pursuit", 1.0),
        *(pytest.param(*at, marks=pytest.mark.slow) for at in (("preview", 1.0), ("pursuit", -1.0))),
    ],
)  # fmt: skip
def test_it_follows_a_curve_whichever_way_the_pointer_goes(model: str, sense: float) -> None:
    """The pointer is a bent function of the swivel angle that the wearer doesn't know."""
    world, part = cell(tracking={"model": model})
    times = np.linspace(0.0, 14.0, 400)
    curve = 0.5 + 0.3 * np.sin(0.8 * times)
    part.wearer.instruct(Follow(times, curve[:, None]))
    off = []
    for i in range(1400):
        world.advance(world.time + 10_000_000)
        share = world.truth_arrays["wearer_dofs"][0] / 1.7
        pointer = 0.5 + sense * (share - 0.5) + 0.05 * np.sin(3.0 * share)
        part.wearer.see([pointer])
        off.append(pointer - np.interp(i / 100, times, curve))
    assert np.sqrt(np.mean(np.square(off[600:]))) < (0.04 if model == "preview" else 0.10)
    assert np.abs(off[600:]).max() > 0.005


def test_a_beginning_it_can_t_know() -> None:
    """Without a pointer it does what it believes; two DoFs at a time."""
    world, part = cell(**STEADY)
    values = np.column_stack([np.full(50, 0.8), np.full(50, 0.2)])
    part.wearer.instruct(Follow(np.linspace(0.0, 4.0, 50), values, ("swivel", "shrug"), POINT))
    truth = run(world, 4.5)
    assert part.wearer.done
    swivel, shrug, protraction = truth["dofs"][-1]
    assert 1.0 < swivel < 1.6
    assert shrug < -0.02
    assert protraction == 0.0


INSTRUCTIONS: tuple[Instruction, ...] = (
    Explore(3.0), Hold(POINT, "shrug"), Hold(POINT, None, None, 0.8), Follow((0.0, 3.0), ((0.3,), (0.8,))), Rest()
)  # fmt: skip


@pytest.mark.parametrize("instruction", INSTRUCTIONS, ids=lambda i: type(i).__name__)
def test_a_saved_world_goes_on_bit_for_bit(instruction: Instruction) -> None:
    world, part = cell(sway=0.02, slip={"RELB": {"by": [0.0, 0.0, 0.01], "at": 1.5}})
    part.wearer.instruct(instruction)
    run(world, 1.003, step=1)
    part.wearer.see([0.4])
    state = world.save()
    first = run(world, 1.0)
    part.wearer.instruct(Rest())
    run(world, 0.5)
    world.restore(state)
    again = run(world, 1.0)
    assert all(np.array_equal(first[name], again[name]) for name in first)


def test_the_same_seed_is_the_same_person() -> None:
    def trial(seed: int) -> Any:
        world, part = cell(seed)
        part.wearer.instruct(Hold(POINT, "swivel"))
        return run(world, 2.0)["position"]

    one = trial(3)
    assert np.array_equal(one, trial(3))
    assert not np.array_equal(one, trial(4))


def test_a_state_of_other_instructions_is_refused() -> None:
    world, part = cell()
    part.wearer.instruct(Rest())
    state = world.save()
    with pytest.raises(ValueError, match="instructions"):
        cell()[0].restore(state)


def test_what_is_worn_moves_with_the_forearm_and_doesn_t_move_it() -> None:
    worn = {"finger": {"part": "robotic-finger", "at": {"parent": "wearer/right_forearm", "position": [0, 0.04, -0.2]}}}
    world, part = cell(parts=worn, **STEADY)
    alone, other = cell(**STEADY)
    for one in (part, other):
        one.wearer.instruct(Hold(POINT, "swivel"))
    with_finger, without = run(world, 3.0), run(alone, 3.0)
    assert with_finger["position"] == pytest.approx(without["position"], abs=1e-6)
    forearm, base = world.data.body("wearer/right_forearm"), world.data.body("finger/base")
    assert base.xpos == pytest.approx(forearm.xpos + forearm.xmat.reshape(3, 3) @ [0, 0.04, -0.2], abs=1e-9)


def test_the_hand_is_turned_as_it_is_told() -> None:
    world, part = cell(**STEADY)
    wearer: Wearer = part.wearer
    run(world, 0.1)
    wearer.instruct(Hold(POINT))
    turn = product(exp(0.0, 0.2, 0.3), tuple(run(world, 3.0)["hand"][-1, 3:].tolist()))  # type: ignore[arg-type]
    wearer.instruct(Hold(POINT, turn=turn))
    hand = run(world, 4.0)["hand"][-1]
    assert wearer.done
    assert hand[:3] == pytest.approx(POINT, abs=1e-4)
    assert abs(hand[3:] @ turn) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.slow
def test_a_trunk_that_sways_takes_the_arm_along() -> None:
    world, part = cell(sway=0.05, **STEADY)
    part.wearer.instruct(Hold(POINT))
    run(world, 2.0)
    truth = run(world, 10.0)
    assert truth["hand"][:, :3] == pytest.approx(np.tile(POINT, (1000, 1)), abs=1e-4)
    assert np.ptp(truth["markers"][:, tuple(part.body.markers).index("RFIN")], axis=0).max() > 0.01


def test_the_other_arm_moves_where_it_is_told() -> None:
    world, part = cell(side="left", **STEADY)
    left = (POINT[0], -POINT[1], POINT[2])
    part.wearer.instruct(Hold(left, "swivel"))
    run(world, 2.0)
    truth = run(world, 4.0)
    assert truth["hand"][:, :3] == pytest.approx(np.tile(left, (400, 1)), abs=1e-4)
    labels = world.truth[0].labels
    moved = {label for label, span in zip(labels, np.ptp(truth["position"], axis=0), strict=True) if span > 1e-3}
    assert moved
    assert all(label.startswith("left") for label in moved)


def test_a_marker_slips_when_it_is_told() -> None:
    world, part = cell(slip={"RELB": {"by": [0.0, 0.0, 0.01], "at": 0.5}}, **STEADY)
    before, after = run(world, 0.45)["markers"][-1], run(world, 0.2)["markers"][-1]
    moved = np.linalg.norm(after - before, axis=1)
    slipped = tuple(part.body.markers).index("RELB")
    assert moved[slipped] == pytest.approx(0.01, abs=1e-6)
    assert np.delete(moved, slipped).max() < 1e-6


def test_a_plan_goes_on_by_itself_and_begins_anew() -> None:
    plan = [{"do": "rest", "seconds": 1.0}, {"do": "hold", "seconds": 2.0, "point": POINT}]
    world, _ = cell(plan=plan, again=True, **STEADY)
    away = np.linalg.norm(run(world, 6.0)["hand"][:, :3] - POINT, axis=1)
    assert away[90] == pytest.approx(away[10], abs=1e-6)
    assert away[290] < 1e-4
    assert away[395] > 0.5 * away[10]
    assert away[590] < 1e-4


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"side": "middle"}, "left"),
        ({"slip": {"RXYZ": {"by": [0, 0, 0.01]}}}, "no such marker"),
        ({"elbow": 1.4, "swing": [0.0, 1.0]}, "within 'swing'"),
        ({"plan": [{"do": "dance", "seconds": 1}]}, "dance"),
        ({"plan": [{"do": "follow", "seconds": 1, "times": [0, 1], "values": {"swivel": [0.5]}}]}, "one value"),
        ({"plan": [{"do": "follow", "seconds": 1, "times": [1, 0], "values": {"swivel": [0, 1]}}]}, "ascend"),
        ({"wander": -1.0}, "greater than or equal"),
        ({"swing": [0.0, float("inf")]}, r"swing\.1"),
        ({"plan": [{"do": "rest", "seconds": float("inf")}]}, "finite"),
        ({"plan": [{"do": "hold", "seconds": 1, "point": [0.3, float("nan"), 0.0]}]}, "finite"),
        ({"slip": {"RSHO": {"by": [0, 0, float("inf")]}}}, "finite"),
        ({"watches": {"swivel": {"joint": "finger/flexion_1", "open": 0.4, "closed": 0.4}}}, "the same place"),
        ({"watches": {"swivel": {"joint": "finger/flexion_1", "open": 0.4, "closed": float("nan")}}}, "finite"),
    ],
)
def test_wrong_options_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        cell(**options)


def test_a_joint_to_watch_that_isn_t_there_is_named() -> None:
    watch = {"swivel": {"joint": "finger/flexion_1", "open": 0.0, "closed": 1.0}}
    with pytest.raises(WiringError, match=r"watches\.swivel\.joint: the cell has no joint 'finger/flexion_1'"):
        cell(watches=watch)


def test_a_follow_that_doesn_t_fit_is_refused() -> None:
    with pytest.raises(ValueError, match="2 DoFs"):
        cell()[1].wearer.instruct(Follow((0.0, 1.0), ((0.1,), (0.2,)), ("swivel", "shrug")))
