"""The twin's three doors: RTDE's handshake, claims and rates; the dashboard's lines; programs."""

import select
import socket
import struct

import numpy as np
import pytest
from helpers.twin import Bench
from helpers.ur import make_fake, speed
from helpers.wait import until

from srl.drivers.ur import UrConfig, rtde
from srl.drivers.ur.config import address
from srl.drivers.ur.recipe import Recipe, input_type, output_type
from srl.drivers.ur.rtde import Kind
from srl.drivers.ur.script import program
from srl.drivers.ur.status import RobotMode
from srl.sim.devices.ur.twin import UrTwin


class Peer:
    """A bare client of one door, in the test's own thread."""

    def __init__(self, bench, port):
        self.bench = bench
        self.link = socket.create_connection(("127.0.0.1", port), timeout=10)
        self.link.setblocking(False)
        bench.twin.service(bench.now)

    def send(self, data):
        self.link.sendall(data)

    def heard(self, enough):
        """Serves the twin until `enough` of the bytes that came."""
        found = b""

        def turn():
            nonlocal found
            self.bench.twin.service(self.bench.now)
            if select.select([self.link], [], [], 0.001)[0]:
                chunk = self.link.recv(65536)
                if not chunk:
                    raise ConnectionError
                found += chunk

        until(lambda: enough(found), turn, what=lambda: f"more than {found!r}", pause=0.0)
        return found

    def line(self, command=b""):
        if command:
            self.send(command + b"\n")
        return self.heard(lambda found: found.endswith(b"\n")).decode().strip()


@pytest.fixture
def bench():
    with Bench(UrTwin(make_fake())) as bench:
        yield bench


@pytest.fixture
def ports(bench):
    return address(bench.twin.address)


def rtde_peer(bench, ports):
    peer = Peer(bench, ports.rtde)
    assert exchange(peer, rtde.ask_protocol()) == rtde.accepted(Kind.PROTOCOL)
    return peer


def exchange(peer, request):
    """One request's whole answer, as bytes."""
    peer.send(request)
    return peer.heard(lambda found: len(found) >= 3 and len(found) >= struct.unpack(">H", found[:2])[0])


def stream(peer, names, rate=500.0):
    recipe = Recipe(names, [output_type(name) for name in names])
    assert exchange(peer, rtde.ask_outputs(rate, names)) == rtde.recipe(Kind.OUTPUTS, 1, recipe.types)
    assert exchange(peer, rtde.start()) == rtde.accepted(Kind.START)
    return recipe


def samples(peer, recipe, count):
    """So many data messages of a started stream, by name."""
    size = recipe.message_size
    data = peer.heard(lambda found: len(found) >= count * size)
    assert len(data) == count * size
    return [recipe.unpack(data[at + 3 : at + size]) for at in range(0, len(data), size)]


def test_the_handshake_is_the_sheets(bench, ports):
    peer = rtde_peer(bench, ports)
    assert exchange(peer, bytes.fromhex("000376")) == bytes.fromhex("0013 76 00000005 0000000b 00000000 00000000")
    wanted = bytes.fromhex("00294f407f400000000000") + b"timestamp,actual_q,robot_mode,"
    assert exchange(peer, wanted) == rtde.recipe(Kind.OUTPUTS, 1, ["DOUBLE", "VECTOR6D", "INT32"])
    assert exchange(peer, bytes.fromhex("000353")) == bytes.fromhex("00045301")
    bench.run(0.002)
    assert len(peer.heard(lambda found: len(found) >= 64)) == 64
    assert exchange(peer, bytes.fromhex("000350")) == bytes.fromhex("00045001")


def test_other_versions_of_the_protocol_are_refused(bench, ports):
    peer = Peer(bench, ports.rtde)
    assert exchange(peer, rtde.ask_protocol(1)) == rtde.accepted(Kind.PROTOCOL, False)


def test_unknown_variables_are_named(bench, ports):
    peer = rtde_peer(bench, ports)
    answer = exchange(peer, rtde.ask_outputs(500.0, ["timestamp", "nonsense"]))
    assert answer == rtde.recipe(Kind.OUTPUTS, 0, ["DOUBLE", "NOT_FOUND"])
    assert exchange(peer, rtde.start()) == rtde.accepted(Kind.START, False)


