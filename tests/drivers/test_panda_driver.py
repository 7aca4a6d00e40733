"""The Panda driver against a scripted robot, millisecond by millisecond over real sockets."""

import select
import socket
import threading
import time

import numpy as np
import pytest
from helpers_fci import HOME, Robot
from helpers_fuzz import mutations
from pydantic import ValidationError

from drivers.panda import Panda, packets
from drivers.panda.config import PandaConfig
from drivers.panda.packets import Controller, Generator, RobotMode
from drivers.panda.protocol import (
    AutomaticErrorRecovery,
    Connect,
    Move,
    SetCollisionBehavior,
    SetJointImpedance,
    SetLoad,
    Status,
    StopMove,
)
from runtime.errors import DeviceError, DeviceLostError
from runtime.signals import Kind, Stop

MS = 1_000_000
VERSIONS = pytest.mark.parametrize("version", packets.VERSIONS)
INTERFACES = pytest.mark.parametrize("interface", ["torque", "velocity", "position"])


class Pair:
    """A robot and a driver that is open; `cycle` is one millisecond of both."""

    def __init__(self, version=10, robot=None, **options):
        self.robot = robot or Robot(version)
        self.driver = Panda("arm", PandaConfig(port=self.robot.address, **options))
        self.state = {s.name: np.zeros(s.shape) for s in self.driver.states}
        (command,) = self.driver.commands
        self.command = np.zeros(command.shape)
        self.driver.bind(self.state, {command.name: self.command})
        self.now = 0
        with self.robot.running():
            self.driver.open()
        self.settle()

    def settle(self):
        """No state is left in the socket."""
        self.robot.serve()
        self.now = time.monotonic_ns()
        self.driver.read(self.now)

    def arrive(self):
        """Waits until the newest state can be read."""
        assert select.select([self.driver.fileno()], [], [], 5)[0]

    def cycle(self, count=1, write=True, states=1):
        for _ in range(count):
            self.robot.tick(states)
            self.now += MS * states
            self.arrive()
            self.driver.read(self.now)
            if write:
                self.driver.write(self.now)
            self.robot.serve()

    def until(self, true, cycles=500, write=True):
        for _ in range(cycles):
            if true():
                return
            self.cycle(write=write)
        raise AssertionError("never came true")

    def start(self):
        self.until(lambda: self.robot.commands)

    def read_until_lost(self):
        for _ in range(500):
            self.driver.read(self.now)
            time.sleep(0.01)

    def close(self):
        with self.robot.running():
            self.driver.close()
        self.robot.close()


@pytest.fixture
def pair(request):
    made = []

    def make(*args, **options):
        made.append(Pair(*args, **options))
        return made[-1]

    yield make
    for one in made:
        one.close()


# -- opening


@VERSIONS
def test_the_protocol_is_the_robots(pair, version):
    p = pair(version)
    tried = [body.version for body in p.robot.requests if isinstance(body, Connect)]
    assert tried == ([5] if version == 5 else [5, 10])
    assert p.driver.health.connected
    assert f"protocol {version}" in p.driver.health.message
    assert ("FR3" if version == 10 else "Panda") in p.driver.health.message or "Research 3" in p.driver.health.message
    limits = p.driver.limits["torque_command"]
    assert limits.velocity[0] == (2.175 if version == 5 else 2.62)
    assert limits.effort_rate is not None


def test_a_robot_of_another_version_is_refused_by_name():
    robot = Robot(10, claims=9)
    with robot.running(), pytest.raises(DeviceError, match=r"FCI protocol 9; known here are 5 .* and 10") as error:
        Panda("arm", PandaConfig(port=robot.address)).open()
    assert "system" in error.value.remedy
    robot.close()


def test_something_else_than_a_robot_is_refused():
    with socket.create_server(("127.0.0.1", 0)) as other:
        url = f"tcp://127.0.0.1:{other.getsockname()[1]}"

        def shout():
            client, _ = other.accept()
            with client:
                client.sendall(b"SSH-2.0-OpenSSH_9.6\r\n" * 3)
                client.recv(100)
                time.sleep(0.2)

        thread = threading.Thread(target=shout)
        thread.start()
        with pytest.raises(DeviceError, match="arm"):
            Panda("arm", PandaConfig(port=url)).open()
        thread.join()
    with pytest.raises(DeviceError, match="refuses a connection"):
        Panda("arm", PandaConfig(port=url)).open()


