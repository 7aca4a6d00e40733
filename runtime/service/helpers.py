"""The processes beside the loop, bus, recorder and viewer: they are started again when they die."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

from srl.runtime.ipc.child import FINAL, PARENT, starting
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.profile.bus import BusConfig

BACKOFF = (0.0, 0.0, 0.2, 1.0, 5.0)  # s before the first, second, ... restart within a minute
ATTEMPTS = 3  # to finish a recording
FINISH = 120.0  # s that the recorder may take to finish its file
CLOSING = 10.0  # s that the bus may take to close its session, and the viewer to end: nothing is lost with them


@dataclass
class Helper:
    """A telemetry process that is started again when it dies.

    Attributes:
        keeps: whether what it hasn't finished would be lost.
    """

    name: str
    command: list[str]
    keeps: bool = False
    process: subprocess.Popen[bytes] | None = None
    restarts: int = 0
    deaths: list[float] = field(default_factory=list)
    not_before: float = 0.0

    def start(self, run_folder: RunFolder) -> None:
        """Starts it. Raises OSError."""
        self.process = spawn(self.command, run_folder)

    def ended(self) -> int | None:
        """Its exit code if it has ended; None while it runs, and before its start."""
        return self.process.poll() if self.process is not None else None

    @property
    def due(self) -> bool:
        """Whether it isn't there and may be started now."""
        return self.process is None and time.monotonic() >= self.not_before

    def give_up(self) -> None:
        """It is not started again."""
        self.process = None
        self.not_before = float("inf")

    def retry_later(self) -> None:
        """It has died, or can't be started: it is started again, the later the more often it has died."""
        now = time.monotonic()
        self.process = None
        self.deaths = [t for t in self.deaths if t > now - 60] + [now]
        self.restarts += 1
        self.not_before = now + BACKOFF[min(len(self.deaths), len(BACKOFF) - 1)]

    def finish(self, run_folder: RunFolder, started: float) -> bool:
        """Waits until it ends by itself. One that `keeps` and died at the very end is restarted to save its rows.

        Args:
            started: when all helpers began to finish, CLOCK_MONOTONIC s. FINISH or CLOSING later it is told to end.
        Returns:
            Whether it has finished its work.
        """
        attempts, deadline = ATTEMPTS, started + (FINISH if self.keeps else CLOSING)
        while time.monotonic() < deadline and attempts:
            if self.process is None and not self.keeps:
                return True
            if self.process is None:
                attempts -= 1
                try:
                    self.start(run_folder)
                except OSError:
                    time.sleep(0.1)
                    continue
            code = self.ended()
            if code == 0 or (code is not None and not self.keeps):
                return True
            if code == FINAL:
                return False
            if code is not None:
                self.process = None
                self.restarts += 1
            time.sleep(0.01)
        if self.process is not None:
            self.process.terminate()
            try:
                self.process.wait(timeout=3)
            except subprocess.TimeoutExpired:
                self.process.kill()
        return False


def spawn(command: list[str], run_folder: RunFolder, *descriptors: int) -> subprocess.Popen[bytes]:
    """Starts a process that ends with this one, and loses no signal from its first instruction on.

    It inherits the run folder's lock: no other run begins there before the last process of this one has ended.
    This process's own environment stays as it is. Raises OSError.
    """
    environment = os.environ | {PARENT: str(os.getpid())}
    inherited = [*descriptors, *([] if run_folder.lock is None else [run_folder.lock])]
    with starting():
        return subprocess.Popen(
            command, stdin=subprocess.DEVNULL, start_new_session=True, pass_fds=inherited, env=environment
        )


def helpers(
    run_folder: RunFolder, bus: BusConfig | None, record: Path | None, view: bool, foxglove: bool = False
) -> list[Helper]:
    """The telemetry processes of a run."""
    found = []
    if bus is not None:
        found.append(Helper("bus", [sys.executable, "-m", "srl.runtime.bus", str(run_folder.path)]))
    if bus is not None and bus.ros2 is not None:
        found.append(Helper("ros2", [sys.executable, "-m", "srl.runtime.ros2", str(run_folder.path)]))
    if record is not None:
        command = [sys.executable, "-m", "srl.runtime.recorder", str(run_folder.path), "--out", str(record)]
        found.append(Helper("recorder", command, keeps=True))
    if view:
        found.append(Helper("viewer", [sys.executable, "-m", "srl.runtime.web.viewing", str(run_folder.path)]))
    if foxglove:
        found.append(Helper("foxglove", [sys.executable, "-m", "srl.runtime.web.foxglove", str(run_folder.path)]))
    return found
