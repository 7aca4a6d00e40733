"""Vibration motors: intensities to duties, off after every stop, whatever is lost on the way."""

from __future__ import annotations

import random
from typing import Any

import numpy as np
import pytest
from helpers.motor_board import MOTORS, MotorBoard, Rig, keep, vibration_motors
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from srl.drivers.vibration_motors import VibrationMotors, VibrationMotorsConfig, driver
from srl.drivers.vibration_motors.config import MotorConfig
from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.contracts.signals import Kind, Stop

OFF = b"\xf7" + b"\xf4\x05\x01" + b"\xf5\x05\x00" + b"\xf4\x06\x01" + b"\xf5\x06\x00"  # outputs, low


@pytest.mark.parametrize(
    ("intensity", "duty"),
    [(0.0, 0), (0.001, 0), (0.01, 65), (0.5, 128), (1.0, 191), (2.0, 191), (-1.0, 0), (float("nan"), 0)],
)
def test_an_intensity_above_0_begins_where_the_motor_turns(intensity: float, duty: int) -> None:
    assert MotorConfig.model_validate(MOTORS["wrist"]).duty_of(intensity) == duty


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"motors": {"wrist": {"pin": 7}}}, "has PWM at the pins 3, 5, 6, 9, 10, 11"),
        ({"motors": {"wrist": {"pin": 5, "start": 0.8, "full": 0.6}}}, "start .0.8. must be less than full"),
        ({"motors": {"wrist": {"pin": 5, "start": 0.5, "full": 0.501}}}, "by 0.05 at least"),
        ({"motors": {"wrist": {"pin": 5}, "elbow": {"pin": 5}}}, "pin 5 is used twice, by wrist and elbow"),
        ({"motors": {"wrist": {"pin": 5, "duty": 1.5}}}, "less than or equal to 1"),
        ({"motors": {}}, "at least 1"),
    ],
)
def test_boards_that_cant_be_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        VibrationMotorsConfig.model_validate({"port": "/dev/null", **options})


@pytest.fixture
def board(monkeypatch: pytest.MonkeyPatch) -> MotorBoard:
    made = MotorBoard()
    monkeypatch.setattr(driver, "open_transport", lambda *_, **__: made)
    return made


@pytest.fixture
def motors(board: MotorBoard) -> VibrationMotors:
    made = vibration_motors()
    made.open()
    return made


@pytest.fixture
def rig(motors: VibrationMotors, board: MotorBoard) -> Rig:
    return Rig(motors, board)


def test_it_declares_an_intensity_that_only_goes_off(motors: VibrationMotors) -> None:
    (command,) = motors.commands
    assert (command.kind, command.stops, command.unseen) == (Kind.INTENSITY, (Stop.OFF,), False)
    assert command.labels == ("wrist", "elbow")
    assert not motors.home


def test_intensities_reach_the_board_as_duties_and_are_confirmed(board: MotorBoard, rig: Rig) -> None:
    rig.run(0.1, 0.5, 0.25)
    assert (board.pwm[5], board.pwm[6]) == (128, 64)
    assert rig.driver.sent_arrays["intensity_command"].tolist() == [0.5, 0.25]
    assert rig.age < 0.1
    assert rig.driver.health.errors == 0
    rig.run(5.0, 0.5, 0.25)  # and go on being asked for
    assert rig.age < 0.1


def test_a_board_that_isnt_active_stays_fresh_and_off(board: MotorBoard, rig: Rig) -> None:
    rig.run(2.0)
    assert rig.age < 0.1
    assert not board.on


@pytest.mark.parametrize("category", list(Stop))
def test_every_stop_and_the_frames_for_the_loops_death_are_off(board: MotorBoard, rig: Rig, category: Stop) -> None:
    rig.run(0.1, 1.0, 1.0)
    assert rig.driver.stop_frames(category) == (3 * OFF,)
    rig.driver.stop(category)
    assert not board.on
    rig.run(0.1, 0.0, 0.5)  # and they can go on
    assert (board.pwm[5], board.pwm[6]) == (0, 128)


def test_the_stop_frame_ends_a_message_that_was_cut_short(board: MotorBoard, rig: Rig) -> None:
    rig.run(0.1, 1.0, 1.0)
    board.firmware.receive(b"\xf0\x6d")
    board.firmware.receive(b"".join(rig.driver.stop_frames(Stop.OFF)))
    assert not board.on


def test_what_is_no_number_is_off(board: MotorBoard, rig: Rig) -> None:
    rig.run(0.1, 1.0, 1.0)
    rig.run(0.1, np.nan, np.nan)
    assert not board.on


def test_closing_is_off(board: MotorBoard, rig: Rig) -> None:
    rig.run(0.1, 1.0, 1.0)
    rig.driver.close()
    assert not board.on


def mute(_: bytes) -> bytes:
    return b""


def test_a_board_whose_answers_dont_arrive_takes_every_lower_duty_and_becomes_stale(
    board: MotorBoard, rig: Rig
) -> None:
    rig.run(0.1, 1.0, 1.0)
    board.answered = mute
    rig.run(0.06, 1.0, 1.0)
    rig.cycle(1.0, 0.2)
    assert board.pwm[6] == 51
    rig.cycle(0.0, 0.0)
    assert not board.on
    rig.run(0.6, 0.0, 0.0)
    assert rig.driver.max_age is not None
    assert rig.age > rig.driver.max_age


