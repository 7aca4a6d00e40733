"""The UR driver against the twin, in lockstep: the control program runs in the twin's URScript."""

import os
from fractions import Fraction

import numpy as np
import pytest
from helpers.ur import Rig, advance, make_fake, speed

from srl.drivers.ur import registers
from srl.drivers.ur.registers import ScriptState
from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.contracts.signals import Stop
from srl.runtime.loop.clock import DeviceClock

V = np.array([0.3, -0.2, 0.2, 0.1, -0.1, 0.5])


@pytest.fixture
def rig():
    with Rig() as rig:
        yield rig


# -- states


def test_states_are_the_arms_at_one_instant(rig):
    driver = rig.open()
    rig.follow(V, 150)
    values = rig.fake.sample(rig.fake.newest())
    arrays = driver.state_arrays
    for name, part in (("position", slice(0, 6)), ("velocity", slice(6, 12)), ("effort", slice(12, 18))):
        np.testing.assert_array_equal(arrays[name], values[part])
    np.testing.assert_array_equal(arrays["wrench"], values[24:30])
    turn, at = rig.fake.controller.arm.flange()
    w, x, y, z = arrays["pose"][3:]
    np.testing.assert_allclose(arrays["pose"][:3], at, atol=2e-3)  # the sample is from before the last step
    np.testing.assert_allclose(
        turn[:, 2], [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], atol=5e-3
    )
    assert arrays["speed_scaling"][0] == 1.0


def test_measured_torques_come_from_a_newer_controller():
    with Rig({"effort": "measured"}) as rig:
        rig.twin.dashboard.polyscope, rig.twin.rtde.version = "URSoftware 5.23.0.1", (5, 23, 0, 1)
        driver = rig.open()
        rig.cycle()
        np.testing.assert_array_equal(driver.state_arrays["effort"], rig.fake.sample(rig.fake.newest())[18:24])


def test_buttons_are_digital_inputs():
    with Rig({"buttons": {"go": 0, "tool": 17}}) as rig:
        driver = rig.open()
        rig.fake.controller.inputs = 1 << 0 | 1 << 5
        rig.fake._events = lambda at: None
        rig.cycle()
        rig.cycle()
        assert driver.state_arrays["buttons"].tolist() == [1, 0]


def test_a_backlog_is_drained_to_its_newest_sample_with_its_own_stamp(rig):
    driver = rig.open()
    for _ in range(20):
        rig.cycle()
    stamp, frames = driver.health.stamp, driver.health.frames
    rig.bench.run(0.1)
    late = rig.now
    rig.bench.world.advance(rig.now)
    while driver.health.frames < frames + 50:
        driver.read(late + 40_000_000)  # the loop comes 40 ms late
    assert driver.health.frames == frames + 50
    assert driver.health.stamp == pytest.approx(stamp + 100_000_000, abs=1_000_000)


def test_a_controller_that_falls_silent_is_lost(rig):
    driver = rig.open()
    rig.cycle()
    driver.read(rig.now + 1_900_000_000)
    with pytest.raises(DeviceLostError, match="sends no data"):
        driver.read(rig.now + 2_100_000_000)
    assert not driver.health.connected


def test_the_loop_can_wait_on_the_arms_tick(rig):
    driver = rig.open()
    clock = DeviceClock(Fraction(500), driver.fileno)
    with rig.bench.running():
        clock.start()
        for _ in range(100):
            driver.read(clock.wait().now)
    assert clock.silent < 100
    assert driver.health.frames > 20


# -- commands


def test_every_cycles_command_is_taken_in_the_next_cycle(rig):
    driver = rig.open()
    rig.follow(V, 300)
    np.testing.assert_allclose(driver.state_arrays["velocity"], V, atol=2e-3)
    assert driver.metrics()["held_back"] == 0
    assert driver.health.unsent == registers.SIZE  # the newest is on its way
    rig.cycle()
    assert driver.health.unsent == 0
    assert rig.twin.errors == []


@pytest.mark.parametrize("interface", ["velocity", "position"])
def test_both_doors_of_the_arm_give_the_same_motion(interface):
    fake = make_fake({"interface": interface})
    fake.open()
    advance(fake, 10)
    home = fake.controller.arm.position
    rng = np.random.default_rng(3)
    goals = np.repeat(rng.normal(0, 0.02 if interface == "position" else 0.3, (20, 6)), 10, axis=0)
    goals += home if interface == "position" else 0.0
    one, two = [], []
    for goal in goals:
        fake.command_arrays[f"{interface}_command"][:] = goal
        advance(fake, 1, lambda: fake.write(fake.world.time))
        one.append(fake.state_arrays["position"].copy())
    with Rig({"interface": interface}) as rig:
        rig.open()
        for goal in goals:
            rig.follow(goal, 1)
            two.append(rig.driver.state_arrays["position"].copy())
    np.testing.assert_allclose(two, one, atol=1e-6)


