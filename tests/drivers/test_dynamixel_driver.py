"""The driver on its twin, in lockstep: first command, modes, lost answers."""

import numpy as np
import pytest
from helpers.dynamixel import BOTH, MS, THREE, TWO, Rig, make_twin, near, torque, truth

from srl.runtime.contracts.errors import DeviceLostError

# -- commands


@BOTH
def test_torque_comes_with_the_first_command_and_nothing_moves(protocol):
    with Rig(make_twin(protocol=protocol)) as rig:
        rig.run(10)
        before = truth(rig)
        rig.hold(20)
        assert torque(rig) == [True] * 3
        np.testing.assert_allclose(truth(rig), before, atol=2e-3)


def test_a_first_command_elsewhere_gets_no_torque_and_is_a_fault():
    with Rig(make_twin()) as rig:
        rig.start()
        rig.run(5, [0.5, 0.0, 0.0])
        assert torque(rig) == [False, True, True]
        assert rig.driver.health.fault == "shoulder is too far from its first command"
        np.testing.assert_allclose(truth(rig)[0], 0.0, atol=1e-3)
        rig.driver.recover(rig.now)
        assert rig.driver.health.fault == ""
        rig.run(5, [0.0, 0.0, 0.0])
        assert torque(rig) == [True] * 3


@BOTH
def test_positions_are_reached_by_physics_with_a_delay_of_a_cycle(protocol):
    with Rig(make_twin(protocol=protocol)) as rig:
        where = rig.hold()
        goal = where + np.array([0.4, -0.3, 0.006])
        rig.run(3, goal)
        assert 0.0 < truth(rig)[0] < 0.3  # on its way: no echo
        rig.run(80, goal)
        near(rig.state["position"], goal, [0.015, 0.015, 1e-4])
        near(rig.state["position"], truth(rig), [2e-3, 2e-3, 2e-5])
        stamps = [stamp for stamp, _ in rig.log]
        steps = np.diff(stamps[10:])
        assert np.median(steps) == 10 * MS  # a sample in every cycle, but for those of a check
        assert steps.max() == 20 * MS
        assert rig.now - stamps[-1] == 20 * MS  # asked for in the write before the last read
        metrics = rig.twin.metrics()
        assert (metrics["damaged"], metrics["collisions"], metrics["bytes_lost"]) == (0, 0, 0)


@pytest.mark.slow
@BOTH
@pytest.mark.parametrize("flipped", [False, True])
def test_velocity(protocol, flipped):
    motors = {k: m | {"reversed": flipped} for k, m in THREE.items()}
    with Rig(make_twin(motors, protocol=protocol, mode="velocity")) as rig:
        rig.hold()
        wanted = np.array([1.0, -1.5, 0.008])
        rig.run(60, wanted)
        np.testing.assert_allclose(rig.state["velocity"], wanted, rtol=0.12)
        a = truth(rig)
        rig.run(20, wanted)
        np.testing.assert_allclose((truth(rig) - a) / 0.2, wanted, rtol=0.12)
        rig.run(120, [0.0, 0.0, 0.0])
        assert np.abs(rig.state["velocity"]).max() < 0.05


@BOTH
def test_effort_is_torque_at_the_axis(protocol):
    motors = {"shoulder": {"model": "MX-106"}, "elbow": {"model": "MX-64", "reversed": True}}
    with Rig(make_twin(motors, protocol=protocol, mode="effort")) as rig:
        rig.hold()
        limits = rig.driver.limits["effort_command"]
        assert limits.effort[1] > 4.0
        rig.run(10, [0.5, 0.6])
        np.testing.assert_allclose(rig.state["effort"], [0.5, 0.6], atol=0.02)
        a = truth(rig)
        assert (a > 0.01).all()  # both turn the way they are pushed


@BOTH
def test_effort_of_a_held_load_is_measured(protocol):
    """The elbow against its end stop: the drive pushes with its position error."""
    with Rig(make_twin(TWO, protocol=protocol)) as rig:
        where = rig.hold()
        for step in range(100):
            rig.cycle(where + np.array([0.0, 0.027 * step]))  # stop at 2.6 rad
        rig.run(30, where + np.array([0.0, 2.65]))
        world = rig.twin.bus.world
        assert rig.state["effort"][1] == pytest.approx(world.truth_arrays["arm_effort"][1], abs=0.05)
        assert rig.state["effort"][1] > 0.5


