"""The signals that end a run: none is lost, from the first instruction of `srl run` to its last."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.run import environment, srl
from helpers.wait import until

from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.service.end_signals import SIGNALS, EndSignals


@pytest.fixture(autouse=True)
def as_before() -> Iterator[None]:
    """The signals of this process are its own again."""
    handlers = {number: signal.getsignal(number) for number in SIGNALS}
    yield
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", SIGNALS)
def test_one_that_comes_before_there_is_a_run_ends_it(number: signal.Signals) -> None:
    calls: list[str] = []
    with EndSignals() as signals:
        os.kill(os.getpid(), number)
        signals.pass_to(lambda: calls.append("end"))
        assert calls == ["end"]
        os.kill(os.getpid(), number)
        assert calls == ["end", "end"]


def test_one_that_comes_after_the_run_changes_nothing() -> None:
    with EndSignals():
        pass
    os.kill(os.getpid(), signal.SIGTERM)  # would end this process
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_IGN  # which the interpreter's end leaves as it is


def test_after_an_error_they_are_as_before() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(ZeroDivisionError), EndSignals():
        raise ZeroDivisionError
    assert signal.getsignal(signal.SIGTERM) == before


@pytest.mark.parametrize("number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.slow)])
def test_a_run_that_has_just_begun_ends_in_order(tmp_path: Path, number: signal.Signals) -> None:
    process = subprocess.Popen(
        srl("run", "sixth-finger", "--sim", "--set", "bus=null"), env=environment(tmp_path), cwd=tmp_path,
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    folder = RunFolder(tmp_path / "run" / "sixth-finger")
    until(folder.is_claimed, pause=0.0)  # before it has started anything
    process.send_signal(number)
    _, output = process.communicate(timeout=60)
    assert process.returncode == 0, output
    assert "Traceback" not in output
    assert not folder.is_claimed()
