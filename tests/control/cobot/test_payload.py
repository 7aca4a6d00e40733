"""The watched payload: pick-up, contact that an assumed load hid, dropping, putting down, stops and what follows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from helpers.control import bound
from scipy.spatial.transform import Rotation

from srl.control.cobot.contact_compliance import ComplianceConfig, ContactCompliance
from srl.control.cobot.load_watch import Phase
from srl.control.cobot.payload import Payload, PayloadConfig
from srl.runtime.contracts.signals import Array

DT = 2e-3
MASS, COM = 10.0, np.array([0.04, 0.0, 0.25])
UP, DOWN = np.array([0.0, 0, 1]), np.array([0.0, 0, -1])
FLANGE = (0.0, 0.0, -0.1, 1.0, 0.0, 0.0, 0.0)  # as the control point sees it


class Held:
    """A tool that a person moves, what it holds, and the law that watches it. The tool hangs with its z axis down."""

    def __init__(self, robot: str = "ur16e", noise: bool = True, **options: Any) -> None:
        config = PayloadConfig(robot=robot, axes="sensor", **options)
        self.law = bound(Payload("payload", config), flange=FLANGE)
        self.position, self.velocity = np.array([0.5, 0.0, 0.8]), np.zeros(3)
        self.down = Rotation.from_euler("x", np.pi)
        self.rigid = pin.Inertia(MASS, COM, 0.08 * np.eye(3))
        self.share = 0.0  # of the load that the tool holds
        self.outside = np.zeros(6)  # N, N m at the control point, world axes
        self.hand = np.zeros(6)
        self._rng = np.random.default_rng(7)
        self._noise = [0.5] * 3 + [0.03] * 3 if noise else [0.0] * 6
        self.closed = False
        self._fill(np.zeros(3))
        self.law.reset()

    @property
    def phase(self) -> Phase:
        return Phase(int(self.law.output["phase"][0]))

    @property
    def load(self) -> Array:
        return self.law.output["load"].copy()

    @property
    def seen(self) -> Array:
        return self.law.output["outside"].copy()

    def _fill(self, a: Array) -> None:
        """The tool accelerates by a (3,), world axes."""
        g = self.down.inv().apply(np.array([0, 0, -9.81]) - a)
        pull = -(self.rigid * pin.Motion(-g, np.zeros(3))).vector * self.share
        total = np.concatenate([self.down.apply(pull[:3]), self.down.apply(pull[3:])]) + self.outside + self.hand
        measured = np.concatenate([self.down.inv().apply(total[:3]), self.down.inv().apply(total[3:])])
        given, tool = self.law.input, self.down.as_quat()[[3, 0, 1, 2]]
        given["flange_wrench"][:] = measured + self._rng.normal(0, self._noise)
        given["pose"][:] = *self.position, *tool
        given["twist"][:3] = self.velocity + self._rng.normal(0, 5e-4, 3) * any(self._noise)
        given["hand"][:] = self.hand
        given["modes"][2] = self.closed

    def step(self, a: Array | None = None) -> None:
        a = np.zeros(3) if a is None else a
        self.velocity = self.velocity + DT * a
        self.position = self.position + DT * self.velocity
        self._fill(a)
        self.law.update(DT)

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds / DT)):
            self.step()

    def go(self, way: Array, seconds: float) -> None:
        """A smooth reach (minimum jerk) from rest to rest."""
        n = round(seconds / DT)
        for k in range(n):
            s = (k + 0.5) / n
            self.step(np.asarray(way) * (60 * s - 180 * s * s + 120 * s**3) / seconds**2)
        self.velocity[:] = 0.0

    def lift(self) -> None:
        """Closes round the load, takes its weight over and lifts it by 0.15 m."""
        self.wait(0.3)
        self.closed = True
        self.wait(0.2)
        for k in range(100):
            self.share = (k + 1) / 100
            self.step()
        self.go(0.15 * UP, 1.0)
        self.wait(0.5)


def until(held: Held, most: float = 1.0) -> float:
    """s until the law stops the limb, infinite if it doesn't."""
    for k in range(round(most / DT)):
        held.step()
        if held.law.contact:
            return (k + 1) * DT
    return float("inf")


CONTACTS = {"downward": 120.0 * DOWN, "sideways": np.array([55.0, 0, 0]), "forward": np.array([0, -55.0, 0])}


