"""Vibration motors of a Firmata board: levels to duties, off in every stop, against the real firmware in simavr."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.firmata import ScriptedBoard, firmata, servo
from helpers.wait import until
from pydantic import ValidationError

from srl.drivers.firmata import Firmata
from srl.drivers.firmata.config import FirmataConfig, MotorConfig
from srl.runtime.contracts.signals import Kind, Stop

sys.path.insert(0, str(Path(__file__).parents[1] / "simavr"))
from board import Board

MOTORS = {"wrist": {"pin": 5, "start": 0.25, "full": 0.75}, "elbow": {"pin": 6}}
OFF = b"\xf7" + b"\xf4\x05\x01" + b"\xf5\x05\x00" + b"\xf4\x06\x01" + b"\xf5\x06\x00"  # outputs, low


@pytest.mark.parametrize(
    ("level", "duty"), [(0.0, 0), (0.001, 0), (0.01, 65), (0.5, 128), (1.0, 191), (2.0, 191), (-1.0, 0)]
)
def test_a_level_above_0_begins_where_the_motor_turns(level: float, duty: int) -> None:
    assert MotorConfig.model_validate(MOTORS["wrist"]).drive.pulse(level) == duty


@pytest.mark.parametrize(
    ("board", "words"),
    [
        ({"motors": {"wrist": {"pin": 7}}}, "pin 7 has no PWM"),
        ({"motors": {"wrist": {"pin": 5, "start": 0.8, "full": 0.6}}}, "start .0.8. must be less than full"),
        ({"motors": {"wrist": {"pin": 5, "start": 0.5, "full": 0.501}}}, "by 0.05 at least"),
        ({"motors": MOTORS, "servos": {"base": servo(9)}}, "a board of their own"),
        ({"motors": MOTORS, "buttons": {"go": {"pin": 5}}}, "pin 5 is used twice"),
        ({"motors": {"wrist": {"pin": 5, "duty": 1.5}}}, "less than or equal to 1"),
    ],
)
def test_boards_that_cant_be_are_refused(board: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        FirmataConfig.model_validate({"port": "/dev/null", **board})


@pytest.fixture
def board(tmp_path: Path) -> Iterator[ScriptedBoard]:
    with ScriptedBoard(tmp_path) as running:
        yield running


@pytest.fixture
def driver(board: ScriptedBoard) -> Iterator[Firmata]:
    made = firmata(board.port, motors=MOTORS)
    made.open()
    yield made
    made.close()


def send(driver: Firmata, *levels: float) -> None:
    """Cycles until the board has taken these levels."""

    def cycle() -> None:
        driver.read(time.monotonic_ns())
        driver.command_arrays["intensity_command"][:] = levels
        driver.write(time.monotonic_ns())

    until(lambda: driver.health.unsent == 0 and np.allclose(driver.sent_arrays["intensity_command"], levels), cycle)


def test_it_declares_an_intensity_that_only_goes_off(driver: Firmata) -> None:
    (command,) = driver.commands
    assert (command.kind, command.stops, command.unseen) == (Kind.INTENSITY, (Stop.OFF,), False)
    assert command.labels == ("wrist", "elbow")


def test_levels_reach_the_board_as_duties(board: ScriptedBoard, driver: Firmata) -> None:
    send(driver, 0.5, 0.25)
    until(lambda: bytes((0xE6, 64, 0)) in board.seen)
    assert bytes((0xF4, 5, 3)) in board.seen  # PWM
    assert bytes((0xE5, 128 & 0x7F, 1)) in board.seen


@pytest.mark.parametrize("category", list(Stop))
def test_every_stop_and_the_frames_for_the_loops_death_are_off(
    board: ScriptedBoard, driver: Firmata, category: Stop
) -> None:
    send(driver, 1.0, 1.0)
    assert driver.stop_frames(category) == (OFF,)
    board.seen.clear()
    driver.stop(category)
    until(lambda: bytes((0xF5, 6, 0)) in board.seen)
    assert bytes((0xF5, 5, 0)) in board.seen
    send(driver, 0.0, 0.5)  # and they can go on
    until(lambda: bytes((0xE6, 0, 1)) in board.seen)


def test_what_is_no_number_is_off(board: ScriptedBoard, driver: Firmata) -> None:
    send(driver, 1.0, 1.0)
    board.seen.clear()
    driver.command_arrays["intensity_command"][:] = np.nan

    def cycle() -> None:
        driver.read(time.monotonic_ns())
        driver.write(time.monotonic_ns())

    until(lambda: bytes((0xE5, 0, 0)) in board.seen and bytes((0xE6, 0, 0)) in board.seen, cycle)


def test_closing_is_off(board: ScriptedBoard) -> None:
    driver = firmata(board.port, motors=MOTORS)
    driver.open()
    send(driver, 1.0, 1.0)
    board.seen.clear()
    driver.close()
    until(lambda: bytes((0xF5, 6, 0)) in board.seen)


@pytest.mark.slow
def test_the_real_firmware_gives_these_duties_and_its_stop_frame_ends_them(tmp_path: Path) -> None:
    def share(pin: int) -> float:
        """Of the time that it is high; an output that never changes is at its level."""
        real.wait(0.02)
        real.pin(pin)
        real.wait(0.02)
        look = real.pin(pin)
        return look.last_us / period if look.pulses and look.max_us else float(look.high)

    period = 1024.0  # us, of timer 0
    with Board(tmp_path) as real:
        driver = firmata(real.port, motors=MOTORS)
        driver.open()
        for wrist, elbow in ((0.5, 0.25), (1.0, 0.75), (0.1, 1.0)):
            send(driver, wrist, elbow)
            assert share(5) == pytest.approx(
                MotorConfig.model_validate(MOTORS["wrist"]).drive.pulse(wrist) / 255, abs=0.01
            )
            assert share(6) == pytest.approx(elbow, abs=0.01)
        link = driver._link
        assert link is not None
        link.write_all(b"".join(driver.stop_frames(Stop.OFF)), 1.0)  # as the supervisor does it
        until(lambda: share(5) == share(6) == 0.0)
        driver.close()
