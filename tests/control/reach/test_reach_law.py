"""The law `reach`: it goes to goals, waits for a new one after a reset, and comes round a wearer who stands still."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from helpers.blame import DT, HIGH, LOW, A, V, Wearer
from pydantic import ValidationError

from srl.control.reach.law import Reach
from srl.control.reach.mode import Mode
from srl.control.reach.options import ReachConfig
from srl.control.reach.rest_margin import RestMargin
from srl.control.skeleton.body_clearance import BodyClearanceConfig
from srl.control.skeleton.envelope import link_nodes
from srl.runtime.contracts.signals import Array
from srl.runtime.models.models import ArmsModel
from srl.runtime.profile import profile
from srl.studies.human_srl import reach_trial
from srl.studies.human_srl.goals_claims import PACE_STILL
from srl.studies.human_srl.reach_claims import tasks
from srl.testing import bound, check_controller

ARMS = ArmsModel(base=(-0.15, 0.05, 0.35))
NAMES = [f"J{i}" for i in range(1, 8)]
LIMITS: dict[str, Any] = {
    key: dict(zip(NAMES, values.tolist(), strict=True))
    for key, values in (("lower", LOW), ("upper", HIGH), ("velocity", V), ("acceleration", A))
}
CONFIG = ReachConfig(arms=ARMS, **LIMITS)
AWAY = np.array([-1.4, -0.9, 0.0, 0.0, 0.0, 0.0, 0.0])


def a_law() -> tuple[Reach, Wearer]:
    law = bound(Reach("reach", CONFIG))
    wearer = Wearer(BodyClearanceConfig(least=0.02, uncertainty=0.0), np.random.default_rng(0), 1.0)
    law.input["rotation"][:], law.input["translation"][:] = wearer.aside(), wearer.translation
    law.input["target"][:] = np.nan
    return law, wearer


def step(law: Reach, q: Array, count: int = 1) -> Array:
    """Cycles of an arm that follows its command as fast as its joints go."""
    for _ in range(count):
        law.input["rotation"][0, 1] += 1e-12  # a real suit's samples differ
        law.applied["q"][:] = q
        law.update(DT)
        q = np.clip(law.output["q"], q - V * DT, q + V * DT)
    return q


def beside_a_still_wearer() -> RestMargin:
    """The margins beside a wearer who was seen for ten cycles."""
    made = RestMargin(CONFIG)
    _, wearer = a_law()
    for k in range(10):
        pose = wearer.aside()
        pose[0, 1] += 1e-12 * k
        made.see(pose, wearer.translation, DT)
    return made


def mode(law: Reach) -> Mode:
    return Mode(int(law.output["state"][0]))


def test_it_keeps_the_contract_of_controllers():
    law, wearer = a_law()
    check_controller(
        law, {"target": AWAY, "rotation": wearer.aside(), "translation": wearer.translation}, {"q": np.zeros(7)}
    )


def test_it_goes_to_a_goal_and_stays_where_it_is_after_a_reset_until_another_comes():
    law, _ = a_law()
    q = np.zeros(7)
    law.applied["q"][:] = q
    law.reset()
    assert (step(law, q, 20) == q).all()
    assert mode(law) is Mode.NO_GOAL
    law.input["target"][:] = AWAY
    q = step(law, q, 100)
    assert mode(law) is Mode.DIRECT
    q = step(law, q, 200)
    assert mode(law) is Mode.ARRIVED
    assert q == pytest.approx(AWAY, abs=1e-6)
    law.applied["q"][:] = 0.5 * q
    law.reset()
    q = 0.5 * q
    assert (step(law, q, 50) == q).all(), "the goal from before the reset isn't taken up again"
    law.input["target"][:] = np.nan
    assert (step(law, q, 5) == q).all()
    law.input["target"][:] = 0.9 * AWAY
    assert step(law, q, 300) == pytest.approx(0.9 * AWAY, abs=1e-6)


def test_a_goal_beyond_the_limits_is_the_limit():
    law, _ = a_law()
    law.applied["q"][:] = 0.0
    law.reset()
    law.input["target"][:] = [9.0, -9.0, 0.0, 0.0, 9.0, 0.0, 0.0]
    step(law, np.zeros(7), 20)
    assert law.output["q"] == pytest.approx([HIGH[0], LOW[1], 0.0, 0.0, HIGH[4], 0.0, 0.0])


def test_the_way_out_makes_room():
    room = beside_a_still_wearer()
    rng, gained = np.random.default_rng(0), []
    for q in rng.uniform(LOW, HIGH, (600, 7)):
        before = float(room.margins(q[None])[0])
        if -0.05 < before < 0.02:
            way = room.outward(q, 0.03) * V**2  # a way in the metric of the joints' speeds
            gained.append(float(room.margins((q + way * 0.003 / np.abs(way / V).max() / 0.8)[None])[0]) - before)
    assert len(gained) > 10
    assert np.mean(np.array(gained) > 0) > 0.9


def test_room_is_the_distance_less_what_the_body_may_do():
    """Of a body that stands still: 0.5 a_e t (t + window) nearer by the end of the horizon, and what is always kept."""
    room = beside_a_still_wearer()
    envelope, body, t = CONFIG.envelope, room._body, CONFIG.horizon
    for q in np.random.default_rng(1).uniform(LOW, HIGH, (5, 7)):
        nodes = link_nodes(ARMS.arms, "right", q[None])[0]
        least = np.inf
        for pair in envelope.pairs:
            a, b = body.ends[pair.segment]
            s, u = np.meshgrid(np.linspace(0, 1, 60), np.linspace(0, 1, 60))
            on_body = a + s[..., None] * (b - a)
            on_link = nodes[pair.link] + u[..., None] * (nodes[pair.link + 1] - nodes[pair.link])
            gap = float(np.linalg.norm(on_link - on_body, axis=-1).min())
            gap -= float(envelope.radii[pair.segment]) + envelope.link_radius
            fastest = float(envelope.acceleration[pair.segment].max())
            least = min(least, gap - 0.5 * fastest * t * (t + body.window))
        # The faster end counts for the whole segment here, so this is a little less than what the law says.
        assert least - 0.01 <= float(room.margins(q[None])[0]) + CONFIG.least + CONFIG.uncertainty <= least + 0.04


@pytest.mark.slow
@pytest.mark.parametrize("motion", [2, 16])
def test_it_comes_round_a_wearer_who_stands_in_the_straight_way(motion):
    """Motions of the study in which the arm stands for ever before its first goal, though it could rest there."""
    text, task = profile.find("human-srl")[1], tasks(motion, {})[-1]
    first = {}
    for planned in (False, True):
        parameters = {
            **task.parameters, "seconds": 14.5, "attack": {"pace": PACE_STILL, "timeout": 14.0, "planned": planned}
        }  # fmt: skip
        row = reach_trial.trial(text, parameters, task.seed)
        assert row["blamed"] == row["pushed"] == 0
        first[planned] = json.loads(str(row["times"]))[0]
        assert planned or json.loads(str(row["open"]))[0] > 0.9
    assert first[False] is None
    assert first[True] is not None


def test_limits_are_needed_and_must_be_ranges():
    with pytest.raises(ValidationError, match="lower"):
        ReachConfig(arms=ARMS)
    with pytest.raises(ValidationError, match="isn't below"):
        ReachConfig(arms=ARMS, **(LIMITS | {"lower": LIMITS["upper"]}))


def a_point_law() -> tuple[Reach, Wearer]:
    law = bound(Reach("reach", ReachConfig(arms=ARMS, target="point", **LIMITS)))
    wearer = Wearer(BodyClearanceConfig(least=0.02, uncertainty=0.0), np.random.default_rng(0), 1.0)
    law.input["rotation"][:], law.input["translation"][:] = wearer.aside(), wearer.translation
    law.input["target"][:] = np.nan
    return law, wearer


def test_its_end_goes_to_a_place_that_is_measured_and_noisy():
    law, _ = a_point_law()
    side, arms = CONFIG.arm, CONFIG.arms.arms
    q = step(law, AWAY, 10)
    law.reset()
    q = step(law, q, 10)
    place = link_nodes(arms, side, np.array([[-1.0, -0.6, 0.3, -0.6, 0.05, -0.3, 0.1]]))[0, -1]
    noise = np.random.default_rng(1)
    seen = set()
    for _ in range(1500):
        law.input["target"][:] = place + noise.normal(0.0, 0.0003, 3)
        q = step(law, q)
        seen.add(mode(law))
        if mode(law) is Mode.ARRIVED:
            break
    assert mode(law) is Mode.ARRIVED
    assert Mode.SEARCHING in seen
    assert np.linalg.norm(link_nodes(arms, side, q[None])[0, -1] - place) < 0.004


def test_a_place_out_of_reach_is_said_and_the_arm_stays():
    law, _ = a_point_law()
    q = step(law, AWAY, 10)
    law.reset()
    q = step(law, q, 10)
    law.input["target"][:] = 3.0, 0.0, 0.0
    after = step(law, q, 300)
    assert mode(law) is Mode.UNREACHABLE
    assert (after == q).all()


def test_beside_the_other_arm_it_keeps_off_it_and_without_its_joints_it_waits():
    arms = ArmsModel(base=(-0.06, 0.05, 0.35), sides=("right", "left"))
    law = bound(Reach("reach", ReachConfig(arms=arms, side="right", other=True, give_way=1.0, **LIMITS)))
    _, wearer = a_law()
    law.input["rotation"][:], law.input["translation"][:] = wearer.aside(), wearer.translation
    law.input["target"][:], law.input["other"][:] = np.nan, AWAY
    q = step(law, AWAY, 10)
    law.reset()
    q = step(law, q, 10)
    law.input["other"][:] = np.nan
    law.input["target"][:] = AWAY * 0.8
    assert (step(law, q, 20) == q).all()
    assert mode(law) is Mode.WAITING
    # Where the other arm is decides how much room a posture has.
    rest, draws, margins = law._rest, np.random.default_rng(4).uniform(LOW, HIGH, (400, 7)), []
    for other in (AWAY, np.array([0.9, -0.6, 0.3, -0.6, 0.05, -0.3, 0.1])):
        rest.see_other(other)
        margins.append(rest.margins(draws))
    assert (margins[0] != margins[1]).any()
    alone = bound(Reach("reach", ReachConfig(arms=arms, side="right", **LIMITS)))._rest
    for k in range(10):
        pose = wearer.aside()
        pose[0, 1] += 1e-12 * k
        alone.see(pose, wearer.translation, DT)
    assert (margins[1] <= alone.margins(draws) + 1e-6).all()


def test_it_goes_back_for_the_other_arm_where_it_comes_no_nearer_and_tries_again():
    """A goal at which it couldn't rest, beside a wearer who stands still."""
    law = bound(Reach("reach", ReachConfig(arms=ARMS, give_way=1.0, **LIMITS)))
    _, wearer = a_law()
    law.input["rotation"][:], law.input["translation"][:] = wearer.aside(), wearer.translation
    law.input["target"][:] = np.nan
    q = step(law, AWAY, 10)
    law.reset()
    q = step(law, q, 10)
    draws = np.random.default_rng(2).uniform(LOW, HIGH, (2000, 7))
    law.input["target"][:] = draws[int(beside_a_still_wearer().margins(draws).argmin())]
    seen = []
    for _ in range(2500):
        before = q
        q = step(law, q)
        q = before if beside_a_still_wearer_is_near(law, q) else q
        seen.append(mode(law))
    assert Mode.GIVING_WAY in seen
    first = seen.index(Mode.GIVING_WAY)
    assert any(each is not Mode.GIVING_WAY for each in seen[first:]), "it tries again"


def beside_a_still_wearer_is_near(law: Reach, q: Array) -> bool:
    """What the guard wouldn't let through."""
    return bool(law._rest.margins(q[None])[0] < 0.0)
