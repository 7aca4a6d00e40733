"""Remarks never hold up whoever says them: a stopped terminal, a pipe that nobody reads, the journal."""

from __future__ import annotations

import os
import pty
import shlex
import socket
import subprocess
import termios
from pathlib import Path

import pytest
from helpers.run import srl

from srl.runtime.cli.console import Console
from srl.runtime.ipc.events import Level


def test_a_remark_is_a_line(capfd: pytest.CaptureFixture[str]) -> None:
    with open(os.dup(2), "w") as stream:
        console = Console(stream)
        console.say("the glove is back", Level.INFO)
        console.say("odd \ud800 text", Level.WARNING)
        console.say("'\x1b[2J.rrd' is deleted\nand so on", Level.INFO)
    assert capfd.readouterr().err == (
        "srl: the glove is back\nsrl: warning: odd \\ud800 text\nsrl: '\\x1b[2J.rrd' is deleted\nand so on\n"
    )


def test_a_terminal_stopped_with_ctrl_s_blocks_nobody() -> None:
    master, slave = pty.openpty()
    with open(slave, "w") as stream:
        console = Console(stream)
        assert console.terminal
        termios.tcflow(slave, termios.TCOOFF)  # what Ctrl-S does
        for _ in range(100):
            console.say("x" * 1000)
        assert console.dropped > 0
        termios.tcflow(slave, termios.TCOON)
    os.close(master)


def test_a_pipe_that_nobody_reads_blocks_nobody() -> None:
    read, write = os.pipe()
    with open(write, "w") as stream:
        console = Console(stream)
        for _ in range(1000):
            console.say("x" * 1000)
        assert console.dropped > 500
        os.close(read)
        console.say("nobody is there")  # and no SIGPIPE's exception either


def test_the_journal_gets_fields(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("JOURNAL_STREAM", "1:2")
    address = tmp_path / "journal"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as journal, open(os.dup(2), "w") as stream:
        journal.bind(str(address))
        console = Console(stream, str(address))
        console.fields = {"SRL_STATE": "stopped", "SRL_CAUSE": "intent_loss"}
        console.say("lost glove\nits cable is out", Level.WARNING)
        entry = journal.recv(4096).decode()
    fields = dict(line.split("=", 1) for line in entry.splitlines())
    assert fields["MESSAGE"] == "lost glove | its cable is out"
    assert (fields["PRIORITY"], fields["SRL_STATE"], fields["SRL_CAUSE"]) == ("4", "stopped", "intent_loss")
    assert capfd.readouterr().err == ""


def test_without_a_journal_the_line_is_written(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("JOURNAL_STREAM", "1:2")
    with open(os.dup(2), "w") as stream:
        Console(stream, "/nowhere/journal").say("here")
    assert capfd.readouterr().err == "srl: warning: here\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("into", "code", "output"), [("| true", 0, ""), ("> /dev/full", 2, "no room left on the disk")]
)
def test_an_output_that_takes_nothing_is_no_traceback(into: str, code: int, output: str) -> None:
    line = f"set -o pipefail; {shlex.join(srl('list'))} {into}"
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False)
    assert done.returncode == code
    assert (output in done.stderr) if output else done.stderr == ""
