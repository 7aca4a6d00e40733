"""The UR driver against the twin, in lockstep: the control program runs in the twin's URScript."""

import os
import socket
import threading
from fractions import Fraction

import numpy as np
import pytest
from helpers.ur import Rig, advance, make_fake, speed

from drivers.ur import Ur, UrConfig, registers
from drivers.ur.registers import ScriptState
from drivers.ur.status import RobotMode
from runtime.contracts.errors import DeviceError, DeviceLostError
from runtime.contracts.signals import Stop
from runtime.contracts.wearer import Lead
from runtime.loop.clock import DeviceClock
from sim.parts.robots.arm import ArmPart

V = np.array([0.3, -0.2, 0.2, 0.1, -0.1, 0.5])


@pytest.fixture
def rig():
    with Rig() as rig:
        yield rig


def refused(words, config=None, prepare=lambda twin: None, **options):
    """Opening must fail with these words, and leave nothing open."""
    with Rig(config, **options) as rig:
        prepare(rig.twin)
        with pytest.raises(DeviceError, match=words) as caught:
            rig.open()
        assert rig.driver.fileno() is None
        assert not rig.driver.health.connected
        assert caught.value.remedy
        rig.driver.close()


# -- opening


def test_open_says_who_the_arm_is_and_moves_nothing(rig):
    before = rig.fake.controller.arm.position
    driver = rig.open()
    assert driver.figures()["identity"] == "UR16 20195500001, PolyScope 5.11.0"
    assert driver.health.connected
    assert driver.health.fault == ""
    for _ in range(200):
        rig.cycle()
    np.testing.assert_allclose(rig.fake.controller.arm.position, before, atol=1e-4)
    assert driver.health.fault == ""


def test_an_arm_that_is_only_read_gets_nothing_and_may_be_in_local_control():
    with Rig({"interface": "none", "payload": 2.0, "power_on": True}, start="power-off") as rig:
        rig.twin.dashboard.remote = False
        driver = rig.open()
        assert driver.commands == ()
        controller, stamp = rig.fake.controller, driver.health.stamp
        for _ in range(5):
            rig.cycle()
        assert "POWER_OFF): switch the arm on" in driver.health.message
        assert driver.health.stamp == stamp  # nobody measures these angles
        controller.robot_mode = RobotMode.RUNNING  # by the pendant
        for count in range(30):
            if count == 20:
                controller.protective_stop("a hand")
            rig.cycle()
            driver.write(rig.now)
            driver.stop(Stop.HOLD)
            driver.recover(rig.now)
            assert driver.health.fault == ""
        assert "protective stop" in driver.health.message
        assert driver.health.stamp > stamp
        np.testing.assert_allclose(driver.state_arrays["position"], controller.arm.position, atol=1e-9)
        assert driver.stop_frames(Stop.HOLD) == ()
        with rig.bench.running():
            driver.close()
        assert set(rig.twin.dashboard.seen) <= {"PolyscopeVersion", "get robot model", "get serial number", "quit"}
        assert (rig.twin.programs, rig.twin.errors, set(rig.twin.rtde.seen)) == ([], [], {"V", "v", "O", "S"})


def test_a_simulated_arm_that_a_person_leads_is_read_on_the_way():
    fake = make_fake({"interface": "none"}, {"arm": {"part": "ur16e", "guided": True}})
    fake.open()
    wearer, at = fake.cell.part(ArmPart, "arm", None).wearer, []
    wearer.instruct(Lead(1))
    advance(fake, 1600, lambda: at.append(fake.state_arrays["position"].copy()))
    assert wearer.done
    assert np.abs(at[-1] - at[0]).max() > 0.1
    np.testing.assert_allclose(at[-1], wearer.at(fake.world.time * 1e-9), atol=0.01)
    assert (fake.controller.stops, fake.health.fault) == ([], "")
    fake.write(fake.world.time)  # nothing to write
    fake.controller.power_off()
    advance(fake, 1)
    stamp = fake.health.stamp
    advance(fake, 3)
    assert fake.health.stamp == stamp
    assert "POWER_OFF" in fake.health.message


def test_a_cb3_is_refused():
    def old(twin):
        twin.dashboard.polyscope = "URSoftware 3.15.4.106291 (Nov 16 2020)"

    refused("not to a CB3", prepare=old)


def test_an_rtde_of_another_series_is_refused():
    refused("speaks to the e-Series", prepare=lambda twin: setattr(twin.rtde, "version", (3, 15, 4, 0)))


def test_a_name_that_nobody_has_is_refused():
    with pytest.raises(DeviceError, match="no host is called"):
        Ur("arm", UrConfig(port="tcp://no-such-arm.invalid")).open()


def test_local_control_is_refused():
    refused("local control", prepare=lambda twin: setattr(twin.dashboard, "remote", False))


def test_another_model_is_refused():
    refused("is a UR10, the profile says UR16e", prepare=lambda twin: setattr(twin.dashboard, "model", "UR10"))


def test_another_arm_is_refused():
    refused("serial number is 20195500001, the profile says 42", {"serial": "42"})


def test_an_arm_without_power_is_refused():
    refused("robot mode POWER_OFF", start="power-off")


def test_measured_torques_need_a_newer_controller():
    refused("doesn't give measured torques", {"effort": "measured"})


def test_a_program_of_others_is_not_replaced():
    class Other:
        name = "pick_and_place"

        def cycle(self):
            return True

    refused("another program runs", prepare=lambda twin: twin.controller.run(Other()))


def test_two_drivers_of_one_arm_are_one_too_many(rig):
    rig.open()
    second = rig.another()
    with rig.bench.running(), pytest.raises(DeviceError, match="another client holds the arm's inputs"):
        second.open()
    second.close()
    rig.follow(V, 100)
    assert speed(rig.fake) > 0.3


def test_a_program_that_a_killed_driver_left_waiting_is_ended(rig):
    rig.open()
    rig.driver._link.close()
    rig.bench.run(0.01)
    assert rig.twin.controller.program is not None
    rig.driver = rig.another()
    rig.open()
    assert rig.twin.programs == ["srl_control"] * 2
    rig.follow(V, 100)
    assert speed(rig.fake) > 0.3


def test_nobody_there_is_refused_with_a_remedy():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    driver = Ur("arm", UrConfig(port=f"tcp://127.0.0.1:{port}?dashboard={port}&script={port}"))
    with pytest.raises(DeviceError, match=r"dashboard .* can't be reached"):
        driver.open()


def test_another_service_at_the_dashboards_port_is_refused():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]

        def greet():
            link, _ = server.accept()
            link.sendall(b"SSH-2.0-OpenSSH_9.2\r\n")

        thread = threading.Thread(target=greet)
        thread.start()
        driver = Ur("arm", UrConfig(port=f"tcp://127.0.0.1?dashboard={port}"))
        with pytest.raises(DeviceError, match=r"expected the greeting .* got 'SSH"):
            driver.open()
        thread.join()


def test_power_on_brings_the_arm_up():
    with Rig({"power_on": True}, start="power-off") as rig:
        rig.open()
        assert rig.fake.controller.robot_mode is RobotMode.RUNNING
        assert {"power on", "brake release"} <= set(rig.twin.dashboard.seen)
        rig.follow(V, 100)
        assert speed(rig.fake) > 0.3


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
    assert driver.figures()["held_back"] == 0
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
    assert driver.figures()["held_back"] >= 498
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