def test_samples_are_the_fakes_in_every_cycle_and_at_lower_rates(bench, ports):
    fast, slow = rtde_peer(bench, ports), rtde_peer(bench, ports)
    names = ["timestamp", "actual_q", "actual_TCP_pose", "joint_mode", "actual_tool_accelerometer"]
    fast_recipe, slow_recipe = stream(fast, names), stream(slow, names, 125.0)
    bench.run(0.04)
    found = samples(fast, fast_recipe, 20)
    np.testing.assert_allclose(np.diff([one["timestamp"] for one in found]), 0.002)
    fake = bench.twin.arm
    np.testing.assert_allclose(found[-1]["actual_q"], fake.sample(fake.newest())[:6])
    assert found[0]["joint_mode"] == (253,) * 6
    assert np.linalg.norm(found[0]["actual_tool_accelerometer"]) == pytest.approx(9.81)
    np.testing.assert_allclose(np.diff([one["timestamp"] for one in samples(slow, slow_recipe, 5)]), 0.008)


def test_inputs_belong_to_whom_claimed_them_first_until_he_leaves(bench, ports):
    one, two = rtde_peer(bench, ports), rtde_peer(bench, ports)
    names = ["input_int_register_24", "input_double_register_24"]
    types = [input_type(name) for name in names]
    assert exchange(one, rtde.ask_inputs(names)) == rtde.recipe(Kind.INPUTS, 1, types)
    assert exchange(one, rtde.ask_inputs(names[:1])) == rtde.recipe(Kind.INPUTS, 2, types[:1])
    answer = exchange(two, rtde.ask_inputs([*names, "input_int_register_25"]))
    assert answer == rtde.recipe(Kind.INPUTS, 0, ["IN_USE", "IN_USE", "INT32"])
    one.link.close()
    bench.run(0.002)
    assert exchange(two, rtde.ask_inputs(names)) == rtde.recipe(Kind.INPUTS, 1, types)


def test_inputs_act(bench, ports):
    peer = rtde_peer(bench, ports)
    names = ["input_int_register_40", "standard_digital_output_mask", "standard_digital_output", "speed_slider_mask",
             "speed_slider_fraction"]  # fmt: skip
    recipe = Recipe(names, [input_type(name) for name in names])
    exchange(peer, rtde.ask_inputs(names))
    got = stream(peer, ["input_int_register_40", "actual_digital_output_bits", "target_speed_fraction"])
    peer.send(rtde.message(Kind.DATA, b"\x01" + recipe.pack([-7, 0b1100, 0b0100, 1, 0.25])))
    bench.take(0)
    until(lambda: bench.twin.registers.inputs.ints[40] == -7, lambda: bench.twin.service(bench.now))
    bench.run(0.004)
    last = samples(peer, got, 2)[-1]
    assert last == {"input_int_register_40": -7, "actual_digital_output_bits": 4, "target_speed_fraction": 0.25}


@pytest.mark.parametrize("garbage", [b"GET / HTTP/1.0\r\n\r\n", b"\x00\x06\x55\x09\x00\x00", b"\xff" * 50])
def test_garbage_ends_the_connection_and_no_other(bench, ports, garbage):
    good, bad = rtde_peer(bench, ports), rtde_peer(bench, ports)
    bad.send(garbage)
    with pytest.raises(ConnectionError):
        bad.heard(lambda found: False)
    assert exchange(good, rtde.ask_controller())[2:3] == b"v"
    assert bench.twin.metrics()["dropped"] == 1


def test_the_dashboard_answers_line_by_line(bench, ports):
    peer = Peer(bench, ports.dashboard)
    assert peer.line() == "Connected: Universal Robots Dashboard Server"
    for command, answer in (
        (b"PolyscopeVersion", "URSoftware 5.11.0.108249 (Apr 22 2021)"), (b"robotmode", "Robotmode: RUNNING"),
        (b"safetystatus", "Safetystatus: NORMAL"), (b"get robot model", "UR16"), (b"running", "Program running: false"),
        (b"is in remote control", "true"), (b"popup hello", "showing popup"), (b"programState", "STOPPED"),
        (b"make coffee", 'could not understand: "make coffee"'), (b"load x.urp", "File not found: x.urp"),
    ):  # fmt: skip
        assert peer.line(command) == answer
    assert peer.line(b"quit") == "Disconnected"


