"""The Firmata driver against the real StandardFirmata 2.5, run by simavr; times are the simulated board's."""

import os
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from helpers.firmata import firmata, servo

from srl.drivers.firmata import protocol
from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.contracts.signals import Stop

sys.path.insert(0, str(Path(__file__).parents[1] / "simavr"))
from board import Board

PINS = {"base": 9, "first": 10, "second": 11, "tip": 6}
BUTTONS = {"go": 2, "halt": 3, "up": 4, "down": 5}
TOLERANCE = 1.0  # µs; the Servo library's timer counts halves, and interrupts delay an edge by a few cycles


@pytest.fixture(scope="module")
def board(tmp_path_factory):
    """One board for all tests: booting takes it 2 s. `open` must bring it back from whatever was before."""
    with Board(tmp_path_factory.mktemp("board")) as running:
        yield running
        assert running.time()[1] == 0  # nothing was dropped between the driver and the firmware


@pytest.fixture
def driver(board):
    made = firmata(
        board.port,
        servos={
            "base": servo(9),
            "first": servo(10, reversed=True),
            "second": servo(11, min_us=1000, max_us=2000),
            "tip": servo(6, min_us=1201, max_us=1803, trim_us=-7),
        },
        buttons={name: {"pin": pin} for name, pin in BUTTONS.items()},
    )
    made.open()
    yield made
    made.close()


def run(driver, board, seconds, angles=None):
    """Cycles for some simulated time; yields after each."""
    until = board.time()[0] + seconds
    while board.time()[0] < until:
        now = time.monotonic_ns()
        driver.read(now)
        if angles is not None:
            driver.command_arrays["position_command"][:] = angles
            driver.write(now)
        yield
        time.sleep(0.01)


def cycles(*args):
    for _ in run(*args):
        pass


def pulses(board, pins=None):
    """The pulse widths now, in µs, 0 without pulses: the median of five frames, as interrupts delay some."""
    seen = []
    for _ in range(6):
        board.wait(0.021)
        seen.append([look.last_us if look.max_us else 0.0 for look in map(board.pin, pins or PINS.values())])
    return list(np.median(seen[1:], axis=0))


def test_open_identifies_the_firmware_and_leaves_the_servos_without_pulses(board, driver):
    assert driver.metrics()["firmware"] == "'StandardFirmata.ino' 2.5"
    assert pulses(board) == [0.0] * 4


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.5, 2.7, 3.0])
def test_pulses_are_the_commanded_ones(board, driver, angle):
    angles = np.array([angle, angle, 3.0 - angle, angle])
    cycles(driver, board, 0.2, angles)
    sent = driver.metrics()["pulses_us"]
    assert list(sent.values()) == [
        round(544 + angle * 1856 / 3),
        round(2400 - angle * 1856 / 3),
        round(2000 - angle * 1000 / 3),
        round(1194 + angle * 602 / 3),
    ]
    assert pulses(board) == pytest.approx(list(sent.values()), abs=TOLERANCE)


def test_beyond_the_limits_pulses_stay_at_them(board, driver):
    cycles(driver, board, 0.2, np.full(4, 50.0))
    assert pulses(board) == pytest.approx([2400, 544, 2000, 1796], abs=TOLERANCE)
    # the board's own fence, were the driver's missing: base 544 to 2400, second 1000 to 2000
    os.write(driver.fileno(), protocol.analog_write(11, 2300) + protocol.analog_write(9, 2600))
    assert pulses(board, [11])[0] == pytest.approx(2000, abs=TOLERANCE)
    assert pulses(board, [9])[0] == pytest.approx(2400, abs=TOLERANCE)


def test_a_servo_starts_at_its_first_command(board, driver):
    cycles(driver, board, 0.2, np.full(4, 1.0))
    before = list(driver.metrics()["pulses_us"].values())
    driver.stop(Stop.LIMP)
    cycles(driver, board, 0.05)
    pulses(board)
    cycles(driver, board, 0.2, np.full(4, 2.0))
    for pin, sent in zip(PINS.values(), driver.metrics()["pulses_us"].values(), strict=True):
        seen = board.pin(pin)
        # Between attaching and its value, half a millisecond in a frame of twenty, the Servo library can let
        # out one pulse of its last width (1500 µs after power-up). The protocol has no way around that.
        for width in (seen.min_us, seen.max_us):
            assert min(abs(width - known) for known in (sent, *before, 1500)) < 10


def test_hold_goes_on_with_the_last_pulse_even_when_closed_and_opening_ends_it(board, driver):
    cycles(driver, board, 0.2, np.full(4, 1.0))
    driver.stop(Stop.HOLD)
    cycles(driver, board, 0.1)
    assert pulses(board, [9])[0] == pytest.approx(1163, abs=TOLERANCE)
    driver.close()
    assert pulses(board, [9])[0] == pytest.approx(1163, abs=TOLERANCE)
    driver.open()
    assert pulses(board, [9])[0] == 0.0


