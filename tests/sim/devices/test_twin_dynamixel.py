"""The servos' twin, byte by byte: instructions, refusals, watchdog, return delay, collisions; and mode rules."""

import termios

import numpy as np
import pytest
from helpers.dynamixel import make_twin
from helpers.fuzz import mutations
from helpers.twin import Bench, Client

from srl.drivers.dynamixel import protocol2
from srl.drivers.servo_bus import protocol1
from srl.drivers.servo_bus.packets import Status
from srl.sim.devices.dynamixel.twin_servo1 import magnitude, with_sign

MS = 1_000_000
ONE = {"elbow": {"model": "MX-64"}}


TWO = {"elbow": {"model": "MX-64", "id": 1}, "shoulder": {"model": "MX-106", "id": 2}}


class Wire:
    """A bare client that speaks in packets; both the device's and its own clock stand still meanwhile."""

    def __init__(self, protocol: int = 2, motors=ONE, delay: int = 0, **attributes):
        self.p = protocol1 if protocol == 1 else protocol2
        self.twin = make_twin(motors, protocol=protocol, baudrate=57600)
        for servo in self.twin.servos:
            servo.put("return_delay_time", delay)
        for name, value in attributes.items():
            setattr(self.twin, name, value)
        self.bench = Bench(self.twin)
        self.parser = self.p.Parser()

    def __enter__(self):
        self.client = Client(self.bench)
        self.at(termios.B57600)
        return self

    def at(self, speed):
        """Sets the client's baud rate."""
        mode = termios.tcgetattr(self.client.fd)
        mode[4] = mode[5] = speed
        termios.tcsetattr(self.client.fd, termios.TCSANOW, mode)

    def __exit__(self, *_):
        self.client.close()
        self.twin.close()

    def ask(self, packet: bytes) -> list[Status]:
        self.client.send(packet)
        self.bench.run(0.003)
        return self.parser.statuses(self.client.rest())

    def read(self, name: str, k: int = 0) -> int:
        register = self.twin.servos[k].by_name[name]
        (status,) = self.ask(self.p.read(k + 1, register.address, register.size))
        assert status.error == 0
        return register.decode(status.data, register.address)

    def write(self, name: str, value: int, k: int = 0) -> int:
        register = self.twin.servos[k].by_name[name]
        (status,) = self.ask(self.p.write(k + 1, register.address, register.encode(value)))
        return status.error


def test_ping_and_the_sheet_s_delivered_state():
    with Wire() as wire:
        assert wire.ask(protocol2.ping(1)) == [Status(1, 0, False, bytes.fromhex("37012a"))]
        assert wire.ask(protocol2.ping(2)) == []
        for name, value in (
            ("baud_rate", 1), ("operating_mode", 3), ("shutdown", 52), ("position_p_gain", 850),
            ("temperature_limit", 80), ("current_limit", 1941), ("goal_pwm", 885), ("present_position", 2048),
            ("present_input_voltage", 120), ("status_return_level", 2),
        ):  # fmt: skip
            assert wire.read(name) == value, name


def test_refusals():
    with Wire() as wire:
        limit, access, out = protocol2.LIMIT, protocol2.ACCESS, protocol2.RANGE
        assert wire.write("goal_position", 4096) == limit
        assert wire.write("goal_velocity", 400) == limit
        assert wire.write("model_number", 1) == access
        assert wire.write("operating_mode", 2) == out
        assert wire.write("torque_enable", 2) == out
        assert wire.write("bus_watchdog", -1) == out
        assert wire.write("torque_enable", 1) == 0
        assert wire.write("operating_mode", 4) == access
        assert wire.ask(protocol2.write(1, 116, b"\0"))[0].error == protocol2.LENGTH
        assert wire.ask(protocol2.write(1, 66, b"\0"))[0].error == access  # no register
        assert wire.ask(protocol2.read(1, 660, 10))[0].error == access
        assert wire.ask(protocol2.packet(1, 0x77))[0].error == protocol2.INSTRUCTION
        assert wire.ask(protocol2.packet(1, protocol2.FACTORY_RESET, b"\x07"))[0].error == out
        assert wire.read("goal_position") == 2048


