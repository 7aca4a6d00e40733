"""The Firmata driver against a scripted board on a pty."""

import os
import select
import threading
import time

import numpy as np
import pytest
from helpers.dynamixel import waiting
from helpers.firmata import BOOT, OLD, UNO, ScriptedBoard, firmata, servo
from helpers.wait import until

from srl.drivers.firmata import identify
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Stop

MS = 1_000_000
TWO = {"base": servo(9), "tip": servo(10)}  # 544 us + 618.67 us/rad


@pytest.fixture
def board(tmp_path):
    with ScriptedBoard(tmp_path) as running:
        yield running


@pytest.fixture
def opened(board):
    driver = firmata(board.port, servos=TWO, buttons={"go": {"pin": 2}, "halt": {"pin": 8, "debounce": 0.0}})
    driver.open()
    yield driver
    driver.close()


def pulse(angle):
    """µs, for a servo of TWO."""
    return round(544 + angle * 1856 / 3)


class Loop:
    """Cycles of a driver, 10 ms of its clock each; waits in real time only for what the board answers."""

    def __init__(self, driver):
        self.driver = driver
        self.now = 10**12

    def cycle(self, *angles):
        self.now += 10 * MS
        self.driver.read(self.now)
        if angles:
            self.driver.command_arrays["position_command"][:] = angles
            self.driver.write(self.now)

    def until(self, condition, *angles):
        until(condition, lambda: self.cycle(*angles))


def test_opening_resets_the_board_attaches_nothing_and_takes_the_buttons_as_they_are(board):
    board.pressed = {8}
    driver = firmata(board.port, servos=TWO, buttons={"go": {"pin": 2}, "halt": {"pin": 8}})
    driver.open()
    assert b"\xff" in board.seen
    assert not any(message[0] & 0xF0 == 0xE0 or message[:2] == b"\xf0\x70" for message in board.seen)
    assert driver.health.connected
    assert driver.health.frames >= 5
    driver.read(0)
    np.testing.assert_array_equal(driver.state_arrays["buttons"], [0.0, 1.0])
    driver.close()


def test_the_first_command_attaches_with_limits_and_pulse_together_and_later_ones_send_only_changes(board, opened):
    loop = Loop(opened)
    loop.cycle()
    loop.until(lambda: opened.health.stamp > 0)
    board.seen.clear()
    loop.until(lambda: len(board.seen) >= 4, 1.5, 1.5)
    value = bytes((pulse(1.5) & 127, pulse(1.5) >> 7))
    assert board.seen == [
        bytes.fromhex("f0 70 09 20 04 60 12 f7"),
        b"\xe9" + value,
        bytes.fromhex("f0 70 0a 20 04 60 12 f7"),
        b"\xea" + value,
    ]
    board.seen.clear()
    loop.until(lambda: board.seen, 1.5, 1.6)
    for _ in range(20):
        loop.cycle(1.5, 1.6 + 1e-4)  # less than a microsecond
        time.sleep(0.001)
    assert board.seen == [bytes((0xEA, pulse(1.6) & 127, pulse(1.6) >> 7))]


def test_a_pin_beyond_15_is_driven_by_the_extended_message(board):
    driver = firmata(board.port, servos={"a": servo(16)})
    driver.open()
    Loop(driver).until(lambda: len(board.seen) >= 2 and board.seen[-1][1] == 0x6F, 0.0)
    assert board.seen[-1] == bytes.fromhex("f0 6f 10 20 04 f7")
    driver.close()


def test_a_command_that_is_not_finite_moves_nothing(board, opened):
    loop = Loop(opened)
    loop.until(lambda: any(message[0] == 0xEA for message in board.seen), 1.0, 1.0)
    board.seen.clear()
    loop.until(lambda: board.seen, np.nan, 1.1)
    loop.cycle(np.inf, -np.inf)
    assert [message[0] for message in board.seen] == [0xEA]


def test_limp_detaches_and_the_next_command_attaches_again(board, opened):
    loop = Loop(opened)
    loop.until(lambda: any(message[0] == 0xEA for message in board.seen), 1.0, 1.0)
    loop.cycle()
    board.seen.clear()
    opened.stop(Stop.LIMP)
    opened.stop(Stop.LIMP)
    loop.until(lambda: board.seen[-1:] == [bytes.fromhex("f5 0a 00")])
    assert b"".join(board.seen) == bytes.fromhex("f7 f4 09 01 f5 09 00 f4 0a 01 f5 0a 00")
    assert opened.stop_frames(Stop.HOLD) == (b"\xf7",)
    board.seen.clear()
    loop.until(lambda: any(message[0] == 0xEA for message in board.seen), 1.0, 1.0)
    assert board.seen[0] == b"\xff"
    assert bytes.fromhex("f4 02 0b") in board.seen
    assert bytes.fromhex("f0 70 09 20 04 60 12 f7") in board.seen


