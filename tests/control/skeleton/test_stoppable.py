"""What is accepted for the arm of `human-srl` can be stopped from, whatever joints and wearer do within bounds."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.blame import HIGH, LOW, A, V, Wearer
from helpers.guard import guard_of

from srl.control.skeleton.body_clearance import BodyClearance, BodyClearanceConfig
from srl.control.skeleton.capsules import nearest
from srl.control.skeleton.envelope import link_nodes
from srl.runtime.contracts.signals import Array, Command, Kind
from srl.runtime.guard.base import PROMPT
from srl.runtime.guard.verified import brake_together, stop_time
from srl.runtime.models.models import ArmsModel

DT, LAG, C, LATENCY, STEP = 0.01, 0.03, 0.02, 0.03, 0.005


def worst(judge: BodyClearance, commanded: list[Array], states: list[tuple[float, float, float]], lags: Array,
          stall: float, push: Array) -> float:  # fmt: skip
    """m, by which the least distance on the way to rest is more than C.

    Args:
        judge: it has the body as it was seen.
        commanded: what was applied, every DT, the newest one now.
        states: that one, with which the stop begins DT and `stall` later.
        lags: (7,) s, by which each joint is late.
        stall: s.
        push: (s, 3) unit vectors, along which each segment's ends accelerate as much as they may.
    """
    no_jerk = [np.inf] * 7
    T = stop_time([v for _, v, _ in states], A.tolist())
    rest = T + DT + stall + LAG  # after that it is the body that comes
    t = np.linspace(0.0, rest, int(np.ceil(rest / STEP)) + 1)
    since = DT * np.arange(1 - len(commanded), 1)
    begin = DT + stall
    times = np.concatenate([since, begin + np.linspace(0.0, T, 40)])
    stop = [[p for p, _, _ in brake_together(states, A.tolist(), no_jerk, s)] for s in np.linspace(0.0, T, 40)]
    values = np.array([*commanded, *stop])
    path = np.stack([np.interp(t - lag, times, values[:, i]) for i, lag in enumerate(lags)], axis=1)
    nodes = link_nodes(judge.options.arms.arms, judge.options.arm, path)
    envelope = judge._envelope
    a = judge.options.acceleration * envelope.acceleration[..., None]
    gone = (t + LATENCY)[:, None, None, None]
    way = push[:, None]
    speed = judge._velocity + way * a * (judge._window[:, None, None] / 2)
    ends = judge._ends + gone * speed + 0.5 * gone**2 * a * way
    links = np.array([pair.link for pair in envelope.pairs])
    segments = np.array([pair.segment for pair in envelope.pairs])
    found = np.array([nearest(body, segments, arm, links).distance for body, arm in zip(ends, nodes, strict=True)])
    return float((found - envelope.radii[segments] - envelope.link_radius).min()) - C


def towards(judge: BodyClearance, q: Array) -> Array:
    """(s, 3), from each segment to the nearest link."""
    nodes = link_nodes(judge.options.arms.arms, judge.options.arm, q[None])[0]
    s, n = np.indices((len(judge._ends), 7)).reshape(2, -1)
    n = n + 1
    found = nearest(judge._ends, s, nodes, n)
    best = found.distance.reshape(-1, 7).argmin(axis=1) + 7 * np.arange(len(judge._ends))
    unit: Array = found.normal[:, best].T
    return unit


def least(seed: int, seconds: float = 4.0) -> tuple[float, int]:
    """The worst of all that was accepted on the way to random goals beside a wearer who moves, m; how many."""
    rng = np.random.default_rng(seed)
    config = BodyClearanceConfig(
        least=C, uncertainty=0.0, latency=LATENCY, arms=ArmsModel(base=(-0.15, 0.05, 0.35)), side="right"
    )
    command = Command(name="c", shape=(7,), unit="rad", kind=Kind.POSITION, labels=config.arms.arms.labels)
    judge, wearer = BodyClearance("clear", config, command), Wearer(config, rng, 0.7)
    judge.bind({"rotation": wearer.rotation(0.0), "translation": wearer.translation})
    guard = guard_of(
        Kind.POSITION, 7, DT, lower=LOW.tolist(), upper=HIGH.tolist(), velocity=V.tolist(), acceleration=A.tolist()
    )
    applied, start = np.zeros(7), np.array([-0.9, -0.6, 0.0, 0.0, 0.0, 0.0, 0.0])
    guard.bind(applied)
    guard.keep_clear(judge, LAG, np.zeros(7))
    guard.reset(start)
    verified = guard.verified
    assert verified is not None
    commanded, found, count, goal = [start.copy()] * 6, np.inf, 0, start
    for k in range(round(seconds / DT)):
        if k % 80 == 0:
            goal = rng.uniform(LOW, HIGH)
        now = 10_000_000_000 + round(k * DT * 1e9)
        judge.input["rotation"][:] = wearer.rotation(k * DT)
        verified.begin(now, {"rotation": now, "translation": now}, 0.0)
        guard.step(goal, None, DT)
        commanded = [*commanded[1:], applied.copy()]
        if verified.held or not verified.margin >= 0 or not guard.velocity.any() or rng.random() < 0.5:
            continue
        count += 1
        states = guard._states  # type: ignore[attr-defined]
        random = rng.normal(size=(len(judge._ends), 3))
        for push in (towards(judge, applied), random / np.linalg.norm(random, axis=1)[:, None]):
            for lags in (rng.uniform(0, LAG, 7), LAG * rng.integers(0, 2, 7)):
                for stall in (0.0, (PROMPT - 1) * DT):
                    found = min(found, worst(judge, commanded, states, lags, stall, push))
    return found, count


@pytest.mark.sampled(1)
@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_whatever_was_accepted_can_be_stopped_from_though_each_joint_has_a_lag_of_its_own(seed):
    margin, count = least(seed)
    assert count > 30
    assert margin >= -1e-6