def test_an_mx_28_has_no_current():
    with Wire(motors={"end": {"model": "MX-28"}}) as wire:
        assert wire.write("operating_mode", 0) == protocol2.RANGE
        assert wire.ask(protocol2.write(1, 102, b"\0\0"))[0].error == protocol2.ACCESS
        assert wire.write("operating_mode", 16) == 0


def test_several_registers_are_written_whole_or_not_at_all():
    with Wire() as wire:
        data = (5).to_bytes(4, "little") + (7).to_bytes(4, "little") + (9999).to_bytes(4, "little")
        assert wire.ask(protocol2.write(1, 108, data))[0].error == protocol2.LIMIT
        assert wire.read("profile_acceleration") == 0
        assert wire.ask(protocol2.write(1, 108, data[:8]))[0].error == 0
        assert (wire.read("profile_acceleration"), wire.read("profile_velocity")) == (5, 7)


def test_a_change_of_mode_resets_profile_and_goals():
    with Wire() as wire:
        wire.write("profile_velocity", 50)
        wire.write("goal_current", 100)
        wire.write("position_p_gain", 100)
        assert wire.write("operating_mode", 5) == 0
        assert wire.read("profile_velocity") == 0
        assert wire.read("goal_current") == 1941
        assert wire.read("position_p_gain") == 850


def test_status_return_level():
    with Wire() as wire:
        assert len(wire.ask(protocol2.write(1, 68, b"\1"))) == 1  # by the level before
        assert wire.ask(protocol2.write(1, 65, b"\1")) == []
        assert wire.read("led") == 1
        wire.ask(protocol2.write(1, 68, b"\0"))
        assert wire.ask(protocol2.read(1, 65, 1)) == []
        assert len(wire.ask(protocol2.ping(1))) == 1


def test_the_watchdog_stops_and_locks_the_goals_until_it_is_cleared():
    with Wire() as wire:
        wire.write("torque_enable", 1)
        wire.write("bus_watchdog", 5)
        wire.bench.run(0.09)
        assert wire.read("bus_watchdog") == 5
        wire.bench.run(0.11)
        assert wire.read("bus_watchdog") == -1
        assert wire.write("goal_position", 2100) == protocol2.RANGE
        assert wire.write("led", 1) == 0
        assert wire.write("bus_watchdog", 0) == 0
        assert wire.write("goal_position", 2100) == 0


def test_indirect_registers():
    with Wire() as wire:
        wire.ask(protocol2.write(1, 168, b"".join((132 + k).to_bytes(2, "little") for k in range(4))))
        wire.ask(protocol2.write(1, 176, (65).to_bytes(2, "little")))
        (status,) = wire.ask(protocol2.read(1, 224, 5))
        assert int.from_bytes(status.data[:4], "little") == 2048
        assert wire.ask(protocol2.write(1, 228, b"\1"))[0].error == 0
        assert wire.read("led") == 1
        assert wire.ask(protocol2.write(1, 224, b"\1"))[0].error == protocol2.ACCESS  # a read-only target


def test_homing_offset_and_secondary_id():
    with Wire() as wire:
        wire.write("homing_offset", 100)
        assert wire.read("present_position") == 2148
        wire.write("secondary_id", 9)
        assert wire.ask(protocol2.write(9, 65, b"\1")) == []
        assert wire.read("led") == 1
        wire.ask(protocol2.write(9, 11, b"\4"))
        assert wire.read("operating_mode") == 3  # volatile registers only


def test_group_reads_answer_in_the_order_asked_and_stop_at_a_missing_servo():
    three = {"a": {"model": "MX-64"}, "b": {"model": "MX-64"}, "c": {"model": "MX-28"}}
    with Wire(motors=three) as wire:
        assert [s.id for s in wire.ask(protocol2.group_read(132, 4, (3, 1, 2)))] == [3, 1, 2]
        wire.twin.absent = {1}
        assert [s.id for s in wire.ask(protocol2.group_read(132, 4, (3, 1, 2)))] == [3]
        assert [s.id for s in wire.ask(protocol2.ping(254))] == [2, 3]


def test_answers_wait_for_the_return_delay_one_after_another_and_collide_with_what_comes_too_soon():
    two = {"a": {"model": "MX-64"}, "b": {"model": "MX-64"}}
    with Wire(motors=two, delay=250) as wire:
        wire.client.send(protocol2.group_read(132, 4, (1, 2)))
        assert wire.client.rest() == b""
        wire.bench.run(0.001)
        assert len(wire.parser.statuses(wire.client.rest())) == 2  # after 0.5 and 1 ms
        wire.client.send(protocol2.group_read(132, 4, (1, 2)))
        wire.client.send(protocol2.ping(1))
        wire.bench.run(0.005)
        assert wire.client.rest() == b""
        assert wire.twin.metrics()["collisions"] == 1


