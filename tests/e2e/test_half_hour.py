"""From an empty folder to a finger that follows a calibrated hand: every command of docs/half-hour.md, on twins.

The twins stand for unboxed hardware: the glove's sensors have gains and offsets that nobody knows, and the hand in it
makes the nine shapes of the calibration in their order, then opens and closes.
"""

from __future__ import annotations

import json
import os
import pty
import re
import select
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from helpers import ROOT
from helpers.glove_calibration import GAIN, NAMES, OFFSET
from helpers.run import environment, srl
from helpers.srl_twin import TwinProcess
from helpers.wait import until

from srl.commissioning.calibration.glove.shapes import LAST, Angles, shapes
from srl.runtime.ipc.header import State
from srl.runtime.recording.reader import read

PAGE = ROOT / "docs" / "half-hour.md"
FIRST = 100.0  # s for which the hand is flat at first: until the calibration has begun
HELD = 9.0  # s for which it keeps each further shape
MOVES = 0.8  # s from one to the next
AFTER = 400.0  # s in which the hand opens and closes, once the shapes are over
PERSON = "P07"

pytestmark = [pytest.mark.slow, pytest.mark.exhaustive]  # five minutes of a simulated person, at a person's pace


def hand(path: Path) -> None:
    """Writes what the hand does: the shapes, then it opens and closes every 4 s."""
    every = shapes(Angles())
    rows = [(0.0, {})]
    for number in range(1, LAST + 1):
        started = rows[-1][0] + MOVES
        held = FIRST if number == 1 else HELD
        rows += [(started, every[number].angles), (started + held, every[number].angles)]
    fist, started = every[2].angles, rows[-1][0]
    for i in range(round(AFTER / 4)):
        rows += [(started + 4 * i + 2, {name: 0.6 * angle for name, angle in fist.items()}), (started + 4 * i + 4, {})]
    lines = [",".join(["time", *NAMES])]
    lines += [",".join(str(x) for x in (t, *(angles.get(name, 0.0) for name in NAMES))) for t, angles in rows]
    path.write_text("\n".join(lines) + "\n")


def seconds_active(text: str) -> float:
    """As the line of a run on a terminal has it."""
    found = re.findall(r"ACTIVE\s+([0-9.]+) s", text)
    return float(found[-1]) if found else 0.0


