"""Compliance of a stiff robot: the spring it says, what is no contact, contact behind a delay, failing sensors."""

from __future__ import annotations

from math import nan
from typing import Any

import numpy as np
import pytest
from helpers.control import bound
from helpers.superman import KairosRig
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from srl.control.cobot.contact_compliance import ComplianceConfig, ContactCompliance
from srl.control.cobot.kairos_clik import KairosClik, KairosClikConfig
from srl.runtime.contracts.frames import IDENTITY


def press(force_feedback: dict[str, Any] | None, stiffness: float, push: float) -> tuple[float, float, float]:
    """N on a wall, the arm's speed loop 20 ms behind: the peak, while the hand pushes with `push`, after it let go.

    The tool comes at 5 cm/s.
    """
    rig = KairosRig(lag=0.02, **({"force_feedback": force_feedback} if force_feedback is not None else {}))
    chain = rig.chain
    wall = chain.tool.output["pose"][0] + 0.02
    chain.press("A")
    forces, touched = [], False
    for k in range(4500):
        depth = chain.tool.output["pose"][0] - wall
        force = -stiffness * max(depth, 0.0)
        away = Rotation.from_quat(chain.tool.output["pose"][[4, 5, 6, 3]]).inv()
        touched = touched or force < 0
        hand = 0.0 if k >= 3000 else push if touched else 3.0
        chain.wrench[:3] = away.apply([hand, 0, 0])
        if force_feedback is not None:
            chain.law.input["flange_wrench"][:3] = [force + hand, 0, 0]
        rig.step()
        chain.press()
        forces.append(-force)
    assert np.isfinite(forces).all()
    return max(forces), forces[2999], forces[-1]


WORLD_AXES: dict[str, Any] = {"axes": "world"}


@pytest.mark.slow
def test_contact_forces_stay_bounded_with_the_flanges_sensor() -> None:
    rigid = press(None, 20_000, 15.0)
    soft = press(WORLD_AXES, 20_000, 15.0)
    assert rigid[0] > 160  # beyond the arm's payload line, as published
    assert soft[0] < 50
    assert soft[2] < soft[1] < 40


@pytest.mark.parametrize("stiffness", [2_000.0, 20_000.0])
def test_contact_does_not_ring(stiffness: float) -> None:
    compliance = ContactCompliance(ComplianceConfig(axes="world", hand=False, dead_band=(0, 0)))
    compliance.reset(False)
    x, late, seen = 0.0, [0.0] * 10, []
    for k in range(6000):
        x += 2e-3 * late.pop(0)  # the robot, 20 ms behind
        f = -stiffness * max(x, 0.0)
        approach = 0.02 if k < 1000 else 0.0
        desired = [approach, 0, 0, 0, 0, 0]
        compliance.update([f, 0, 0, 0, 0, 0], [0.0] * 6, desired, (1, 0, 0, 0), 0.0, False, 2e-3)
        late.append(approach + compliance.velocity[0])
        seen.append(x)
    assert np.ptp(seen[-500:]) < 1e-5 + 0.1 * max(seen)
    assert max(np.abs(seen[-500:])) <= max(np.abs(seen))


@pytest.mark.slow
def test_compliance_is_the_spring_it_says_and_takes_off_weight_and_hand() -> None:
    config = ComplianceConfig(
        axes="sensor", dead_band=(0, 0),
        tool={"mass": 1.2, "com": (0, 0, 0.1)}, load=0.0, carrying=(0, 0),
    )  # fmt: skip
    compliance = ContactCompliance(config)
    compliance.place({"sensor": np.array([0.01, 0.02, 0.03, 0.6, 0, 0.8, 0])})
    tool = Rotation.from_euler("xyz", [0.4, -0.7, 1.1])
    sensor = tool * Rotation.from_quat([0, 0.8, 0, 0.6])
    hand, contact = np.array([3, -2, 5, 0.3, 0.1, -0.2]), np.array([10.0, -20, -8, 1, -0.5, 0.7])
    total = hand + contact
    weight = np.array([0, 0, -9.81 * 1.2])
    total += np.concatenate([weight, np.cross(tool.apply([0, 0, 0.1]), weight)])
    at = tool.apply([0.01, 0.02, 0.03])
    raw = np.concatenate([sensor.inv().apply(total[:3]), sensor.inv().apply(total[3:] - np.cross(at, total[:3]))])
    w, x, y, z = tool.as_quat()[[3, 0, 1, 2]].tolist()
    compliance.reset(True)
    for _ in range(20_000):
        compliance.update(raw.tolist(), hand.tolist(), [0.0] * 6, (w, x, y, z), 0.3, True, 2e-3)
    np.testing.assert_allclose(compliance.contact, contact, atol=1e-9)
    np.testing.assert_allclose(compliance.deviation, contact / np.array([500] * 3 + [30] * 3), rtol=1e-6)