def test_options_are_checked():
    for options in (
        {"port": "192.168.1.11"},
        {"interface": "cartesian"},
        {"joint_impedance": [1.0] * 6},
        {"joint_impedance": [20000.0] * 7},
        {"collision": {"torque": [1.0] * 6, "force": 10.0}},
        {"collision": {"torque": 10.0}},
        {"load": {"mass": -1.0}},
    ):
        with pytest.raises(ValidationError):
            PandaConfig(**({"port": "tcp://arm:1337"} | options))


@VERSIONS
def test_settings_are_sent_before_anything_moves(pair, version):
    p = pair(
        version,
        collision={"torque": 20.0, "force": [30.0] * 6, "contact_torque": 10.0},
        joint_impedance=[3000.0] * 7,
        load={"mass": 1.5, "centre": [0, 0, 0.1], "inertia": [1, 2, 3, 0.1, 0.2, 0.3]},
    )
    *_, collision, impedance, load = p.robot.requests
    assert collision == SetCollisionBehavior(*[(10.0,) * 7, (20.0,) * 7] * 2, *[(30.0,) * 6, (30.0,) * 6] * 2)
    assert impedance == SetJointImpedance((3000.0,) * 7)
    assert load == SetLoad(1.5, (0, 0, 0.1), (1, 0.1, 0.2, 0.1, 2, 0.3, 0.2, 0.3, 3))


def test_a_refused_setting_is_an_error_with_its_name():
    robot = Robot(5)
    robot.answers[SetLoad] = Status.INVALID_ARGUMENT
    driver = Panda("arm", PandaConfig(port=robot.address, load={"mass": 50.0}))
    with robot.running(), pytest.raises(DeviceError, match="refuses SetLoad: invalid argument"):
        driver.open()
    assert driver.fileno() is None
    robot.close()


def test_a_robot_that_is_stopped_is_opened_and_gets_its_settings_later(pair):
    robot = Robot(10)
    robot.state["robot_mode"] = RobotMode.USER_STOPPED
    p = pair(robot=robot, load={"mass": 1.0})
    assert "stop button" in p.driver.health.fault
    p.cycle(5)
    assert not any(isinstance(body, SetLoad | Move) for body in robot.requests)
    robot.idle()
    p.until(lambda: any(isinstance(body, Move) for body in robot.requests))
    assert p.driver.health.fault == ""
    assert [type(body) for body in robot.requests[-2:]] == [SetLoad, Move]


def test_no_reset_gets_past_a_setting_that_the_robot_refuses(pair):
    robot = Robot(10)
    robot.state["robot_mode"] = RobotMode.USER_STOPPED
    robot.answers[SetCollisionBehavior] = Status.INVALID_ARGUMENT
    p = pair(robot=robot, collision={"torque": 20.0, "force": 30.0})
    robot.idle()
    for _ in range(2):
        p.until(lambda: "refuses SetCollisionBehavior" in p.driver.health.fault, write=False)
        p.driver.recover(p.now)
        assert p.driver.health.fault == ""
        p.cycle(20)
    assert not any(isinstance(body, Move) for body in robot.requests)
    del robot.answers[SetCollisionBehavior]
    p.driver.recover(p.now)
    p.until(lambda: robot.moving)


# -- states


@VERSIONS
def test_states_fill_the_arrays(pair, version):
    p = pair(version)
    values = {
        "q": np.linspace(-1, 1, 7),
        "dq": np.linspace(0, 0.6, 7),
        "tau_J": np.linspace(-20, 20, 7),
        "tau_ext_hat_filtered": np.linspace(1, 2, 7),
        "O_F_ext_hat_K": np.linspace(3, 8, 6),
    }
    for name, value in values.items():
        p.robot.state[name] = value
    T = np.eye(4)
    T[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]  # a quarter turn about z
    T[:3, 3] = 0.3, 0.1, 0.5
    p.robot.state["O_T_EE"] = T.T.ravel()
    p.robot.state["control_command_success_rate"] = 0.75
    p.cycle()
    names = ("position", "velocity", "effort", "external_effort", "wrench")
    for name, value in zip(names, values.values(), strict=True):
        assert p.state[name] == pytest.approx(value, abs=1e-5)
    half = np.sqrt(0.5)
    assert p.state["pose"] == pytest.approx([0.3, 0.1, 0.5, half, 0, 0, half], abs=1e-6)
    assert p.state["success_rate"][0] == pytest.approx(0.75)


