"""A SoftHand in a process that is stopped and goes on: at most one command waits for it."""

import time

import pytest
from helpers.peer import Peer, bound, cycles
from helpers.wait import until

from srl.drivers.softhand import SoftHand
from srl.drivers.softhand.config import SoftHandConfig
from srl.drivers.softhand.driver import Motor
from srl.runtime.contracts.errors import DeviceLostError

WORLD = {"world": "cell", "parts": {"hand": {"part": "softhand"}}}


@pytest.fixture
def peer():
    with Peer("softhand", world=WORLD) as running:
        yield running


@pytest.fixture
def hand(peer):
    driver = bound(SoftHand("hand", SoftHandConfig(port=peer.address)))
    driver.open()
    yield driver
    driver.close()


class Ramp:
    """Another command each cycle."""

    def __init__(self, hand):
        self.hand, self.closure = hand, 0.0

    def __call__(self, now):
        self.closure = (self.closure + 0.003) % 1.0
        self.hand.command_arrays["position_command"][:] = self.closure
        self.hand.write(now)

    def cycle(self):
        now = time.monotonic_ns()
        self.hand.read(now)
        self(now)


def inputs(peer):
    return peer.metrics()["commands"].get("SET_INPUTS", 0)


def test_a_stall_leaves_at_most_one_command(peer, hand):
    ramp = Ramp(hand)
    until(lambda: hand._motor is Motor.ON and hand._sent is not None, ramp.cycle)
    cycles(hand, 0.3, 100, ramp)
    before = inputs(peer)
    assert before > 5
    peer.stop()
    try:
        cycles(hand, 0.3, 100, ramp)
    finally:
        peer.cont()
    until(lambda: hand.health.unsent == 0, lambda: hand.read(time.monotonic_ns()))
    assert inputs(peer) - before <= 2  # one that was under way when it was counted, one that waited


def test_a_long_stall_is_a_loss_and_the_hand_is_opened_again(peer, hand):
    ramp = Ramp(hand)
    until(lambda: hand._motor is Motor.ON, ramp.cycle)
    peer.stop()
    with pytest.raises(DeviceLostError):
        cycles(hand, 5.0, 100, ramp)
    hand.close()
    peer.cont()
    until(lambda: not peer.metrics()["active"])  # its watchdog, or the last words of the driver
    hand.open()
    assert hand.health.reconnects == 1
    assert hand._motor is Motor.OFF
    until(lambda: hand._motor is Motor.ON, ramp.cycle)
