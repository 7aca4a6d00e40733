"""The clearance `body-clearance`: data it refuses, and attacks on an arm and a wearer who doesn't look."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from helpers.blame import Attack, Outcome, Wearer, trial
from helpers.skeleton import TWO
from pydantic import ValidationError
from scipy.optimize import minimize

from srl.control.skeleton import body_clearance
from srl.control.skeleton.body_clearance import BodyClearance, BodyClearanceConfig
from srl.control.skeleton.envelope import link_nodes
from srl.runtime.contracts.clearance import NEVER, Braking
from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.rotation import from_euler_xyz
from srl.runtime.contracts.signals import Command, Kind

MS = 1_000_000


def judge(**options: Any) -> tuple[BodyClearance, Wearer]:
    config = BodyClearanceConfig(**({"least": 0.02, "uncertainty": 0.0} | options))
    command = Command(name="c", shape=(7,), unit="rad", kind=Kind.POSITION, labels=config.arms.arms.labels)
    made = BodyClearance("guard.c.clear", config, command)
    wearer = Wearer(config, np.random.default_rng(0), 1.0)
    made.bind({"rotation": wearer.aside(), "translation": wearer.translation})
    return made, wearer


def see(made: BodyClearance, now: int, stamp: int | None = None) -> bool:
    """A sample that differs from the one before, as a real suit's does."""
    made.input["rotation"][0, 1] += 1e-12
    stamp = now if stamp is None else stamp
    return made.begin(now, {"rotation": stamp, "translation": stamp})


def resting(made: BodyClearance) -> Braking:
    return Braking(np.zeros((2, 7)), np.array([0.0, 0.01]), np.zeros(7), np.zeros(7))


def test_it_waits_until_speeds_are_known_and_refuses_what_is_no_pose():
    made, _ = judge()
    assert not made.begin(0, {"rotation": NEVER, "translation": 5})
    assert "isn't seen" in made.why()
    now = 10_000 * MS
    good = [see(made, now + 10 * k * MS) for k in range(8)]
    assert good == [False] * 5 + [True] * 3
    now += 70 * MS
    for joint, value, match in ((3, np.nan, "finite"), (5, 0.0, "none"), (7, 2.0, "none")):
        kept = made.input["rotation"][joint].copy()
        made.input["rotation"][joint] = value
        now += 10 * MS
        assert not see(made, now)
        assert match in made.why()
        made.input["rotation"][joint] = kept
        now += 10 * MS
        assert not see(made, now), "what came before a gap says nothing of speeds"
        good = [see(made, now + 10 * k * MS) for k in range(1, 8)]
        assert good[-1]
        now += 70 * MS
    assert not see(made, now + 400 * MS, now)
    assert "0.44 s old" in made.why()


@pytest.mark.parametrize(("rate", "span"), [(60, 0.05), (500, 0.15), (1000, 0.45), (1000, 0.05)])
def test_a_suit_of_any_rate_is_usable_after_the_span(rate, span):
    made, _ = judge(span=span)
    step = round(1e9 / rate)
    usable = [see(made, 10_000 * MS + step * k) for k in range(round(0.6 * rate))]
    first = usable.index(True)
    assert first * step == pytest.approx(span * 1e9, abs=2 * step)
    assert all(usable[first:])


@pytest.mark.parametrize("factor", [0.01, 0.4, 2.5, 100.0, 1e3, 1e200])
def test_a_body_of_impossible_size_is_none(factor):
    """Centimetres for metres: a wearer of 170 m whose arm hangs far from everything, or one smaller than a thumb."""
    made, wearer = judge()
    right = wearer.translation.copy()
    made.input["translation"][:] = right * factor
    assert not any(see(made, 10_000 * MS + 10 * k * MS) for k in range(12))
    assert "times as long as the figure's" in made.why()
    made.input["translation"][:] = right
    made.input["translation"][wearer.names.index("RightForeArm")] *= factor
    assert not any(see(made, 11_000 * MS + 10 * k * MS) for k in range(12))
    assert "RightForeArm" in made.why()
    for possible in (0.6, 1.8):
        made.input["translation"][:] = right * possible
        assert any(see(made, (12_000 + 10 * k) * MS) for k in range(12))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, -1.0, 1e-9, 1e9])