def test_any_rotation_becomes_its_quaternion_without_jumps(pair):
    p = pair(10)
    last = None
    rng = np.random.default_rng(0)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    for angle in np.linspace(0, 4 * np.pi, 60):
        R = np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
        T = np.eye(4)
        T[:3, :3] = R
        p.robot.state["O_T_EE"] = T.T.ravel()
        p.cycle(write=False)
        w, x, y, z = q = p.state["pose"][3:].copy()
        assert np.linalg.norm(q) == pytest.approx(1)
        back = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        assert back == pytest.approx(R, abs=1e-5)
        assert last is None or np.dot(q, last) > 0.9
        last = q


def test_a_backlog_is_drained_to_the_newest_and_answered_once(pair):
    p = pair(10)
    p.start()
    before = len(p.robot.commands)
    p.cycle(states=30)
    assert len(p.robot.commands) == before + 1
    assert p.robot.commands[-1]["message_id"] == p.robot.state["message_id"]
    p.driver.write(p.now)
    p.robot.serve()
    assert len(p.robot.commands) == before + 1


def test_states_that_never_came_are_counted_and_old_ones_have_old_stamps(pair):
    p = pair(10)
    p.cycle(20)
    health = p.driver.health
    errors, frames = health.errors, health.frames
    p.robot.state["message_id"] += 7
    p.now += 7 * MS
    p.cycle()
    assert (health.errors - errors, health.frames - frames) == (7, 1)
    assert p.driver.figures()["lost_states"] >= 7
    stamp = health.stamp
    p.robot.tick()
    p.now += 500 * MS  # our own stall: what lies in the socket is half a second old
    p.arrive()
    p.driver.read(p.now)
    assert health.stamp == pytest.approx(stamp + MS, abs=0.2 * MS)


def test_damaged_states_are_counted_and_change_nothing(pair):
    p = pair(5)
    p.cycle(5)
    position = p.state["position"].copy()
    p.robot.state["q"][3] = np.nan
    p.cycle()
    assert (p.state["position"] == position).all()
    assert p.driver.health.errors >= 1
    p.robot.state["q"] = HOME
    assert p.robot._udp is not None
    p.robot._udp.send(b"short")
    p.cycle()
    assert p.driver.health.errors >= 2
    assert p.driver.health.connected


@VERSIONS
@pytest.mark.parametrize(
    "field", ["tau_J", "tau_ext_hat_filtered", "O_F_ext_hat_K", "O_T_EE", "control_command_success_rate"]
)
@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_no_state_is_fresh_with_a_number_that_isn_t_finite(pair, version, field, wrong):
    p = pair(version)
    p.cycle(3)
    stamp, errors = p.driver.health.stamp, p.driver.health.errors
    p.robot.state[field].flat[-1] = wrong
    p.cycle(3)
    assert all(np.isfinite(values).all() for values in p.state.values())
    assert p.driver.health.stamp == stamp
    assert p.driver.health.errors == errors + 3


def test_a_message_id_from_nowhere_doesn_t_overflow_the_counts(pair):
    p = pair(10)
    p.cycle(2)
    p.robot.state["message_id"] = 2**64 - 2
    p.cycle()
    assert p.driver.health.errors < 20_000


@VERSIONS
def test_a_flood_of_damaged_states_and_replies_does_no_harm(pair, version):
    p = pair(version)
    p.cycle(2)
    good = p.robot.state.tobytes()
    for data in mutations(good, 0, 1_000_000):
        p.driver._take_states([data, data + good[len(data) :]], p.now)
        p.driver._judge()
    p.driver._id = -1
    p.cycle(2)
    assert p.state["position"] == pytest.approx(HOME, abs=1e-6)


