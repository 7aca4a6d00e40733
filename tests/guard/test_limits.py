"""Limits from a profile and a device, and what a guard says where they don't do."""

import numpy as np
import pytest
from helpers_guard import PLACE, guard_of
from pydantic import ValidationError

from runtime.errors import WiringError
from runtime.guard import GuardLimits, PositionGuard, TorqueGuard, VelocityGuard, merge
from runtime.signals import Kind, Limits


def test_a_number_is_for_every_joint_a_list_has_one_each():
    limits = GuardLimits(velocity=2, upper=[1, 2, 3]).to_limits((3,), PLACE)
    assert limits.velocity.tolist() == [2, 2, 2]
    assert limits.upper.tolist() == [1, 2, 3]
    assert limits.lower is None


def test_a_list_of_another_length_is_named():
    with pytest.raises(WiringError, match=rf"{PLACE}.velocity: 2 values for a command of 3"):
        GuardLimits(velocity=[1, 2]).to_limits((3,), PLACE)


@pytest.mark.parametrize(
    "wrong", [{"velocity": 0}, {"jerk": -1}, {"lower": float("nan")}, {"effort": float("inf")}, {"speed": 1}]
)
def test_nonsense_is_refused(wrong):
    with pytest.raises(ValidationError):
        GuardLimits(**wrong)


def test_merging_takes_the_narrower_of_each():
    a = Limits(lower=np.array([-1.0, -3.0]), upper=np.array([1.0, 3.0]), velocity=np.array([2.0, 5.0]))
    b = Limits(lower=np.array([-2.0, -2.0]), upper=np.array([2.0, 2.0]), jerk=np.array([7.0, 7.0]))
    merged = merge(a, b)
    assert merged.lower.tolist() == [-1, -2]
    assert merged.upper.tolist() == [1, 2]
    assert merged.velocity.tolist() == [2, 5]
    assert merged.jerk.tolist() == [7, 7]
    assert merged.effort is None


@pytest.mark.parametrize(
    ("kind", "given", "missing"),
    [
        (Kind.POSITION, {"velocity": 1}, "acceleration"),
        (Kind.VELOCITY, {"acceleration": 1}, "velocity"),
        (Kind.TORQUE, {"effort": 1, "velocity": 1}, "effort_rate"),
        (Kind.TORQUE, {"effort": 1, "velocity": 1, "effort_rate": 1, "lower": 0}, "upper"),
    ],
)
def test_a_missing_limit_is_named(kind, given, missing):
    with pytest.raises(WiringError, match=missing) as caught:
        guard_of(kind, **given)
    assert caught.value.place == PLACE
    assert missing in caught.value.remedy


def test_limits_without_room_and_a_rest_outside_are_refused():
    with pytest.raises(WiringError, match="no room"):
        guard_of(Kind.POSITION, velocity=1, acceleration=1, lower=1, upper=1)
    with pytest.raises(WiringError, match="rest"):
        guard_of(Kind.POSITION, velocity=1, acceleration=1, lower=0, upper=1, rest=np.array([2.0]))


def test_the_kind_decides_the_guard():
    assert isinstance(guard_of(Kind.POSITION, velocity=1, acceleration=1), PositionGuard)
    assert isinstance(guard_of(Kind.VELOCITY, velocity=1, acceleration=1), VelocityGuard)
    assert isinstance(guard_of(Kind.TORQUE, velocity=1, effort=1, effort_rate=1), TorqueGuard)


def test_measurements_a_kind_needs_must_be_bound():
    velocity = guard_of(Kind.VELOCITY, velocity=1, acceleration=1, lower=-1, upper=1)
    with pytest.raises(WiringError, match="measured position"):
        velocity.bind(np.zeros(1))
    torque = guard_of(Kind.TORQUE, velocity=1, effort=1, effort_rate=1)
    with pytest.raises(WiringError, match="measured position and velocity"):
        torque.bind(np.zeros(1), np.zeros(1))
    with pytest.raises(WiringError, match="shape"):
        torque.bind(np.zeros(2), np.zeros(1), np.zeros(1))