@pytest.mark.parametrize(
    "option",
    [
        "least", "acceleration", "span", "link_radius", "stroke", "max_age", "repeat", "radii",
        "uncertainty", "latency", "creep", "clothing",
    ],
)  # fmt: skip
def test_no_option_cancels_the_protection(option, value):
    """What may be next to nothing: an uncertainty, a latency, a clothing, how long a pose stands, a creep."""
    if value == 1e-9 and option in ("uncertainty", "latency", "creep", "clothing", "repeat", "max_age"):
        assert judge(**{option: value})
        return
    with pytest.raises(ValidationError):
        judge(**{option: {"hand": value} if option == "radii" else value})


def test_leaving_out_all_pairs_of_a_link_is_refused():
    envelope = judge()[0]._envelope
    tip = envelope.links[-1]
    judge(leave_out=[(tip, name) for name in envelope.segments[:3]])
    with pytest.raises(ValidationError, match=f"nothing of the body would be compared with {tip}"):
        judge(leave_out=[(tip, name) for name in envelope.segments])


def test_what_is_no_number_is_not_clear_and_a_stamp_to_come_makes_nothing_younger():
    made, _ = judge(latency=0.04)
    for k in range(8):
        see(made, 10_000 * MS + 10 * k * MS)
    far = Braking(np.tile(TWO, (2, 1)), np.array([0.0, 0.01]), np.full(7, 0.1), np.zeros(7))
    assert made.clear(far)
    for broken in (
        Braking(np.full((2, 7), np.nan), far.until, far.velocity, far.slack),
        Braking(far.path, far.until * np.nan, far.velocity, far.slack),
        Braking(far.path, far.until, far.velocity, far.slack * np.nan),
        Braking(far.path, far.until + np.inf, far.velocity, far.slack),
    ):
        with np.errstate(invalid="ignore"):
            assert not made.clear(broken)
    assert see(made, 10_080 * MS, 10_500 * MS)
    assert made._age == 0.04


@pytest.mark.parametrize("repeat", [0.0, 0.1])
def test_a_suit_that_repeats_itself_gets_older(repeat):
    made, _ = judge(repeat=repeat)
    now = 10_000 * MS
    for k in range(8):
        assert see(made, now + 10 * k * MS) == (k >= 5)
    now += 70 * MS
    fresh = made._age
    ages = []
    for k in range(1, 26):
        at = now + 10 * k * MS
        usable = made.begin(at, {"rotation": at, "translation": at})
        ages.append(made._age - fresh)
        assert usable == (made._age <= 0.25)
    kept = round(repeat * 100)
    assert ages[:kept] == pytest.approx([0.0] * kept, abs=1e-9)
    assert ages[kept:20] == pytest.approx(0.01 * np.arange(kept + 1, 21))


def hanging(joints: tuple[str, ...], **options: Any) -> list[tuple[bool, float, str]]:
    """A wearer who moves, some of whose joints hang from 0.8 s on, until 1.6 s: usable, oldest age, why; at 100 Hz."""
    made, wearer = judge(**options)
    found, held = [], {}
    for k in range(240):
        pose = wearer.rotation(k * 0.01)
        if k == 80:
            held = {name: pose[wearer.names.index(name)].copy() for name in joints}
        if 80 <= k < 160:
            for name, value in held.items():
                pose[wearer.names.index(name)] = value
        made.input["rotation"][:] = pose
        now = 10_000 * MS + 10 * k * MS
        usable = made.begin(now, {"rotation": now, "translation": now})
        found.append((usable, float(made._ages.max()), made.why()))
    return found


@pytest.mark.parametrize("joint", ["RightArm", "LeftForeArm"])
def test_a_single_joint_that_hangs_makes_its_segments_old(joint):
    found = hanging((joint,))
    assert all(usable for usable, _, _ in found[6:100])
    assert found[79][1] == pytest.approx(0.04)
    assert [age for _, age, _ in found[81:101]] == pytest.approx([0.04 + 0.01 * (k - 80) for k in range(81, 101)])
    assert not any(usable for usable, _, _ in found[102:160])
    assert joint in found[120][2]
    assert not found[162][0], "speeds aren't known before they have been seen for a while"
    assert all(usable for usable, _, _ in found[167:])


def test_a_joint_may_repeat_itself_for_as_long_as_told_and_one_that_never_moved_for_ever():
    assert hanging(("RightArm",), repeat=0.1)[88][1] == pytest.approx(0.04)
    assert hanging(("RightArm",), repeat=0.1)[95][1] == pytest.approx(0.04 + 0.15)
    assert all(usable for usable, _, _ in hanging(("RightHandIndex1", "Neck", "LeftLeg"))[6:])


