"""`srl calibrate PROFILE servos --panel` with the real driver, a twin and a page in headless Chromium, in real time."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from e2e.test_calibrate_servos import PROFILE, QUICK
from helpers.chromium import Chromium, Page
from helpers.held_up import unless_held_up
from helpers.run import alive, environment, srl
from helpers.srl_twin import TwinProcess
from helpers.wait import until

from srl.commissioning.jog.hold import PAUSE
from srl.control.setpoint.jog import REST
from srl.runtime.contracts.servo_record import ServoRecord
from srl.runtime.ipc.header import CYCLE, State
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.ipc.presses import FRESH, MOVES
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.models import record_file
from srl.runtime.recording.reader import read
from srl.runtime.web.operator.client import OperatorPage

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]  # real time, and a page's own: a busy machine is slow
KEYS = {
    "right": {"key": "ArrowRight", "code": "ArrowRight", "windowsVirtualKeyCode": 39},
    "left": {"key": "ArrowLeft", "code": "ArrowLeft", "windowsVirtualKeyCode": 37},
    ".": {"key": ".", "code": "Period", "windowsVirtualKeyCode": 190},
    ",": {"key": ",", "code": "Comma", "windowsVirtualKeyCode": 188},
}


class Guided:
    """The run, the panel's process, and its page with the control."""

    def __init__(self, folder: Path, run: subprocess.Popen[str], panel: OperatorPage, page: Page) -> None:
        self.folder, self.run, self.panel, self.page = RunFolder(folder / "run" / "tip"), run, panel, page
        self.layout, self.reader = Layout.load(self.folder.layout), RingReader(self.folder.rows)
        self.down = ""

    def says(self, part: str, words: str) -> None:
        shown = f"document.getElementById('{part}').innerText"

        def output() -> bool:
            self.keep_control()
            return words in str(self.page.value(shown))

        until(output, what=lambda: f"'{words}': {self.page.value(shown)}", pause=0.05)

    def keep_control(self) -> None:
        """A page that was silent for 3 s, as on a busy machine, has lost its control, and takes it again."""
        self.page.value("pictureNow.control || document.getElementById('control').click()")

    def able(self, part: str) -> bool:
        """Whether it can be pressed."""
        if part != "control":
            self.keep_control()
        return bool(self.page.value(f"!document.getElementById('{part}').disabled"))

    def click(self, part: str) -> None:
        until(lambda: self.able(part), what=part, pause=0.05)
        self.page.value(f"document.getElementById('{part}').click()")

    def start(self) -> None:
        """Presses until it is granted: a loop that a host under load made late refuses a start for a second."""

        def press() -> None:
            if self.able("start"):
                self.page.value("for (const part of ['start', 'yes']) document.getElementById(part).click()")

        until(lambda: self.state not in (State.STARTING, State.READY), press, what="the start", pause=0.5)

    def hold(self, key: str) -> None:
        """A key goes down, or the one that is held goes up: ""."""
        lapsed = bool(self.down) and not self.page.value("pictureNow.jogging")  # pictures were late: press it anew
        if lapsed or key != self.down:
            self.keep_control()
        if key == self.down and not lapsed:
            return
        if self.down:
            self.page.ask("Input.dispatchKeyEvent", type="keyUp", **KEYS[self.down])
        if key:
            self.page.value("document.getElementById('jog').focus()")
            self.page.ask("Input.dispatchKeyEvent", type="rawKeyDown", **KEYS[key])
        self.down = key

    @property
    def state(self) -> State:
        row = self.reader.newest()
        return State.STARTING if row is None else State(int(row[CYCLE.state]))

    @property
    def applied(self) -> float:
        row = self.reader.newest()
        assert row is not None
        return float(self.layout.value(row, "finger.position_command.applied")[0])

    def passed(self, seconds: float) -> None:
        """Waits until the loop has run for so long, at 100 Hz."""
        seen = self.reader.head
        until(lambda: self.reader.head > seen + 100 * seconds, what="rows")

    def bring(self, to: float) -> None:
        """A person who looks at the page and holds keys, slowly where it is near."""
        self.passed(PAUSE + 0.1)

        def there() -> bool:
            off = to - self.applied
            self.hold("" if abs(off) <= 0.004 else ("left", "right", ",", ".")[(off > 0) + 2 * (abs(off) < 0.1)])
            return abs(off) <= 0.008 and not self.down

        output = "document.body.innerText"
        until(
            there, what=lambda: f"the joint at {to}: {self.applied}, {self.page.value(output)}",
            timeout=120.0, pause=0.02,
        )  # fmt: skip
        self.passed(0.3)

    def rows(self) -> Words:
        return np.array(RingReader(self.folder.rows).take(1 << 20))


