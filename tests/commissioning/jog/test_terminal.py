"""`srl jog` on a terminal of its own (a pty), in real time: keys, stops, and what becomes of the limb without it."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from helpers.run import alive, call, environment, srl
from helpers.wait import until

from srl.control.setpoint.jog import HOLD, REST
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import CYCLE, Cause, Latch, State
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder

pytestmark = pytest.mark.slow

RIGHT, LEFT = b"\x1b[C", b"\x1b[D"
# The pty becomes the terminal that controls the session: so its loss is a hangup, and Ctrl-Z a signal.
TAKE = "import fcntl, os, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0); os.execv(sys.argv[1], sys.argv[1:])"
CONTROLLED = [sys.executable, "-c", TAKE]
APPLIED = "finger.position_command.applied"
LATE = ("intent_loss terminal", "overrun")  # faults that a host under load makes: the keys or the loop come late
AGAIN = 0.5  # s after which a key that had no effect is pressed again


class Jogging:
    """The command on a pty, whose rows are read from the run folder."""

    def __init__(self, folder: Path, alone: bool, arguments: Sequence[str]) -> None:
        """`alone`: the messages go to the terminal, too, as a person has it."""
        self.folder = RunFolder(folder / "run" / "servo-jog")
        self.terminal, theirs = pty.openpty()
        self.process = subprocess.Popen(
            [*CONTROLLED, *srl("jog", "servo-jog", "--sim", *arguments)], env=environment(folder), cwd=folder,
            stdin=theirs, stdout=subprocess.PIPE, stderr=theirs if alone else subprocess.PIPE, text=True,
            start_new_session=True,
        )  # fmt: skip
        os.close(theirs)
        os.set_blocking(self.terminal, False)
        self.screen = b""
        self.output = ""

    def step(self) -> None:
        """Reads what is on the screen: a terminal that nobody reads fills up."""
        assert self.process.poll() is None, self.process.communicate()
        try:
            self.screen = (self.screen + os.read(self.terminal, 65536))[-20000:]
        except BlockingIOError:
            pass
        time.sleep(0.002)

    def until(self, condition: Callable[[], object], what: str) -> None:
        until(condition, self.step, what=what)

    def started(self) -> None:
        self.until(lambda: b"active" in self.screen, "the screen")
        self.layout = Layout.load(self.folder.layout)
        self.reader = RingReader(self.folder.rows)
        self.until(lambda: self.state is State.ACTIVE, "motion may begin")
        started = self.reader.head
        self.until(lambda: self.reader.head > started + 100 * REST + 20, "time in which no key is held")  # at 100 Hz

    @property
    def row(self) -> Words:
        row = self.reader.newest()
        assert row is not None
        return row

    @property
    def state(self) -> State:
        return State(int(self.row[CYCLE.state]))

    @property
    def latches(self) -> Latch:
        return Latch(int(self.row[CYCLE.latches]))

    def type(self, data: bytes) -> None:
        os.write(self.terminal, data)

    def ask(self, key: bytes, condition: Callable[[], object], what: str) -> None:
        """Presses a key until it is granted, as a person does.

        A loop that a host under load made late answers too late, or refuses a start and a reset for that second.
        """

        def press() -> None:
            nonlocal due
            self.step()
            if time.monotonic() >= due:
                due = time.monotonic() + AGAIN
                self.type(key)

        due = 0.0
        until(condition, press, what=lambda: f"{what}: {self.screen[-2000:]!r}")

    def hold(self, data: bytes, presses: int) -> None:
        """A key that is held: each repeat follows once its press has arrived."""
        for _ in range(presses):
            self.reader.take()
            before = self.pressed([self.row])
            seen: list[Words] = []
            self.type(data)
            self.until(lambda seen=seen, b=before: seen.extend(self.reader.take()) or self.pressed(seen) > b, "a press")

    def pressed(self, rows: Sequence[Words]) -> float:
        """The number of the newest press in these rows."""
        return max((float(self.layout.value(row, "terminal.press")[0]) for row in rows), default=0.0)

    def taken(self) -> Words:
        """All rows."""
        return np.array(RingReader(self.folder.rows).take(1 << 20))

    def ended(self, *codes: int) -> None:
        """Waits for the end, with one of the codes; by default without a fault, but for one by a host under load."""
        end = time.monotonic() + 30.0
        while self.process.poll() is None and time.monotonic() < end:
            try:
                os.read(self.terminal, 65536)
            except OSError:
                pass
            time.sleep(0.01)
        out, output = self.process.communicate(timeout=10)
        self.output = output or ""
        well = (0, 1) if any(f"({fault})" in self.output for fault in LATE) else (0,)
        assert self.process.returncode in (codes or well), (self.process.returncode, out, self.output)
        assert "Traceback" not in self.output

    @property
    def loop(self) -> int:
        """The process id of the loop."""
        (found,) = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        return int(found)

    def hang_up(self) -> None:
        os.close(self.terminal)
        self.terminal = -1


@contextmanager
def jogging(folder: Path, *arguments: str, alone: bool = False) -> Iterator[Jogging]:
    made = Jogging(folder, alone, arguments)
    try:
        yield made
    finally:
        if made.process.poll() is None:
            os.killpg(made.process.pid, signal.SIGKILL)
            made.process.communicate()
        if made.terminal >= 0:
            os.close(made.terminal)


def brakes(layout: Layout, rows: Words) -> float:
    """s of the loop's time from the row that saw the last press to the last row in which the command changed."""
    press = layout.value(rows, "terminal.press")[:, 0]
    commanded: Array = layout.value(rows, APPLIED)
    now = rows[:, CYCLE.now]
    last = int(np.flatnonzero(press == np.nanmax(press))[0])
    moved = np.flatnonzero(np.abs(np.diff(commanded, axis=0)).max(axis=1) > 0.0)
    return float(now[moved[-1] + 1] - now[last]) / 1e9


