"""Two arms of one wearer keep clear of each other: each is judged against all that the other may still do."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.blame import HIGH, LOW, A, V, Wearer
from helpers.guard import guard_of

from srl.control.skeleton.body_clearance import BodyClearance, BodyClearanceConfig
from srl.control.skeleton.capsules import nearest
from srl.control.skeleton.envelope import link_nodes
from srl.runtime.contracts.clearance import Braking
from srl.runtime.contracts.signals import Array, Command, Kind
from srl.runtime.models.models import ArmsModel
from srl.runtime.models.skeleton.arms import SIDES, Side
from srl.runtime.profile import profile, wiring

DT, LAG, C = 0.01, 0.03, 0.02
BASE = (-0.15, 0.05, 0.35)  # m, as in human-srl-two
ARMS = ArmsModel(sides=("right", "left"), base=BASE)
NAMES = ARMS.arms.labels
INWARDS = np.array([-0.9, -0.2, 1.4, -1.4, 0.09, -1.4, -0.6])  # with both arms in it their ends are in one place


def judges(**options: object) -> dict[Side, BodyClearance]:
    """Of both arms, with a wearer who stands with both arms stretched out sideways."""
    made = {}
    for side in SIDES:
        config = BodyClearanceConfig(arms=ARMS, side=side, **({"least": C, "uncertainty": 0.0} | options))  # type: ignore[arg-type]
        command = Command(name="c", shape=(7,), unit="rad", kind=Kind.POSITION, labels=NAMES)
        made[side] = BodyClearance(f"guard.{side}.clear", config, command)
        wearer = Wearer(config, np.random.default_rng(0), 1.0)
        made[side].bind({"rotation": wearer.aside(), "translation": wearer.translation})
    return made


def meet(both: dict[Side, BodyClearance]) -> None:
    for side, each in both.items():
        each.meet([other for at, other in both.items() if at != side])


def see(each: BodyClearance, now: int) -> None:
    each.input["rotation"][0, 1] += 1e-12
    each.begin(now, {"rotation": now, "translation": now})


def gap(right: Array, left: Array, first: int = 0) -> float:
    """m, between the surfaces of the two arms' links; of the right one's from the given one on."""
    a, b = (link_nodes(ARMS.arms, side, q[None])[0] for side, q in (("right", right), ("left", left)))
    i, j = (each[first:].ravel() for each in np.indices((8, 8)))
    return float(nearest(np.stack([b[:-1], b[1:]], axis=1), j, a, i).distance.min() - 2 * 0.037)


def motion(start: Array, end: Array, slack: float = 0.0) -> Braking:
    path = start + np.linspace(0, 1, 8)[:, None] * (end - start)
    return Braking(path, 0.03 + 0.02 * np.arange(8), np.abs(end - start), np.full(7, slack))


def test_a_motion_into_all_that_the_other_arm_may_still_do_is_not_clear():
    both = judges()
    meet(both)
    for k in range(8):
        see(both["right"], 10_000_000_000 + 10_000_000 * k)
    right, left, aside = both["right"], both["left"], np.array([-1.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    way = motion(aside, INWARDS)
    assert not right.clear(way)
    assert right.why() == "nobody knows where the other arm is"
    left.extent = aside, aside
    assert right.clear(motion(aside, aside + 0.05)), "far from both"
    left.extent = INWARDS, INWARDS
    assert not right.clear(way)
    assert "RJ" in right.why()
    assert "/LJ" in right.why()
    left.extent = np.minimum(aside, INWARDS), np.maximum(aside, INWARDS)
    assert not right.clear(motion(aside, aside + 0.2)), "it may be anywhere between"
    left.extent = np.full(7, np.nan), aside
    with np.errstate(invalid="ignore"):
        assert not right.clear(motion(aside, aside + 0.05))


def test_the_extent_of_the_other_arm_holds_every_place_in_it():
    both = judges()
    meet(both)
    (other,) = both["right"]._others
    rng = np.random.default_rng(0)
    for _ in range(30):
        low = rng.uniform(LOW, HIGH)
        high = np.minimum(low + rng.uniform(0, 0.3, 7) * (HIGH - LOW) / 3, HIGH)
        own = rng.uniform(LOW, HIGH)
        both["left"].extent = low, high
        judged = other.judge(both["right"].way(Braking(np.array([own, own]), np.zeros(2), np.zeros(7), np.zeros(7))))
        assert judged is not None
        for _ in range(20):
            assert gap(own, rng.uniform(low, high), first=1) >= judged.margin.min() + C - 1e-9


def both_go(seed: int, met: bool, seconds: float = 8.0) -> tuple[list[float], int]:
    """Both arms go to random goals, each obeyed late by up to the lag: speed (m/s) of each arm where they are nearer
    than C, the greater one at each instant; goals reached."""
    rng = np.random.default_rng(seed)
    both = judges()
    if met:
        meet(both)
    guards, at, applied, queue, goal = {}, {}, {}, {}, {}
    for side in SIDES:
        guard = guards[side] = guard_of(
            Kind.POSITION, 7, DT, lower=LOW.tolist(), upper=HIGH.tolist(), velocity=V.tolist(), acceleration=A.tolist()
        )
        at[side], applied[side] = np.array([-1.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), np.zeros(7)
        guard.bind(applied[side], at[side])
        guard.keep_clear(both[side], LAG, np.full(7, 0.001))
        guard.reset(at[side])
        queue[side] = [at[side].copy()] * int(rng.integers(0, 4))
        goal[side] = INWARDS
    near, reached = [], 0
    by = both["right"].body.reach[:, -1]
    for k in range(round(seconds / DT)):
        before = {side: at[side].copy() for side in SIDES}
        for side in SIDES:
            both[side].input["rotation"][0, 1] += 1e-12
            if np.abs(at[side] - goal[side]).max() < 0.02 or k % 150 == 0:
                reached += bool(np.abs(at[side] - goal[side]).max() < 0.02)
                goal[side] = rng.uniform(LOW, HIGH) if rng.random() < 0.5 else INWARDS + rng.normal(size=7) * 0.1
                goal[side] = np.clip(goal[side], LOW, HIGH)
            verified = guards[side].verified
            assert verified is not None
            now = 10_000_000_000 + 10_000_000 * k
            verified.begin(now, {"rotation": now, "translation": now}, 0.0)
            guards[side].step(goal[side], None, DT)
            queue[side].append(applied[side].copy())
        for side in SIDES:
            at[side][:] = queue[side].pop(0)
        if gap(at["right"], at["left"]) < C - 1e-6:
            near.append(max(float(np.abs(at[side] - before[side]) @ by) / DT for side in SIDES))
    return near, reached


@pytest.mark.slow
def test_two_arms_that_head_for_one_place_never_run_into_each_other():
    alone = [both_go(seed, met=False, seconds=6.0) for seed in range(2)]
    together = [both_go(seed, met=True, seconds=6.0) for seed in range(4)]
    assert sum(speed > 0.1 for near, _ in alone for speed in near) > 20, "without it they do"
    assert max((speed for near, _ in together for speed in near), default=0.0) <= 0.02 + 1e-6
    assert sum(goals for _, goals in together) > 3, "and they move"


def test_in_the_profile_both_arms_know_each_other():
    graph = wiring.build(*profile.load("human-srl-two"))
    for name, each in graph.clearances.items():
        (line,) = [line for line in each.clearance.remarks() if "compared with the arm of" in line]
        other = "left" if name.startswith("right") else "right"
        assert f"guard.{other}.position_command.clear" in line
        assert each.clearance.watched
    assert not next(iter(wiring.build(*profile.load("human-srl")).clearances.values())).clearance.watched
