"""MIT-mode actuators behind the driver's contract: starting, stopping, and every fault from its onset to safety."""

from __future__ import annotations

import re

import can
import numpy as np
import pytest
from helpers.mit_can import AK, ONE, PERIOD, TWO, Limb, cell

from srl.drivers.mit_can import MitCan, protocol
from srl.drivers.mit_can.protocol import Register
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Kind, Stop

MS = 1e-3


def stops(category: Stop, **options: object) -> Limb:
    """A limb that has held itself, and then stopped so for 0.3 s."""
    limb = Limb(**options).open()  # type: ignore[arg-type]
    where = limb.hold()
    if category is Stop.HOLD:
        limb.run(0.5, where)
    else:
        limb.run(0.3, stop=category)
    return limb


# -- starting


@pytest.mark.parametrize(("motors", "maker"), [(TWO, "damiao"), (AK, "v2"), (AK, "v3")])
def test_a_start_moves_nothing_but_by_its_weight(motors: dict, maker: str) -> None:  # type: ignore[type-arg]
    limb = Limb(motors, maker, cell(motors, hanging=False, start=0.1)).open()
    moved: list[float] = []
    limb.run(1.0, limb.state("position"), look=lambda: moved.append(float(np.abs(limb.truth() - 0.1).max())))
    assert not limb.fault
    assert all(limb.on)
    assert max(moved) < 2e-3


def test_nothing_is_enabled_by_opening_a_damiao() -> None:
    limb = Limb().open()
    limb.run(0.2)
    assert not any(limb.on)
    assert set(limb.drives.seen) == {"state", "read", "write"}


def test_its_watchdog_is_armed_at_open_and_its_other_registers_left_alone() -> None:
    limb = Limb(watchdog=0.3)
    limb.drives.registers[0][Register.CTRL_MODE] = 2
    limb.open()
    for registers in limb.drives.registers:
        assert registers[Register.TIMEOUT] * protocol.TICK == pytest.approx(0.3)
        assert registers[Register.CTRL_MODE] == protocol.MIT
    assert limb.drives.seen["write"] == 3


def test_it_follows_within_what_its_stiffness_leaves() -> None:
    limb = Limb(world=cell(hanging=False)).open()
    where = limb.hold(0.6)
    limb.run(1.0, lambda t: where + 0.5 * t)
    assert limb.state("position") == pytest.approx(where + 0.5, abs=0.02)
    assert limb.truth() == pytest.approx(limb.state("position"), abs=1e-2)
    assert limb.fake.sent_arrays[limb.name] == pytest.approx(where + 0.5, abs=2e-3)


def test_a_command_far_away_enables_nothing() -> None:
    limb = Limb().open()
    started = limb.state("position")
    limb.run(0.1, started + np.array([0.0, 0.5]))
    assert limb.on == [True, False]
    assert re.search(r"^'elbow' \(id 2\) is 0\.\d\d from its first command, too far", limb.fault)
    sent = limb.fake.sent_arrays[limb.name]
    assert sent[0] == started[0]
    assert np.isnan(sent[1])


def test_a_command_beyond_the_travel_stays_inside() -> None:
    limb = Limb(ONE, world=cell(ONE, hanging=False, start=1.9)).open()
    where = limb.hold(0.6)
    limb.run(1.0, lambda t: where + t)
    assert limb.truth()[0] < 2.02
    assert limb.fake.sent_arrays[limb.name][0] == 2.0


def test_velocity_and_torque_are_the_joint_s() -> None:
    turned = {"elbow": ONE["elbow"] | {"reversed": True, "zero": 0.3}}
    limb = Limb(turned, world=cell(turned, hanging=False), interface="velocity").open()
    assert limb.fake.commands[0].kind is Kind.VELOCITY
    limb.run(0.5, [0.4])
    assert limb.truth("velocity")[0] == pytest.approx(0.4, abs=0.25)  # friction, against kd alone
    assert limb.state("velocity")[0] == pytest.approx(limb.truth("velocity")[0], abs=0.02)
    limb = Limb(turned, world=cell(turned, hanging=False), interface="torque").open()
    limb.run(0.1, [2.0])
    assert limb.truth("velocity")[0] > 0.1
    assert limb.state("effort")[0] == pytest.approx(2.0 - 2 * limb.truth("velocity")[0], abs=0.1)