def test_hold_sends_nothing(board, opened):
    loop = Loop(opened)
    loop.until(lambda: any(message[0] == 0xEA for message in board.seen), 1.0, 1.0)
    board.seen.clear()
    opened.stop(Stop.HOLD)
    for _ in range(10):
        loop.cycle()
    opened.close()
    board.wait_for(b"\xd1\x00")
    assert board.seen == [b"\xd0\x00", b"\xd1\x00"]  # closing leaves the servos alone


def test_stop_frames_repeat_the_last_pulses_or_detach(board, opened):
    assert opened.stop_frames(Stop.HOLD) == (b"\xf7",)
    loop = Loop(opened)
    loop.until(lambda: any(message[0] == 0xEA for message in board.seen), 0.0, 3.0)
    hold = opened.stop_frames(Stop.HOLD)
    assert hold == (bytes.fromhex("f7 e9 20 04 ea 60 12"),)
    loop.cycle(0.0, 3.0)
    assert opened.stop_frames(Stop.HOLD) is hold
    assert opened.stop_frames(Stop.RETRACT) is hold
    assert opened.stop_frames(Stop.LIMP) == (bytes.fromhex("f7 f4 09 01 f5 09 00 f4 0a 01 f5 0a 00"),)
    os.write(opened.fileno(), *opened.stop_frames(Stop.LIMP))
    board.wait_for(bytes.fromhex("f5 0a 00"))


def test_a_board_that_stops_reading_gets_one_command_and_then_the_newest(board, opened):
    loop = Loop(opened)
    loop.until(lambda: any(message[0] == 0xEA for message in board.seen), 1.0, 1.0)
    loop.until(lambda: opened.health.unsent == 0, 1.0, 1.0)
    board.pause()
    while select.select([opened.fileno()], [], [], 0.03)[0]:  # takes what the board said before
        loop.cycle()
    board.seen.clear()
    stamp = opened.health.stamp
    for step in range(300):  # 3 s of the loop
        loop.cycle(1.0 + step / 300, 1.0)
    assert opened.health.unsent > 0
    assert opened.health.stamp == stamp
    assert loop.now - stamp > opened.max_age * 1e9
    board.reading.set()
    loop.until(lambda: len(board.seen) >= 2, 2.5, 1.0)
    loop.until(lambda: opened.health.unsent == 0, 2.5, 1.0)
    assert all(message[0] == 0xE9 for message in board.seen)
    sent = [message[1] | message[2] << 7 for message in board.seen]
    assert sent[-1] == pulse(2.5)
    assert sent[:-1] in ([pulse(1.0 + 1 / 300)], [])
    assert opened.health.connected


def test_liveness_is_asked_for_about_twice_a_second_while_nothing_moves(opened):
    loop = Loop(opened)
    loop.until(lambda: opened.health.stamp > 0)
    start = opened.health.frames
    for _ in range(500):  # 5 s of the loop
        loop.cycle()
        time.sleep(0.001)
    assert 9 <= opened.health.frames - start <= 11
    loop.until(lambda: opened.health.unsent == 0 and opened.health.stamp > loop.now - 10 * MS, 1.0, 1.0)
    start = opened.health.frames
    for _ in range(500):
        loop.cycle(1.0, 1.0)
        time.sleep(0.001)
    assert 11 <= opened.health.frames - start <= 14
    assert loop.now - opened.health.stamp < opened.max_age * 1e9


def test_a_board_that_restarts_by_itself_is_lost_and_opens_again(board, opened):
    loop = Loop(opened)
    loop.until(lambda: any(message[0] == 0xEA for message in board.seen), 1.0, 1.0)
    board.reset()
    with pytest.raises(DeviceLostError, match="restarted by itself"):
        loop.until(lambda: False)
    assert not opened.health.connected
    opened.close()
    opened.open()
    assert opened.health.connected
    assert opened.health.reconnects == 1
    board.seen.clear()
    loop.until(lambda: any(message[0] == 0xEA for message in board.seen), 1.2, 1.2)
    assert bytes.fromhex("f0 70 09 20 04 60 12 f7") in board.seen