# -- motions


@VERSIONS
@INTERFACES
def test_a_motion_is_asked_for_and_each_state_answered(pair, version, interface):
    p = pair(version, interface=interface)
    assert not p.robot.moving
    p.command[:] = HOME if interface == "position" else 0
    p.start()
    move = next(body for body in p.robot.requests if isinstance(body, Move))
    wanted = {
        "torque": (Controller.EXTERNAL, Generator.JOINT_VELOCITY if version == 5 else Generator.NONE),
        "velocity": (Controller.JOINT_IMPEDANCE, Generator.JOINT_VELOCITY),
        "position": (Controller.JOINT_IMPEDANCE, Generator.JOINT_POSITION),
    }[interface]
    assert (move.controller, move.generator + 1) == wanted
    p.robot.commands.clear()
    first = int(p.robot.state["message_id"]) + 1
    p.cycle(50)
    assert [int(c["message_id"]) for c in p.robot.commands] == list(range(first, first + 50))
    for command in p.robot.commands:
        assert not command["motion_generation_finished"]
        assert (command["dq_c"] == 0).all()
        assert (command["tau_J_d"] == 0).all()
        if interface == "position":
            assert command["q_c"] == pytest.approx(HOME, abs=1e-6)


@VERSIONS
def test_a_torque_step_reaches_the_robot_as_a_ramp(pair, version):
    p = pair(version)
    p.start()
    p.command[:] = 5.0, -5.0, 2.0, 0.0, 1.0, 20.0, 0.5
    p.robot.commands.clear()
    p.cycle(30)
    torques = np.array([c["tau_J_d"] for c in p.robot.commands])
    assert (np.abs(np.diff(torques, axis=0)) < 1.0).all()
    assert torques[-1] == pytest.approx([5.0, -5.0, 2.0, 0.0, 1.0, 12.0, 0.5])
    assert torques[6] == pytest.approx([5.0, -5.0, 2.0, 0.0, 1.0, torques[6][5], 0.5])


@VERSIONS
def test_a_velocity_step_reaches_the_robot_without_a_jerk(pair, version):
    p = pair(version, interface="velocity")
    p.start()
    p.command[:] = 0.4
    p.robot.commands.clear()
    p.cycle(200)
    dq = np.array([c["dq_c"] for c in p.robot.commands])
    ddq = np.diff(dq, axis=0, prepend=0) / 1e-3
    jerk = np.diff(ddq, axis=0, prepend=0) / 1e-3
    limits = p.driver.limits["velocity_command"]
    assert (np.abs(ddq) <= 1.001 * limits.acceleration).all()
    assert (np.abs(jerk) <= 1.001 * limits.jerk).all()
    assert dq[-1] == pytest.approx([0.4] * 7)
    assert p.state["velocity"] == pytest.approx([0.4] * 7)


def test_a_position_is_moved_to_smoothly(pair):
    p = pair(10, interface="position")
    p.command[:] = HOME
    p.start()
    for k in range(300):
        p.command[:] = np.array(HOME) + 0.01 * (1 - np.cos(2 * np.pi * k / 300))
        p.cycle()
    p.cycle(200)
    assert p.state["position"] == pytest.approx(p.command, abs=1e-4)


@VERSIONS
@INTERFACES
def test_stop_ends_the_motion_in_good_order_and_another_can_follow(pair, version, interface):
    p = pair(version, interface=interface)
    p.command[:] = HOME if interface == "position" else 0
    p.start()
    if interface == "velocity":
        p.command[:] = 0.3
        p.cycle(100)
    p.driver.stop(Stop.HOLD)
    p.until(lambda: not p.robot.moving, write=False)
    p.cycle(3, write=False)
    last = p.robot.commands[-1]
    flag = "torque_command_finished" if version == 10 and interface == "torque" else "motion_generation_finished"
    assert last[flag]
    assert (last["dq_c"] == 0).all()
    assert np.abs(p.robot.state["dq_d"]).max() < 1e-3
    assert p.driver.health.fault == ""
    assert not any(isinstance(body, StopMove) for body in p.robot.requests)
    p.robot.commands.clear()
    p.command[:] = p.state["position"] if interface == "position" else 0
    p.start()
    assert p.driver.figures()["moves"] == 2
    assert p.driver.health.fault == ""