# -- stops


def test_damping_alone_lets_a_limb_sink_at_torque_over_damping() -> None:
    limb = stops(Stop.DAMP, motors=ONE, world=cell(ONE))
    torque = (0.4 * 0.125) * 9.81 * np.cos(limb.truth()[0])
    assert limb.on == [True]
    assert 0.02 < limb.truth("velocity")[0] < torque / 2.0
    rows = limb.drives.motors
    assert (rows.kp[0], rows.kd[0], rows.speed[0]) == (0, pytest.approx(2.0, abs=2e-3), pytest.approx(0, abs=3e-3))


def test_limp_takes_the_torque_and_disables() -> None:
    limb = stops(Stop.LIMP)
    assert limb.on == [False, False]
    assert not limb.fault
    assert limb.truth("effort") == pytest.approx(0)


def test_hold_stays_where_it_was_commanded_and_sags_no_further() -> None:
    limb = stops(Stop.HOLD)
    before = limb.truth()
    limb.run(1.0, np.array([0.0, 0.0]))
    assert limb.truth() == pytest.approx(before, abs=5e-3)


@pytest.mark.parametrize("category", [Stop.DAMP, Stop.LIMP])
def test_after_a_stop_it_is_taken_up_where_it_is(category: Stop) -> None:
    limb = stops(category)
    speeds: list[float] = []
    limb.run(1.0, limb.state("position"), look=lambda: speeds.append(float(np.abs(limb.truth("velocity")).max())))
    assert not limb.fault
    assert all(limb.on)
    assert limb.truth("velocity") == pytest.approx(0, abs=0.05)


def test_after_the_end_of_the_program_a_damiao_lets_go_and_a_cubemars_does_not() -> None:
    for motors, maker, on in ((TWO, "damiao", False), (AK, "v2", True)):
        limb = Limb(motors, maker).open()
        limb.hold()
        limb.fake.stop(Stop.HOLD)
        limb.fake.close()
        limb.world.advance(limb.world.time + 700_000_000)
        assert limb.on == [on, on], maker


def test_a_torque_never_outlives_its_program() -> None:
    limb = Limb(AK, "v2", interface="torque").open()
    limb.run(0.1, [1.0, 1.0])
    limb.fake.close()
    rows = limb.drives.motors
    assert np.allclose(rows.feedforward, 0, atol=0.05)
    assert np.allclose(rows.kd, 2.0, atol=2e-3)


def test_a_cubemars_that_nobody_moved_is_let_go() -> None:
    limb = Limb(AK, "v2").open()
    assert limb.on == [True, True]
    limb.fake.close()
    assert limb.on == [False, False]


# -- faults: what is told, and what the limb does


def test_one_silent_motor_is_named_and_the_others_hold() -> None:
    limb = Limb().open()
    where = limb.hold()
    limb.drives.unplugged.add(1)
    reported = limb.run(1.0, where, until=lambda: "'elbow' (id 2) doesn't answer" in limb.fault)
    assert reported <= 20 * MS
    limb.run(1.0, where)
    assert limb.on == [True, False]  # its own watchdog has let it go
    assert abs(limb.truth()[0] - where[0]) < 0.05
    with pytest.raises(DeviceLostError, match="looked at anew"):
        limb.fake.recover(limb.world.time)


def test_a_bus_that_is_unplugged_is_a_loss_and_damiaos_let_go_by_themselves() -> None:
    limb = Limb().open()
    where = limb.hold()
    limb.drives.unplugged.update((0, 1))
    with pytest.raises(DeviceLostError, match="no motor has answered"):
        limb.run(1.0, where)
    assert not limb.fake.health.connected
    limb.world.advance(limb.world.time + 200_000_000)
    assert limb.on == [False, False]
    limb.fake.close()


