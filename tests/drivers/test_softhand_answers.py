"""The SoftHand driver on a line of the test's own: which answer belongs to which question."""

import struct

from helpers.ft import bound

from srl.drivers.softhand import SoftHand, protocol
from srl.drivers.softhand.config import SoftHandConfig
from srl.drivers.softhand.driver import Motor
from srl.runtime.contracts.signals import Stop

MS = 1_000_000


class Line:
    """In the place of the link: keeps what is written, and gives what a test puts in."""

    def __init__(self):
        self.written, self.waiting = [], b""

    def write(self, data):
        self.written.append(data)
        return True

    def read(self):
        data, self.waiting = self.waiting, b""
        return data


def wired(**config):
    """An open hand on a line of the test's own, its motor off."""
    hand = bound(SoftHand("hand", SoftHandConfig(port="/dev/null", **config)))
    hand._link, hand._armed = Line(), True
    hand._forget()
    hand.health.connected = True
    return hand, hand._link


def both(ticks):
    return protocol.frame(1, protocol.Cmd.GET_BOTH, struct.pack(">5h", 0, 0, ticks, 0, 0))


def test_of_answers_to_repeated_questions_each_has_its_own_question_s_age():
    hand, line = wired()
    at = 10_000 * MS
    for k in range(41):  # no answer for 0.4 s: asked again every 50 ms
        hand.read(at + 10 * k * MS)
    asked = sum(protocol.Cmd.GET_BOTH.to_bytes() in data for data in line.written)
    assert asked >= 8
    now = at + 410 * MS
    line.waiting = both(1)  # the answers were held back on their way, and come in two parts
    hand.read(now)
    assert hand.health.stamp <= at + 10 * MS
    hand.read(now + 20 * MS)  # asks anew
    line.waiting = both(2) * (asked - 1)
    hand.read(now + 30 * MS)
    assert hand.health.stamp <= now - 10 * MS  # sampled before the new question
    for k in range(30):  # soon each answer is the newest question's
        hand.read(now + (30 + 20 * k) * MS)
        line.waiting = both(3)
        hand.read(now + (40 + 20 * k) * MS)
    assert hand.health.stamp == now + (20 + 20 * 29) * MS
    for k in range(200):  # every second answer is lost, and asked for again: the stamps stay young
        at = now + (1000 + 10 * k) * MS
        line.waiting = both(3) if k % 12 > 6 else b""
        hand.read(at)
        assert k < 12 or at - hand.health.stamp <= 160 * MS


def test_off_isn_t_believed_by_an_answer_that_was_asked_for_before():
    hand, line = wired()
    at = 10_000 * MS
    hand.read(at)
    line.waiting = both(1)
    hand.read(at + MS)
    hand.command_arrays["position_command"][:] = 0.2
    hand.write(at + 2 * MS)
    assert line.written[-1].startswith(protocol.activate(1, True))
    hand.stop(Stop.LIMP)  # it may collide with the answer, and be lost
    line.waiting = protocol.frame(1, protocol.Cmd.GET_ACTIVATE, b"\0")  # from before it was on
    hand.read(at + 4 * MS)
    assert hand._motor is Motor.TURNING_OFF
    assert line.written[-1].startswith(protocol.activate(1, False))