def test_a_stop_reaches_a_board_whose_answers_dont_arrive(board: MotorBoard, rig: Rig) -> None:
    rig.run(0.1, 1.0, 1.0)
    board.answered = mute
    rig.run(0.3, 1.0, 1.0)
    rig.driver.stop(Stop.OFF)
    assert not board.on


def test_an_off_that_is_lost_is_repeated(board: MotorBoard, rig: Rig) -> None:
    rig.run(0.1, 1.0, 1.0)
    board.heard = mute
    rig.driver.stop(Stop.OFF)
    assert board.on
    board.heard = keep
    rig.run(0.3)  # the loop reads on; it doesn't call `stop` again
    assert not board.on


def test_a_duty_that_is_lost_is_sent_again(board: MotorBoard, rig: Rig) -> None:
    rig.run(0.1, 1.0, 1.0)
    board.heard = lambda data: data.replace(b"\xe6\x00\x00", b"\xe6\x00")
    rig.cycle(1.0, 0.0)
    board.heard = keep
    rig.run(0.1, 1.0, 0.0)
    assert board.pwm[6] == 0


@pytest.mark.parametrize("late", [0, 4_000_000, 22_000_000, 80_000_000])
@pytest.mark.parametrize("hz", [100, 1000])
@pytest.mark.parametrize("count", [1, 6])
def test_a_board_that_answers_late_is_none_that_is_wrong(board: MotorBoard, late: int, hz: int, count: int) -> None:
    """A grip that is let go lowers the duty in each cycle, also while an answer is on its way."""
    motors = {f"m{pin}": {"pin": pin} for pin in (3, 5, 6, 9, 10, 11)[:count]}
    made = vibration_motors(motors=motors)
    made.open()
    rig = Rig(made, board, 10**9 // hz)
    rig.run(0.2, *[1.0] * count)
    board.late = late
    for k in range(2 * hz):
        rig.cycle(*[abs(1.0 - k / hz)] * count)
        assert rig.age < 0.3
    assert made.metrics()["unconfirmed"] == 0


@pytest.mark.parametrize("late", [0.2, 0.4, 0.6])
def test_a_confirmation_is_as_old_as_its_question(board: MotorBoard, rig: Rig, late: float) -> None:
    board.late = round(late * 1e9)
    rig.run(3.0)
    assert late <= rig.age + 0.011 < late + 0.2
    rig.run(2.0, 0.5, 0.5)
    assert late <= rig.age + 0.011 < late + 0.2


@pytest.mark.parametrize("missing", range(16))
def test_a_tap_is_felt_whichever_byte_of_an_answer_is_lost(board: MotorBoard, rig: Rig, missing: int) -> None:
    rig.run(0.1, 0.0, 0.0)
    board.answered = lambda data: data[:missing] + data[missing + 1 :]
    rig.cycle(0.0, 0.0)
    on = 0
    for k in range(30):
        board.answered = board.answered if k < 3 else keep
        rig.cycle(*[1.0 if k < 10 else 0.0] * 2)
        on += board.pwm[5] > 0 and board.pwm[6] > 0
    assert on == 10


def test_a_board_that_doesnt_do_what_it_is_commanded_is_lost(board: MotorBoard, rig: Rig) -> None:
    rig.run(0.1, 0.0, 0.0)
    board.heard = lambda data: data.replace(b"\xe6", b"\xe9")
    with pytest.raises(DeviceLostError, match="don't do what they are commanded"):
        rig.run(1.0, 0.0, 1.0)
    assert not rig.driver.health.connected


def test_a_board_that_restarts_is_lost(board: MotorBoard, rig: Rig) -> None:
    rig.run(0.1, 1.0, 1.0)
    board.restart()
    with pytest.raises(DeviceLostError, match="motors are off"):
        rig.cycle(1.0, 1.0)
    rig.driver.open()
    assert rig.driver.health.reconnects == 1


def test_a_restart_whose_banner_is_damaged_is_noticed(board: MotorBoard, rig: Rig) -> None:
    rig.run(0.1, 1.0, 1.0)
    board.restart(banner=b"\xf9\x02")
    board.heard = mute  # while it boots
    rig.run(1.0, 1.0, 1.0)
    assert rig.driver.max_age is not None
    assert rig.age > rig.driver.max_age
    board.heard = keep
    rig.run(0.3, 1.0, 1.0)
    assert (board.pwm[5], board.pwm[6]) == (191, 255)  # its pins have their modes again
    assert rig.driver.metrics()["unconfirmed"] or rig.age < 0.1


@given(st.integers(0, 2**32), st.lists(st.tuples(*[st.sampled_from([0.0, 0.1, 0.6, 1.0])] * 2), min_size=1, max_size=9))
@settings(max_examples=40, deadline=None)
def test_whatever_was_lost_a_stop_over_a_link_that_is_whole_again_ends_it(
    seed: int, levels: list[tuple[float, float]]
) -> None:
    rng = random.Random(seed)

    def lose(data: bytes) -> bytes:
        return bytes(byte for byte in data if rng.random() > 0.1)

    board = MotorBoard()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(driver, "open_transport", lambda *_, **__: board)
        made = vibration_motors()
        made.open()
    rig = Rig(made, board)
    board.heard = board.answered = lose
    try:
        for each in levels:
            rig.run(0.2, *each)
        made.stop(Stop.OFF)
        rig.run(0.1)
        board.heard = board.answered = keep
        rig.run(1.0)
    except DeviceLostError:
        board.heard = board.answered = keep
        made.close()  # the loop does, before it opens the device again
    assert not board.on