def test_a_cubemars_that_hears_nothing_goes_on_unless_its_firmware_has_a_timeout() -> None:
    for silence, torque in ((0.0, True), (0.1, False)):
        limb = Limb(AK, "v2", fake={"silence": silence}).open()
        where = limb.hold()
        limb.drives.unplugged.update((0, 1))
        with pytest.raises(DeviceLostError):
            limb.run(1.0, where)
        assert limb.on == [True, True]
        assert (np.abs(limb.truth("effort")) > 0.1).all() == torque


@pytest.mark.parametrize("maker", ["damiao", "v2"])
def test_a_brown_out_is_never_followed_by_a_jump(maker: str) -> None:
    """Power is gone for 50 ms where the encoder then reads another turn, as it can't know which it stands in."""
    motors = {"elbow": {"model": "DM4340" if maker == "damiao" else "AK80-9", "lower": 3.0, "upper": 5.0}}
    motors["elbow"] |= {"kp": 40, "kd": 2} | ({} if maker == "damiao" else {"park": 4.0})
    limb = Limb(motors, maker, cell(motors, hanging=False, start=4.0), ramp=0.1).open()
    where = limb.hold(0.2)
    limb.run(0.3, lambda t: where + t)
    limb.run(0.5, where + 0.3)
    away, read = limb.truth(), limb.state("position")
    limb.drives.power_down(0)
    limb.run(0.05, where + 0.3)
    limb.drives.power_up(0)
    speeds: list[float] = []
    limb.run(0.2, where + 0.3, look=lambda: speeds.append(abs(float(limb.truth("velocity")[0]))))
    assert "'elbow' (id 1)" in limb.fault
    assert max(speeds) < 0.1
    assert limb.truth() == pytest.approx(away, abs=0.02)
    with pytest.raises(DeviceLostError):
        limb.fake.recover(limb.world.time)
    limb.fake.close()
    if maker == "damiao":  # its travel leaves one turn
        limb.open()
        assert limb.state("position") == pytest.approx(read, abs=0.01)
    else:
        with pytest.raises(DeviceError, match=r"isn.t parked at 4: it could stand at 2\.90, 3\.60, 4\.30"):
            limb.fake.open()


def test_an_overheated_motor_is_told_before_it_switches_itself_off() -> None:
    limb = Limb().open()
    where = limb.hold()
    limb.drives.motors.temperature[1] = 85.0
    limb.run(0.1, where)
    assert "elbow is at 85 degC (stops at 90)" in limb.fake.health.message
    assert not limb.fault
    limb.drives.motors.temperature[1] = 95.0
    reported = limb.run(1.0, where, until=lambda: bool(limb.fault))
    assert reported < 0.35
    assert "'elbow' (id 2) is at 9" in limb.fault
    assert all(limb.on)
    limb.drives.motors.temperature[1] = 101.0
    limb.run(0.02, where)
    assert limb.on == [True, False]
    assert "winding too hot" in limb.fault


def test_an_error_is_cleared_by_a_reset_and_comes_again_if_its_cause_stays() -> None:
    limb = Limb().open()
    where = limb.hold()
    limb.drives.motors.fail(1, 8)
    limb.run(0.02, where)
    assert "'elbow' (id 2): under-voltage" in limb.fault
    limb.fake.recover(limb.world.time)
    limb.run(0.1)
    assert not limb.fault
    limb.run(0.5, limb.state("position"))
    assert not limb.fault
    assert all(limb.on)


def test_a_zero_that_somebody_moves_stops_the_motor_before_it_drives_there() -> None:
    limb = Limb(ONE, world=cell(ONE, hanging=False, start=0.8)).open()
    where = limb.hold()
    limb.drives.take(1, protocol.SET_ZERO, False)
    speeds: list[float] = []
    limb.run(0.5, where, look=lambda: speeds.append(abs(float(limb.truth("velocity")[0]))))
    assert "its position jumped by -0.80 rad" in limb.fault
    assert max(speeds) < 2.0  # two cycles of torque, which no host can prevent
    assert abs(limb.truth()[0] - 0.8) < 0.05


