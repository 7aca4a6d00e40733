"""Limits from a profile and a device, and what a guard says where they don't do."""

import numpy as np
import pytest
from helpers.guard import PLACE, guard_of
from helpers.verified import Scene
from pydantic import ValidationError

from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.signals import Command, Kind, Limits, Stop
from srl.runtime.guard import GUARDS, GuardLimits, PositionGuard, TorqueGuard, VelocityGuard, merge


def test_a_number_is_for_every_joint_a_list_has_one_each():
    limits = GuardLimits(velocity=2, upper=[1, 2, 3]).to_limits((3,), PLACE)
    assert limits.velocity.tolist() == [2, 2, 2]
    assert limits.upper.tolist() == [1, 2, 3]
    assert limits.lower is None


def test_a_list_of_another_length_is_named():
    with pytest.raises(WiringError, match=rf"{PLACE}.velocity: 2 values for 3 elements"):
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
        (Kind.TORQUE, {"effort": 1, "velocity": 1, "effort_rate": 1}, "inertia"),
        (Kind.TORQUE, {"effort": 1, "velocity": 1, "effort_rate": 1, "inertia": 1, "lower": 0}, "upper"),
        (Kind.TORQUE, {"effort": 1, "velocity": 1, "effort_rate": 1, "inertia": 1, "upper": 0}, "lower"),
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


ONE = {  # the limits of a joint of each kind
    Kind.POSITION: {"lower": -1.0, "upper": 1.5, "velocity": 4.0, "acceleration": 40.0},
    Kind.VELOCITY: {"lower": -1.0, "upper": 1.5, "velocity": 4.0, "acceleration": 40.0},
    Kind.TORQUE: {"lower": -1.0, "upper": 1.5, "velocity": 4.0, "effort": 10.0, "effort_rate": 200.0, "inertia": 0.5,
                  "acceleration": 12.0},
}  # fmt: skip
JERK = {"jerk": 400.0}


@pytest.mark.parametrize("stop", [Stop.HOLD, Stop.RETRACT])
@pytest.mark.parametrize(("kind", "more"), [*((kind, {}) for kind in ONE), (Kind.POSITION, JERK)])
def test_each_joint_has_the_limits_of_its_own_name(kind, more, stop):
    """Beside a joint that may do less or more, each does the same as alone: no limit is another joint's."""
    scales = (1.0, 0.3, 1.7)
    limits = [{name: scale * value for name, value in (ONE[kind] | more).items()} for scale in scales]
    together = {name: [each[name] for each in limits] for name in limits[0]}
    rests = np.array([0.2, -0.1, 0.3])

    def bound(joints, rest, given):
        guard = guard_of(kind, joints, rest=rest, **given)
        arrays = np.zeros((4, joints))
        guard.bind(arrays[0], arrays[1], arrays[2], arrays[3])
        guard.reset(np.zeros(joints))
        return guard, arrays

    guards = [bound(3, rests, together), *(bound(1, rests[i : i + 1], each) for i, each in enumerate(limits))]
    random = np.random.default_rng(5)
    wanted, stopping, largest = np.zeros(3), False, np.zeros(3)
    for k in range(400):
        if k % 20 == 0:
            wanted, stopping = random.uniform(-20.0, 20.0, 3), bool(k % 100 >= 60)
        for n, (guard, (applied, q, qd, sent)) in enumerate(guards):
            guard.resynchronise(k > 0, 0.01)
            if stopping:
                guard.stop(stop, 0.01)
            else:
                guard.step(wanted if n == 0 else wanted[n - 1 : n], None, 0.01)
            before = q.copy()
            q[:] += {Kind.POSITION: applied - q, Kind.VELOCITY: applied * 0.01, Kind.TORQUE: qd * 0.01}[kind]
            qd[:] += applied * 0.02 if kind is Kind.TORQUE else (q - before) / 0.01 - qd
            sent[:] = applied
        assert guards[0][0].applied.tolist() == [guard.applied.item() for guard, _ in guards[1:]]
        largest = np.maximum(largest, np.abs(guards[0][0].applied))
    assert largest[1] < largest[0] < largest[2]


def test_the_kind_decides_the_guard():
    assert isinstance(guard_of(Kind.POSITION, velocity=1, acceleration=1), PositionGuard)
    assert isinstance(guard_of(Kind.VELOCITY, velocity=1, acceleration=1), VelocityGuard)
    assert isinstance(guard_of(Kind.TORQUE, velocity=1, effort=1, effort_rate=1, inertia=1), TorqueGuard)