def test_power_goes_off_and_on_by_the_dashboard(bench, ports):
    peer = Peer(bench, ports.dashboard)
    peer.line()
    assert peer.line(b"power off") == "Powering off"
    bench.run(0.05)
    assert peer.line(b"robotmode") == "Robotmode: POWER_OFF"
    peer.line(b"power on")
    bench.run(0.5)
    assert peer.line(b"robotmode") == "Robotmode: IDLE"
    assert peer.line(b"brake release") == "Brake releasing"
    bench.run(0.5)
    assert peer.line(b"robotmode") == "Robotmode: RUNNING"


@pytest.mark.slow
def test_a_protective_stop_cant_be_ended_within_5_s(bench, ports):
    bench.twin.controller.protective_stop("test")
    bench.run(0.1)
    peer = Peer(bench, ports.dashboard)
    peer.line()
    assert peer.line(b"safetystatus") == "Safetystatus: PROTECTIVE_STOP"
    assert peer.line(b"unlock protective stop").startswith("Cannot unlock")
    bench.run(5.0)
    assert peer.line(b"unlock protective stop") == "Protective stop releasing"
    assert peer.line(b"safetystatus") == "Safetystatus: NORMAL"


def send_program(bench, ports, text):
    peer = Peer(bench, ports.script)
    peer.send(text.encode())
    started = len(bench.twin.programs) + len(bench.twin.errors)
    until(lambda: len(bench.twin.programs) + len(bench.twin.errors) > started, lambda: bench.twin.service(bench.now))
    return peer


def test_a_program_of_somebody_elses_moves_the_arm(bench, ports):
    start = bench.twin.controller.arm.position
    text = "def nod():\n  q = get_actual_joint_positions()\n  movej([q[0] + 0.2, q[1], q[2], q[3], q[4], q[5]], "
    send_program(bench, ports, text + "a=2, v=1)\n" + '  textmsg("nodded ", 1)\n  stopj(2)\nend\n')
    bench.run(0.2)
    assert speed(bench.twin.arm) > 0.1
    bench.run(1.0)
    assert bench.twin.controller.arm.position[0] == pytest.approx(start[0] + 0.2, abs=1e-3)
    metrics = bench.twin.metrics()
    assert (metrics["programs"], metrics["texts"], metrics["errors"]) == (["nod"], ["nodded 1"], [])


def test_a_program_that_ends_in_motion_leaves_the_arm_at_rest(bench, ports):
    send_program(bench, ports, "def go():\n  speedj([0.5, 0, 0, 0, 0, 0], 2, 0.3)\nend\n")
    bench.run(0.28)
    assert speed(bench.twin.arm) > 0.3
    bench.run(0.4)
    assert speed(bench.twin.arm) < 0.01


def test_a_watchdog_stops_the_program_whose_inputs_fall_silent(bench, ports):
    text = 'def go():\n  rtde_set_watchdog("input_int_register_30", 10, "stop")\n'
    send_program(bench, ports, text + "  speedj([0.3, 0, 0, 0, 0, 0], 2, 60)\nend\n")
    bench.run(0.09)
    assert speed(bench.twin.arm) > 0.1
    bench.run(0.3)
    assert speed(bench.twin.arm) < 0.01
    assert "watchdog" in bench.twin.errors[0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("def go():\n  while True:\n    x = 1\n  end\nend\n", "letting time pass"),
        ("def go():\n  dance()\nend\n", "dance"),
        ("speedj([1], 2, 1)\n", "six finite"), ("servoj([1, 2, 3, 4, 5, 6], gain=5)\n", "gain 100"),
    ],
)  # fmt: skip
def test_a_wrong_program_ends_and_is_told(bench, ports, text, words):
    send_program(bench, ports, text)
    bench.run(0.01)
    assert words in bench.twin.errors[0]
    assert bench.twin.controller.program is None


def test_programs_are_refused_in_local_control_and_without_power(bench, ports):
    bench.twin.dashboard.remote = False
    send_program(bench, ports, "stopj(2)\n")
    assert "local control" in bench.twin.errors[0]
    bench.twin.dashboard.remote = True
    bench.twin.controller.robot_mode = RobotMode.IDLE
    send_program(bench, ports, "stopj(2)\n")
    assert "isn't ready" in bench.twin.errors[1]