@pytest.mark.parametrize("direction", CONTACTS)
def test_contact_that_an_assumed_load_hides_is_seen_and_stops(direction: str) -> None:
    """Before, a closed gripper was blind to 197 N downward and 59 N sideways, whatever it held."""
    force = CONTACTS[direction]
    assumed = ContactCompliance(ComplianceConfig(axes="world", hand=False))
    assumed.reset(True)
    whole = [*(force + (9.81 * 4.0 * DOWN if direction == "downward" else 0.0)), 0, 0, 0]
    for _ in range(500):
        assumed.update(whole, [0.0] * 6, [0.0] * 6, (1, 0, 0, 0), 0.0, True, DT)
    assert assumed.contact == [0.0] * 6  # why it mustn't be assumed

    held = Held()
    held.lift()
    identified = ContactCompliance(ComplianceConfig(load="identified", carrying=(15.0, 3.0)))
    identified.reset(True)
    held.outside[:3] = force
    assert until(held) < 0.05
    held.wait(0.05)
    np.testing.assert_allclose(held.seen[:3], force, atol=5.0)
    for _ in range(100):
        held.step()
        identified.update(held.seen.tolist(), [0.0] * 6, [0.0] * 6, (1, 0, 0, 0), 0.0, True, DT)
    away = np.array(identified.deviation[:3])
    assert away @ force / np.linalg.norm(force) > 0.004


@pytest.mark.slow
def test_a_load_is_identified_from_pick_up_on_and_guided_motion_is_no_contact() -> None:
    held = Held()
    held.lift()
    assert held.phase is Phase.CARRYING
    assert held.load[0] == pytest.approx(MASS, abs=0.2)
    np.testing.assert_allclose(held.load[1:3], COM[:2], atol=0.01)
    rng, most = np.random.default_rng(5), 0.0
    for _ in range(6):
        way, time = rng.normal(0, 0.15, 3), rng.uniform(0.6, 1.0)
        held.hand[:3] = 3 * way / time**2
        held.go(way, time)
        held.hand[:] = 0
        most = max(most, float(np.linalg.norm(held.seen[:3])))
        assert not held.law.contact
    assert most < 10.0
    metrics = held.law.metrics()
    assert (metrics["contacts"], metrics["drops"], metrics["put_down"]) == (0, 0, 0)
    assert held.load[0] == pytest.approx(MASS, abs=0.1)
    assert held.law.output["deviation"][0] < 0.7  # most of it is what the sensor may be off


@pytest.mark.slow
def test_the_centre_of_mass_is_given_in_the_flanges_frame() -> None:
    held = Held(noise=False)
    held.lift()
    held.down = Rotation.from_euler("xy", [np.pi, 0.5])
    for k in range(500):
        held.down = Rotation.from_euler("xy", [np.pi, 0.5 * k / 500])  # slowly, so that turning isn't simulated
        held.step()
        assert not held.law.contact
    held.wait(1.0)
    np.testing.assert_allclose(held.load[1:], COM - np.array(FLANGE[:3]), atol=0.02)


@pytest.mark.slow
def test_leaning_does_not_become_load() -> None:
    held = Held()
    held.lift()
    before = held.load[0]
    held.outside[2] = -25.0
    held.wait(5.0)
    assert held.load[0] == pytest.approx(before, abs=0.05)
    assert held.seen[2] == pytest.approx(-25.0, abs=4.0)


def test_while_it_is_lifted_only_what_pulls_down_may_be_the_load() -> None:
    held = Held(watch={"stop": {"force": 30.0, "torque": 8.0}})
    held.wait(0.3)
    held.closed = True
    held.wait(0.2)
    held.outside[:3] = 25.0, 0, -25.0
    held.wait(0.1)
    assert held.phase is Phase.PICKING
    np.testing.assert_allclose(held.seen[:3], [25.0, 0, 0], atol=3.0)
    held.outside[0] = 45.0
    assert until(held) < 0.05


def test_a_gripper_that_closed_on_nothing_sees_what_pulls_down() -> None:
    held = Held()
    held.closed = True
    held.go(0.12 * UP, 1.0)
    assert held.phase is Phase.CARRYING
    assert held.load[0] == 0.0
    held.outside[2] = -80.0
    assert until(held) < 0.05


def test_a_load_heavier_than_the_arm_may_carry_is_contact() -> None:
    held = Held("panda")
    held.closed = True
    held.wait(0.2)
    held.outside[2] = -9.81 * 3.0 - 60.0
    assert until(held) < 0.05
    assert held.law.watch.estimate.mass <= 3.0


@pytest.mark.slow
def test_a_dropped_load_is_gone_within_50_ms_and_is_no_contact() -> None:
    held = Held()
    held.lift()
    held.share = 0.0
    for _ in range(25):
        held.step()
        assert not held.law.contact
    assert held.load[0] < 0.5
    held.wait(1.0)
    assert held.law.metrics()["drops"] == 1
    np.testing.assert_allclose(held.seen[:3], 0.0, atol=5.0)