def test_a_motor_with_another_program_is_a_fault() -> None:
    limb = Limb().open()
    where = limb.hold()
    link = limb.fake.driver._line.link
    link._waiting.append(can.Message(arbitration_id=2, data=protocol.ENABLE, is_extended_id=False))
    limb.run(0.01, where)
    assert "another program commands 'elbow' (id 2)" in limb.fault


def test_a_velocity_that_isn_t_the_position_s_is_doubted() -> None:
    limb = Limb(ONE | {"elbow": ONE["elbow"]}, world=cell(ONE, hanging=False)).open()
    limb.drives.spans[0] = protocol.Range(12.5, 16.0, 28.0)  # the drive scales by twice the velocity it should
    where = limb.hold()
    limb.run(2.0, lambda t: where + 0.9 * t)
    assert "its velocity says 0.5" in limb.fake.health.message


def test_a_start_counts_from_where_a_bounded_torque_left_it() -> None:
    """Silence in the middle of a stop: damping needs its frames, and a Damiao ends limp."""
    limb = stops(Stop.DAMP)
    limb.world.advance(limb.world.time + 600_000_000)
    limb.run(2 * PERIOD * 1e-9, stop=Stop.DAMP)
    limb.run(0.01)
    assert limb.on == [False, False]
    assert "its watchdog" in limb.fault


def test_it_declares_what_the_driver_declares() -> None:
    limb = Limb()
    real = MitCan("bus", limb.fake.config)
    assert (limb.fake.states, limb.fake.commands, limb.fake.max_age) == (real.states, real.commands, real.max_age)
    assert limb.fake.traffic == real.traffic


@pytest.mark.parametrize("gap", [0.05, 0.2])
def test_a_v3_that_lost_its_turn_isn_t_driven_back_though_it_obeys_without_enabling(gap: float) -> None:
    motors = {"elbow": AK["elbow"] | {"lower": 3.0, "upper": 5.0, "park": 4.0}}
    limb = Limb(motors, "v3", cell(motors, hanging=False, start=4.0), ramp=0.1).open()
    where = limb.hold(0.2)
    limb.run(0.3, lambda t: where + t)
    limb.run(0.5, where + 0.3)
    away = limb.truth()
    limb.drives.power_down(0)
    limb.run(gap, where + 0.3)
    limb.drives.power_up(0)
    limb.run(0.3, where + 0.3)
    assert "its position jumped" in limb.fault
    assert limb.truth() == pytest.approx(away, abs=0.01)


@pytest.mark.parametrize("maker", ["v2", "v3"])
def test_whole_turns_away_from_its_park_isn_t_taken_for_parked_within_a_run(maker: str) -> None:
    motors = {"elbow": AK["elbow"]}
    limb = Limb(motors, maker, cell(motors, hanging=False), ramp=0.1).open()
    where = limb.hold(0.2)
    limb.run(0.7, lambda t: where + t)
    limb.run(0.5, where + 0.7)
    limb.fake.close()
    with pytest.raises(DeviceError, match=r"stood at 0\.70 when it was last heard, and would be at 0\.00"):
        limb.fake.open()


def test_an_ak_that_let_go_while_the_loop_paused_isn_t_pulled_back() -> None:
    motors = {"elbow": AK["elbow"]}
    limb = Limb(motors, "v2", cell(motors), fake={"silence": 0.025}, ramp=0.1).open()
    where = limb.hold(0.5)
    limb.world.advance(limb.world.time + 300_000_000)
    fallen = limb.truth()[0]
    limb.run(0.3, where)
    assert fallen > 0.3
    assert limb.truth()[0] > fallen
    assert "its position jumped" in limb.fault


def test_an_ak_that_held_while_the_loop_paused_goes_on() -> None:
    motors = {"elbow": AK["elbow"]}
    limb = Limb(motors, "v2", cell(motors), ramp=0.1).open()
    where = limb.hold(0.5)
    stood = limb.truth()
    limb.world.advance(limb.world.time + 300_000_000)
    limb.run(0.3, where)
    assert not limb.fault
    assert limb.truth() == pytest.approx(stood, abs=0.02)