def test_a_torque_motion_brakes_what_still_moves_before_it_ends(pair):
    p = pair(10)
    p.start()
    p.robot.state["dq"] = 0.5
    p.driver.stop(Stop.HOLD)
    p.cycle(60, write=False)
    assert p.robot.moving
    damping = p.robot.commands[-1]["tau_J_d"]
    limits = p.driver.limits["torque_command"]
    assert damping == pytest.approx(-0.5 * limits.effort / limits.velocity, rel=1e-6)
    p.robot.state["dq"] = 0.0
    p.cycle(3, write=False)
    assert not p.robot.moving


def test_a_motion_ends_when_the_writes_cease(pair):
    p = pair(10, interface="velocity")
    p.start()
    p.command[:] = 0.2
    p.cycle(50)
    p.until(lambda: not p.robot.moving, write=False)
    ids = [int(c["message_id"]) for c in p.robot.commands]
    assert max(np.diff(ids)) <= 4  # far from the 20 that the robot stops for
    assert p.driver.health.fault == ""


@VERSIONS
def test_close_ends_the_motion_first(pair, version):
    p = pair(version, interface="velocity")
    p.start()
    p.command[:] = 0.2
    p.cycle(50)
    p.close()
    assert p.robot.commands[-1]["motion_generation_finished"]
    assert not any(isinstance(body, StopMove) for body in p.robot.requests)
    p.driver.close()
    assert not p.driver.health.connected
    assert p.driver.fileno() is None


def test_close_stops_a_motion_that_does_not_end(pair):
    p = pair(10)
    p.start()
    p.robot.shy = True
    p.close()
    assert isinstance(p.robot.requests[-1], StopMove)


def test_no_stop_frame_is_needed(pair):
    p = pair(10)
    assert p.driver.stop_frame(Stop.HOLD) == b""
    (command,) = p.driver.commands
    assert (command.kind, command.feedback, command.stops[0]) == (Kind.TORQUE, "position", Stop.HOLD)


# -- faults


@VERSIONS
def test_a_reflex_is_a_fault_until_the_recovery_a_person_asks_for(pair, version):
    p = pair(version)
    p.start()
    p.robot.abort("joint_reflex", "power_limit_violation")
    p.cycle(5, write=False)
    assert p.driver.health.fault == "reflex: joint_reflex, power_limit_violation"
    assert p.driver.health.connected
    p.cycle(20, write=False)
    assert not any(isinstance(body, AutomaticErrorRecovery) for body in p.robot.requests)
    p.driver.recover(p.now)
    p.driver.recover(p.now)
    p.until(lambda: p.driver.health.fault == "", write=False)
    assert sum(isinstance(body, AutomaticErrorRecovery) for body in p.robot.requests) == 1
    p.robot.commands.clear()
    p.start()
    p.cycle(10)
    assert p.robot.moving


def test_the_reply_may_come_long_before_the_state(pair):
    p = pair(10)
    p.start()
    p.robot._end(Status.ABORTED)
    p.cycle(5)
    assert p.driver.health.fault == "motion aborted"
    p.robot.idle()
    p.robot.state["robot_mode"] = RobotMode.USER_STOPPED
    p.cycle(5)
    assert p.driver.health.fault.startswith("stopped by a person")
    p.robot.idle()
    p.cycle(5, write=False)
    assert p.driver.health.fault == ""


def test_a_recovery_that_fails_says_so(pair):
    p = pair(10)
    p.start()
    p.robot.abort("joint_position_limits_violation")
    p.robot.answers[AutomaticErrorRecovery] = Status.MANUAL_RECOVERY
    p.cycle(3, write=False)
    p.driver.recover(p.now)
    p.until(lambda: "web interface" in p.driver.health.fault, write=False)
    assert p.driver.health.fault.startswith("reflex: joint_position_limits_violation, automatic error recovery: ")


