"""The law `retreat`: it gives way, comes back, and its motion passes the guard as any other."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.blame import DT, HIGH, LAG, LOW, A, Gap, V, Wearer
from helpers.guard import guard_of

from srl.control.skeleton.body_clearance import BodyClearance, BodyClearanceConfig
from srl.control.skeleton.retreat import Retreat, RetreatConfig
from srl.runtime.contracts.rotation import from_euler_xyz, product
from srl.runtime.contracts.signals import Command, Kind
from srl.testing import bound, check_controller

TARGET = np.array([-0.6, -0.5, 0.0, -0.6, 0.0, 0.0, 0.0])


def beside(wearer: Wearer, near: float) -> np.ndarray:
    """(59, 4): arms aside; `near` 0 to 1 brings the right hand from the side to the arm's elbow."""
    made = wearer.aside()
    upper = product(from_euler_xyz(0.0, 1.2 * near, 0.0), from_euler_xyz(0.0, 0.0, 0.9 * near))
    made[wearer.names.index("RightArm")] = upper
    return made


def session(with_retreat: bool) -> tuple[float, float, float]:
    """The hand comes in 4 s, stays 2 s, goes in 4 s. Returns the least distance, the greatest share, and the error of
    the arm at the end, rad."""
    config = BodyClearanceConfig(least=0.02, uncertainty=0.0, latency=0.0)
    command = Command(name="c", shape=(7,), unit="rad", kind=Kind.POSITION, labels=config.arms.arms.labels)
    clearance, wearer = BodyClearance("clear", config, command), Wearer(config, np.random.default_rng(0), 1.0)
    applied, measured = np.zeros(7), TARGET.copy()
    guard = guard_of(
        Kind.POSITION, 7, DT, lower=LOW.tolist(), upper=HIGH.tolist(), velocity=V.tolist(), acceleration=A.tolist()
    )
    guard.bind(applied, measured)
    clearance.bind({"rotation": beside(wearer, 0.0), "translation": wearer.translation})
    guard.keep_clear(clearance, LAG, np.full(7, 0.001))
    guard.reset(measured)
    law = bound(Retreat("retreat", RetreatConfig()))
    law.input["translation"][:], law.input["target"][:] = wearer.translation, TARGET
    law.input["rotation"][:] = beside(wearer, 0.0)
    law.applied["q"][:] = applied
    law.reset()
    assert guard.verified is not None
    least, most, distance = np.inf, 0.0, Gap(config)
    for k in range(1200):
        t = k * DT
        near = np.interp(t, [0.0, 4.0, 6.0, 10.0], [0.0, 1.0, 1.0, 0.0])
        pose = beside(wearer, near)
        law.input["rotation"][:] = clearance.input["rotation"][:] = pose
        law.applied["q"][:] = applied
        law.update(DT)
        now = round((t + 1.0) * 1e9)
        guard.verified.begin(now, {"rotation": now, "translation": now}, 0.0)
        guard.step(law.output["q"] if with_retreat else TARGET, None, DT)
        before = measured.copy()
        measured[:] = applied
        distance.pose(pose, wearer.translation)
        least, most = min(least, distance(measured)), max(most, float(law.output["share"][0]))
        if distance(measured) < 0.0:
            assert distance(before) - distance(measured) <= 0.02 * DT, "the arm doesn't approach what it touches"
    return least, most, float(np.abs(measured - TARGET).max())


@pytest.mark.slow
def test_it_gives_way_to_a_hand_and_comes_back():
    parked, _, _ = session(False)
    least, share, error = session(True)
    assert share > 0.5
    assert parked < 0.01 < least  # a hand with a capsule for each finger passes the parked arm at 7 mm
    assert error < 0.01


def test_it_keeps_the_contract_of_controllers_and_far_from_the_body_it_is_the_target():
    law = bound(Retreat("retreat", RetreatConfig()))
    wearer = Wearer(BodyClearanceConfig(least=0.02, uncertainty=0.0), np.random.default_rng(0), 1.0)
    forward = np.array([-1.4, -0.9, 0.0, 0.0, 0.0, 0.0, 0.0])
    inputs = {"target": forward, "rotation": wearer.aside(), "translation": wearer.translation}
    check_controller(law, inputs=inputs, start={"q": forward})
    far = bound(Retreat("retreat", RetreatConfig(begin=0.01)))
    for name, value in inputs.items():
        far.input[name][:] = value
    far.applied["q"][:] = forward
    far.reset()
    far.update(DT)
    assert far.output["share"][0] == 0.0
    assert far.output["q"] == pytest.approx(forward)


@pytest.mark.parametrize("broken", ["rotation", "translation", "target"])
def test_one_frame_that_is_none_is_left_out_and_leaves_nothing_behind(broken):
    law, calm = bound(Retreat("retreat", RetreatConfig())), bound(Retreat("retreat", RetreatConfig()))
    wearer = Wearer(BodyClearanceConfig(least=0.02, uncertainty=0.0), np.random.default_rng(0), 1.0)
    for each in (law, calm):
        each.input["target"][:], each.input["translation"][:] = TARGET, wearer.translation
        each.input["rotation"][:] = beside(wearer, 0.9)
        each.applied["q"][:] = TARGET
        each.reset()
    for k in range(60):
        for each in (law, calm):
            each.input["rotation"][:] = beside(wearer, 0.9 + 0.001 * k)
            each.input["target"][:], each.input["translation"][:] = TARGET, wearer.translation
            if k == 30 and each is law:
                each.input[broken][:] = np.nan
            each.update(DT)
            each.applied["q"][:] = each.output["q"]
        assert np.isfinite(law.output["q"]).all()
        assert np.isfinite(law.output["share"]).all()
    assert law.output["share"][0] > 0.3
    assert law.output["q"] == pytest.approx(calm.output["q"], abs=0.01)


def test_a_target_that_is_not_there_at_the_reset_leaves_the_arm_where_it_is():
    law = bound(Retreat("retreat", RetreatConfig(begin=0.001, horizon=0.0)))
    wearer = Wearer(BodyClearanceConfig(least=0.02, uncertainty=0.0), np.random.default_rng(0), 1.0)
    law.input["translation"][:], law.input["rotation"][:] = wearer.translation, wearer.aside()
    law.input["target"][:] = np.nan
    law.applied["q"][:] = TARGET
    law.reset()
    for _ in range(5):
        law.update(DT)
    assert law.output["q"] == pytest.approx(TARGET)
    law.input["target"][:] = TARGET + 0.1
    law.update(DT)
    assert law.output["q"] == pytest.approx(TARGET + 0.1)