def test_nothing_gives_way_to_a_load_nor_while_it_slips_out_of_opening_fingers() -> None:
    compliance = ContactCompliance(ComplianceConfig(axes="world", hand=False))
    compliance.reset(False)

    def feel(force: float, closed: bool, seconds: float) -> float:
        for _ in range(round(seconds / 2e-3)):
            compliance.update([0, 0, force, 0, 0, 0], [0.0] * 6, [0.0] * 6, (1, 0, 0, 0), 0.0, closed, 2e-3)
        return compliance.deviation[2]

    feel(0.0, True, 0.6)
    assert feel(-98.1, True, 5.0) == 0.0
    assert feel(50.0, True, 5.0) == 0.0
    assert feel(160.0, True, 8.0) == pytest.approx((160.0 - 60.0) / 500.0, rel=0.01)  # pressed onto a table
    assert feel(-98.1, True, 10.0) == pytest.approx(0.0, abs=1e-3)
    start = compliance.deviation[2]
    assert abs(feel(-98.1, False, 3.0)) <= start  # the fingers are jammed
    assert abs(feel(0.0, False, 1.2)) <= start
    assert feel(-98.1, False, 8.0) == pytest.approx(-(98.1 - 10.0) / 500.0, rel=0.01)
    assert feel(-98.1, True, 10.0) == pytest.approx(0.0, abs=1e-3)


def test_the_arms_axes_turn_with_base_and_mount() -> None:
    mount = Rotation.from_euler("z", 0.5)
    compliance = ContactCompliance(ComplianceConfig(dead_band=(0, 0), hand=False))
    compliance.place({"sensor": np.array(IDENTITY), "mount": np.array([0, 0, 0, *mount.as_quat()[[3, 0, 1, 2]]])})
    compliance.reset(False)
    compliance.update([10, 0, 0, 0, 0, 0], [0.0] * 6, [0.0] * 6, (1, 0, 0, 0), 0.7, False, 2e-3)
    np.testing.assert_allclose(compliance.contact[:3], [10 * np.cos(1.2), 10 * np.sin(1.2), 0], atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 4), st.integers(0, 3), st.integers(1, 80))
def test_a_measurement_that_is_no_number_is_refused_and_leaves_nothing_behind(which: int, at: int, n: int) -> None:
    def run(broken: bool) -> ContactCompliance:
        compliance = ContactCompliance(ComplianceConfig())
        compliance.reset(False)
        for k in range(200):
            measured: list[list[float]] = [
                [30.0, 0, 0, 0, 2.0, 0], [2.0] * 6, [-0.1, 0, 0, 0, -0.1, 0], [1.0, 0, 0, 0], [0.0] * 4,
            ]  # fmt: skip
            if 100 <= k < 100 + n:
                if not broken:
                    continue
                measured[which][0 if which == 4 else at] = nan
            wrench, hand, desired, (w, x, y, z), (yaw, *_) = measured
            compliance.update(wrench, hand, desired, (w, x, y, z), yaw, False, 2e-3)
            assert np.isnan(compliance.velocity).all() == (100 <= k < 100 + n)
        return compliance

    broken, whole = run(True), run(False)
    assert broken.deviation == whole.deviation
    assert broken.velocity == whole.velocity


def test_with_an_identified_load_it_gives_way_to_what_the_law_payload_says_is_outside() -> None:
    law = KairosClik("k", KairosClikConfig(force_feedback={"load": "identified", "carrying": (15.0, 3.0)}))
    names = {signal.name for signal in law.inputs}
    assert "outside" in names
    assert not names & {"flange_wrench", "hand"}
    assert law.transforms == ()
    controller = bound(law)
    controller.input["jacobian"][:] = np.random.default_rng(5).normal(0, 0.3, (6, 9))
    controller.input["pose"][3] = controller.input["desired_pose"][3] = 1.0
    controller.input["modes"][2] = 1.0
    controller.reset()
    for _ in range(4000):
        controller.input["outside"][:] = [40.0, 0, -14.0, 0, 0, 2.0]
        controller.update(2e-3)
    compliance = controller._compliance
    assert compliance is not None
    force = np.array([40.0, 0, -14.0])
    beyond = force * (1 - 15.0 / np.linalg.norm(force))  # the closed gripper's dead band
    np.testing.assert_allclose(compliance.deviation[:3], beyond / 500.0, rtol=0.01)
    assert compliance.deviation[5] == 0.0


def test_what_gave_way_turns_with_the_desired_turning_and_not_against_the_contact() -> None:
    """Pushed aside about y, then firmly held about x, while the tool is to turn about z."""
    controller = bound(KairosClik("k", KairosClikConfig(force_feedback={"axes": "world", "hand": False})))
    controller.input["jacobian"][:] = np.random.default_rng(5).normal(0, 0.3, (6, 9))
    controller.input["pose"][3] = controller.input["desired_pose"][3] = 1.0
    controller.reset()
    compliance = controller._compliance
    assert compliance is not None
    for _ in range(1500):
        controller.input["flange_wrench"][:] = [0, 0, 0, 0, 8.0, 0]
        controller.update(2e-3)
    aside = Rotation.from_rotvec(compliance.deviation[3:])
    assert aside.magnitude() > 0.2
    controller.input["desired_twist"][5] = 0.5
    task = controller._task(2e-3)
    away = Rotation.from_rotvec(compliance.deviation[3:]).as_rotvec() * [0.05, 0.01, 0.01]
    free = aside.apply([0, 0, 0.5])
    np.testing.assert_allclose(task[3:] - away - compliance.velocity[3:], free, atol=2e-3)
    for _ in range(100):
        controller.input["flange_wrench"][:] = [0, 0, 0, -8.0, 0, 0]
        task = controller._task(2e-3)
        away = np.array(compliance.deviation[3:]) * [0.05, 0.01, 0.01]
        lately = compliance._against[1]._pushed  # the contact's impulse
        assert np.dot(task[3:] - away - compliance._yielding[3:], lately) > -1e-9
