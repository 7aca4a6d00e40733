"""`srl calibrate PROFILE servos` on a terminal of its own, with the real driver and a twin, in real time."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from helpers.run import alive, call, environment, srl
from helpers.srl_twin import TwinProcess
from helpers.wait import until

from srl.control.setpoint.jog import REST
from srl.drivers.firmata.config import FirmataConfig
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.servo_record import ServoRecord
from srl.runtime.ipc.header import CYCLE, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.models import record_file
from srl.runtime.recording.reader import read

pytestmark = pytest.mark.slow

PROFILE = """
name: tip
summary: one servo of a finger
rate: 50
devices:
  finger:
    driver: firmata
    port: /dev/ttyACM0
    servos:
      flexion_3: {pin: 10, lower: -1.571, upper: 1.571, home: 0.4}
setpoints:
  client.position: {shape: [1], unit: rad, labels: [flexion_3], max_age: 0.5}
controllers:
  - use: joint-setpoint
    joints: [flexion_3]
    in: {target: client.position}
    out: {q: finger.position_command, q_velocity: finger.position_command.velocity}
guard:
  finger.position_command: {lower: -1.0, upper: 1.2, velocity: 1.0, acceleration: 10.0}
stop: {finger: hold}
frames: {hand: {}, finger: {parent: hand, position: [0.0, 0.3, 0.3]}}
sim:
  world: cell
  parts: {finger: {part: robotic-finger}}
"""
RIGHT, LEFT = b"\x1b[C", b"\x1b[D"
TAKE = "import fcntl, os, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0); os.execv(sys.argv[1], sys.argv[1:])"
QUICK = ("speed=0.4", "settle=0.2", "hold=0.3", "first=0.3")


class Calibrating:
    """The command on a pty, whose rows are read from the run folder."""

    def __init__(self, folder: Path, port: str) -> None:
        self.folder = RunFolder(folder / "run" / "tip")
        self.terminal, theirs = pty.openpty()
        options = [part for each in QUICK for part in ("--option", each)]
        command = srl("calibrate", "tip.yaml", "servos", "-o", "tip.json", "--record", "tip.rrd", *options)
        self.process = subprocess.Popen(
            [sys.executable, "-c", TAKE, *command, "--set", f"devices.finger.port={port}"],
            env=environment(folder), cwd=folder, stdin=theirs, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            text=True, start_new_session=True,
        )  # fmt: skip
        os.close(theirs)
        os.set_blocking(self.terminal, False)
        self.screen = b""

    def step(self) -> None:
        """Reads what is on the screen: a terminal that nobody reads fills up."""
        assert self.process.poll() is None, self.process.communicate()
        try:
            self.screen = (self.screen + os.read(self.terminal, 65536))[-4000:]
        except BlockingIOError:
            pass
        time.sleep(0.002)

    def until(self, condition: Callable[[], object], what: str) -> None:
        until(condition, self.step, what=what)

    def sees(self, text: str) -> None:
        self.screen = b""
        self.until(lambda: text.encode() in self.screen, text)

    def type(self, data: bytes) -> None:
        os.write(self.terminal, data)

    def started(self) -> None:
        self.sees("s start")
        self.layout = Layout.load(self.folder.layout)
        self.reader = RingReader(self.folder.rows)
        self.screen, task = b"", b"Move 'flexion_3' until it stands at 0.3 rad"
        due = 0.0

        def press() -> None:
            """Again, as a person does: a loop that a host under load made late refuses a start for a second."""
            nonlocal due
            self.step()
            row = self.reader.newest()
            if time.monotonic() >= due and row is not None and row[CYCLE.state] == State.READY:
                due = time.monotonic() + 0.5
                self.type(b"s")

        until(lambda: task in self.screen, press, what=lambda: f"the task: {self.screen!r}")
        started = self.reader.head
        self.until(lambda: self.reader.head > started + 50 * REST + 20, "time in which no key is held")

    @property
    def applied(self) -> float:
        row = self.reader.newest()
        assert row is not None
        return float(self.layout.value(row, "finger.position_command.applied")[0])

    def bring(self, to: float) -> None:
        """A person who looks at the screen and holds keys."""

        def there() -> bool:
            off = to - self.applied
            if abs(off) > 0.008 and time.monotonic() > self.next:
                near = abs(off) < 0.05
                self.type((b"." if near else RIGHT) if off > 0 else (b"," if near else LEFT))
                self.next = time.monotonic() + (0.3 if near else 0.04)
            return abs(off) <= 0.008

        self.next = time.monotonic() + 1.0
        until(there, self.step, what=f"the joint at {to}", timeout=120.0)

    @property
    def loop(self) -> int:
        """The process id of the loop: that child which isn't the recorder."""
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        found = [int(pid) for pid in children if b"srl.runtime.loop" in Path(f"/proc/{pid}/cmdline").read_bytes()]
        return found[0]

    def hang_up(self) -> None:
        os.close(self.terminal)
        self.terminal = -1

    def ended(self, code: int) -> str:
        end = time.monotonic() + 60.0
        while self.process.poll() is None and time.monotonic() < end:
            try:
                os.read(self.terminal, 65536)
            except OSError:
                pass
            time.sleep(0.01)
        _, output = self.process.communicate(timeout=60)
        assert self.process.returncode == code, (self.process.returncode, output)
        assert "Traceback" not in output
        return str(output)


