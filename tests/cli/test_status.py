"""The status line of `srl run`."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from helpers.bus import layout
from helpers.wait import until

from srl.runtime.cli import main
from srl.runtime.cli.console import Console
from srl.runtime.cli.status import Status, working
from srl.runtime.ipc.events import Level
from srl.runtime.ipc.header import CYCLE, Cause, Latch, State
from srl.runtime.ipc.ring import RingReader, RingWriter
from srl.runtime.service.summary import Summary


def test_it_says_what_keeps_the_stop(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    made = layout("sixth-finger", 100)
    with RingWriter.create(tmp_path / "rows.ring", made.width, 8) as ring:
        words = np.zeros(made.width, np.int64)
        words[[CYCLE.state, CYCLE.cause, CYCLE.fault_source]] = State.STOPPED, Cause.REQUEST, -1
        words[CYCLE.latches] = Latch.PERSON | Latch.FAULT
        ring.append(words)
        summary = Summary(made, RingReader(tmp_path / "rows.ring"))
        summary.update()
        Status(Console(sys.stderr)).show(summary)
    assert "STOPPED  (request) latched: person, fault" in capfd.readouterr().err


class Screen:
    """A terminal, and what a command has written on it."""

    def __init__(self) -> None:
        self._master, slave = pty.openpty()
        self.stream = os.fdopen(slave, "w")

    def text(self) -> str:
        self.stream.flush()
        output = b""
        while select.select([self._master], [], [], 0)[0]:
            output += os.read(self._master, 4096)
        return output.decode()

    def close(self) -> None:
        self.stream.close()
        os.close(self._master)


@pytest.fixture
def screen() -> Iterator[Screen]:
    made = Screen()
    yield made
    made.close()


def test_what_goes_on_before_the_first_row_is_shown_on_a_terminal_and_taken_away(screen: Screen) -> None:
    status = Status(Console(screen.stream))
    status.wait("the devices are opened, 3 s")
    assert "the devices are opened, 3 s" in screen.text()
    status.line("a message", Level.WARNING)
    assert screen.text().startswith("\r\x1b[2Ksrl: warning: a message")
    status.clear()
    assert screen.text() == "\r\x1b[2K"
    status.clear()
    assert screen.text() == ""


def test_no_sign_of_life_without_a_terminal_or_beside_json(screen: Screen, capfd: pytest.CaptureFixture[str]) -> None:
    Status(Console(sys.stderr)).wait("the devices are opened")
    with working("it is replayed"):
        pass
    assert capfd.readouterr().err == ""
    Status(Console(screen.stream), quiet=True).wait("the devices are opened")
    assert screen.text() == ""


def test_a_command_at_work_says_so_on_a_terminal(screen: Screen, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", screen.stream)
    monkeypatch.setenv("TERM", "xterm")
    output = ""

    def more() -> str:
        nonlocal output
        output += screen.text()
        return output

    with working("run.rrd is replayed"):
        until(lambda: "run.rrd is replayed" in more())
    assert more().endswith("\x1b[2K")  # the line is taken away


@pytest.mark.parametrize("arguments", [["replay", "none.rrd"], ["export", "none.rrd", "--bvh", "out.bvh"]])
def test_replay_and_export_are_at_work_while_they_read(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shown: list[str] = []

    @contextlib.contextmanager
    def noted(text: str) -> Iterator[None]:
        shown.append(text)
        yield
        shown.append("whole")

    monkeypatch.setattr(f"srl.runtime.cli.{arguments[0]}.working", noted)
    assert main(arguments) == 2  # there is no such recording: it was looked for while the sign was there
    assert shown == [f"none.rrd is {arguments[0]}ed"]


@pytest.mark.slow
def test_a_run_shows_on_a_terminal_that_it_begins(tmp_path: Path) -> None:
    master, slave = pty.openpty()
    environment = os.environ | {"SRL_RUNTIME_DIR": str(tmp_path / "run"), "SRL_STATE_DIR": str(tmp_path / "state")}
    command = [sys.executable, "-m", "srl", "run", "finger-jog", "--sim", "--duration", "1.5"]
    run = subprocess.Popen(command, env=environment, stderr=slave, stdout=subprocess.DEVNULL)
    os.close(slave)
    output = b""
    with contextlib.suppress(OSError):  # the other side is closed
        while data := os.read(master, 4096):
            output += data
    os.close(master)
    assert run.wait(100) == 0, output
    text = output.decode()
    assert text.index("finger-jog: its parts are put together") < text.index("finger-jog: the devices are opened, 0 s")
    assert text.index("the devices are opened") < text.index("ACTIVE")
