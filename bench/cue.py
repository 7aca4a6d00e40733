"""How late a contact is felt, and how soon the motors are off when the loop dies: `third-thumb` on twins, in real time.

The times are of one clock: when the loop read the sample with the contact, and when the twin of the motors' board had
the new duty. The twin looks at its port a thousand times a second.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

import numpy as np

from bench.pairs import QUICK, Row
from srl.recordings import read
from srl.runtime.contracts.errors import SrlError
from srl.runtime.ipc.header import CYCLE, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder

SECONDS: Final = 60.0  # of contacts, two a second
DEATHS: Final = 10
TIMEOUT: Final = 60.0  # s
_CONTACTS: Final = ["sim.devices.toes.period=0.5"]
_LIGHT: Final = "controllers.0.threshold=0.0001"  # all is a contact: the motor is on when the loop dies
_SRL: Final = [sys.executable, "-m", "srl"]


def run() -> list[Row]:
    """Contacts in one run, then runs whose loop is killed while the motor is on."""
    quick = QUICK in os.environ
    late = _contacts(15.0 if quick else SECONDS)
    dead = [_death() for _ in range(3 if quick else DEATHS)]
    return [
        _row(f"contact to the motor's duty, {len(late)} contacts, median", float(np.median(late)), "at most 10", 10.0),
        _row("the same, p99", float(np.percentile(late, 99)), "at most 10", 10.0),
        _row(f"loop killed to the motor off, worst of {len(dead)}", max(dead), "at most 50", 50.0),
    ]


def _row(what: str, ms: float, aim: str, most: float) -> Row:
    return Row(
        id="cue", what=what, ours=round(ms, 2), other=most, other_name="the aim", ratio=round(ms / most, 3),
        control=None, unit="ms", aim=aim, holds=ms <= most,
    )  # fmt: skip


def _contacts(seconds: float) -> list[float]:
    """ms from the sample in which each contact begins to the first duty after it."""
    with tempfile.TemporaryDirectory() as folder:
        where = Path(folder)
        with _twins(where, []) as command:
            command += ["--duration", str(seconds), "--record", str(where / "run.rrd")]
            subprocess.run(
                [*_SRL, *command], env=_env(where), check=True, capture_output=True, timeout=seconds + TIMEOUT
            )
        recording = read(where / "run.rrd")
        sent = recording.value("cuff.intensity_command")[:, 0]
        begins = np.flatnonzero((sent[1:] >= 0.99) & (sent[:-1] == 0.0)) + 1
        read_at = recording.rows[begins, CYCLE.wake]
        log = np.load(where / "twin.npz")
        on = log["cuff.duty_ns"][log["cuff.duty"] > 0]
        return [float(on[on >= at][0] - at) / 1e6 for at in read_at.tolist() if (on >= at).any()]


def _death() -> float:
    """ms from the loop's SIGKILL to the motor off."""
    with tempfile.TemporaryDirectory() as folder:
        where = Path(folder)
        with _twins(where, [_LIGHT]) as command:
            process = subprocess.Popen(
                [*_SRL, *command], env=_env(where), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
            )
            try:
                loop = _active(where)
                time.sleep(0.5)  # into a contact
                killed = time.monotonic_ns()
                os.kill(loop, signal.SIGKILL)
                process.wait(TIMEOUT)
            finally:
                process.kill()
                process.wait()
        log = np.load(where / "twin.npz")
        at, duty = log["cuff.duty_ns"], log["cuff.duty"]
        before = duty[at < killed]
        if not before.size or before[-1] == 0:
            raise RuntimeError("the motor was off when the loop was killed")
        off = at[(at >= killed) & (duty == 0)]
        return float(off[0] - killed) / 1e6


@contextmanager
def _twins(where: Path, more: list[str]) -> Iterator[list[str]]:
    """The twins meanwhile, which log; gives the command of a run on them."""
    given = [word for value in ["feedback=cuff", *_CONTACTS, *more] for word in ("--set", value)]
    command = [*_SRL, "twin", "third-thumb", *given, "--json", "--log", str(where / "twin.npz")]
    process = subprocess.Popen(command, env=_env(where), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    try:
        yield [*json.loads(process.stdout.readline())["run"], "--json"]
    finally:
        process.terminate()
        process.communicate(timeout=TIMEOUT)


def _env(where: Path) -> dict[str, str]:
    return {**os.environ, "SRL_RUNTIME_DIR": str(where / "run"), "XDG_STATE_HOME": str(where / "state")}


def _active(where: Path) -> int:
    """Waits until the limb follows, and returns the number of the loop's process."""
    folder, end = RunFolder(where / "run" / "third-thumb"), time.monotonic() + TIMEOUT
    while time.monotonic() < end:
        time.sleep(0.05)
        with suppress(OSError, SrlError, ValueError):
            layout = Layout.from_json(folder.layout.read_text(), "layout")
            reader = RingReader(folder.rows, marks=True, width=layout.width)
            try:
                row = reader.newest()
                if row is not None and layout.header(row, "state") == State.ACTIVE:
                    return _loop()
            finally:
                reader.close()
    raise RuntimeError("the limb doesn't follow")


def _loop() -> int:
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            words = path.read_bytes().split(b"\0")
            if b"srl.runtime.loop" in words and b"third-thumb" in path.read_bytes():
                return int(path.parent.name)
    raise RuntimeError("there is no loop")
