"""Reflexes, refusals and losses of a scripted robot, and how the Panda driver gets over them."""

import time

import numpy as np
import pytest
from helpers.fci_pair import MS, VERSIONS

from srl.drivers.panda import Panda
from srl.drivers.panda.config import PandaConfig
from srl.drivers.panda.packets import RobotMode
from srl.drivers.panda.protocol import Status
from srl.drivers.panda.requests import AutomaticErrorRecovery, Connect, Move
from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.contracts.signals import Stop

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
    assert p.driver.metrics()["moves"] == 2


def test_a_silent_robot_is_lost_after_a_second(pair):
    p = pair(10)
    p.start()
    p.driver.read(p.now + 900 * MS)
    with pytest.raises(DeviceLostError, match="no state"):
        p.driver.read(p.now + 1100 * MS)
    started = time.monotonic()
    p.driver.close()
    assert time.monotonic() - started < 5  # nobody is left to end the motion with


def test_after_a_silence_a_velocity_begins_at_rest_not_at_what_was_meant_before(pair):
    p = pair(10, interface="velocity")
    p.start()
    p.command[:] = 0.3
    p.cycle(300)
    assert min(p.driver.sent_arrays["velocity_command"]) > 0.2
    p.driver.sent_arrays["velocity_command"][:] = np.nan  # as the loop does, once it has taken what was sent
    p.driver.read(p.now + 19 * MS)
    assert np.isnan(p.driver.sent_arrays["velocity_command"]).all()  # the robot may still be moving
    p.driver.read(p.now + 30 * MS)
    assert p.driver.sent_arrays["velocity_command"].tolist() == [0.0] * 7
    p.driver.sent_arrays["velocity_command"][:] = np.nan
    p.driver.read(p.now + 31 * MS)
    assert np.isnan(p.driver.sent_arrays["velocity_command"]).all()  # said once: nothing leaves


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