def test_a_refused_motion_is_a_fault_that_a_person_clears(pair):
    p = pair(5)
    p.robot.answers[Move] = Status.NOT_POSSIBLE
    p.until(lambda: p.driver.health.fault)
    assert p.driver.health.fault == "no motion: command not possible in the present mode"
    asked = sum(isinstance(body, Move) for body in p.robot.requests)
    p.cycle(20)
    assert sum(isinstance(body, Move) for body in p.robot.requests) == asked == 1
    del p.robot.answers[Move]
    p.driver.recover(p.now)
    assert p.driver.health.fault == ""
    p.start()


@pytest.mark.parametrize(
    ("mode", "words"),
    [
        (RobotMode.GUIDING, "guided by a person"),
        (RobotMode.USER_STOPPED, "stopped by a person"),
        (RobotMode.OTHER, "brakes"),
        (RobotMode.AUTOMATIC_ERROR_RECOVERY, "recovering"),
        (99, "brakes"),
    ],
)
def test_modes_that_keep_it_from_moving_are_faults_while_they_last(pair, mode, words):
    p = pair(10)
    p.robot.state["robot_mode"] = mode
    p.cycle(3)
    assert words in p.driver.health.fault
    assert not p.robot.moving
    p.robot.idle()
    p.cycle(2, write=False)
    assert p.driver.health.fault == ""


def test_a_motion_that_ends_without_a_word_is_noticed(pair):
    p = pair(10)
    p.start()
    p.robot.idle()
    p.robot._move = None
    p.until(lambda: p.driver.health.fault, cycles=1500)
    assert "without a word" in p.driver.health.fault


# -- losses


@VERSIONS
def test_a_robot_that_hangs_up_is_lost_and_comes_back(pair, version):
    p = pair(version)
    p.start()
    p.robot.hang_up()
    with pytest.raises(DeviceLostError):
        p.read_until_lost()
    assert not p.driver.health.connected
    p.driver.close()
    with p.robot.running():
        p.driver.open()
    assert p.driver.health.reconnects == 1
    versions = [body.version for body in p.robot.requests if isinstance(body, Connect)]
    assert versions[-1] == version
    assert versions[-2:] != [5, 10]  # it knows whom it speaks to
    p.robot.commands.clear()
    p.settle()
    p.start()
    assert p.driver.figures()["moves"] == 2


def test_a_silent_robot_is_lost_after_a_second(pair):
    p = pair(10)
    p.start()
    p.driver.read(p.now + 900 * MS)
    with pytest.raises(DeviceLostError, match="no state"):
        p.driver.read(p.now + 1100 * MS)
    started = time.monotonic()
    p.driver.close()
    assert time.monotonic() - started < 5  # nobody is left to end the motion with


def test_our_own_stall_is_no_loss_and_makes_no_burst(pair):
    p = pair(10)
    p.start()
    before = len(p.robot.commands)
    p.robot.tick(50)
    p.robot.abort("communication_constraints_violation")
    p.robot.tick(50)
    p.now += 3000 * MS
    p.arrive()
    p.driver.read(p.now)
    p.driver.write(p.now)
    p.cycle(3, write=False)
    assert len(p.robot.commands) <= before + 1
    assert p.driver.health.fault == "reflex: communication_constraints_violation"
    p.driver.recover(p.now)
    p.until(lambda: p.driver.health.fault == "", write=False)
    p.start()


def test_a_deaf_robot_never_blocks_and_is_given_up(pair):
    p = pair(10)
    p.robot.deaf = True
    p.cycle(20)
    assert p.driver.health.fault == ""
    p.driver.read(p.now + 1)
    p.now += 11_000 * MS
    p.robot.tick()
    p.arrive()
    with pytest.raises(DeviceLostError, match="doesn't reply"):
        p.driver.read(p.now)


def test_use_before_opening_is_an_error_not_a_crash():
    driver = Panda("arm", PandaConfig(port="tcp://127.0.0.1:1"))
    for call in (driver.read, driver.write, driver.recover):
        with pytest.raises(DeviceLostError):
            call(0)
    driver.stop(Stop.HOLD)
    driver.close()
    driver.close()
    assert driver.fileno() is None
