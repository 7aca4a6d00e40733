"""Admittance: steady state, a real device's recorded motion, switches, the leash, a stiff hand behind a delay."""

from __future__ import annotations

import csv
from collections import deque
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from helpers.admittance import admittance, follow
from helpers.shared import shared
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from srl.control.cobot.ft_record import Unloaded
from srl.runtime.contracts import rotation

DT = 1e-3
ON = [1.0, 1.0, 0.0, 0.0]
BARE: dict[str, Any] = {"leash": None, "tank": None, "dead_band": (0, 0)}


def test_a_constant_push_gives_the_terminal_velocity() -> None:
    controller = admittance(**BARE)
    controller.input["wrench"][:] = [0, 0, 10, 0, 0, 0.9]  # along and about one axis, which stays where it is
    for _ in range(10_000):
        follow(controller)
    np.testing.assert_allclose(controller.output["twist"], [0, 0, 10 / 40, 0, 0, 0.5], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("number", [1, 2])
def test_a_real_devices_recorded_motion_is_reproduced_from_its_recorded_torques(number: int) -> None:
    with shared(f"data/exo_admittance/TaskClass_data{number}.csv").open() as file:
        rows = list(csv.DictReader(file))
    axes = ("pitch", "yaw")
    column = {key: np.array([float(row[key]) for row in rows]) for key in rows[0] if key and key != "task_num"}
    position = np.array([column[f"ADMI_{axis}_pos"] for axis in axes]).T
    velocity = np.array([column[f"ADMI_{axis}_vel"] for axis in axes]).T
    torque = np.array([column[f"{axis}_torque"] for axis in axes]).T
    one, d, dt = 0.01, 0.03, 0.004  # N m s^2/deg, N m s/deg (the law doesn't care for the unit), s
    # The device steps by v + dt/M (f - D v). That is the exact step of the slightly lighter mass with D dt/M' =
    # -log(1 - D dt/M). Its position then takes dt times the new speed, which differs from the way by what telescopes.
    lighter = -d * dt / np.log(1 - d * dt / one)
    late = dt - (one - lighter) / d
    controller = admittance(mass=(lighter,) * 6, damping=(d,) * 6, **BARE)
    controller.input["pose"][:2] = position[0]
    controller.reset()
    controller._virtual.velocity[:2] = velocity[0].tolist()
    for k in range(1, len(rows)):
        controller.input["wrench"][:2] = torque[k]
        controller.update(dt)
        way = position[k] - late * (velocity[k] - velocity[0])
        assert np.abs(controller.output["pose"][:2] - way).max() < 1e-9
        assert np.abs(controller.output["twist"][:2] - velocity[k]).max() < 1e-9
    assert len(rows) > 15_000
    assert np.ptp(position, axis=0).min() > 5


@settings(max_examples=50, deadline=None)
@given(st.tuples(*[st.floats(-3, 3)] * 3), st.tuples(*[st.floats(-1, 1)] * 6), st.tuples(*[st.floats(-0.3, 0.3)] * 3))
def test_gravity_of_the_handle_and_bias_leave_nothing_and_the_hands_wrench_remains(
    turn: Any, hand: Any, offset: Any
) -> None:
    mass, com, bias = 0.8, np.array([0.01, -0.02, 0.09]), np.array([3, -2, 1, 0.1, 0.2, -0.3])
    mount = Rotation.from_euler("xyz", [0.3, -0.4, 1.2])
    tool = Rotation.from_rotvec(turn)
    sensor = tool * mount
    weight = sensor.inv().apply([0, 0, -9.81 * mass])
    force, torque = 10 * np.array(hand[:3]), np.array(hand[3:])  # at the sensor's origin, world axes
    raw = (
        np.concatenate([sensor.inv().apply(force) + weight, sensor.inv().apply(torque) + np.cross(com, weight)]) + bias
    )
    quat = mount.as_quat()[[3, 0, 1, 2]]
    controller = admittance(
        (1, 2, 3, *tool.as_quat()[[3, 0, 1, 2]]), (*offset, *quat),
        calibration=Unloaded(bias=tuple(bias), tool_mass=mass, tool_com=tuple(com)), **BARE,
    )  # fmt: skip
    controller.input["wrench"][:] = raw
    controller.update(DT)
    lever = tool.apply(offset)
    np.testing.assert_allclose(controller.output["force"][:3], force, atol=1e-9)
    np.testing.assert_allclose(controller.output["force"][3:], torque + np.cross(lever, force), atol=1e-9)


def test_a_handle_laid_down_drifts_nowhere_and_the_dead_band_is_continuous() -> None:
    controller = admittance(dead_band=(1.0, 0.05))
    seen = []
    for push in np.linspace(0, 3, 301):
        controller.input["wrench"][:] = [push, 0, 0, 0, 0, 0]
        controller.update(DT)
        seen.append(controller.output["force"][0])
    assert max(seen[:100]) == 0
    assert np.abs(np.diff(seen)).max() < 0.011
    assert seen[-1] == pytest.approx(2.0)


@pytest.mark.slow
def test_orientation_turns_about_the_pushed_axis_without_bounds() -> None:
    controller = admittance(**BARE)
    controller.input["wrench"][3:] = [0.3, 0.6, 0.6]
    turned = 0.0
    axis = np.array([1, 2, 2]) / 3
    before = rotation.exp(0, 0, 0)
    for _ in range(20_000):
        # The hand's torque keeps its direction in the world.
        q = controller.input["pose"][3:]
        controller.input["wrench"][3:] = Rotation.from_quat(q[[1, 2, 3, 0]]).inv().apply(0.9 * axis)
        follow(controller)
        now = rotation.normalised(tuple(controller.output["pose"][3:].tolist()))  # type: ignore[arg-type]
        step = np.array(rotation.error(now, before))
        turned += float(step @ axis)
        assert np.linalg.norm(step - (step @ axis) * axis) < 1e-9
        before = now
    assert turned > 3 * np.pi
    assert np.linalg.norm(controller.output["pose"][3:]) == pytest.approx(1, abs=1e-12)


@pytest.mark.slow
def test_switches_at_any_instant_make_no_step() -> None:
    rng = np.random.default_rng(5)
    controller = admittance()
    twists = []
    force = np.zeros(6)
    for k in range(20_000):
        if k % 50 == 0:
            force = rng.normal(0, [15, 15, 15, 1, 1, 1])
        if rng.random() < 0.01:
            controller.input["modes"][:2] = rng.integers(0, 2, 2)
        controller.input["wrench"][:] = force
        follow(controller)
        twists.append(controller.output["twist"].copy())
    steps = np.abs(np.diff(twists, axis=0)).max(axis=0)
    assert np.isfinite(twists).all()
    assert (steps[:3] < 60 / 6 * DT + 40 / 6 * 1.5 * DT).all()  # the force's own effect, no more
    controller.input["modes"][:2] = 0
    for _ in range(6000):
        follow(controller)
    assert np.abs(controller.output["twist"]).max() < 1e-3


def test_translation_only_turns_nothing() -> None:
    controller = admittance(**BARE)
    controller.input["modes"][:] = [1, 0, 0, 0]
    controller.input["wrench"][:] = [5, 0, 0, 1, 1, 1]
    for _ in range(500):
        follow(controller)
    assert controller.output["twist"][0] > 0.05
    np.testing.assert_array_equal(controller.output["twist"][3:], 0)
    np.testing.assert_array_equal(controller.output["pose"][3:], [1, 0, 0, 0])


def test_the_leash_bounds_how_far_a_blocked_robot_is_pulled_and_jumps_nowhere() -> None:
    controller = admittance(tank=None)
    controller.input["wrench"][:] = [20, 0, 0, 0, 0, 1.5]
    twists = []
    for _ in range(8000):
        controller.update(DT)  # the robot stays where it is
        twists.append(controller.output["twist"].copy())
    pose = controller.output["pose"]
    assert pose[0] == pytest.approx(0.03 + 19 / 1000, abs=1e-3)
    assert np.linalg.norm(rotation.log(tuple(pose[3:].tolist()))) == pytest.approx(0.2 + 1.45 / 30, abs=0.01)  # type: ignore[arg-type]
    steps = np.abs(np.diff(twists, axis=0)).max(axis=0)
    assert steps[0] < 0.02
    assert np.abs(twists[-1]).max() < 1e-3
    controller.input["wrench"][:] = 0
    for _ in range(3000):
        controller.update(DT)
    assert controller.output["pose"][0] <= 0.031


def test_switched_off_nothing_drags_the_desired_pose() -> None:
    controller = admittance()
    controller.input["modes"][:] = 0
    controller.input["pose"][:3] = [0.2, 0, -0.1]  # pushed away, for long
    for _ in range(3000):
        controller.update(DT)
    np.testing.assert_array_equal(controller.output["pose"], [0, 0, 0, 1, 0, 0, 0])


def held(stiffness: float, delay: float, tank: float | None, seconds: float = 8.0) -> list[float]:
    """Velocities with an arm of this stiffness that holds the handle, the robot `delay` behind its desired pose."""
    controller = admittance(
        mass=(3, 3, 3, 0.8, 0.8, 0.8), damping=(20, 20, 20, 1.5, 1.5, 1.5), leash=None, tank=tank, dead_band=(0, 0)
    )
    waiting = deque([(0.0, 0.0)] * max(round(delay / DT), 1))
    controller.input["wrench"][0] = 2.0
    seen = []
    for k in range(round(seconds / DT)):
        x, v = waiting.popleft()
        controller.input["pose"][0], controller.input["twist"][0] = x, v
        push = 2.0 if k < 100 else 0.0
        controller.input["wrench"][0] = push - stiffness * x - 5.0 * v
        controller.update(DT)
        waiting.append((controller.output["pose"][0], controller.output["twist"][0]))
        seen.append(controller.output["twist"][0])
    return seen


@pytest.mark.sampled
@pytest.mark.parametrize("stiffness", [200, 500, 1000, 2000])
@pytest.mark.parametrize("delay", [0.002, 0.01, 0.02, 0.03])
def test_a_stiff_hand_behind_a_delay_makes_no_growing_oscillation(stiffness: float, delay: float) -> None:
    seen = np.abs(held(stiffness, delay, 0.1))
    early, late = seen[:1500].max(), seen[-1500:].max()
    assert np.isfinite(seen).all()
    assert late <= early
    assert seen.max() < 0.5


def knocked_late_sensor(age: float) -> tuple[float, float]:
    """RMS speeds early and late of a handle held with 2000 N/m, the sensor 30 ms and the robot 10 ms late.

    Args:
        age: what the law is told of the sensor's.
    """
    dt, stiffness = 0.002, 2000.0
    controller = admittance(mass=(3,) * 3 + (0.8,) * 3, damping=(20,) * 3 + (1.5,) * 3, force_age=age)
    controller.input["modes"][:] = [1, 0, 0, 0]
    forces, twists = deque([0.0] * 15), deque([0.0] * 5)
    x = v = 0.0
    speeds = []
    for k in range(1750):
        forces.append(min(max(-stiffness * x - 5.0 * v, -150.0), 150.0) + 30.0 * (100 <= k < 125))
        controller.input["wrench"][0] = forces.popleft()
        controller.input["pose"][0], controller.input["twist"][0] = x, v
        controller.update(dt)
        twists.append(controller.output["twist"][0])
        v = twists.popleft()
        x += dt * v
        speeds.append(v)
    return float(np.std(speeds[150:650])), float(np.std(speeds[-500:]))


def test_the_tank_holds_a_stiff_hand_behind_a_late_sensor_sooner_if_it_knows_how_late() -> None:
    early, late = knocked_late_sensor(age=0.03)
    assert late < 0.05 * early
    unaware, _ = knocked_late_sensor(age=0.0)
    assert early < 0.75 * unaware


def test_the_hands_whole_wrench_is_told_whatever_the_modes() -> None:
    """At the control point, world axes, without the handle's weight; the dead band doesn't touch it."""
    place = (0.1, -0.05, 0.2)
    controller = admittance(
        sensor=(*place, 0.6, 0.0, 0.8, 0.0), calibration=Unloaded(tool_com=(0.0, 0.01, 0.04), tool_mass=0.4)
    )
    tool = Rotation.from_euler("xyz", [0.4, -0.7, 1.1])
    sensor = tool * Rotation.from_quat([0.0, 0.8, 0.0, 0.6])
    hand, weight = np.array([0.1, -0.05, 0.1, 0.02, 0.3, -0.1]), np.array([0, 0, -9.81 * 0.4])
    at = tool.apply(place)
    force = hand[:3] + weight
    torque = hand[3:] - np.cross(at, hand[:3]) + np.cross(sensor.apply([0.0, 0.01, 0.04]), weight)
    controller.input["wrench"][:] = [*sensor.inv().apply(force), *sensor.inv().apply(torque)]
    controller.input["pose"][3:] = tool.as_quat()[[3, 0, 1, 2]]
    for modes in ([0, 0, 0, 0], [1, 0, 0, 0], [1, 1, 0, 0]):
        controller.input["modes"][:] = modes
        controller.update(1e-3)
        np.testing.assert_allclose(controller.output["hand"], hand, atol=1e-9)


def test_an_empty_tank_doesnt_lock_the_robot_against_a_hand_that_pushes_on() -> None:
    """A robot that moves against a hand's 100 N empties the tank; with motion as noisy as it is, it follows then."""
    controller = admittance(leash=None, dead_band=(0, 0))
    rng = np.random.default_rng(3)
    controller.input["modes"][:] = [1, 0, 0, 0]
    controller.input["wrench"][0] = 100.0
    controller.input["twist"][0] = -0.1
    for _ in range(50):
        controller.update(0.002)
    assert controller.output["tank"][0] < 0.0
    for _ in range(1000):
        controller.input["twist"][0] = controller.output["twist"][0] + rng.normal(0.0, 0.005)
        controller.update(0.002)
    config = controller._config
    assert controller.output["twist"][0] >= 0.99 * 100.0 / (config.damping[0] + config.brake)


def test_the_bare_law_does_ring_there() -> None:
    seen = np.abs(held(2000, 0.03, None, 2.0))
    peaks = [seen[a:b].max() for a, b in pairwise(range(0, 2001, 400))]
    assert peaks[-1] > 5 * peaks[0]


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(st.sampled_from(["wrench", "pose", "twist"]), st.integers(0, 5), st.integers(1, 2000))
def test_a_measurement_that_is_no_number_is_refused_and_leaves_nothing_behind(name: str, at: int, count: int) -> None:
    """What comes out meanwhile is no number either, which the guard refuses; afterwards it goes on from less speed."""
    controller = admittance(force_age=0.005)
    push = np.array([5, 0, 3, 0, 0.4, 0])
    controller.input["wrench"][:] = push
    for _ in range(200):
        follow(controller)
    pose, twist = controller.output["pose"].copy(), controller.output["twist"].copy()
    good = controller.input[name].copy()
    controller.input[name][at] = np.nan
    for _ in range(count):
        controller.update(DT)
        assert np.isnan(controller.output["pose"]).all()
        assert np.isnan(controller.output["twist"]).all()
    controller.input[name][:] = good
    controller.update(DT)
    gained = DT * np.linalg.norm(push[:3]) / 6.0
    speed, before = np.linalg.norm(controller.output["twist"][:3]), np.linalg.norm(twist[:3])
    assert speed <= before * np.exp(-count * DT * 40 / 6.0) * 1.05 + 1.01 * gained
    assert np.linalg.norm(controller.output["pose"][:3] - pose[:3]) <= DT * (before + gained)
    for each in ("hand", "force", "tank"):
        assert np.isfinite(controller.output[each]).all()


def test_a_handle_that_fails_while_it_is_switched_off_stops_nothing() -> None:
    controller = admittance()
    controller.input["modes"][:] = 0.0
    controller.input["wrench"][:] = np.nan
    follow(controller)
    np.testing.assert_array_equal(controller.output["twist"], 0.0)
    assert np.isfinite(controller.output["pose"]).all()
