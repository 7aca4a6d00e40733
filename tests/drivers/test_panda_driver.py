"""Opening the Panda driver on a scripted robot, and the states that come over real sockets."""

import socket
import threading
import time

import numpy as np
import pytest
from helpers.fci import HOME, Robot
from helpers.fci_pair import MS, VERSIONS
from helpers.fuzz import mutations
from pydantic import ValidationError

from srl.drivers.panda import Panda
from srl.drivers.panda.config import PandaConfig
from srl.drivers.panda.packets import RobotMode
from srl.drivers.panda.protocol import Status
from srl.drivers.panda.requests import Connect, Move, SetCollisionBehavior, SetJointImpedance, SetLoad
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.signals import Stop

# -- opening


@VERSIONS
def test_an_arm_that_is_only_read_gets_no_motion_no_setting_and_no_recovery(version):
    robot = Robot(version)
    driver = Panda("arm", PandaConfig(port=robot.address, interface="none", collision={"torque": 20.0, "force": 20.0}))
    assert driver.commands == ()
    state = {s.name: np.zeros(s.shape) for s in driver.states}
    driver.bind(state, {})
    with robot.running():
        driver.open()
    for count in range(50):
        if count == 20:
            robot.abort(mode=RobotMode.GUIDING)
        robot.tick()
        driver.read(time.monotonic_ns())
        driver.write(time.monotonic_ns())
        driver.stop(Stop.HOLD)
        driver.recover(time.monotonic_ns())
        robot.serve()
        assert driver.health.fault == ""  # a fault would stop the run
    assert "guided by a person" in driver.health.message
    assert {type(body) for body in robot.requests} == {Connect}
    assert robot.commands == []
    np.testing.assert_allclose(state["position"], HOME)
    with robot.running():
        driver.close()
    robot.close()


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


@pytest.mark.slow
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
        load={
            "mass": 1.5,
            "centre": [0, 0, 0.1],
            "inertia": {"xx": 1, "yy": 2, "zz": 3, "xy": 0.1, "xz": 0.2, "yz": 0.3},
        },
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


def test_masses_that_an_earlier_program_left_are_refused(pair):
    def opened(**options):
        robot = Robot(10)
        robot.state["m_load"], robot.state["m_ee"] = 2.0, 0.73
        with robot.running():
            Panda("arm", PandaConfig(port=robot.address, **options)).open()

    with pytest.raises(DeviceError, match=r"a load of 2 kg, .*the profile names none.*load: {mass: 0}"):
        opened()
    with pytest.raises(DeviceError, match=r"the end effector set in Desk is 0.73 kg, the profile says 0.5"):
        opened(load={"mass": 1.0}, end_effector=0.5)
    robot = Robot(5)
    robot.state["m_load"], robot.state["m_ee"] = 2.0, 0.73
    one = pair(robot=robot, load={"mass": 0.0}, end_effector=0.73)
    assert [body.mass for body in one.robot.requests if isinstance(body, SetLoad)] == [0.0]
    assert "end effector 0.73 kg" in one.driver.health.message


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
    assert p.driver.metrics()["lost_states"] >= 7
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