def test_a_pulled_cable_is_a_loss_and_the_board_opens_again(board, opened):
    loop = Loop(opened)
    loop.until(lambda: any(message[0] == 0xEA for message in board.seen), 1.0, 1.0)
    board.replug()
    with pytest.raises(DeviceLostError):
        loop.until(lambda: False, 1.0, 1.1)
    opened.stop(Stop.LIMP)
    opened.close()
    opened.close()
    opened.open()
    assert opened.health.reconnects == 1
    loop.until(lambda: board.seen[-1][0] == 0xEA, 1.0, 1.0)


def test_garbage_is_counted_and_changes_nothing(board, opened):
    loop = Loop(opened)
    loop.until(lambda: opened.health.stamp > 0)
    rubbish = np.random.default_rng(7).integers(0, 256, 20_000, dtype=np.uint8).tobytes()
    rubbish = rubbish.replace(b"\x79", b"\x78").replace(b"\x90", b"\x10").replace(b"\x91", b"\x11")
    for at in range(0, len(rubbish), 1000):
        board.say(rubbish[at : at + 1000])
        loop.cycle()
    loop.until(lambda: opened.health.errors > 100)
    assert opened.health.resyncs > 100
    board.pressed = {2}
    board.say(b"\xf7" + board.port_message(0))
    loop.until(lambda: opened.state_arrays["buttons"][0] == 1.0)
    frames = opened.health.frames
    loop.until(lambda: opened.health.frames > frames, 1.0, 1.0)


def test_a_bouncing_button(board, opened):
    loop = Loop(opened)
    seen = []
    for step in range(60):
        if step in (5, 6, 7, 8, 9, 35, 36, 37):  # ends pressed, then released
            board.pressed ^= {2}
            board.say(board.port_message(0))
            until(lambda: waiting(opened.fileno()) >= 3)
        loop.cycle()
        seen.append(opened.state_arrays["buttons"][0])
    edges = np.flatnonzero(np.diff(seen))
    assert len(edges) == 2
    assert seen[20] == 1.0
    assert seen[-1] == 0.0
    assert edges[0] + 1 >= 9 + 2  # 20 ms after the last bounce


@pytest.fixture
def hurried(monkeypatch):
    for name in ("BOOT", "LAST_CALL", "ANSWER"):
        monkeypatch.setattr(identify, name, 0.3)


FEWER = {"capabilities": b"\x7f" + UNO}  # pin 2 can do nothing


@pytest.mark.usefixtures("hurried")
@pytest.mark.parametrize(
    ("board_options", "options", "complaint"),
    [
        ({"chatter": b""}, {"servos": TWO}, "nothing at .* answered Firmata's version query"),
        ({"chatter": b"?\r\n"}, {"servos": TWO}, "isn't a Firmata board: it said 3f 0d 0a"),
        ({"chatter": b"\xf9\x01\x00"}, {"servos": TWO}, "speaks Firmata 1.0"),
        ({"capabilities": OLD}, {"buttons": {"go": {"pin": 2}}}, "it has no pull-ups"),
        (FEWER, {"servos": {"a": servo(2)}}, r"pin 2 \(a\) can't drive a servo.*Pins that can: 3, 4"),
        (FEWER, {"buttons": {"go": {"pin": 2}}}, r"pin 2 \(go\) can't pull up an input"),
    ],
)
def test_a_wrong_board_is_refused_with_what_it_said_and_a_remedy(tmp_path, board_options, options, complaint):
    with ScriptedBoard(tmp_path, **board_options) as board:
        driver = firmata(board.port, **options)
        with pytest.raises(DeviceError, match=complaint) as refusal:
            driver.open()
        assert refusal.value.remedy
        assert not driver.health.connected
        driver.close()


def test_an_old_board_will_do_with_resistors(tmp_path):
    with ScriptedBoard(tmp_path, capabilities=OLD) as board:
        driver = firmata(board.port, buttons={"go": {"pin": 2, "pull_up": False}})
        driver.open()
        assert bytes.fromhex("f4 02 00") in board.seen
        driver.close()


def test_a_board_that_boots_late_is_waited_for(tmp_path):
    with ScriptedBoard(tmp_path) as board:
        board.reading.clear()
        driver = firmata(board.port, servos=TWO)

        def boot():
            board.say(BOOT)
            board.reading.set()

        threading.Timer(0.3, boot).start()
        driver.open()
        driver.read(0)
        assert driver.health.connected
        driver.close()


def test_calls_on_a_board_that_is_not_open():
    driver = firmata("/dev/null", servos=TWO)
    driver.stop(Stop.LIMP)
    driver.close()
    assert driver.fileno() is None
    assert driver.stop_frames(Stop.HOLD) == (b"\xf7",)
    with pytest.raises(DeviceLostError):
        driver.read(0)