@pytest.mark.slow
@BOTH
def test_extended_position_goes_over_several_turns(protocol):
    motors = {"screw": {"model": "MX-28", "m_per_rad": 0.001}}
    with Rig(make_twin(motors, protocol=protocol, mode="extended")) as rig:
        where = rig.hold()
        for _ in range(400):
            where = where + 5e-5
            rig.cycle(where)
        rig.run(30, where)
        assert truth(rig)[0] == pytest.approx(0.02, abs=1e-4)  # 3.2 turns
        assert rig.state["position"][0] == pytest.approx(0.02, abs=1e-4)


def test_a_command_that_is_not_finite_moves_nothing():
    with Rig(make_twin()) as rig:
        where = rig.hold()
        rig.run(20, [np.nan, np.inf, where[2]])
        np.testing.assert_allclose(truth(rig), where, atol=2e-3)


# -- the line


def test_a_damaged_answer_costs_a_sample_and_no_more():
    with Rig(make_twin()) as rig:
        where = rig.hold()
        rig.twin.corrupt = 1
        rig.run(10, where)
        assert rig.driver.health.errors >= 1
        assert rig.now - rig.driver.health.stamp == 20 * MS
        ages = [10 * MS * k for k in range(len(rig.log))]
        worst = max(now - stamp for now, (stamp, _) in zip(ages, rig.log, strict=True) if stamp >= 0)
        assert worst < rig.driver.max_age * 1e9
        assert rig.driver.health.fault == ""


def test_a_motor_that_falls_silent_makes_samples_stale_and_then_is_a_loss():
    with Rig(make_twin()) as rig:
        where = rig.hold()
        rig.twin.absent = {2}
        stamp = rig.driver.health.stamp
        rig.run(20, where)
        assert rig.driver.health.stamp <= stamp + 10 * MS  # no sample of only some motors
        with pytest.raises(DeviceLostError, match=r"'elbow' \(id 2\) hasn't answered for a second, others have"):
            rig.run(200, where)
        assert not rig.driver.health.connected
        rig.twin.absent = set()
        rig.open()
        assert rig.driver.health.reconnects == 1
        rig.hold()
        np.testing.assert_allclose(truth(rig), where, atol=5e-3)


def test_a_bus_that_stalls_holds_one_command_and_no_old_sample_is_taken_for_new():
    with Rig(make_twin()) as rig:
        where = rig.hold()
        client, service = rig.driver, rig.twin.service
        log = rig.twin.door.bytes_in
        for step in range(20):  # 0.2 s: the twin hangs, its world goes on
            client.read(rig.now)
            client.command_arrays["position_command"][:] = where + 0.002 * step * np.array([1, 1, 0.01])
            client.write(rig.now)
            rig.bench.now += 10 * MS
            rig.twin.fake.world.advance(rig.now)
        assert client.health.unsent > 0
        stamp = client.health.stamp
        service(rig.now)
        waiting = rig.twin.door.bytes_in - log
        assert waiting < 250  # one command with its request, and pings
        client.read(rig.now)  # what the twin answers now is of the past
        assert client.health.stamp == stamp
        rig.run(3, where)
        assert client.health.stamp > stamp
        assert client.health.unsent < 60


def test_the_world_may_pause_between_opening_and_the_first_cycle():
    with Rig(make_twin()) as rig:
        rig.bench.run(1.0)  # no word from the driver: all watchdogs trip
        assert [s.get("bus_watchdog") for s in rig.twin.servos] == [-1] * 3
        where = rig.hold(10)
        assert rig.driver.health.fault == ""
        rig.run(50, where + np.array([0.1, 0.1, 0.0]))
        np.testing.assert_allclose(truth(rig)[:2], where[:2] + 0.1, atol=0.01)


@pytest.mark.slow
def test_the_watchdog_stops_a_motion_whose_host_is_gone_and_going_on_takes_a_person():
    with Rig(make_twin(mode="velocity")) as rig:
        rig.hold()
        rig.run(30, [0.5, 0.5, 0.0])
        rig.bench.run(1.5)  # the host hangs
        a = truth(rig)
        rig.bench.run(0.3)
        np.testing.assert_allclose(truth(rig), a, atol=2e-3)
        rig.run(8, [0.5, 0.5, 0.0])
        assert "the bus watchdog has stopped shoulder, elbow, slide" in rig.driver.health.fault
        np.testing.assert_allclose(truth(rig), a, atol=2e-3)
        rig.driver.recover(rig.now)
        rig.run(3, [0.0, 0.0, 0.0])
        assert rig.driver.health.fault == ""
        rig.run(30, [0.5, 0.5, 0.0])
        assert (truth(rig)[:2] > a[:2] + 0.05).all()