@contextmanager
def guided(folder: Path, browser: Chromium) -> Iterator[Guided]:
    (folder / "tip.yaml").write_text(PROFILE.replace("rate: 50", "rate: 100"))
    options = [part for each in QUICK for part in ("--option", each)]
    where = RunFolder(folder / "run" / "tip")
    with TwinProcess(str(folder / "tip.yaml")) as twin:
        command = srl("calibrate", "tip.yaml", "servos", "--panel", "-o", "tip.json", "--record", "tip.rrd", *options)
        run = subprocess.Popen(
            [*command, "--set", f"devices.finger.port={twin.addresses['finger']}"], env=environment(folder), cwd=folder,
            text=True, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        try:
            until(lambda: where.guide_socket.exists() or run.poll() is not None, timeout=200)
            assert run.poll() is None, run.communicate()[0]
            with OperatorPage(where, folder) as panel:
                page = browser.open(panel.address)
                page.ask("Emulation.setFocusEmulationEnabled", enabled=True)
                made = Guided(folder, run, panel, page)
                until(lambda: page.value("globalThis.pictureNow && pictureNow.takes"), what="the jog")
                made.click("control")
                made.start()
                made.says("guide_task", "Move 'flexion_3' until it stands at 0.3 rad")
                made.says("guide_words", "under Jog")
                made.passed(REST + 0.2)
                yield made
        finally:
            if run.poll() is None:
                run.kill()
                run.communicate()


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with Chromium(tmp_path_factory.mktemp("chromium")) as made:
        yield made


def test_a_person_at_the_page_makes_the_file_and_a_key_held_into_the_next_step_moves_nothing(
    tmp_path: Path, browser: Chromium
) -> None:
    unless_held_up(lambda folder: _at_the_page(folder, browser), tmp_path)


def _at_the_page(tmp_path: Path, browser: Chromium) -> None:
    with guided(tmp_path, browser) as made:
        made.bring(0.1)  # there the person sees 0.3
        made.hold("right")
        made.page.value("document.getElementById('guide_on').click()")
        made.says("guide_task", "Leave 'flexion_3' as it is")
        seen = made.applied  # it still brakes
        made.says("guide_task", "POSITIVE side")
        taken = made.applied  # what the key in between moved is in it: it was let go for longer before
        assert abs(made.applied - seen) <= 0.4 * (FRESH + MOVES + 0.1)
        rest = made.applied
        made.passed(0.3)
        assert made.applied == rest
        made.hold("")
        made.bring(-0.2)
        made.click("guide_on")
        made.says("guide_task", "home: hold")
        aim = float(made.page.value("document.getElementById('guide_task').innerText.match(/by ([0-9.]+) rad/)[1]"))
        made.bring(made.applied + aim)
        made.says("guide_on", "Write the file")
        made.hold("right")
        rest = made.applied
        made.passed(0.3)
        assert made.applied == rest  # at the end nothing moves any more
        made.hold("")
        made.click("guide_on")
        made.says("guide_task", "The calibration is done")
        output, _ = made.run.communicate(timeout=60)
    assert made.run.returncode == 0, output
    assert "Traceback" not in output
    line = record_file.read(ServoRecord, tmp_path / "tip.json").joints["flexion_3"]
    assert (line.direction, line.scale, line.known) == (-1, 1.0, False)
    assert line.trim == pytest.approx(-taken - 0.3, abs=0.005)  # the mean of the hold, with the end of its braking
    found = read(tmp_path / "tip.rrd")
    last = float(found.layout.value(found.rows[-1], "finger.position_command.sent")[0])
    assert last == pytest.approx(-(0.4 + line.trim), abs=0.011)  # home, 0.4, is there


@pytest.mark.exhaustive
def test_the_page_is_gone_with_a_held_key_and_the_run_is_ended_by_a_signal(tmp_path: Path, browser: Chromium) -> None:
    with guided(tmp_path, browser) as made:
        loop = [
            int(pid) for pid in Path(f"/proc/{made.run.pid}/task/{made.run.pid}/children").read_text().split()
            if b"srl.runtime.loop" in Path(f"/proc/{pid}/cmdline").read_bytes()
        ]  # fmt: skip
        started = made.applied

        def moves() -> bool:
            made.hold("right")  # again, where pictures were late
            return made.applied > started + 0.1

        until(moves, what="motion", timeout=80.0)
        os.kill(made.panel.pid, signal.SIGKILL)
        dead = time.monotonic_ns()
        made.passed(0.5)
        rows = made.rows()
        press = made.layout.value(rows, "terminal.press")[:, 0]
        fresh = np.flatnonzero((press[1:] != press[:-1]) & (press[1:] > 0)) + 1
        assert rows[fresh[-1], CYCLE.wake] - dead <= FRESH * 1e9
        after = rows[:, CYCLE.now] > rows[fresh[-1], CYCLE.now] + (MOVES + 0.15) * 1e9
        assert after.any()
        assert np.ptp(made.layout.value(rows[after], "finger.position_command.applied")[:, 0]) < 1e-9
        made.run.send_signal(signal.SIGINT)
        output, _ = made.run.communicate(timeout=60)
        assert made.run.returncode == 130, output
        assert "Traceback" not in output
        until(lambda: not any(map(alive, loop)), what="the end of the loop")
        assert State(int(made.rows()[-1][CYCLE.state])) is State.ENDED
    assert not (tmp_path / "tip.json").exists()
