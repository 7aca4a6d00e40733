"""The Feetech driver on its twin: goals, torque, stops, faults and their end."""

import numpy as np
import pytest
from helpers.feetech import TWO, FeetechRig, cell, make_twin

from srl.drivers.feetech import protocol
from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.contracts.signals import Stop


def test_it_measures_and_moves():
    with FeetechRig(make_twin()) as rig:
        where = rig.hold()
        assert rig.torque == [True, True]
        wanted = where + np.array([0.3, -0.2])
        for k in range(60):
            rig.cycle(where + (wanted - where) * min(1.0, (k + 1) / 40))
        rig.run(60, wanted)
        np.testing.assert_allclose(rig.state["position"], wanted, atol=0.01)
        np.testing.assert_allclose(rig.truth(), wanted, atol=0.01)
        assert rig.state["voltage"] == pytest.approx([12.0, 12.0])
        assert rig.state["temperature"] == pytest.approx([25, 25], abs=3)
        assert rig.driver.health.errors == 0
        assert rig.fault == ""


def test_reversed_and_displaced_axes_are_measured_where_they_are():
    motors = {"one": {"model": "STS3215", "reversed": True, "zero": 0.4}, "two": {"model": "STS3215", "offset": -85}}
    with FeetechRig(make_twin(motors)) as rig:
        rig.start()
        assert rig.state["position"][0] == pytest.approx(rig.truth()[0], abs=0.002)
        assert rig.state["position"][1] == pytest.approx(rig.truth()[1], abs=0.002)


def test_the_goal_is_stored_and_read_back_before_the_torque():
    twin = make_twin()
    for servo in twin.servos:
        servo.put("goal_position", 3900)  # an old one, far away
    with FeetechRig(twin) as rig:
        rig.start()
        where = rig.state["position"].copy()
        order = []
        for servo in twin.servos:
            effect = servo.take_effect

            def noted(name, effect=effect, servo=servo):
                order.append((servo.get("id"), name, servo.get("goal_position")))
                effect(name)

            servo.take_effect = noted
        while not order:
            rig.cycle(where)
        assert {name for _, name, _ in order} == {"goal_position"}
        assert not any(rig.torque)
        rig.run(5, where)
        on = [(id, goal) for id, name, goal in order if name == "torque_enable"]
        assert sorted(id for id, _ in on) == [1, 2]
        assert all(abs(goal - 2048) < 3 for _, goal in on)
        rig.run(20, where)
        np.testing.assert_allclose(rig.truth(), where, atol=0.01)


def test_without_the_goal_there_is_no_torque():
    """A servo that doesn't take its goal keeps an old one: with torque it would drive there."""
    twin = make_twin()
    twin.servos[0].put("goal_position", 3900)
    write = twin.servos[0].write
    twin.servos[0].write = lambda address, data: None if address == 42 else write(address, data)
    with FeetechRig(twin) as rig:
        rig.hold(30)
        assert rig.torque == [False, True]
        assert rig.goals[0] == 3900


def test_a_first_command_that_is_far_gives_no_torque():
    with FeetechRig(make_twin()) as rig:
        rig.start()
        rig.run(5, rig.state["position"] + np.array([0.5, 0.0]))
        assert rig.torque == [False, True]
        assert "shoulder is too far" in rig.fault
        rig.driver.recover(rig.now)
        rig.run(6, "here")
        assert rig.fault == ""
        assert rig.torque == [True, True]


def test_nothing_but_numbers_reaches_the_servos():
    with FeetechRig(make_twin()) as rig:
        where = rig.hold()
        goals = rig.goals
        rig.run(3, [np.nan, np.inf])
        assert rig.goals == goals
        rig.run(
            3, where + np.array([1e9, -1e9])
        )  # the guard never lets this pass; the driver keeps to the servos' limits
        assert rig.goals == [4095, 0]


def test_limp_is_told_until_it_is_seen():
    with FeetechRig(make_twin()) as rig:
        rig.hold()
        lost = []
        write = rig.twin.servos[1].write

        def deaf_once(address, data):
            if address == 40 and not lost:
                lost.append(data)
            else:
                write(address, data)

        rig.twin.servos[1].write = deaf_once
        rig.driver.stop(Stop.LIMP)
        rig.run(30)
        assert lost
        assert rig.torque == [False, False]


def test_the_end_leaves_the_last_goals():
    with FeetechRig(make_twin()) as rig:
        rig.hold()
        goals = rig.goals
        rig.driver.stop(Stop.HOLD)
        rig.driver.close()
        rig.bench.run(1.0)
        assert rig.goals == goals
        assert rig.torque == [True, True]