def test_keys_move_and_stop_and_reset(tmp_path: Path) -> None:
    with jogging(tmp_path, "--set", "start=manual") as run:
        run.type(RIGHT)  # before it takes the keys: it counts for nothing
        run.until(lambda: b"s start" in run.screen, "the screen")
        run.ask(b"s", lambda: b"active" in run.screen, "the start")
        run.started()
        rows = run.taken()
        assert np.ptp(run.layout.value(rows, APPLIED)[10:], axis=0).max() == 0.0
        run.hold(RIGHT, 20)
        run.until(lambda: not float(run.layout.value(run.row, "terminal.press")[0]), "no press")
        place = float(run.layout.value(run.row, APPLIED)[0])
        assert place > HOLD * 0.1  # more than one tap
        run.type(b" ")
        run.until(lambda: run.state is State.STOPPED and run.latches & Latch.PERSON, "the stop")
        run.type(RIGHT * 3)
        run.until(lambda: b"latched: person" in run.screen, "the stop on the screen")
        still = len(run.taken())
        run.until(lambda: len(run.taken()) > still + 50, "rows of the stop")
        stopped = run.taken()[still:]
        assert np.ptp(run.layout.value(stopped, APPLIED), axis=0).max() == 0.0
        run.ask(b"r", lambda: run.state is State.ACTIVE, "the reset")
        run.type(b"\x1b")
        run.until(lambda: run.state is State.STOPPED, "the stop by Esc")
        run.type(b"q")
        run.ended()
        assert "q was pressed" in run.output
        rows = run.taken()
        velocity = np.diff(run.layout.value(rows, APPLIED)[:, 0])
        assert velocity.max() <= 0.1 * 0.01 * 1.01 * max(1, int(rows[:, CYCLE.dt].max() / 1e7))


ENDS: dict[str, tuple[Callable[[Jogging], object], str]] = {
    "end of input": (lambda run: run.type(b"\x04"), "the input has ended"),
    "hangup": (lambda run: run.hang_up(), ""),
    "suspended": (lambda run: run.type(b"\x1a"), "about to be suspended"),
    "focus lost": (lambda run: run.type(b"\x1b[O"), "lost the focus"),
    "Ctrl-C": (lambda run: run.type(b"\x03"), ""),
    "terminated": (lambda run: run.process.terminate(), ""),
}


@pytest.mark.sampled(4)
@pytest.mark.parametrize("end", ENDS)
def test_the_loss_of_the_terminal_brakes_and_ends(end: str, tmp_path: Path) -> None:
    act, words = ENDS[end]
    with jogging(tmp_path, alone=end == "hangup") as run:
        run.started()
        run.hold(RIGHT, 5)
        act(run)
        run.ended()
        assert words in run.output
        rows = run.taken()
        assert State(int(rows[-1][CYCLE.state])) is State.ENDED
        assert brakes(run.layout, rows) < 0.3
        assert not RunFolder(run.folder.path).is_claimed()


def test_a_terminal_process_that_is_frozen_moves_nothing_more(tmp_path: Path) -> None:
    with jogging(tmp_path) as run:
        run.started()
        run.hold(RIGHT, 5)
        os.kill(run.process.pid, signal.SIGSTOP)
        until(lambda: run.state is State.STOPPED, what="the stop by the loop itself")
        assert Cause(int(run.row[CYCLE.cause])) is Cause.INTENT_LOSS
        assert brakes(run.layout, run.taken()) < 0.3
        os.kill(run.process.pid, signal.SIGCONT)
        run.type(b"q")
        run.ended(1)


def test_the_death_of_the_loop_and_of_the_terminals_process_ends_it(tmp_path: Path) -> None:
    with jogging(tmp_path) as run:
        run.started()
        os.kill(run.loop, signal.SIGKILL)
        run.ended(1)
        assert "find the cause before the next run" in run.output
    with jogging(tmp_path) as run:
        run.started()
        loop = run.loop
        run.hold(RIGHT, 5)
        run.process.kill()
        until(lambda: not alive(loop), what="the end of the loop")
        assert State(int(run.row[CYCLE.state])) is State.ENDED
        assert brakes(run.layout, run.taken()) < 0.3
        run.process.communicate()


def test_one_instance_runs_once(tmp_path: Path) -> None:
    with jogging(tmp_path) as run:
        run.started()
        done = call(tmp_path, "run", "servo-jog", "--sim", code=2)
        assert "it is running already" in done.stderr
        with jogging(tmp_path) as other:
            until(lambda: other.process.poll() is not None)
            _, output = other.process.communicate()
            assert "it is running already" in output
            assert other.process.returncode == 2
        run.type(b"q")
        run.ended()
