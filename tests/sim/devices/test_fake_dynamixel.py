"""The simulated bus behind the driver's contract, and the chain of servos in its world."""

import numpy as np
import pytest
from helpers.dynamixel import MS, THREE, Rig, cell, config, make_twin
from helpers.sim import bind

from srl.drivers.dynamixel import Dynamixel
from srl.runtime.contracts.errors import DeviceError, DeviceLostError, WiringError
from srl.runtime.contracts.signals import Stop
from srl.sim.devices.dynamixel.fake import FakeDynamixel
from srl.sim.world.cell import Cell, CellConfig

PERIOD = 10 * MS


def make(world=None, motors=THREE, seed=1, options=(), **profile):
    world = world or cell(motors, seed)
    fake = FakeDynamixel("bus", config(motors, **profile), world, FakeDynamixel.Options(**dict(options)))
    bind(fake)
    fake.open()
    return fake


def run(fake, cycles, command=None):
    for _ in range(cycles):
        fake.read(fake.world.time)
        if command is not None and fake.health.stamp >= 0:
            fake.command_arrays[fake.commands[0].name][:] = command
            fake.write(fake.world.time)
        fake.world.advance(fake.world.time + PERIOD)


def truth(fake):
    return fake.world.truth_arrays["arm_position"].copy()


@pytest.mark.parametrize("mode", ["position", "extended", "velocity"])
def test_it_declares_what_the_driver_declares(mode):
    fake, real = make(mode=mode), Dynamixel("bus", config(mode=mode))
    assert (fake.states, fake.commands, fake.max_age) == (real.states, real.commands, real.max_age)
    assert fake.fileno() is None
    limits = fake.limits[fake.commands[0].name]
    assert limits.velocity.shape == (3,)


def test_limits_are_those_of_the_driver_on_the_twin():
    fake = make()
    with Rig(make_twin()) as rig:
        ours, theirs = fake.limits["position_command"], rig.driver.limits["position_command"]
        for name in ("lower", "upper", "velocity"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))


def test_it_moves_as_the_driver_on_the_twin_does():
    fake = make()
    run(fake, 3)
    goal = [0.4, -0.3, 0.006]
    run(fake, 4, [0.0, 0.0, 0.0])
    run(fake, 60, goal)
    with Rig(make_twin()) as rig:
        rig.hold()
        rig.run(60, goal)
        # The twin's goals reach its servos within the cycle they are sent in, like the fake's.
        np.testing.assert_allclose(fake.state_arrays["position"], rig.state["position"], atol=2e-3)
        np.testing.assert_allclose(fake.state_arrays["voltage"], 12.0)
        assert np.abs(fake.state_arrays["position"] - goal).max() < 0.015


def test_a_sample_is_one_exchange_old_and_stamped_so():
    fake = make()
    run(fake, 10)
    fake.read(fake.world.time)
    assert fake.world.time - fake.health.stamp == PERIOD


def test_a_first_command_elsewhere_gets_no_torque():
    fake = make()
    run(fake, 3)
    run(fake, 5, [0.5, 0.0, 0.0])
    assert "shoulder is too far" in fake.health.fault
    np.testing.assert_array_equal(fake.motors.torque, [0, 1, 1])
    fake.recover(fake.world.time)
    assert fake.health.fault == ""


def test_limp_falls_and_hold_holds():
    axes = {"a": {"model": "MX-64", "axis": [0, 1, 0], "mass": 0.8}}
    world = Cell(CellConfig.model_validate({"parts": {"arm": {"part": "dynamixel-chain", "axes": axes}}}), 1)
    motors = {"a": {"model": "MX-64"}}
    fake = make(world, motors)
    fake.read(0)
    world.advance(PERIOD)
    fake.read(world.time)
    run(fake, 50, [0.0])
    held = truth(fake)[0]
    assert 0.005 < held < 0.05  # gravity against a proportional loop
    fake.stop(Stop.HOLD)
    run(fake, 20, [0.0])
    assert truth(fake)[0] == pytest.approx(held, abs=2e-3)
    assert fake.state_arrays["effort"][0] == pytest.approx(-0.3, abs=0.15)
    fake.stop(Stop.LIMP)
    run(fake, 100)
    assert truth(fake)[0] > held + 0.5


