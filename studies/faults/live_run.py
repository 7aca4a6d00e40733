"""A run of `srl` as its users start it, in folders of its own: for faults of processes and of the host."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.errors import HostError
from srl.runtime.ipc.child import end_with_parent
from srl.runtime.ipc.header import CYCLE
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder

SRL: list[str] = [sys.executable, "-m", "srl"]  # a test puts a program here in which something is broken
NAME: Final = "trial"
TIMEOUT: Final = 60.0  # s
PAUSE: Final = 0.005  # s between two looks
PROCESSES: Final = ("loop", "bus", "recorder")


class LiveRun:
    """`srl run PROFILE --sim` in the background; whatever is left of it ends with the `with`.

    Attributes:
        folder: holds its run folder, its state and its recording.
        run_folder: of the instance.
        process: the supervisor.
        out, err: what it has said, once it has ended.
    """

    def __init__(self, profile: str, overrides: list[str], small: str = "", room: str = "1m") -> None:
        """
        Args:
            profile: its name.
            overrides: as `--set` takes them.
            small: "record" or "run": this folder is a file system of its own, in memory, as large as `room`.
        """
        # Short, for the sockets' paths, and in memory where the host has that.
        base = Path("/dev/shm") if os.access("/dev/shm", os.W_OK) else None
        self.folder = Path(tempfile.mkdtemp(prefix="srl-", dir=base))
        for name in ("run", "record"):
            (self.folder / name).mkdir()
        self.run_folder = RunFolder(self.folder / "run" / NAME)
        self.recording = self.folder / "record" / "trial.rrd"
        words = [word for override in overrides for word in ("--set", override)]
        command = [*SRL, "run", profile, "--sim", "--json", "--instance", NAME, "--record", str(self.recording), *words]
        if small:
            # Whoever sleeps keeps the file system after the run, for what is in it.
            keep = f"sleep 600 </dev/null >/dev/null 2>&1 & echo $! > {self.folder}/keeper"
            mount = f'mount -t tmpfs -o size={room} tmpfs "$0" && {{ {keep}; exec "$@"; }}'
            command = ["unshare", "-m", "sh", "-c", mount, str(self.folder / small), *command]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True,
            start_new_session=True, cwd=self.folder, preexec_fn=_end_with_us,  # noqa: PLW1509 - one thread
            env=os.environ | {"SRL_RUNTIME_DIR": f"{self.folder}/run", "STATE_DIRECTORY": f"{self.folder}/state"},
        )  # fmt: skip
        self.out = self.err = ""
        self.stopped_in: float | None = None  # s that a stop took in the middle of a fault
        self.reader: RingReader | None = None
        self.layout: Layout | None = None
        self._rows: list[NDArray[np.int64]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)  # its children are in its group
        with contextlib.suppress(subprocess.TimeoutExpired, ValueError):
            self.process.communicate(timeout=TIMEOUT)
        if self.reader is not None:
            self.reader.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def until(self, condition: Callable[[], object], what: str, most: float = TIMEOUT) -> float:
        """Waits until it is so, also if the run has ended; returns s. Raises HostError: it isn't."""
        begun = time.monotonic()
        while not condition():
            if time.monotonic() - begun > most:
                raise HostError("trial", f"not in {most:g} s: {what}", "Is the machine overloaded?")
            self.take()
            time.sleep(PAUSE)
        return time.monotonic() - begun

    def started(self) -> None:
        """Waits for the first rows. Raises HostError: there are none."""

        def there() -> bool:
            if self.process.poll() is not None:
                self.finish()
                raise HostError(
                    "trial", f"srl run ended at its start: {self.err.strip()[-300:]}", "Look at the profile"
                )
            return self.run_folder.layout.exists() and self.run_folder.rows.exists()

        self.until(there, "the first row")
        self.layout = Layout.load(self.run_folder.layout)
        self.reader = RingReader(self.run_folder.rows)
        self.until(lambda: self._rows, "the first row")

    @property
    def kept(self) -> Path:
        """The recording's path as this process can reach it, also where its folder is a file system of its own."""
        keeper = self.folder / "keeper"
        return Path(f"/proc/{keeper.read_text().strip()}/root{self.recording}") if keeper.exists() else self.recording

    def take(self) -> None:
        """Takes the rows that are there."""
        if self.reader is not None:
            while len(rows := self.reader.take()):
                self._rows.append(rows.copy())

    def is_recorded(self) -> bool:
        """Whether the recorder is at work."""
        return self.reader is not None and self.reader.consumed > 0

    @property
    def rows(self) -> NDArray[np.int64]:
        """All rows since the start, as the loop wrote them."""
        self.take()
        return np.concatenate(self._rows)

    def header(self, place: int) -> int:
        """A word of the newest row."""
        self.take()
        return int(self._rows[-1][-1, place])

    @property
    def cycles(self) -> int:
        """Of the newest row."""
        return self.header(CYCLE.cycle)

    def children(self) -> dict[str, int]:
        """Process ids, by "loop", "bus", "recorder"."""
        found: dict[str, int] = {}
        with contextlib.suppress(OSError):
            for pid in Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split():
                line = Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace").split("\0")
                found |= {name: int(pid) for name in PROCESSES if f"srl.runtime.{name}" in line}
        return found

    def finish(self, most: float = TIMEOUT) -> dict[str, Any] | None:
        """Waits for the run's end; returns what `--json` said, None if nothing. Raises HostError: it doesn't end."""
        try:
            self.out, self.err = self.process.communicate(timeout=most)
        except subprocess.TimeoutExpired:
            raise HostError("trial", f"the run hasn't ended in {most:g} s", "Look at the supervisor") from None
        self.take()
        try:
            found: dict[str, Any] = json.loads(self.out.strip().splitlines()[-1])
        except (ValueError, IndexError):
            return None
        return found


def _end_with_us() -> None:
    """In the run's process, before it is one: it ends safely when whoever runs the trial is killed, or Ctrl-C'd."""
    end_with_parent(signal.SIGTERM)


def lives(pid: int) -> bool:
    """Whether a process is there and isn't merely waiting to be reaped."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in ("Z", "X")
    except (FileNotFoundError, ProcessLookupError):
        return False
