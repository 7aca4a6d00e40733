"""`srl jog --panel` and the panel beside it, as two processes: a held jog ends by itself, whatever dies on the way."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from helpers.chromium import Chromium, Page
from helpers.run import call, environment, srl
from helpers.wait import until

from srl.commissioning.jog.profile_subset import RAMP
from srl.control.setpoint.jog import REST
from srl.runtime.ipc.header import CYCLE, State
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.ipc.presses import FRESH, MOVES
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.web.operator.client import OperatorPage

pytestmark = pytest.mark.slow
KEYS = [{"key": name, "code": name, "windowsVirtualKeyCode": n} for name, n in (("ArrowRight", 39), ("ArrowLeft", 37))]


class Jogged:
    """The run, the panel's process, and its page with the control."""

    def __init__(self, folder: Path, run: subprocess.Popen[str], panel: OperatorPage, page: Page) -> None:
        self.folder, self.run, self.panel, self.page = RunFolder(folder / "run" / "servo-jog"), run, panel, page
        self.layout, self.reader = Layout.load(self.folder.layout), RingReader(self.folder.rows)
        self.key = KEYS[0]  # the one that is pressed

    def moving(self) -> None:
        """Holds a key until the joint has moved at its full speed for a while.

        On a machine so busy that the page falls silent the key counts no more, and the control may end. A person would
        take it again, and press again; the other key, as the joint may be at its end.
        """
        for k in range(10):
            last, self.key = k == 9, KEYS[k % 2]
            until(self.has_control, pause=2.0, timeout=60)
            seen = self.reader.head
            until(lambda seen=seen: self.reader.head > seen + 100 * REST + 20, what="time in which no key is held")
            self.page.value("document.getElementById('jog').focus()")
            self.page.ask("Input.dispatchKeyEvent", type="rawKeyDown", **self.key)
            started = self.reader.head
            most = started + (1 << 40 if last else 300)
            until(lambda most=most: self._moves() or self.reader.head > most, what="motion")
            if self._moves():
                return
            self.page.ask("Input.dispatchKeyEvent", type="keyUp", **self.key)

    def has_control(self) -> bool:
        """Whether the page has it; if not, it is asked for."""
        if "Hold" in str(self.page.value("document.getElementById('jog_words').innerText")):
            return True
        self.page.value("pictureNow.control || document.getElementById('control').click()")
        return False

    def _moves(self) -> bool:
        return bool((np.abs(self.speed(self.rows()[-40:])) > 0.09).sum() > 20)

    def rows(self) -> Words:
        return np.array(RingReader(self.folder.rows).take(1 << 20))

    def speed(self, rows: Words) -> np.ndarray:
        """rad/s of the first joint, as applied, in each row but the first."""
        q = self.layout.value(rows, "finger.position_command.applied")[:, 0]
        return np.diff(q) / (np.diff(rows[:, CYCLE.now]) / 1e9)

    def checked(self, dead: int, state: State = State.ACTIVE) -> None:
        """The joint has come to rest after `dead`, CLOCK_MONOTONIC ns, in time, while the run goes on."""
        seen = self.reader.head
        until(lambda: self.reader.head > seen + 60)
        rows = self.rows()
        press = self.layout.value(rows, "terminal.press")[:, 0]
        fresh = np.flatnonzero((press[1:] != press[:-1]) & (press[1:] > 0)) + 1
        # No press is taken that is older than it may be; the loop asks that after it woke.
        assert rows[fresh[-1], CYCLE.wake] - dead <= FRESH * 1e9
        # It moves the joint for so long, by the loop's own clock, and the ramp to rest follows.
        now = rows[:, CYCLE.now]
        still = now[1:] > now[fresh[-1]] + (MOVES + 2 * RAMP + 0.03) * 1e9
        assert still.any()
        assert np.abs(self.speed(rows)[still]).max() < 1e-6
        assert State(int(rows[-1, CYCLE.state])) is state


@contextmanager
def jogged(folder: Path, browser: Chromium) -> Iterator[Jogged]:
    command = srl("jog", "servo-jog", "--sim", "--panel", "--confirm")
    run = subprocess.Popen(
        command, env=environment(folder), cwd=folder, text=True, stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    where = RunFolder(folder / "run" / "servo-jog")
    try:
        until(lambda: where.press_socket.exists() or run.poll() is not None, timeout=60)
        assert run.poll() is None, run.communicate()[0]
        with OperatorPage(where, folder) as panel:
            page = browser.open(panel.address)
            page.ask("Emulation.setFocusEmulationEnabled", enabled=True)
            until(lambda: page.value("pictureNow.takes"))
            until(lambda: not page.value("document.getElementById('control').disabled"))
            made = Jogged(folder, run, panel, page)
            until(made.has_control, pause=2.0, timeout=60)
            yield made
    finally:
        run.send_signal(signal.SIGINT)
        output, _ = run.communicate(timeout=60)
    assert run.returncode == 0, output
    assert "Traceback" not in output


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with Chromium(tmp_path_factory.mktemp("chromium")) as made:
        yield made


def killed(jogged: Jogged) -> None:
    os.kill(jogged.panel.pid, signal.SIGKILL)


def hung(jogged: Jogged) -> None:
    os.kill(jogged.panel.pid, signal.SIGSTOP)


def crashed(jogged: Jogged) -> None:
    jogged.page.close()


def let_go(jogged: Jogged) -> None:
    jogged.page.ask("Input.dispatchKeyEvent", type="keyUp", **jogged.key)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("end", [killed, hung, crashed, let_go])
def test_a_held_jog_ends_with_whatever_ends_it(
    tmp_path: Path, browser: Chromium, end: Callable[[Jogged], None]
) -> None:
    with jogged(tmp_path, browser) as made:
        made.moving()
        try:
            end(made)
            made.checked(time.monotonic_ns())
        finally:
            if end is hung:
                os.kill(made.panel.pid, signal.SIGCONT)
        if end is hung:  # what waited is too old, and a key that is still held must be pressed again
            until(lambda: made.page.value("pictureNow.condition") == "live")
            seen = made.reader.head
            until(lambda: made.reader.head > seen + 30)
            assert np.abs(made.speed(made.rows()[-30:])).max() < 1e-6


def test_a_stop_and_a_reset_on_the_page_and_a_key_held_through_them(tmp_path: Path, browser: Chromium) -> None:
    with jogged(tmp_path, browser) as made:
        made.moving()
        made.page.key("Escape", "Escape", 27)
        until(lambda: State(int(made.rows()[-1, CYCLE.state])) is State.STOPPED)
        until(lambda: made.page.value("!document.getElementById('reset').disabled"))
        for button in ("reset", "yes"):
            made.page.value(f"document.getElementById('{button}').click()")
        until(lambda: State(int(made.rows()[-1, CYCLE.state])) is State.ACTIVE)
        seen = made.reader.head
        until(lambda: made.reader.head > seen + 30)
        assert np.abs(made.speed(made.rows()[-30:])).max() < 1e-6
        call(tmp_path, "stop", "servo-jog")


def test_without_the_option_the_panel_says_who_has_the_keys(tmp_path: Path) -> None:
    done = call(tmp_path, "jog", "servo-jog", "--sim", code=2)  # no terminal here
    assert "terminal" in done.stderr