@pytest.mark.parametrize("category", [Stop.HOLD, Stop.LIMP, Stop.RETRACT])
def test_the_stop_frame_works_behind_a_cut_packet(category):
    with FeetechRig(make_twin()) as rig:
        where = rig.hold()
        rig.run(3, where + 0.01)
        goals, frames = rig.goals, rig.driver.stop_frames(category)
        assert frames is rig.driver.stop_frames(category)
        (frame,) = frames
        cut = protocol.sync_write(42, 2, {1: b"\x00\x0f", 2: b"\x00\x0f"})
        for at in range(len(cut)):
            rig.twin.receive(cut[:at] + frame, rig.now)
            assert rig.goals == goals, at
        assert rig.torque == [category is not Stop.LIMP] * 2


def test_before_the_first_goal_the_stop_frame_of_a_hold_is_empty():
    with FeetechRig(make_twin()) as rig:
        assert rig.driver.stop_frames(Stop.HOLD) == ()
        assert rig.driver.stop_frames(Stop.LIMP)


def test_an_overload_is_told_its_data_taken_and_reset_offers_a_way_back():
    with FeetechRig(make_twin()) as rig:
        where = rig.hold()
        motors = rig.twin.bus.chain.motors
        motors.fail(1, 32)
        rig.run(3, where)
        assert rig.fault == "elbow: overload: it now pushes with its protective torque only"
        stamp = rig.driver.health.stamp
        rig.run(3, where)
        assert rig.driver.health.stamp > stamp  # its error bit doesn't hide its data
        assert motors.pwm_cap[1] == pytest.approx(0.2)
        rig.driver.recover(rig.now)
        rig.run(3)
        assert rig.fault == ""
        assert rig.torque == [True, False]
        rig.run(6, "here")
        assert rig.torque == [True, True]
        assert motors.pwm_cap[1] == 1.0


def test_an_overload_that_stays_is_told_again():
    with FeetechRig(make_twin()) as rig:
        rig.hold()
        rig.twin.bus.chain.motors.errors[1] = 2  # the angle sensor: torque off doesn't end it
        rig.run(3)
        rig.driver.recover(rig.now)
        rig.run(5)
        assert rig.fault == "elbow: angle sensor"


@pytest.mark.slow
def test_real_overload_by_an_obstacle():
    """Physics: an axis at its end stop, pushed on, weakens after its protection time."""
    with FeetechRig(make_twin(world=cell(TWO))) as rig:
        where = rig.hold()
        chain = rig.twin.bus.chain
        chain._model.jnt_range[1] = (-0.05, 0.05)
        for k in range(100):
            rig.cycle(where + np.array([0.0, min(0.6, 0.02 * k)]))
        for _ in range(200):
            if rig.fault:
                break
            rig.cycle(where + np.array([0.0, 0.6]))
        assert "elbow: overload" in rig.fault


def test_a_hot_servo_is_told_before_and_stops_the_limb():
    with FeetechRig(make_twin()) as rig:
        where = rig.hold()
        motors = rig.twin.bus.chain.motors
        motors.temperature_limit[:] = 1e9  # its own protection is off, as in some
        motors.temperature[1] = 67
        rig.run(3, where)
        assert "elbow is at 67 degC (limit 70)" in rig.driver.health.message
        assert rig.fault == ""
        motors.temperature[1] = 73
        rig.run(3, where)
        assert rig.fault == ""  # one sample isn't enough
        for _ in range(40):
            motors.temperature[1] = 73
            rig.cycle(where)
        assert "elbow is at 73 degC, its limit is 70" in rig.fault
        assert rig.torque == [True, True]  # a hanging limb isn't dropped by this
        motors.temperature[1] = 50
        rig.driver.recover(rig.now)
        rig.run(5, where)
        assert rig.fault == ""


def test_a_low_supply_is_told():
    with FeetechRig(make_twin()) as rig:
        where = rig.hold()
        rig.twin.bus.chain.motors.voltage[:] = 3.5
        rig.run(45, where)
        assert "has 3.5 V, its limits are 4.0 to 14.0 V" in rig.fault


def test_a_servo_that_falls_silent_among_several():
    with FeetechRig(make_twin()) as rig:
        where = rig.hold()
        rig.twin.absent.add(2)
        with pytest.raises(DeviceLostError, match=r"'elbow' \(id 2\) hasn't answered for a second, others have"):
            rig.run(150, where)
        rig.twin.absent.clear()
        rig.open()
        rig.run(10, where)
        assert rig.torque == [True, True]