def test_silence_stops_the_arm_and_a_reset_starts_it_again(rig):
    driver = rig.open()
    rig.follow(V, 200)
    for _ in range(24):
        rig.cycle()
    assert driver.health.fault == ""
    rig.until(lambda: driver.health.fault)
    assert driver.health.fault == "the arm stopped itself: no command came for 0.05 s"
    rig.until(lambda: speed(rig.fake) < 0.005)
    where = rig.fake.controller.arm.position
    rig.follow(V, 50)
    np.testing.assert_allclose(rig.fake.controller.arm.position, where, atol=1e-3)
    driver.recover(rig.now)
    rig.until(lambda: not driver.health.fault)
    assert driver.health.reconnects == 0
    rig.follow(V, 200)
    assert speed(rig.fake) > 0.3


def test_a_stalled_controller_holds_no_more_than_two_commands(rig):
    driver = rig.open()
    rig.follow(V, 100)
    sent = rig.twin.rtde.seen["U"]
    for _ in range(500):  # the loop goes on, the controller doesn't
        driver.read(rig.now)
        driver.write(rig.now)
    assert driver.health.unsent == registers.SIZE
    assert driver.metrics()["held_back"] >= 498
    rig.bench.run(0.02)
    assert rig.twin.rtde.seen["U"] - sent <= 2


def test_commands_from_before_a_stall_move_nothing_after_it(rig):
    driver = rig.open()
    rig.follow(V, 200)
    rig.twin.muted = True
    for _ in range(500):  # a second
        rig.bench.run(0.002)
        driver.read(rig.now)
        driver.write(rig.now)
    assert speed(rig.fake) < 0.005
    rig.twin.muted = False
    where = rig.fake.controller.arm.position
    for _ in range(100):
        rig.cycle(write=True)
    np.testing.assert_allclose(rig.fake.controller.arm.position, where, atol=1e-3)
    assert "no command came" in driver.health.fault


def test_a_command_that_isnt_finite_is_not_sent(rig):
    rig.open()
    rig.follow(V, 50)
    sent = rig.twin.rtde.seen["U"]
    rig.follow([0.1, np.nan, 0, 0, 0, 0], 5)
    assert rig.twin.rtde.seen["U"] == sent


def test_stop_ramps_down_and_holds(rig):
    driver = rig.open()
    rig.follow(V, 200)
    driver.stop(Stop.HOLD)
    driver.stop(Stop.BRAKE)  # it leaves with the next read, if the command before it is still on its way
    rig.until(lambda: speed(rig.fake) < 0.005, cycles=200)
    for _ in range(10):
        rig.cycle()
    assert driver.health.fault == ""
    assert rig.twin.registers.outputs.ints[registers.STATE] == ScriptState.READY
    rig.follow(V, 200)
    assert speed(rig.fake) > 0.3


def test_the_stop_frame_stops_the_arm_from_another_process(rig):
    driver = rig.open()
    rig.follow(V, 200)
    frames = driver.stop_frames(Stop.HOLD)
    assert frames is driver.stop_frames(Stop.BRAKE)
    copy = os.dup(driver.fileno())
    os.write(copy, *frames)
    os.close(copy)
    rig.settle()
    rig.bench.run(0.15)
    assert speed(rig.fake) < 0.05
    assert rig.twin.registers.outputs.ints[registers.STATE] == ScriptState.READY  # sooner than by its time-out


def test_a_stop_frame_behind_half_a_command_ends_the_connection_and_the_arm_stops(rig):
    driver = rig.open()
    rig.follow(V, 200)
    os.write(driver.fileno(), registers.command(1, 5, 1, 9, 25, V.tolist())[:30])
    os.write(driver.fileno(), *driver.stop_frames(Stop.HOLD))
    rig.bench.run(0.3)
    assert speed(rig.fake) < 0.005


@pytest.mark.slow
def test_waiting_costs_a_sign_of_life_a_second_and_the_program_stays(rig):
    driver = rig.open()
    before = rig.twin.rtde.seen["U"]
    for _ in range(1750):
        rig.cycle()
    assert 2 <= rig.twin.rtde.seen["U"] - before <= 4
    assert driver.health.fault == ""


def test_close_ends_the_program(rig):
    driver = rig.open()
    rig.follow(V, 100)
    driver.close()
    rig.bench.run(0.4)
    assert rig.twin.controller.program is None
    assert rig.twin.registers.outputs.ints[registers.STATE] == ScriptState.ENDED
    assert speed(rig.fake) < 0.005
    driver.close()
