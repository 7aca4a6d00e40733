"""Simulated people who do the ten actions: bits, continuity, feet on the floor, and that they differ."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from srl.drivers.noitom.skeleton import Skeleton
from srl.runtime.contracts.rotation import matrices
from srl.runtime.contracts.wearer import Action, Explore, Perform, Rest, Return, Walk
from srl.sim.wearer.people import subject
from srl.sim.wearer.performer import Performer, measured

SKELETON = Skeleton("axis-neuron")
ACTIONS = get_args(Action)


def person(number: int = 0, kind: str = "axis-neuron") -> Performer:
    skeleton = Skeleton(kind)  # type: ignore[arg-type]
    return Performer(subject(number, skeleton.names), skeleton)


def places(who: Performer, t: float) -> np.ndarray:
    """(59, 3) m, of the joints in the suit's world."""
    hips, q = who.at(t)
    R, p = np.empty((59, 3, 3)), np.empty((59, 3))
    for i, (parent, own) in enumerate(zip(SKELETON.parents, matrices(q), strict=True)):
        up = R[parent] if parent >= 0 else np.eye(3)
        R[i] = up @ own
        p[i] = hips if parent < 0 else p[parent] + up @ who.offsets[i]
    return p


def at(name: str) -> int:
    return SKELETON.names.index(name)


@pytest.mark.parametrize("action", ACTIONS)
def test_each_action_goes_where_it_says(action: Action) -> None:
    who = person()
    who.instruct(1.0, Perform(action))
    rest, there = places(who, 0.5), places(who, 4.0)
    left, right, hips, head, chest = (at(n) for n in ("LeftHand", "RightHand", "Hips", "Head", "Spine3"))
    x, y, z = 0, 1, 2
    says = {
        "overhead": lambda: there[[left, right], y].min() > there[head, y] + 0.1,
        "forward": lambda: (there[[left, right], z] - there[chest, z]).min() > 0.45,
        "reach-left": lambda: there[left, x] - there[chest, x] > 0.5 and abs(there[right, x]) < 0.4,
        "reach-right": lambda: there[right, x] - there[chest, x] < -0.5 and abs(there[left, x]) < 0.4,
        "carry": lambda: (
            (there[[left, right], z] - there[hips, z]).min() > 0.15
            and abs(there[[left, right], y] - there[hips, y]).max() < 0.35
        ),
        "bend": lambda: (
            there[[left, right], y].max() < 0.8 and there[chest, z] > 0.2 and there[hips, y] > rest[hips, y] - 0.1
        ),
        "squat": lambda: there[hips, y] < rest[hips, y] - 0.2,
        "turn-left": lambda: _yaw(there) > 0.5,
        "turn-right": lambda: _yaw(there) < -0.5,
        "wave": lambda: there[right, y] > there[chest, y] + 0.1 and there[left, y] < there[chest, y] - 0.3,
    }
    assert says[action](), {n: there[at(n)].round(2).tolist() for n in ("LeftHand", "RightHand", "Hips", "Spine3")}
    who.instruct(5.0, Rest())
    assert np.abs(places(who, 9.0) - rest).max() < 0.05


def _yaw(p: np.ndarray) -> float:
    """rad, of the shoulders about the vertical."""
    across = p[at("LeftArm")] - p[at("RightArm")]
    return float(np.arctan2(-across[2], across[0]))


@pytest.mark.parametrize("action", ["squat", "bend"])
def test_feet_stay_on_the_floor(action: Action) -> None:
    who = person()
    before = places(who, 0.0)[[at("LeftFoot"), at("RightFoot")], 1]
    who.instruct(1.0, Perform(action))
    for t in np.linspace(0.0, 4.0, 41):
        assert np.abs(places(who, t)[[at("LeftFoot"), at("RightFoot")], 1] - before).max() < 0.06


@pytest.mark.slow
@pytest.mark.parametrize("number", [0, 3])
def test_it_never_jumps_whenever_it_is_told_something_else(number: int) -> None:
    who, rng, t = person(number), np.random.default_rng(number), 0.0
    for given in [Perform("wave"), Perform("squat"), Walk(), Rest(), Walk(), Perform("bend"), Walk(), Walk(), Rest()]:
        t += rng.uniform(0.1, 3.0)
        who.instruct(t, given)
    steps = np.array([np.concatenate([places(who, k * 0.01).ravel()]) for k in range(round(100 * t) + 300)])
    assert np.abs(np.diff(steps, axis=0)).max() < 0.09  # m in 10 ms, of a hand that waves or a foot that swings