def test_limp_detaches_and_a_command_attaches_again_as_often_as_wanted(board, driver):
    for angle in (0.5, 1.0, 2.0):
        cycles(driver, board, 0.2, np.full(4, angle))
        assert pulses(board, [9])[0] == pytest.approx(544 + angle * 1856 / 3, abs=TOLERANCE)
        driver.stop(Stop.LIMP)
        cycles(driver, board, 0.1)
        assert pulses(board) == [0.0] * 4


def test_limp_in_the_middle_of_a_pulse_does_not_leave_a_pin_high(board, driver):
    for step in range(25):  # frames are 20 ms, four pulses fill a quarter: some fall into one
        cycles(driver, board, 0.03 + 0.0013 * step, np.full(4, 2.0))
        driver.stop(Stop.LIMP)
        cycles(driver, board, 0.025)
        assert not any(board.pin(pin).high for pin in PINS.values())


def test_twelve_servos_can_be_made_limp_and_driven_again(board):
    driver = firmata(board.port, servos={f"j{pin}": servo(pin) for pin in range(2, 14)})
    driver.open()
    for angle in (1.0, 2.0):
        cycles(driver, board, 0.3, np.linspace(0.0, angle, 12))
        sent = list(driver.metrics()["pulses_us"].values())
        assert pulses(board, range(2, 14)) == pytest.approx(sent, abs=TOLERANCE)
        driver.stop(Stop.LIMP)
        cycles(driver, board, 0.1)
    driver.close()


# Every way to cut a message short, with the values of a pulse of 2000 µs that must not stay.
WHOLE = [
    protocol.analog_write(9, 2000),
    protocol.extended_analog_write(9, 2000),
    protocol.servo_config(9, 544, 2400) + protocol.analog_write(9, 2000),
    protocol.set_pin_mode(2, protocol.Mode.PULL_UP),
    protocol.report_digital(0, True),
]
CUT = sorted({message[:size] for message in WHOLE for size in range(1, len(message))})


@pytest.mark.slow
@pytest.mark.parametrize("category", [Stop.HOLD, Stop.LIMP])
def test_the_stop_frame_is_obeyed_after_any_message_that_was_cut_short(board, driver, category):
    for cut in CUT:
        cycles(driver, board, 0.07, np.array([1.0, 2.0, 1.5, 0.5]))
        sent = list(driver.metrics()["pulses_us"].values())
        assert None not in sent
        os.write(driver.fileno(), cut + driver.stop_frames(category)[0])
        expected = [0.0] * 4 if category is Stop.LIMP else sent
        board.wait(0.02)
        assert pulses(board) == pytest.approx(expected, abs=TOLERANCE), cut.hex(" ")
        driver.stop(Stop.LIMP)
        cycles(driver, board, 0.02)


def test_every_edge_of_every_button_is_seen_while_the_servos_move(board, driver):
    rounds = 4
    edges = dict.fromkeys(BUTTONS, 0)
    before = driver.state_arrays["buttons"].copy()
    for turn in range(rounds):
        for column, (name, pin) in enumerate(BUTTONS.items()):
            for change, level in ((board.press, 1.0), (board.release, 0.0)):
                change(pin)
                deadline = time.monotonic() + 5
                while driver.state_arrays["buttons"][column] != level:
                    assert time.monotonic() < deadline, f"{name} doesn't become {level}"
                    for _ in run(driver, board, 0.02, np.full(4, 1.0 + 0.1 * (turn + level))):
                        now = driver.state_arrays["buttons"]
                        for i, other in enumerate(edges):
                            edges[other] += int(np.isfinite(before[i]) and now[i] != before[i])
                        before = now.copy()
    assert edges == dict.fromkeys(BUTTONS, 2 * rounds)


@pytest.mark.slow
def test_a_bounce_shorter_than_the_debounce_time_is_no_press(board, driver):
    cycles(driver, board, 0.05)
    board.press(2)
    board.wait(0.004)
    board.release(2)
    for _ in run(driver, board, 0.1):
        assert driver.state_arrays["buttons"][0] == 0.0


@pytest.mark.slow
def test_a_board_that_resets_itself_is_lost_and_comes_back(board, driver):
    cycles(driver, board, 0.2, np.full(4, 1.0))
    board.tell("reset")
    with pytest.raises(DeviceLostError, match="restarted by itself"):
        cycles(driver, board, 6.0, np.full(4, 1.0))
    assert pulses(board) == [0.0] * 4
    driver.close()
    driver.open()
    assert driver.health.reconnects == 1
    cycles(driver, board, 0.2, np.full(4, 1.0))
    assert pulses(board, [9])[0] == pytest.approx(1163, abs=TOLERANCE)
