"""The UR driver and its twin in processes of their own, in real time: what hangs, what dies, what piles up."""

import time

import numpy as np
import pytest
from helpers.peer import Peer, bound, cycles
from helpers.wait import until
from helpers.zenoh import reopened

from srl.drivers.ur import Ur, UrConfig
from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.contracts.signals import Stop

pytestmark = pytest.mark.serial  # an arm that is driven 500 times a second, and how far it goes on by itself

V = np.array([0.2, 0.0, 0.0, 0.0, 0.0, -0.2])
CELL = {"world": "cell", "parts": {"device": {"part": "ur16e"}}}
# What an arm at 0.2 rad/s travels until its time-out and while it ramps down, and as much again.
OVERSHOOT = 2 * (0.2 * 0.2 + 0.2**2 / (2 * 5.0))


@pytest.fixture
def peer():
    with Peer("ur", {"port": "tcp://127.0.0.1"}, {"noise": 0.0}, CELL) as peer:
        yield peer


def opened(peer, **config):
    # A loop that shares two cores with other tests comes late at times: a longer time-out than the default.
    driver = bound(Ur("arm", UrConfig(port=peer.address, **{"timeout": 0.2, **config})))
    driver.open()
    return driver


def following(driver):
    driver.command_arrays["velocity_command"][:] = V
    return driver.write


def moving(driver, peer):
    """Commands `V` until the arm does it; a busy host starves the program on the controller at times."""
    until(lambda: np.abs(truth(peer)[1] - V).max() < 0.02, lambda: cycles(driver, 0.5, 500, following(driver)))


def in_step(peer):
    """Whether the twin's time goes on as the real one."""
    wall, own = time.monotonic(), peer.metrics()["time"]
    time.sleep(0.2)
    return peer.metrics()["time"] - own < 1.5e9 * (time.monotonic() - wall)


def still(peer):
    return np.abs(truth(peer)[1]).max() < 0.01


def truth(peer):
    """What the arm really does: position, velocity."""
    metrics = peer.metrics()["truth"]
    return np.array(metrics["device_position"]), np.array(metrics["device_velocity"])


def test_a_hung_controller_plays_nothing_back_when_it_goes_on(peer):
    driver = opened(peer)
    moving(driver, peer)
    before = truth(peer)[0]
    peer.stop()
    cycles(driver, 1.2, 500, following(driver))
    assert driver.health.unsent > 0
    held_back = driver.metrics()["held_back"]
    assert isinstance(held_back, int)
    assert held_back > 100
    peer.cont()
    cycles(driver, 1.5, 500)  # the loop has long since stopped the limb: only what was under way can move the arm
    position, velocity = truth(peer)
    assert np.abs(velocity).max() < 0.01
    assert np.abs(position - before).max() < OVERSHOOT
    assert "no command came" in driver.health.fault
    driver.recover(time.monotonic_ns())
    until(lambda: not driver.health.fault, lambda: cycles(driver, 0.05, 500))
    moving(driver, peer)
    driver.close()


def test_a_controller_that_hangs_for_long_is_lost_and_opened_again(peer):
    driver = opened(peer)
    cycles(driver, 0.5, 500, following(driver))
    peer.stop()
    with pytest.raises(DeviceLostError):
        cycles(driver, 30.0, 500, following(driver))
    peer.cont()
    until(lambda: in_step(peer), what="the twin has caught up with its stall, in which its time-outs are short")
    reopened(driver)  # the old program ended
    assert driver.health.reconnects == 1
    moving(driver, peer)
    driver.close()


def test_a_loop_that_dies_leaves_an_arm_that_stops(peer):
    driver = opened(peer)
    cycles(driver, 0.5, 500, following(driver))
    before = truth(peer)[0]
    time.sleep(1.0)  # nobody reads or writes any more; the link stays open
    position, velocity = truth(peer)
    assert np.abs(velocity).max() < 0.01
    assert np.abs(position - before).max() < OVERSHOOT
    driver.close()


def test_a_killed_client_leaves_an_arm_that_stops_and_a_controller_that_takes_the_next(peer):
    driver = opened(peer)
    cycles(driver, 0.5, 500, following(driver))
    driver._link.close()  # no farewell
    until(lambda: still(peer))
    again = opened(peer)
    moving(again, peer)
    again.stop(Stop.HOLD)
    again.close()
    until(lambda: still(peer))