def test_a_segment_is_moved_by_the_joints_between_it_and_what_carries_the_arm():
    made, wearer = judge()
    joints = made._joints
    by = {
        segment: {name for name, moves in zip(joints.names, row, strict=True) if moves}
        for segment, row in zip(made._envelope.segments, joints._by, strict=True)
    }
    assert by["right_thigh"] == {"Spine", "RightUpLeg"}
    assert by["pelvis"] == {"Spine"}
    assert by["abdomen"] == {"Spine1"}
    assert by["left_forearm"] == {
        "Spine1", "Spine2", "Spine3", "LeftShoulder", "LeftArm", "LeftForeArm",
    }  # fmt: skip
    # The oracle: a turn of a joint moves an end in the carrier's frame or doesn't.
    at = {}
    made._motion.take(1, wearer.aside(), wearer.translation)
    rest = made._motion.ends.copy()
    for j, name in enumerate(joints.names):
        pose = wearer.aside()
        pose[j] = from_euler_xyz(0.3, 0.4, 0.5)
        made._motion.take(1, pose, wearer.translation)
        at[name] = np.abs(made._motion.ends - rest).max(axis=(1, 2)) > 1e-9
    for j, name in enumerate(joints.names):
        assert (joints._by[:, j] == at[name]).all(), name


def test_the_joints_may_come_in_another_order_and_must_be_the_arm_s():
    config = BodyClearanceConfig(least=0.02, uncertainty=0.0)
    labels = config.arms.arms.labels
    command = Command(name="c", shape=(7,), unit="rad", kind=Kind.POSITION, labels=labels)
    turned = Command(name="c", shape=(7,), unit="rad", kind=Kind.POSITION, labels=labels[::-1])
    plain, mirrored = BodyClearance("p", config, command), BodyClearance("p", config, turned)
    assert (plain.reach == mirrored.reach[::-1]).all()
    wearer = Wearer(config, np.random.default_rng(0), 1.0)
    margins = []
    for made, order in ((plain, 1), (mirrored, -1)):
        made.bind({"rotation": wearer.aside(), "translation": wearer.translation})
        for k in range(8):
            see(made, 10_000 * MS + 10 * k * MS)
        path = np.linspace(np.zeros(7), np.linspace(-0.5, 0.5, 7), 5)[:, ::order]
        slack, speed = 0.01 * np.arange(7)[::order], np.full(7, 0.1)
        made.clear(Braking(path, 0.05 * np.arange(5), speed, slack))
        margins.append(made.margin)
    assert margins[0] == pytest.approx(margins[1], abs=1e-12)
    with pytest.raises(WiringError, match="the arms J1"):
        BodyClearance("p", config, Command(name="c", shape=(2,), unit="rad", kind=Kind.POSITION, labels=("a", "b")))


def test_the_quick_look_passes_nothing_that_the_close_one_refuses(monkeypatch):
    """Pairs far apart are judged by a bound alone; with the bound gone, all are looked at closely."""
    made, wearer = judge()
    close, _ = judge()
    rng, verdicts = np.random.default_rng(1), []
    for k in range(120):
        now = 10_000 * MS + 20 * k * MS
        pose = wearer.rotation(k * 0.02)
        q = rng.uniform(-0.6, 0.2, 7) * [1, 1, 1, 1, 0.1, 1, 1]
        v = rng.normal(size=7) * 0.3
        path = q + np.linspace(0, 0.1, 6)[:, None] * v
        motion = Braking(path, 0.02 * np.arange(6), np.abs(v), np.full(7, 0.002))
        for each in (made, close):
            each.input["rotation"][:] = pose
            each.begin(now, {"rotation": now, "translation": now})
        if k < 6:
            continue
        with monkeypatch.context() as patch:
            patch.setattr(body_clearance, "reserve", lambda height, *rest: np.full(len(height), -1.0))
            slow = close.clear(motion)
        fast = made.clear(motion)
        verdicts.append(slow)
        assert slow == fast
        assert made.margin <= close.margin + 1e-12
    assert 5 < sum(verdicts) < len(verdicts) - 5