def test_the_same_time_gives_the_same_bits_in_any_order() -> None:
    one, other = person(4), person(4)
    for who in (one, other):
        who.instruct(0.5, Walk())
        who.instruct(4.0, Perform("wave"))
    times = np.linspace(0.0, 8.0, 33).tolist()
    poses = {t: one.at(t) for t in times}
    for t in reversed(times):
        assert all((a == b).all() for a, b in zip(other.at(t), poses[t], strict=True))


def test_walking_goes_about_its_speed_and_stops() -> None:
    who = person()
    who.instruct(1.0, Walk())
    who.instruct(11.0, Rest())
    way = np.array([who.at(t)[0] for t in np.arange(0.0, 16.0, 0.05)])
    speed = np.linalg.norm(np.diff(way[:, [0, 2]], axis=0), axis=1) / 0.05
    assert speed[100:200].mean() == pytest.approx(who.subject.scale, rel=0.05)
    assert speed[:18].max() < 0.01
    assert speed[-40:].max() < 0.01


@pytest.mark.parametrize(("number", "walks"), [(0, 12.0), (1, 3.1), (2, 0.0)])
def test_who_returns_stands_where_it_stood_and_faces_as_it_did(number: int, walks: float) -> None:
    who, stayed = person(number), person(number)
    if walks:
        who.instruct(2.0, Walk())
    who.instruct(2.0 + walks, Return())
    t = next(t for t in np.arange(2.0 + walks, 60.0, 0.1) if who.there(t)) + 0.1
    np.testing.assert_allclose(places(who, t), places(stayed, t), atol=1e-6)
    if walks > 1.0:
        assert np.linalg.norm(places(who, 2.0 + walks)[0] - places(stayed, 2.0 + walks)[0]) > 0.5


def test_people_differ_and_each_repeats_itself() -> None:
    people = [subject(n, SKELETON.names) for n in range(1, 40)]
    assert len({p.sex for p in people}) == 2
    scales = np.array([p.scale for p in people])
    assert 0.8 < scales.min() < 0.95 < 1.0 < scales.max() < 1.15
    assert all(0.2 <= p.reaction <= 0.3 for p in people)
    pose = np.zeros((59, 3))
    pose[3] = 40.0
    a, b = people[0], people[1]
    assert np.abs(a.style("bend", pose, 1) - b.style("bend", pose, 1)).max() > 0.5
    assert (a.style("bend", pose, 1) == subject(1, SKELETON.names).style("bend", pose, 1)).all()
    assert (a.style("bend", pose, 1) != a.style("bend", pose, 2)).any()
    assert not a.style("bend", pose, 1)[4:].any()


def test_a_suits_misfit_is_as_large_as_it_says_and_stays() -> None:
    who = person(2)
    times = np.arange(0.0, 2.0, 0.05)
    true, _ = measured(who, times)
    off, _ = measured(who, times, misfit=4.0, seed=1)
    gap = np.degrees(2.0 * np.arccos(np.clip(np.abs(np.sum(true * off, axis=2)), 0.0, 1.0)))
    assert np.sqrt((gap**2).mean()) == pytest.approx(4.0, rel=0.3)
    assert np.ptp(gap, axis=0).max() < 1e-5
    noisy, _ = measured(who, times, noise=0.01, seed=1)
    small = 2.0 * np.arccos(np.clip(np.abs(np.sum(true * noisy, axis=2)), 0.0, 1.0))
    assert np.sqrt((small**2).mean()) == pytest.approx(0.01 * np.sqrt(3.0), rel=0.1)


def test_what_it_cant_be_told_is_refused() -> None:
    who = person()
    with pytest.raises(ValueError, match="can't do Explore"):
        who.instruct(1.0, Explore())
    who.instruct(1.0, Rest())
    with pytest.raises(ValueError, match="order of time"):
        who.instruct(0.5, Rest())


def test_the_studio_skeleton_does_them_too() -> None:
    who = person(1, "axis-studio")
    for k, action in enumerate(ACTIONS):
        who.instruct(float(k), Perform(action))
        assert np.isfinite(who.at(k + 0.9)[1]).all()