def test_another_baud_rate_is_not_understood():
    with Wire() as wire:
        wire.write("baud_rate", 3)
        assert wire.ask(protocol2.ping(1)) == []
        assert wire.twin.metrics()["wrong_rate"] == 10


def test_a_hardware_error_is_an_alert_in_every_answer_until_the_reboot():
    with Wire() as wire:
        wire.write("torque_enable", 1)
        wire.twin.bus.chain.motors.fail(0, 32)
        (status,) = wire.ask(protocol2.ping(1))
        assert status.alert
        assert wire.read("hardware_error_status") == 32
        assert wire.read("torque_enable") == 0
        wire.ask(protocol2.reboot(1))
        assert wire.ask(protocol2.ping(1)) == []
        wire.bench.run(0.4)
        (status,) = wire.ask(protocol2.ping(1))
        assert not status.alert


@pytest.mark.slow
def test_stalling_leads_to_overload_by_itself():
    with Wire() as wire:
        wire.write("operating_mode", 4)
        wire.write("torque_enable", 1)
        wire.write("goal_position", 2048 + 2500)  # beyond the end stop at 2.6 rad
        wire.bench.run(4.0)
        assert wire.read("hardware_error_status") == 32
        assert wire.read("torque_enable") == 0


def test_a_profile_makes_a_trapezoid():
    with Wire() as wire:
        wire.write("torque_enable", 1)
        wire.write("profile_velocity", 50)  # 1.2 rad/s
        wire.write("profile_acceleration", 20)  # 7.5 rad/s^2
        wire.write("goal_position", 2048 + 800)
        speeds = []
        while len(speeds) < 120:
            speeds.append(wire.twin.servos[0].motors.trajectory_velocity[0])
            wire.bench.run(0.01)
        assert max(speeds) == pytest.approx(1.199, abs=0.01)
        assert np.abs(np.diff(speeds)).max() < 0.09
        assert abs(wire.read("present_position") - 2848) < 10


def test_protocol_1_modes_follow_the_limits_and_a_goal_switches_the_torque_on():
    with Wire(protocol=1) as wire:
        assert wire.read("present_position") == 2048
        assert wire.read("model_number") == 310
        assert wire.write("goal_position", 5000) == protocol1.ANGLE
        assert wire.write("goal_position", 2100) == 0
        assert wire.read("torque_enable") == 1
        assert wire.write("cw_angle_limit", 0) == protocol1.RANGE  # locked
        wire.write("torque_enable", 0)
        wire.write("ccw_angle_limit", 0)
        wire.write("torque_enable", 1)
        wire.write("moving_speed", 0x400 | 200)
        wire.bench.run(0.5)
        assert magnitude(wire.read("present_speed")) == pytest.approx(-200, abs=40)
        wire.write("torque_control_mode", 1)
        wire.write("goal_torque", 100)
        wire.bench.run(0.1)
        assert wire.read("current") == pytest.approx(2148, abs=4)


def test_protocol_1_overload_takes_the_torque_limit_away():
    with Wire(protocol=1) as wire:
        wire.write("goal_position", 2200)
        wire.twin.bus.chain.motors.fail(0, 32)
        (status,) = wire.ask(protocol1.ping(1))
        assert status.error == protocol1.OVERLOAD
        (status,) = wire.ask(protocol1.read(1, 34, 2))
        assert status.data == b"\0\0"
        wire.write("torque_limit", 1023)
        assert wire.ask(protocol1.ping(1))[0].error == 0


@pytest.mark.parametrize("value", [-1023, -1, 0, 1, 500, 1023])
def test_magnitude_and_direction(value):
    assert magnitude(with_sign(value)) == value