def test_what_is_seen_where_the_limb_is_now_stands_for_one_cycle_and_one_place():
    """The guard asks several times in a cycle, from one place; each answer must be that of a judge asked once."""
    made, wearer = judge()
    rng, compared = np.random.default_rng(3), 0
    for k in range(40):
        now = 10_000 * MS + 20 * k * MS
        made.input["rotation"][:] = wearer.rotation(k * 0.02)
        if not made.begin(now, {"rotation": now, "translation": now}):
            continue
        for start in (0.0, 0.0, 0.02, 0.0):
            path = start + np.linspace(0, 0.1, 5)[:, None] * rng.normal(size=7) * 0.3
            motion = Braking(path, 0.02 * np.arange(5), np.full(7, 0.1), np.full(7, 0.002))
            answer = made.clear(motion), made.margin, made.why()
            made._first = None
            assert answer == (made.clear(motion), made.margin, made.why())
            compared += 1
    assert compared > 100


def test_heights_and_speeds_of_ends_are_those_of_the_law():
    """H_je and w_je as `srl.control.shared.approach` defines them, pair by pair in plain vectors."""
    made, wearer = judge()
    for k in range(12):
        made.input["rotation"][:] = wearer.rotation(0.3 + k * 0.02)
        now = 10_000 * MS + 20 * k * MS
        made.begin(now, {"rotation": now, "translation": now})
    nodes = link_nodes(made._arms, "right", np.random.default_rng(0).uniform(-0.5, 0.1, (3, 7)))
    chosen = np.arange(0, len(made._all), 7)
    seen = made._seen(nodes, chosen)
    for i, k in enumerate(chosen.tolist()):
        s, link = made._segments[k], made._links[k]
        a, b = made._ends[s]
        for m in range(3):
            c, d = nodes[m, link : link + 2]
            best = minimize(
                lambda x, a=a, b=b, c=c, d=d: ((a + x[0] * (b - a) - c - x[1] * (d - c)) ** 2).sum(),
                [0.5, 0.5], bounds=[(0, 1), (0, 1)], tol=1e-16,
            ).x  # fmt: skip
            on_body, on_arm = a + best[0] * (b - a), c + best[1] * (d - c)
            n = (on_arm - on_body) / np.linalg.norm(on_arm - on_body)
            for e, end in enumerate((a, b)):
                assert seen.height[m, i, e] == pytest.approx((on_arm - end) @ n - made._radii[k], abs=1e-5)
                mean = max(float(made._velocity[s, e] @ n), 0.0)
                assert seen.speed[m, i, e] == pytest.approx(mean + made._a_e[k, e] * made._window[s] / 2, abs=1e-3)


def together(attack: Attack, seeds: Sequence[int]) -> Outcome:
    made = Outcome()
    for seed in seeds:
        one = trial(seed, attack, 5.0)
        made.contacts += one.contacts
        made.goals += one.goals
    return made


SEEDS = (0, 1, 2, 7)  # in which the arm of the trial without a clearance runs into the wearer


@pytest.mark.slow
def test_the_arm_runs_into_a_wearer_who_doesn_t_look_only_without_a_clearance():
    off, on = together(Attack(guarded=False), SEEDS), together(Attack(), SEEDS)
    assert off.blamed >= 3
    assert on.blamed == 0
    assert max(on.contacts, default=0.0) <= 0.02


@pytest.mark.sampled(2)
@pytest.mark.slow
@pytest.mark.parametrize(
    "attack",
    [
        Attack(delay=0.03, drop=0.3),
        Attack(freeze=(1.0, 3.0)),
        Attack(servo=2.0),
        Attack(delay=0.1, clear={"latency": 0.1}),
        Attack(planned=True),
    ],
    ids=["dropped", "frozen", "servo", "delayed", "reach"],
)
def test_attacks_that_it_knows_of_or_sees_leave_no_blame(attack):
    """Lost frames and a frozen suit make the pose old; a slow servo is measured; a delay that is told is counted."""
    assert together(attack, SEEDS).blamed == 0


@pytest.mark.sampled(1)
@pytest.mark.slow
@pytest.mark.parametrize(
    "attack",
    [Attack(delay=0.1), Attack(pace=2.0), Attack(assumed=0.6)],
    ids=["untold delay", "faster than a_H", "wrong envelope"],
)
def test_attacks_on_what_it_believes_leave_less_than_no_clearance_at_all(attack):
    """Here nothing is promised. What is left: contacts at less speed than without a clearance."""
    on = together(attack, SEEDS)
    off = together(Attack(delay=attack.delay, pace=attack.pace, guarded=False), SEEDS)
    assert off.blamed >= 3
    assert on.blamed < off.blamed
    assert sum(max(s, 0.0) for s in on.contacts) < 0.5 * sum(max(s, 0.0) for s in off.contacts)