class Lab:
    """A folder of a person's own; what was typed there, and how long each command took."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.environment = folder, environment(folder)
        self.log: list[tuple[str, float]] = []

    def types(self, line: str, code: int = 0) -> str:
        """Runs a command to its end. Returns what it printed."""
        started = time.monotonic()
        done = subprocess.run(
            srl(*line.split()[1:]), env=self.environment, cwd=self.folder, capture_output=True, text=True,
            stdin=subprocess.DEVNULL, check=False, timeout=110,
        )  # fmt: skip
        self.log.append((line, time.monotonic() - started))
        assert done.returncode == code, f"{line}: exit {done.returncode}\n{done.stdout}\n{done.stderr}"
        return done.stdout + done.stderr

    @contextmanager
    def terminal(self, line: str) -> Iterator[Terminal]:
        """A command on a terminal of its own; it must have ended at the end of the `with`."""
        started = time.monotonic()
        with Terminal(srl(*line.split()[1:]), self) as terminal:
            yield terminal
            terminal.until(lambda: terminal.process.poll() is not None, "its end")
        self.log.append((line, time.monotonic() - started))
        assert terminal.process.returncode == 0, terminal.text[-3000:]


class Terminal:
    """A command on a pty."""

    def __init__(self, command: list[str], lab: Lab) -> None:
        self._master, theirs = pty.openpty()
        self.process = subprocess.Popen(
            command, env=lab.environment | {"COLUMNS": "100", "LINES": "40"}, cwd=lab.folder,
            stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True,
        )  # fmt: skip
        os.close(theirs)
        self.text = ""

    def step(self) -> None:
        if select.select([self._master], [], [], 0.02)[0]:
            try:
                self.text += os.read(self._master, 65536).decode(errors="replace")
            except OSError:
                time.sleep(0.02)  # it has ended

    def until(self, condition: Callable[[], object], what: str, timeout: float = 110.0) -> None:
        until(condition, self.step, timeout=timeout, what=lambda: f"{what}\n{self.text[-2000:]}")

    def type(self, text: str) -> None:
        os.write(self._master, text.encode())

    def __enter__(self) -> Terminal:
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        os.close(self._master)


@pytest.fixture
def lab(tmp_path: Path) -> Lab:
    return Lab(tmp_path)


@pytest.mark.timeout(400)
def test_from_an_empty_folder_to_a_calibrated_finger_that_follows_the_hand(
    lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SRL_RUNTIME_DIR", lab.environment["SRL_RUNTIME_DIR"])
    monkeypatch.setenv("STATE_DIRECTORY", lab.environment["STATE_DIRECTORY"])
    folder = lab.folder
    (folder / "ports").mkdir()
    hand(folder / "hand.csv")
    hidden = {n: {"gain": float(GAIN[i]), "offset": float(OFFSET[i])} for i, n in enumerate(NAMES[:19])}
    unboxed = f"sim.devices.glove.characteristic={json.dumps(hidden)}"
    hardware = ("sixth-finger", "--link", str(folder / "ports"), "--wearer", str(folder / "hand.csv"), "--set", unboxed)

    with TwinProcess(*hardware):
        lab.types("srl find-port")
        lab.types("srl new my-finger --from sixth-finger --port glove=ports/glove --port finger=ports/finger")
        lab.types("srl check my-finger.yaml")
        assert "finger" in lab.types("srl show my-finger.yaml")
        with lab.terminal("srl jog my-finger.yaml") as jog:
            jog.until(lambda: "s start" in jog.text, "the limb is ready")  # servos without feedback wait for a person
            jog.type("s")
            jog.until(lambda: "active" in jog.text, "motion may begin")
            jog.type("q")

    with TwinProcess(*hardware):  # the hand's shapes begin with the twin
        with lab.terminal(f"srl calibrate my-finger.yaml glove --person {PERSON} -o p07.json") as glove:
            glove.until(lambda: "All shapes are done" in glove.text, "the last shape", 250.0)
            glove.type("\n")
        profile = folder / "my-finger.yaml"
        profile.write_text(profile.read_text().replace("sensors: 22", "sensors: 22, calibration: p07.json"))
        lab.types("srl check my-finger.yaml")
        with lab.terminal("srl run my-finger.yaml --set start=manual --record first.rrd") as run:
            run.until(lambda: "ready" in run.text, "the limb is ready")
            lab.types("srl start")
            run.until(lambda: seconds_active(run.text) > 14.0, "motion")
            lab.types("srl stop --exit")
        assert PERSON in lab.types("srl recordings")  # the glove is calibrated for this person

    recording = read(folder / "first.rrd")
    active = recording.int("state") == State.ACTIVE
    layout, rows = recording.layout, recording.rows[active]
    bent = layout.value(rows, "glove.position")[:, layout.fields["glove.position"].labels.index("index_pij")]
    closes = 0.6 * Angles().pij
    assert bent.min() == pytest.approx(0.0, abs=0.06)
    assert bent.max() == pytest.approx(closes, abs=0.06)
    sent = layout.value(rows, "finger.position_command.sent")
    apart = np.median(sent[bent > 0.8 * closes], axis=0) - np.median(sent[bent < 0.2 * closes], axis=0)
    most = int(np.argmax(np.abs(apart)))  # the joint that closes most with the hand
    print(f"the finger's joints move by {np.round(apart, 2)} rad between the open and the closed hand")
    assert abs(apart[most]) > 0.15
    assert np.sign(apart[most]) * np.corrcoef(bent, sent[:, most])[0, 1] > 0.6
    for line, seconds in lab.log:
        print(f"{seconds:6.1f} s  {re.sub('/tmp[^ ]*', '', line)}")