@pytest.mark.slow
@pytest.mark.parametrize("left", [0.7, 0.4])
def test_a_part_of_the_load_falls_and_the_rest_is_found_once_the_tool_is_raised(left: float) -> None:
    """What seems to bear it from below can't be a table."""
    held = Held()
    held.lift()
    held.share = left
    held.wait(0.5)
    assert held.seen[2] > 15.0
    held.go(0.06 * UP, 0.5)
    assert held.phase is Phase.PICKING
    held.go(0.1 * UP, 1.0)
    held.wait(0.3)
    assert held.phase is Phase.CARRYING
    assert held.load[0] == pytest.approx(left * MASS, abs=0.4)
    np.testing.assert_allclose(held.seen[:3], 0.0, atol=6.0)
    held.outside[:3] = [150.0, 0.0, 0.0]
    assert until(held) < 0.05


@pytest.mark.slow
def test_a_load_may_be_put_down_and_taken_up_again() -> None:
    held = Held()
    held.lift()
    for k in range(300):
        held.outside[2] = 98.1 * k / 300  # the table bears it, on one side of its middle
        held.outside[3:] = np.cross([0.1, 0.05, -0.3], [0, 0, held.outside[2]]) * (1 - k / 300)
        held.step()
        assert not held.law.contact
    held.outside[:] = held.outside[2] * np.array([0, 0, 1, 0, 0, 0])
    held.share, held.outside[2] = 0.0, 0.0
    held.wait(1.0)
    metrics = held.law.metrics()
    assert (metrics["drops"], metrics["put_down"]) == (0, 1)
    assert held.load[0] < 0.1
    held.share = 1.0
    held.go(0.15 * UP, 1.0)
    held.wait(0.3)
    assert held.load[0] == pytest.approx(MASS, abs=0.3)
    assert not held.law.contact


def test_pressing_down_beyond_the_loads_weight_stops() -> None:
    held = Held()
    held.lift()
    held.outside[2] = 9.81 * MASS + 50.0
    assert until(held) < 0.05


@pytest.mark.slow
def test_a_load_that_comes_on_something_fast_hits_it_and_isnt_put_down() -> None:
    stopped = []
    for speed in (0.05, 0.25):
        held = Held()
        held.lift()
        for _ in range(50):
            held.step(-speed / 0.1 * UP)
        held.outside[2] = 60.0
        stopped.append(until(held, 0.1) < 0.05)
    assert stopped == [False, True]


def test_opened_the_load_goes_without_contact() -> None:
    held = Held()
    held.lift()
    held.closed = False
    held.wait(0.3)
    assert held.phase is Phase.RELEASING
    assert held.load[0] == pytest.approx(MASS, abs=0.2)
    for k in range(50):
        held.share = 1 - (k + 1) / 50
        held.step()
    held.wait(0.5)
    assert held.phase is Phase.OPEN
    assert held.load[0] == 0.0
    assert held.law.metrics()["contacts"] == 0


def test_after_a_stop_the_load_is_still_known_and_only_new_contact_stops() -> None:
    held = Held()
    held.lift()
    held.outside[0] = 60.0
    assert until(held) < 0.05
    held.law.reset()
    assert not held.law.contact
    assert held.load[0] == pytest.approx(MASS, abs=0.2)
    assert until(held, 0.5) == float("inf")  # the person must be able to lead it away
    held.outside[0] = 0.0
    held.wait(0.2)
    held.outside[0] = 60.0
    assert until(held) < 0.05


def test_contact_that_has_grown_since_the_reset_stops_all_the_same() -> None:
    """Before, any contact at a reset, however light, let the next one grow without bounds."""
    held = Held()
    held.lift()
    held.outside[0] = 18.0
    held.wait(0.2)
    held.law.reset()
    held.outside[0] = 50.0
    assert until(held, 0.2) == float("inf")
    held.outside[0] = 70.0
    assert until(held) < 0.05


@pytest.mark.slow
def test_the_sensors_bias_before_pick_up_is_no_load() -> None:
    held = Held()
    held.outside[:] = 4.0, -3.0, -5.0, 0.3, 0.0, 0.2
    held.wait(3.0)
    held.lift()
    assert held.load[0] == pytest.approx(MASS, abs=0.2)


def test_a_measurement_that_is_no_number_is_refused_and_leaves_nothing_behind() -> None:
    held = Held()
    held.lift()
    before = held.load
    held.outside[1] = np.nan
    held.step()
    assert np.isnan(held.seen).all()
    np.testing.assert_array_equal(held.load, before)
    held.outside[1] = 0.0
    held.step()
    assert np.linalg.norm(held.seen[:3]) < 10.0