def test_a_cable_that_is_pulled():
    with FeetechRig(make_twin()) as rig:
        where = rig.hold()
        rig.twin.close()
        with pytest.raises(DeviceLostError):
            rig.driver.read(rig.now)
        assert not rig.driver.health.connected
        rig.driver.stop(Stop.LIMP)
        rig.driver.close()
        rig.bench.run(0.3)
        np.testing.assert_allclose(rig.truth(), where, atol=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("wakes_on", [False, True])
def test_a_dip_of_the_supply_over_several_turns_is_no_jump(wakes_on):
    """The servo forgets two turns. Its goal is two turns away now: it must not drive there."""
    twin = make_twin({"drum": {"model": "STS3215"}}, mode="extended")
    servo = twin.servos[0]
    servo.wakes_on = wakes_on
    with FeetechRig(twin) as rig:
        rig.start()
        here = 0.0
        where = rig.hold()
        while here < 4.2 * np.pi:
            here += 0.03
            rig.cycle(where + here)
        rig.run(30, where + here)
        before = rig.truth()[0]
        assert before > 4 * np.pi
        twin.brown_out(servo)
        rig.run(60, where + here)
        assert "drum" in rig.fault
        assert ("jumped by -2 turns" in rig.fault) or ("lost its torque" in rig.fault)
        assert rig.torque == [False]
        assert rig.truth()[0] == pytest.approx(before, abs=0.05)
        assert rig.state["position"][0] == pytest.approx(before, abs=0.05)  # turns are restored
        rig.driver.recover(rig.now)
        rig.run(20, "here")
        assert (rig.fault, rig.torque) == ("", [True])
        rig.run(60, rig.state["position"].copy())
        assert rig.truth()[0] == pytest.approx(before, abs=0.06)


def test_an_encoder_that_passes_its_end_with_torque_on_doesn_t_turn_back_all_the_way():
    twin = make_twin({"one": {"model": "STS3215"}})
    chain = twin.bus.chain
    chain._data.qpos[chain._q] = np.pi - 0.02
    with FeetechRig(twin) as rig:
        where = rig.hold()
        assert rig.torque == [True]
        chain._data.qpos[chain._q] = np.pi + 0.03  # something pushes it over
        rig.run(2, where)
        assert "jumped by -1 turn " in rig.fault
        rig.run(40, where)
        assert rig.torque == [False]
        assert abs(rig.truth()[0] - np.pi) < 0.8


def test_another_program_switches_the_torque_off():
    with FeetechRig(make_twin()) as rig:
        where = rig.hold()
        rig.twin.servos[0].write(40, b"\0")
        rig.run(30, where)
        assert "shoulder lost its torque" in rig.fault
        rig.driver.recover(rig.now)
        rig.run(6, "here")
        assert rig.torque == [True, True]


def test_garbage_on_the_line_does_no_harm():
    with FeetechRig(make_twin()) as rig:
        where = rig.hold()
        rig.twin.corrupt = 7
        rig.run(60, where)
        assert rig.driver.health.errors > 0
        assert rig.fault == ""
        assert rig.torque == [True, True]
        np.testing.assert_allclose(rig.truth(), where, atol=0.01)


def test_a_stop_frame_never_repeats_a_goal_from_before_a_jump():
    twin = make_twin({"one": {"model": "STS3215"}, "two": {"model": "STS3215"}})
    chain = twin.bus.chain
    chain._data.qpos[chain._q[0]] = np.pi - 0.02
    with FeetechRig(twin) as rig:
        where = rig.hold()
        assert b"\x01" + int(rig.goals[0]).to_bytes(2, "little") in rig.driver.stop_frames(Stop.HOLD)[0]
        chain._data.qpos[chain._q[0]] = np.pi + 0.03
        while not rig.fault:
            rig.driver.read(rig.now)
            rig.bench.run(0.01)
        (frame,) = rig.driver.stop_frames(Stop.HOLD)
        end = protocol.sync_write(42, 2, {2: int(rig.goals[1]).to_bytes(2, "little")})
        assert frame.endswith(end + end)
        rig.run(3, where)
        assert rig.torque == [False, True]


@pytest.mark.slow
def test_turns_that_are_lost_while_the_bus_is_gone_are_taken_up():
    twin = make_twin({"drum": {"model": "STS3215"}}, mode="extended")
    with FeetechRig(twin) as rig:
        where, here = rig.hold(), 0.0
        while here < 2.3 * np.pi:
            here += 0.03
            rig.cycle(where + here)
        rig.run(30, where + here)
        before = rig.truth()[0]
        rig.driver.close()
        twin.servos[0].restart()
        rig.open()
        rig.run(10, "here")
        assert rig.state["position"][0] == pytest.approx(before, abs=0.02)
        rig.run(40, rig.state["position"].copy())
        assert rig.truth()[0] == pytest.approx(before, abs=0.03)
        assert rig.torque == [True]


def test_a_limb_that_was_limp_starts_again_where_it_is():
    with FeetechRig(make_twin()) as rig:
        rig.hold()
        rig.driver.stop(Stop.LIMP)
        rig.run(5)
        chain = rig.twin.bus.chain
        chain._data.qpos[chain._q] = [0.7, -0.6]  # it has sunk
        rig.run(5)
        where = rig.hold(10)
        assert where == pytest.approx([0.7, -0.6], abs=0.01)
        assert rig.torque == [True, True]
        rig.run(30, where)
        np.testing.assert_allclose(rig.truth(), where, atol=0.01)