def test_measurements_a_kind_needs_must_be_bound():
    velocity = guard_of(Kind.VELOCITY, velocity=1, acceleration=1, lower=-1, upper=1)
    with pytest.raises(WiringError, match="measured position"):
        velocity.bind(np.zeros(1))
    torque = guard_of(Kind.TORQUE, velocity=1, effort=1, effort_rate=1, inertia=1)
    with pytest.raises(WiringError, match="measured position and velocity"):
        torque.bind(np.zeros(1), np.zeros(1))
    with pytest.raises(WiringError, match="shape"):
        torque.bind(np.zeros(2), np.zeros(1), np.zeros(1))


@pytest.mark.parametrize("wrong", [float("nan"), -1.0, float("inf")])
@pytest.mark.parametrize(
    ("kind", "name"),
    [
        (Kind.VELOCITY, "velocity"),
        (Kind.VELOCITY, "acceleration"),
        (Kind.POSITION, "velocity"),
        (Kind.POSITION, "acceleration"),
        (Kind.TORQUE, "velocity"),
        (Kind.TORQUE, "effort"),
        (Kind.TORQUE, "effort_rate"),
        (Kind.TORQUE, "inertia"),
    ],
)
def test_a_device_whose_own_limit_is_nonsense_is_refused(kind, name, wrong):
    """As a comparison with NaN is never true, it would be no limit at all."""
    given = {"velocity": 1.0, "acceleration": 2.0, "effort": 5.0, "effort_rate": 100.0, "inertia": 0.1}
    given = {each: np.array([value, value]) for each, value in given.items()}
    given[name][1] = wrong
    with pytest.raises(WiringError, match=f"the {name} limit"):
        GUARDS[kind](PLACE, Command(name="c", shape=(2,), unit="1", kind=kind, feedback="p"), Limits(**given), 0.01)


@pytest.mark.parametrize(
    ("kind", "name"), [(Kind.VELOCITY, "acceleration"), (Kind.POSITION, "acceleration"), (Kind.TORQUE, "velocity")]
)
def test_a_limit_that_would_divide_by_zero_in_the_loop_is_refused_before_it(kind, name):
    given = {each: np.full(2, 5.0) for each in ("velocity", "acceleration", "effort", "effort_rate", "inertia")}
    given[name][0] = 0.0
    with pytest.raises(WiringError, match=f"the {name} limit 0"):
        GUARDS[kind](PLACE, Command(name="c", shape=(2,), unit="1", kind=kind, feedback="p"), Limits(**given), 0.01)


def test_an_axis_that_may_not_move_is_none():
    """A base without mecanum wheels."""
    limits = Limits(velocity=np.array([1.0, 0.0]), acceleration=np.array([2.0, 2.0]))
    command = Command(name="c", shape=(2,), unit="1", kind=Kind.VELOCITY, feedback="p")
    guard = GUARDS[command.kind](PLACE, command, limits, 0.01)
    guard.reset(np.zeros(2))
    guard.step(np.array([1.0, 1.0]), None, 0.01)
    assert guard.applied[0] > 0
    assert guard.applied[1] == 0


@pytest.mark.parametrize(
    ("limits", "known", "refused"),
    [
        ({"lower": -1.0, "upper": 1.0}, True, ""),
        ({"lower": -1.5, "upper": 1.0}, True, "may go 1.5 from its zero, and the clearance is right up to 1.25"),
        ({"lower": -1.0, "upper": 1.5}, True, "may go 1.5 from its zero"),
        ({"lower": -1.0, "upper": 1.5}, False, "may go 1.5 from its zero"),
        ({"lower": -1.0}, True, "may go inf from its zero"),
        ({"lower": -1.0}, False, ""),
        ({"lower": -1.5}, False, "may go 1.5 from its zero"),
        ({}, True, "may go inf from its zero"),
        ({}, False, ""),
    ],
)
def test_the_limits_keep_a_limb_where_its_clearance_is_right(limits, known, refused):
    clearance = Scene().clearance
    clearance.stroke = np.full(2, 1.25)
    guard = guard_of(Kind.POSITION, 2, velocity=1.0, acceleration=1.0, **limits)
    if not refused:
        guard.check_stroke(clearance, known)
        return
    with pytest.raises(WiringError, match=refused) as caught:
        guard.check_stroke(clearance, known)
    assert ("stroke" in caught.value.remedy) == ("inf" not in refused)
    with pytest.raises(WiringError, match="from its zero"):
        guard.keep_clear(clearance, 0.03, np.zeros(2))