@pytest.mark.parametrize("protocol", [1, 2])
def test_damaged_packets_never_end_a_twin(protocol):
    p = protocol1 if protocol == 1 else protocol2
    reads = p.ping(1) + p.read(1, 30, 10) + p.group_read(36, 8, (1, 2))
    good = reads + p.write(1, 64, b"\1") + p.sync_write(30, 2, {1: b"ab"})
    twin = make_twin(protocol=protocol)
    for chunk in mutations(good, 3, 100_000):
        twin.receive(chunk, 0)
        twin._answers.clear()
    twin._parser.forget()
    assert twin.metrics()["damaged"] > 10
    twin.absent = set()
    assert twin.seen["ping"] > 10


def test_servos_of_different_baud_rates_each_understand_their_own():
    with Wire(motors=TWO) as wire:
        assert [status.id for status in wire.ask(protocol2.ping(0xFE))] == [1, 2]
        wire.twin.servos[1].put("baud_rate", 3)  # 1 Mbit/s
        assert [status.id for status in wire.ask(protocol2.ping(0xFE))] == [1]
        assert wire.ask(protocol2.ping(2)) == []
        wire.at(termios.B1000000)
        assert [status.id for status in wire.ask(protocol2.ping(0xFE))] == [2]
        wire.at(termios.B115200)
        assert wire.ask(protocol2.ping(0xFE)) == []
        assert wire.twin.metrics()["wrong_rate"] == len(protocol2.ping(0xFE))


def test_a_baud_rate_counts_from_the_packet_after_its_answer_on():
    with Wire() as wire:
        assert wire.write("baud_rate", 3) == 0
        assert wire.ask(protocol2.ping(1)) == []
        wire.at(termios.B1000000)
        assert len(wire.ask(protocol2.ping(1))) == 1


@pytest.mark.parametrize("protocol", [1, 2])
def test_reverse_mode_mirrors_goals_and_measured_values(protocol):
    with Wire(protocol, {"shoulder": {"model": "MX-106"}}) as wire:
        motors = wire.twin.bus.chain.motors
        before = wire.read("present_position")
        assert wire.write("drive_mode", 1) == 0
        assert wire.read("present_position") == 4096 - before
        assert wire.write("torque_enable", 1) == 0
        assert wire.write("goal_position", 2348) == 0
        wire.bench.run(0.5)
        assert wire.read("present_position") == pytest.approx(2348, abs=8)
        assert motors.counts[0] == pytest.approx(4096 - 2348, abs=8)


def test_a_reversed_wheel_turns_the_other_way_and_says_so():
    with Wire() as wire:
        for name, value in (("drive_mode", 1), ("operating_mode", 1), ("torque_enable", 1), ("goal_velocity", 100)):
            assert wire.write(name, value) == 0
        wire.bench.run(0.3)
        assert wire.read("present_velocity") == pytest.approx(100, abs=8)
        assert wire.twin.bus.chain.motors.velocity[0] < 0


@pytest.mark.parametrize("value", [2, 4])
def test_slaves_and_timed_profiles_are_refused_and_counted(value):
    with Wire() as wire:
        assert wire.write("drive_mode", value) == protocol2.RANGE
        assert wire.read("drive_mode") == 0
        assert wire.twin.metrics()["refused"] == {"1.drive_mode": 1}


@pytest.mark.parametrize(("kept", "id", "baud"), [(0xFF, 1, 1), (0x01, 2, 1), (0x02, 2, 3)])
def test_a_factory_reset_keeps_what_it_is_told_to(kept, id, baud):
    with Wire(motors={"shoulder": {"model": "MX-106", "id": 2}}) as wire:
        wire.twin.servos[0].put("baud_rate", 3)
        wire.twin.servos[0].put("position_p_gain", 7)
        wire.at(termios.B1000000)
        (answer,) = wire.ask(protocol2.packet(2, protocol2.FACTORY_RESET, bytes((kept,))))
        assert (answer.id, answer.error) == (2, 0)
        wire.bench.run(0.4)
        servo = wire.twin.servos[0]
        assert (servo.get("id"), servo.get("baud_rate"), servo.get("position_p_gain")) == (id, baud, 850)
        wire.at(termios.B1000000 if baud == 3 else termios.B57600)
        assert [status.id for status in wire.ask(protocol2.ping(0xFE))] == [id]


def test_a_bus_isnt_reset_to_one_id():
    with Wire(motors=TWO) as wire:
        assert wire.ask(protocol2.packet(0xFE, protocol2.FACTORY_RESET, b"\xff")) == []
        assert [servo.get("id") for servo in wire.twin.servos] == [1, 2]
