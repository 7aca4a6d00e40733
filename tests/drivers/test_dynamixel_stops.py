"""The driver on its twin, in lockstep: faults of motors, stops, and what follows them."""

import os

import numpy as np
import pytest
from helpers.dynamixel import BOTH, TWO, Rig, config, make_twin, torque, truth
from helpers.twin import bound

from srl.drivers.dynamixel import Dynamixel
from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.contracts.signals import Stop

# -- faults


@pytest.mark.slow
@BOTH
def test_overload_is_a_fault_and_recovery_leaves_it_limp_until_the_next_start(protocol):
    with Rig(make_twin(protocol=protocol)) as rig:
        where = rig.hold()
        rig.run(50, where + np.array([0.3, 0.3, 0.0]))
        motors = rig.twin.bus.chain.motors
        motors.fail(1, 32)
        rig.run(30, where + np.array([0.3, 0.3, 0.0]))
        assert "elbow: overload" in rig.driver.health.fault
        if protocol == 2:
            assert torque(rig) == [True, False, True]
        stamp = rig.driver.health.stamp
        rig.driver.recover(rig.now)
        rig.driver.recover(rig.now)  # asking twice does no harm
        assert rig.driver.health.fault or protocol == 1
        rig.run(100, where + np.array([0.3, 0.0, 0.0]))  # the others hold on; the elbow stands at 0.3
        assert torque(rig)[0]
        assert not torque(rig)[1]
        assert rig.driver.health.stamp > stamp
        assert "too far" in rig.driver.health.fault
        rig.driver.recover(rig.now)
        rig.hold(20)
        assert rig.driver.health.fault == ""
        assert torque(rig) == [True] * 3
        rig.run(60, where)
        np.testing.assert_allclose(truth(rig)[:2], where[:2], atol=0.02)


def test_a_power_dip_of_one_motor_is_noticed():
    with Rig(make_twin()) as rig:
        where = rig.hold()
        rig.twin.servos[1].restart()
        rig.run(40, where)
        assert "elbow lost its torque" in rig.driver.health.fault
        rig.driver.recover(rig.now)
        rig.run(30, where)
        assert rig.driver.health.fault == ""
        assert rig.twin.servos[1].get("bus_watchdog") == 5
        assert torque(rig) == [True] * 3


@pytest.mark.slow
def test_turns_are_taken_up_after_a_reboot():
    motors = {"screw": {"model": "MX-28", "m_per_rad": 0.001}}
    with Rig(make_twin(motors, mode="extended")) as rig:
        where = rig.hold()
        for _ in range(400):
            where = where + 5e-5
            rig.cycle(where)
        rig.run(20, where)
        rig.twin.bus.chain.motors.fail(0, 32)
        rig.run(30, where)
        rig.driver.recover(rig.now)
        rig.run(100)
        assert rig.driver.health.fault == ""
        assert 0 <= rig.twin.servos[0].motors.counts[0] < 4096
        assert rig.state["position"][0] == pytest.approx(truth(rig)[0], abs=1e-5)
        before = truth(rig)[0]
        rig.hold(30)
        assert truth(rig)[0] == pytest.approx(before, abs=2e-5)


@pytest.mark.slow
def test_a_servo_that_does_not_come_back_stays_a_fault_until_the_bus_is_opened_anew():
    with Rig(make_twin()) as rig:
        where = rig.hold()
        rig.twin.bus.chain.motors.fail(1, 4)
        rig.run(30, where)
        assert rig.driver.health.fault == "elbow: overheating"
        rig.twin.absent = {2}
        rig.driver.recover(rig.now)
        with pytest.raises(DeviceLostError, match="elbow"):
            rig.run(600, where)
        assert "doesn't come back from its reboot" in rig.driver.health.fault


@BOTH
@pytest.mark.parametrize("mode", ["velocity", "effort"])
def test_a_velocity_or_an_effort_ends_with_its_commands(protocol, mode):
    """The loop writes no more to a device with a fault, but goes on reading it."""
    with Rig(make_twin(TWO, protocol=protocol, mode=mode)) as rig:
        rig.hold()
        rig.run(20, [0.5, 0.5])
        motors = rig.twin.bus.chain.motors
        assert motors.goal_velocity.any() or motors.goal_current.any()
        rig.run(3)
        assert not motors.goal_velocity.any()
        assert not (mode == "effort" and motors.goal_current.any())
        assert torque(rig) == [True, True]


# -- stops


@BOTH
def test_limp_hold_and_closing(protocol):
    with Rig(make_twin(protocol=protocol)) as rig:
        where = rig.hold()
        rig.driver.stop(Stop.HOLD)
        rig.run(5, where)
        assert torque(rig) == [True] * 3
        rig.driver.stop(Stop.LIMP)
        rig.driver.stop(Stop.LIMP)
        rig.run(5)
        assert torque(rig) == [False] * 3
        assert rig.driver.health.fault == ""
        rig.run(20)
        assert rig.driver.health.fault == ""
        rig.hold()
        rig.driver.close()
        rig.driver.close()
        rig.bench.run(0.5)
        assert torque(rig) == [True] * 3
        if protocol == 2:
            assert [s.get("bus_watchdog") for s in rig.twin.servos] == [0] * 3
        rig.open()
        assert torque(rig) == [True] * 3  # goes on holding
        rig.hold()
        np.testing.assert_allclose(truth(rig), where, atol=5e-3)


