"""`srl find-port --ask DRIVER`: who is at a port, asked in the driver's protocol of twins that speak it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from helpers.peer import make

from srl.drivers.feetech import opening
from srl.runtime.cli import main
from srl.runtime.service import serial_ports
from srl.runtime.service.serial_ports import Guess, SerialPort
from srl.runtime.testing.twin_bench import TwinBench
from srl.sim.devices.examples import DEVICES

WHO = {
    "cyberglove": "a right glove with 22 sensors, settings ",
    "dynamixel": "with 57600 baud and protocol 2 there are: 1 (MX-64 (model number 311))",
    "feetech": "1000000 baud, id 1: STS3215 (model number 777)",
    "firmata": "the firmware 'StandardFirmata.ino' 2.5",
    "softhand": "a SoftHand with id 1",
}


@contextmanager
def twin(driver: str) -> Iterator[TwinBench]:
    """The twin of a driver's example, and time that passes."""
    config, options, world, port = DEVICES[driver]
    order: dict[str, Any] = {"driver": driver, "config": {"port": port} | config, "options": options}
    with TwinBench.of(make(order | {"world": world, "seed": 3})[2]) as bench, bench.serving():
        yield bench


@pytest.mark.parametrize("driver", WHO)
def test_who_is_there_is_said_in_a_line(driver: str, capsys: pytest.CaptureFixture[str]) -> None:
    with twin(driver) as bench:
        assert main(["find-port", "--ask", driver, "--port", bench.address]) == 0
        assert f"{bench.address}: {WHO[driver]}" in capsys.readouterr().out


def test_asking_sets_nothing_and_moves_nothing() -> None:
    with twin("feetech") as bench:
        before = [bytes(servo.memory) for servo in bench.twin.servos]
        assert main(["find-port", "--ask", "feetech", "--port", bench.address]) == 0
        changed = [
            at
            for servo, memory in zip(bench.twin.servos, before, strict=True)
            for at, (old, new) in enumerate(zip(memory, servo.memory, strict=True))
            if old != new and at < 56  # from 56 on are what it measures
        ]
        assert changed == []


def test_somebody_else_s_answer_is_no_answer(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opening, "SCAN", 0.02)
    with twin("cyberglove") as bench:
        assert main(["find-port", "--json", "--ask", "feetech", "--port", bench.address]) == 1
        output = capsys.readouterr()
        assert json.loads(output.out) == {"driver": "feetech", "answers": {bench.address: None}}
        assert "no servo of this kind answers a ping" in output.err
        assert "Traceback" not in output.err


def test_without_a_port_those_that_may_be_it_are_asked(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def there(path: str, driver: str) -> SerialPort:
        guess = Guess(driver, "", exact=True)
        return SerialPort(path, None, None, "1a86:55d3", None, None, None, (guess,), None, None)

    with twin("feetech") as bench:
        found = [there(bench.address, "feetech"), there("/dev/never-opened", "dynamixel")]
        monkeypatch.setattr(serial_ports, "ports", lambda: found)
        assert main(["find-port", "--ask", "feetech"]) == 0
        assert capsys.readouterr().out == f"{bench.address}: {WHO['feetech']}\n"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--ask", "feetch"], "no driver is called 'feetch'"),
        (["--ask", "panda"], "driver 'panda' can't ask who is at a port. These can: bno085, cyberglove"),
        (["--ask", "feetech"], "no port here may be feetech's by its USB numbers. Name one with --port PORT"),
        (["--ask", "feetech", "--wait"], "doesn't go with --wait"),
        (["--port", "/dev/ttyUSB0"], "goes with --ask DRIVER"),
    ],
)
def test_what_can_t_be_asked_is_refused(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serial_ports, "ports", list)
    assert main(["find-port", *arguments]) == 2
    assert words in capsys.readouterr().err