def test_a_client_that_doesnt_read_is_hung_up_on_and_holds_nobody_back(bench, ports):
    idle, good = rtde_peer(bench, ports), rtde_peer(bench, ports)
    names = [f"output_double_register_{k}" for k in range(48)]
    idle.link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
    stream(idle, names)
    recipe = stream(good, ["timestamp"])
    values = bench.twin.arm.sample(bench.twin.arm.newest())

    def flood():
        for _ in range(100):
            for connection in bench.twin.rtde._connections[:1]:
                connection.send(0, values)
        bench.twin.rtde.receive()

    until(lambda: bench.twin.rtde.dropped, flood)
    bench.run(0.002)
    assert samples(good, recipe, 1)


def test_a_loss_closes_all_doors_and_brings_them_back_at_the_same_ports():
    with Bench(UrTwin(make_fake(loss=[[0.1, 0.2]]))) as bench:
        where = bench.twin.address
        peer = rtde_peer(bench, address(where))
        bench.run(0.15)
        assert bench.twin.address == ""
        with pytest.raises(OSError):  # noqa: PT011
            peer.heard(lambda found: False)
        bench.run(0.1)
        assert bench.twin.address == where
        rtde_peer(bench, address(where))


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e300, -1e300, 0.0])
def test_no_register_content_upsets_the_controller(bench, ports, value, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo's log of what it warns of
    registers, controller = bench.twin.registers, bench.twin.controller
    home = controller.arm.position
    peer = rtde_peer(bench, ports)
    recipe = stream(peer, ["timestamp", "actual_q", "output_int_register_0", "output_int_register_26"])
    registers.inputs.doubles[:] = [value] * 48
    x = "read_input_float_register(0)"
    q, pose = f"[{', '.join([x] * 6)}]", f"p[{', '.join([x] * 6)}]"
    for call in (
        f"movej({q})", f"movej({pose})", f"movel({q}, a={x}, v={x})", f"movel({pose}, r={x})", f"speedj({q}, 1, 0.1)",
        f"speedl({q}, {x}, 0.1)", f"servoj({q})", f"servoc({pose})", f"stopj({x})", f"stopl({x})", f"set_tcp({pose})",
        f"force_mode({pose}, {q}, {q}, 2, {q})", f"force_mode_set_damping({x})", f"get_inverse_kin({pose}, {q})",
        f"set_payload({x}, [{x}, {x}, {x}])", f"get_actual_joint_positions_history({x})", f"tool_contact({q})",
    ):  # fmt: skip
        send_program(bench, ports, f"def go():\n  {call}\n  sync()\nend\n")
        bench.run(0.01)
        controller.end_program()
        bench.run(0.05)
        assert np.isfinite(controller.motion.q).all(), call
    registers.inputs.ints[24:28] = [77, 1, 5, 10]
    send_program(bench, ports, program(UrConfig(port=bench.twin.address), 77))
    registers.inputs.ints[26] = 6
    bench.run(0.1)
    data = peer.heard(lambda found: len(found) > recipe.message_size)
    assert np.isfinite(recipe.unpack(data[3 : recipe.message_size])["actual_q"]).all()
    assert np.isfinite(controller.arm.position).all()
    np.testing.assert_allclose(controller.arm.position, home, atol=2.5)


@pytest.mark.parametrize(
    "call",
    [
        "set_payload(0/1 - 5)", "set_payload(1e9)", "set_digital_out(-1, True)", "set_digital_out(99, True)",
        "sleep(1e999)", "write_output_integer_register(99, 1)", "movej([0, 0, 0, 0, 0, 1e999])",
        "speedj([0, 0, 0, 0, 0, 0], 0, 1)",
    ],
)  # fmt: skip
def test_wrong_arguments_end_a_program_only(bench, ports, call):
    send_program(bench, ports, f"def go():\n  {call}\nend\n")
    bench.run(0.01)
    assert len(bench.twin.errors) == 1
    assert bench.twin.controller.program is None


def test_integers_of_a_program_have_32_bits(bench, ports):
    send_program(bench, ports, "def go():\n  write_output_integer_register(0, 3000000000)\n  sync()\nend\n")
    bench.run(0.01)
    assert bench.twin.registers.outputs.ints[0] == 3000000000 - 2**32