@contextmanager
def calibrating(folder: Path) -> Iterator[Calibrating]:
    (folder / "tip.yaml").write_text(PROFILE)
    with TwinProcess(str(folder / "tip.yaml")) as twin:
        made = Calibrating(folder, twin.addresses["finger"])
        try:
            yield made
        finally:
            if made.process.poll() is None:
                os.killpg(made.process.pid, signal.SIGKILL)
                made.process.communicate()
            if made.terminal >= 0:
                os.close(made.terminal)


def test_a_person_at_the_keys_makes_the_file_and_leaves_the_limb_at_its_new_home(tmp_path: Path) -> None:
    with calibrating(tmp_path) as run:
        run.started()
        run.bring(0.1)  # there the person sees 0.3
        run.type(b"\r" + RIGHT * 20)  # while it is taken no key moves it
        run.sees("POSITIVE side")
        first = run.applied
        assert abs(first - 0.1) <= 0.01
        run.bring(-0.2)  # so the joint turns the other way than the profile says
        run.type(b"\r")
        run.sees("home: hold")
        run.bring(first - 0.1)  # trim is -first - 0.3 in the angle turned round: 0.4 is there
        run.sees("Enter write it")
        run.type(RIGHT * 20)
        run.type(b"\r")
        run.ended(0)
    record = record_file.read(ServoRecord, tmp_path / "tip.json")
    assert not record.simulated
    line = record.joints["flexion_3"]
    assert (line.direction, line.scale, line.known) == (-1, 1.0, False)
    assert line.trim == pytest.approx(-0.4, abs=0.01)
    found = read(tmp_path / "tip.rrd")
    last = float(found.layout.value(found.rows[-1], "finger.position_command.sent")[0])
    config = {"port": "x", "servos": {"flexion_3": line.entry | {"home": 0.4}}}
    before = FirmataConfig.model_validate(config)
    after = FirmataConfig.model_validate(config | {"calibration": KeptFile.read(tmp_path / "tip.json")})
    left = before.servos["flexion_3"].calibration.pulse(last)
    begins = after.joints["flexion_3"].calibration.pulse(0.4)
    assert abs(left - begins) <= 7  # us: 0.01 rad and a rounding
    assert abs(before.servos["flexion_3"].calibration.pulse(0.4) - begins) > 200
    call(tmp_path, "check", "tip.yaml", "--set", "devices.finger.calibration=tip.json")


ENDS: dict[str, tuple[Callable[[Calibrating], object], int | None]] = {
    "q": (lambda run: run.type(b"q"), 2),
    "hangup": (lambda run: run.hang_up(), None),
    "focus lost": (lambda run: run.type(b"\x1b[O"), 2),
    "killed": (lambda run: run.process.kill(), -9),
}


@pytest.mark.sampled(1)  # tests/commissioning/jog has each end
@pytest.mark.parametrize("end", ENDS)
def test_what_ends_in_the_middle_brakes_and_writes_nothing(end: str, tmp_path: Path) -> None:
    act, code = ENDS[end]
    with calibrating(tmp_path) as run:
        run.started()
        loop = run.loop
        run.bring(0.3)
        for _ in range(5):
            run.type(RIGHT)
            run.until(lambda at=run.reader.head: run.reader.head > at + 1, "a row")
        act(run)
        if code is None:
            until(lambda: run.process.poll() is not None, what="the end")
        else:
            run.ended(code)
        until(lambda: not alive(loop), what="the end of the loop")
        rows = RingReader(run.folder.rows).take(1 << 20)
        assert State(int(rows[-1][CYCLE.state])) is State.ENDED
        pressed = np.flatnonzero(run.layout.value(rows, "terminal.press")[:, 0] > 0)[-1]
        after = run.layout.value(rows[pressed:], "finger.position_command.applied")[:, 0]
        assert np.ptp(after) <= 0.4 * 0.3  # rad: a press' 0.12 s, and braking
    assert not (tmp_path / "tip.json").exists()