def test_overload_recovers_by_a_reboot():
    fake = make()
    run(fake, 3)
    run(fake, 20, [0.0, 0.0, 0.0])
    fake.motors.fail(1, 32)
    run(fake, 3, [0.0, 0.0, 0.0])
    assert fake.health.fault == "elbow: overload"
    fake.recover(fake.world.time)
    assert fake.health.fault
    run(fake, 60)
    assert fake.health.fault == ""
    run(fake, 5, fake.state_arrays["position"].copy())
    np.testing.assert_array_equal(fake.motors.torque, [1, 1, 1])


def test_a_lost_bus_stops_by_its_watchdog_and_comes_back():
    fake = make(mode="velocity", options={"loss": ((0.5, 1.0),)})
    run(fake, 3)
    with pytest.raises(DeviceLostError, match="gone"):
        run(fake, 100, [0.5, 0.5, 0.0])
    fake.close()
    with pytest.raises(DeviceError):
        fake.open()
    fake.world.advance(1_500 * MS)
    assert truth(fake)[0] < 0.45  # 0.5 rad/s for 0.5 s, 0.1 s to the watchdog, and its braking
    fake.open()
    assert fake.health.reconnects == 1
    run(fake, 50)
    a = truth(fake)
    run(fake, 50)
    np.testing.assert_allclose(truth(fake), a, atol=3e-3)


def test_dropouts_are_counted_and_leave_the_last_sample():
    fake = make(options={"dropout": 0.3})
    run(fake, 100)
    assert 10 < fake.health.errors < 60


def test_the_same_seed_gives_the_same_bits_and_another_gives_others():
    def play(seed):
        fake = make(seed=seed, options={"noise": 2.0, "dropout": 0.1})
        run(fake, 5)
        run(fake, 5, [0.0, 0.0, 0.0])
        run(fake, 40, [0.2, 0.1, 0.003])
        return [*fake.state_arrays["position"], fake.health.errors, *truth(fake)]

    assert play(1) == play(1)
    assert play(1) != play(2)


def test_a_restored_world_goes_on_bit_for_bit():
    fake = make()
    run(fake, 5)
    run(fake, 20, [0.05, 0.05, 0.001])
    saved, at = fake.world.save(), fake.world.time
    fake.world.advance(at + 300 * MS)
    first = fake.world.save()
    fake.motors.switch(0, False)
    fake.world.advance(at + 400 * MS)
    fake.world.restore(saved)
    fake.world.advance(at + 300 * MS)
    np.testing.assert_array_equal(fake.world.save(), first)


def test_torque_and_speed_keep_to_the_motor_s_line():
    """In effort mode a free axis speeds up to where the voltage is used up; no current beyond the limit."""
    fake = make(motors={"a": {"model": "MX-64"}}, mode="velocity")
    run(fake, 3)
    run(fake, 30, [20.0])  # beyond its limit
    assert fake.world.truth_arrays["arm_velocity"][0] < 6.6
    run(fake, 2, [-20.0])
    assert np.abs(fake.world.truth_arrays["arm_effort"]).max() <= 6.0 + 1e-6


def test_worlds_that_do_not_fit_are_refused():
    with pytest.raises(WiringError, match="has no axis 'elbow'"):
        make(cell({"shoulder": {"model": "MX-106"}}))
    with pytest.raises(WiringError, match=r"it is an MX-64, devices\.bus says MX-28"):
        make(cell({"a": {"model": "MX-64"}}), {"a": {"model": "MX-28"}})
    with pytest.raises(WiringError, match=r"moves 0\.02 a radian"):
        make(cell({"a": {"model": "MX-28", "m_per_rad": 0.02}}), {"a": {"model": "MX-28", "m_per_rad": 0.01}})
    with pytest.raises(ValueError, match="no axis can be called 'tip'"):
        cell({"tip": {"model": "MX-28"}})
