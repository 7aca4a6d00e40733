"""The simulated Feetech bus behind the driver's contract, and the chain of servos in its world."""

import numpy as np
import pytest
from helpers.dynamixel import MS
from helpers.feetech import TWO, FeetechRig, cell, config, make_twin
from helpers.sim import bind

from srl.drivers.feetech import Feetech
from srl.runtime.contracts.errors import DeviceError, DeviceLostError, WiringError
from srl.runtime.contracts.signals import Stop
from srl.sim.devices.feetech.fake import FakeFeetech
from srl.sim.world.cell import Cell, CellConfig

PERIOD = 10 * MS
SIDEWAYS = {"one": {"model": "STS3215"}}


def make(world=None, motors=TWO, seed=1, options=(), **profile):
    world = world or cell(motors, seed)
    fake = FakeFeetech("bus", config(motors, **profile), world, FakeFeetech.Options(**dict(options)))
    bind(fake)
    fake.open()
    return fake


def run(fake, cycles, command=None):
    for _ in range(cycles):
        fake.read(fake.world.time)
        if command is not None and fake.health.stamp >= 0:
            fake.command_arrays["position_command"][:] = command
            fake.write(fake.world.time)
        fake.world.advance(fake.world.time + PERIOD)


def truth(fake):
    return fake.world.truth_arrays["arm_position"].copy()


def hanging():
    """An axis along y, its link along x: gravity turns it."""
    world = CellConfig.model_validate(
        {
            "parts": {
                "arm": {
                    "part": "feetech-chain",
                    "axes": {"one": {"model": "STS3215", "axis": [0, 1, 0], "link": [0.2, 0, 0], "mass": 0.3}},
                }
            }
        }
    )
    return Cell(world, 1)


@pytest.mark.parametrize("mode", ["position", "extended"])
def test_it_declares_what_the_driver_declares(mode):
    fake, real = make(mode=mode), Feetech("bus", config(mode=mode))
    assert (fake.states, fake.commands, fake.max_age) == (real.states, real.commands, real.max_age)
    assert fake.fileno() is None


def test_limits_are_those_of_the_driver_on_the_twin():
    fake = make()
    with FeetechRig(make_twin()) as rig:
        ours, theirs = fake.limits["position_command"], rig.driver.limits["position_command"]
        for name in ("lower", "upper", "velocity"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))


def test_it_moves_as_the_driver_on_the_twin_does():
    fake, goal = make(), np.array([0.4, -0.3])
    run(fake, 4, [0.0, 0.0])
    run(fake, 100, goal)
    with FeetechRig(make_twin()) as rig:
        rig.hold()
        rig.run(100, goal)
        np.testing.assert_allclose(truth(fake), rig.truth(), atol=0.005)
    np.testing.assert_allclose(truth(fake), goal, atol=0.02)


def test_a_first_command_elsewhere_gets_no_torque():
    fake = make()
    run(fake, 3)
    run(fake, 3, [0.5, 0.0])
    assert "shoulder is too far" in fake.health.fault
    assert fake.motors.torque.tolist() == [0.0, 1.0]


@pytest.mark.slow
def test_limp_falls_and_hold_holds():
    fake = make(hanging(), SIDEWAYS)
    run(fake, 3)
    run(fake, 50, [0.0])
    held = truth(fake)[0]
    fake.stop(Stop.HOLD)
    run(fake, 100)
    assert truth(fake)[0] == pytest.approx(held, abs=0.01)
    fake.stop(Stop.LIMP)
    run(fake, 300)
    assert abs(truth(fake)[0] - held) > 0.5


def test_an_overload_weakens_it_and_recovery_ends_that():
    fake = make(hanging(), SIDEWAYS)
    run(fake, 3)
    run(fake, 50, [0.0])
    fake.motors.fail(0, 32)
    run(fake, 2, [0.0])
    assert "one: overload" in fake.health.fault
    assert fake.motors.torque[0]
    fake.recover(fake.world.time)
    run(fake, 3)
    assert fake.health.fault == ""
    assert not fake.motors.torque[0]


def test_a_lost_bus_goes_on_to_its_last_goal_and_comes_back():
    fake = make(options={"loss": [[0.5, 2.0]]})
    run(fake, 5, [0.0, 0.0])
    with pytest.raises(DeviceLostError):
        run(fake, 60, [0.3, 0.0])
    for _ in range(100):
        fake.world.advance(fake.world.time + PERIOD)
    assert truth(fake)[0] == pytest.approx(0.3, abs=0.02)  # it has no watchdog
    with pytest.raises(DeviceError):
        fake.open()
    fake.world.advance(2_100 * MS)
    fake.open()
    run(fake, 5)
    assert fake.health.reconnects == 1


def test_the_same_seed_gives_the_same_bits_and_another_gives_others():
    def seen(seed):
        fake = make(seed=seed, options={"noise": 1.5, "dropout": 0.2})
        run(fake, 40, [0.0, 0.0])
        return fake.state_arrays["position"].copy(), fake.health.errors

    (a, lost), (b, _), (c, _) = seen(1), seen(1), seen(2)
    np.testing.assert_array_equal(a, b)
    assert lost > 0
    assert not np.array_equal(a, c)


def test_a_restored_world_goes_on_bit_for_bit():
    fake = make()
    run(fake, 20, [0.2, 0.1])
    state = fake.world.save()
    fake.world.advance(fake.world.time + 30 * PERIOD)
    first = truth(fake)
    fake.world.restore(state)
    fake.world.advance(fake.world.time + 30 * PERIOD)
    np.testing.assert_array_equal(truth(fake), first)


def test_worlds_that_do_not_fit_are_refused():
    with pytest.raises(WiringError, match="FeetechChain"):
        make(Cell(CellConfig.model_validate({"parts": {"a": {"part": "box", "size": [0.1, 0.1, 0.1]}}}), 1))
    with pytest.raises(WiringError, match="STS3250"):
        make(cell({"shoulder": {"model": "STS3215"}, "elbow": {"model": "STS3215"}}))
    with pytest.raises(WiringError, match="no axis 'elbow'"):
        make(cell({"shoulder": {"model": "STS3250"}}))