@BOTH
def test_closing_ends_a_velocity(protocol):
    with Rig(make_twin(protocol=protocol, mode="velocity")) as rig:
        rig.hold()
        rig.run(20, [0.5, 0.5, 0.0])
        rig.driver.close()
        rig.bench.run(1.0)
        a = truth(rig)
        rig.bench.run(0.3)
        np.testing.assert_allclose(truth(rig), a, atol=2e-3)


@pytest.mark.sampled
@BOTH
@pytest.mark.parametrize("mode", ["position", "velocity", "effort"])
@pytest.mark.parametrize("cut", [0, 3, 9, 17])
def test_stop_frames_work_behind_a_packet_cut_short(protocol, mode, cut):
    with Rig(make_twin(TWO, protocol=protocol, mode=mode)) as rig:
        where = rig.hold()
        driver = rig.driver
        moving = {"position": where, "velocity": np.array([0.5, 0.5]), "effort": np.array([0.6, 0.3])}[mode]
        rig.run(10, moving)
        (frame,) = driver.stop_frames(Stop.HOLD)
        if mode == "position":
            rig.run(1, moving)
            assert driver.stop_frames(Stop.RETRACT) == (frame,)
        fd = driver.fileno()
        rig.run(1)
        os.write(fd, driver._goals.newest[:cut] + frame)
        rig.bench.run(1.0)
        a = truth(rig)
        rig.bench.run(0.2)
        np.testing.assert_allclose(truth(rig), a, atol=0.2 if mode == "effort" else 2e-3)
        if mode == "effort":
            assert not rig.twin.bus.chain.motors.goal_current.any()
        else:
            assert torque(rig) == [True, True]
        os.write(fd, driver._goals.newest[:cut] + driver.stop_frames(Stop.LIMP)[0])
        rig.bench.run(0.02)
        assert torque(rig) == [False, False]


def test_stop_frame_is_the_same_object_while_nothing_is_sent():
    with Rig(make_twin()) as rig:
        assert rig.driver.stop_frames(Stop.HOLD) == ()  # no torque: nothing to stop
        rig.hold()
        assert rig.driver.stop_frames(Stop.HOLD) is rig.driver.stop_frames(Stop.HOLD)
        assert rig.driver.stop_frames(Stop.LIMP) is rig.driver.stop_frames(Stop.LIMP)


def test_a_pulled_cable_is_a_loss_and_the_bus_opens_again():
    with Rig(make_twin()) as rig:
        where = rig.hold()
        rig.twin.door.close()
        with pytest.raises(DeviceLostError):
            rig.run(5)
        rig.driver.stop(Stop.LIMP)
        rig.driver.close()
        rig.twin.open()
        rig.driver.config = rig.driver.config.model_copy(update={"port": rig.twin.address})
        rig.driver._units.config = rig.driver.config
        rig.open()
        assert rig.driver.health.reconnects == 1
        rig.hold()
        np.testing.assert_allclose(truth(rig), where, atol=5e-3)


def test_calls_on_a_bus_that_is_not_open():
    bus = Dynamixel("bus", config())
    bus.stop(Stop.LIMP)
    bus.close()
    bus.recover(0)
    assert bus.fileno() is None
    assert bus.stop_frames(Stop.HOLD) == ()
    with pytest.raises(DeviceLostError):
        bus.read(0)


@pytest.mark.parametrize("protocol", [2, 1])
def test_a_servo_beyond_its_own_limits_does_not_leap_to_them(protocol):
    twin = make_twin(protocol=protocol)
    low, high = ("min_position_limit", "max_position_limit") if protocol == 2 else ("cw_angle_limit", "ccw_angle_limit")
    twin.servos[0].put(low, 1024)
    twin.servos[0].put(high, 1500)  # it hangs at 2048
    with Rig(twin) as rig:
        rig.start()
        rig.run(30, rig.state["position"].copy())
        assert torque(rig) == [False, True, True]
        assert rig.driver.health.fault == "shoulder is beyond its servo's own position limits; bring it back by hand"
        np.testing.assert_allclose(truth(rig)[0], 0.0, atol=1e-3)


def test_a_first_command_that_is_not_finite_moves_no_servo_that_has_torque():
    with Rig(make_twin()) as rig:
        rig.hold(20)
        before = truth(rig)
        again = Rig.__new__(Rig)
        again.twin, again.bench, again.log = rig.twin, rig.bench, []
        rig.driver.close()
        again.driver = bound(Dynamixel("bus", rig.driver.config))
        again.open()
        again.start()
        again.run(30, np.full(3, np.nan))
        np.testing.assert_allclose(truth(again), before, atol=2e-3)
        again.driver.close()
