"""The supervisor: starts the loop, the bus and the recorder, and outlives them.

It has no real-time priority, and the loop never waits for it. The worst fault is that the loop dies or gives no
sign of life. The supervisor then sends the actuators' prebuilt stop frames through its own duplicates of their
descriptors, saves the ring as a black box, and ends the run. It starts the bus and the recorder again when they die.
"""

from __future__ import annotations

import json
import os
import select
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from runtime.contracts.errors import DeviceError, SrlError
from runtime.ipc.channel import Channel
from runtime.ipc.control_socket import send_request
from runtime.ipc.launch import Launch
from runtime.ipc.notify import Notifier
from runtime.ipc.requests import RequestWriter
from runtime.ipc.ring import RingReader
from runtime.ipc.run_folder import RunFolder
from runtime.ipc.stop_slots import StopSlots
from runtime.loop.realtime import PARENT

POLL = 0.005  # s between two checks of the loop's sign of life
HUNG = 100_000_000  # ns without a sign of life, plus two periods, after which the loop counts as hung
HUNG_UNPACED = 10_000_000_000  # ns, the same for an unpaced simulation
BACKOFF = (0.0, 0.0, 0.2, 1.0, 5.0)  # s before the first, second, ... restart within a minute
FINISH = 120.0  # s that the recorder may take to finish its file
LET_GO = 5_000_000_000  # ns that the loop's process may take to release its devices after its last row
OPENING = 10.0  # s after a request to end, during which devices may still be opening; then the loop is killed


@dataclass
class Helper:
    """A telemetry process that is started again when it dies."""

    name: str
    command: list[str]
    process: subprocess.Popen[bytes] | None = None
    restarts: int = 0
    deaths: list[float] = field(default_factory=list)
    not_before: float = 0.0


@dataclass
class Death:
    """How the loop ended without a request."""

    how: str
    stopped_after_ms: float
    black_box: Path | None


class Supervisor:
    """Supervises one run; see the module's docstring.

    Attributes:
        death: how the loop died, if it did.
        error: an error that the user can correct, if the loop could not start.
        figures: the own figures of controllers, devices and guard.
    """

    def __init__(
        self, run_folder: RunFolder, launch: Launch, state: Path, helpers: list[Helper], report: Callable[[str], None]
    ) -> None:
        """`run_folder` must be claimed; `state` is the folder for black boxes; `report` takes a line of text."""
        self.run_folder, self.launch, self.state, self.helpers, self.report = run_folder, launch, state, helpers, report
        self.loop: subprocess.Popen[bytes] | None = None
        self.running = False
        self.death: Death | None = None
        self.error: SrlError | None = None
        self.figures: dict[str, Any] = {}
        self._actuators: dict[int, int] = {}
        self._hung_after = HUNG
        self._ring: RingReader | None = None
        self._ask_to_end = False
        self._asked = self._first_asked = 0.0
        self._notifier = Notifier()

    def start(self) -> None:
        """Starts the loop. The helpers follow once it runs."""
        run_folder = self.run_folder
        for path in (run_folder.rows, run_folder.layout, run_folder.events, run_folder.stops, run_folder.result):
            path.unlink(missing_ok=True)
        RequestWriter.create(self.run_folder.requests)
        self.launch.save(self.run_folder.launch)
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.channel = Channel(ours)
        os.set_inheritable(theirs.fileno(), True)
        end = theirs.fileno()
        command = [sys.executable, "-m", "runtime.loop", str(self.run_folder.path), str(end)]
        self.loop = _spawn(command, pass_fds=[end])
        theirs.close()

    def end(self) -> None:
        """Requests the loop's safe stop and end. May also be called from a signal handler."""
        self._ask_to_end = True

    def step(self, timeout: float = POLL) -> bool:
        """Checks the loop and the helpers once. Returns False when the run is over."""
        assert self.loop is not None
        if self._ask_to_end:
            self._pass_on_end()
        ready, _, _ = select.select([self.channel.socket], [], [], timeout)
        if ready and not self._hear():
            self._loop_ended()
            return False
        if self.running and self._ring is not None:
            silent = time.monotonic_ns() - self._ring.beat
            if silent > (LET_GO if self._ring.closed else self._hung_after):
                self._loop_died(f"the loop gave no sign of life for {silent / 1e6:.0f} ms", kill=True)
                return False
        for helper in self.helpers if self.running else ():
            self._tend(helper)
        return True

    def _hear(self) -> bool:
        message = self.channel.receive()
        if message is None:
            return False
        content, descriptor = message
        match content["say"]:
            case "actuator" if descriptor is not None:
                self._drop(content["slot"])
                self._actuators[content["slot"]] = descriptor
            case "lost":
                self._drop(content["slot"])
            case "running":
                self.running = True
                self._hung_after = HUNG_UNPACED if content["unpaced"] else HUNG + 2 * content["period"]
                self._ring = RingReader(self.run_folder.rows)
            case "failed":
                cls = DeviceError if content["kind"] == "device" else SrlError
                self.error = cls(content["place"], content["problem"], content["remedy"])
        return True

    def _drop(self, slot: int) -> None:
        if slot in self._actuators:
            os.close(self._actuators.pop(slot))

    def _loop_ended(self) -> None:
        assert self.loop is not None
        # The channel closes when the process ends; its exit code follows at once.
        try:
            code = self.loop.wait(timeout=0.05)
        except subprocess.TimeoutExpired:
            code = None
        ended = (self._ring is not None and self._ring.closed) or (self._ask_to_end and not self.running)
        if self.error is None and not ended:
            how = f"killed by {signal.Signals(-code).name}" if code is not None and code < 0 else f"exit code {code}"
            self._loop_died(f"the loop's process ended ({how})", kill=code is None)
        else:
            self.loop.wait()
            self._notifier.stopping()
            if self.run_folder.result.exists():
                self.figures = json.loads(self.run_folder.result.read_text())
        self.running = False

    def _loop_died(self, how: str, kill: bool) -> None:
        """Handles the loop's death. A hanging loop is killed first, so that it cannot wake up and move the limb."""
        assert self.loop is not None
        begun = time.monotonic_ns()
        if kill:
            self.loop.send_signal(signal.SIGKILL)
            self.loop.wait()
        self._stop_actuators()
        stopped = time.monotonic_ns()
        self._notifier.stopping()
        # Counted from the last complete cycle, as the person wearing the limb sees it.
        since = self._ring.beat if self._ring is not None and self._ring.beat else begun
        self.running = False
        self.death = Death(how, (stopped - since) / 1e6, self._save_black_box())

    def _stop_actuators(self) -> None:
        if not self._actuators:
            return
        slots = StopSlots(self.run_folder.stops, len(self._actuators))
        for slot, descriptor in self._actuators.items():
            frame = slots.read(slot)
            deadline = time.monotonic() + 0.2
            while frame and time.monotonic() < deadline:
                try:
                    frame = frame[os.write(descriptor, frame) :]
                except BlockingIOError:
                    select.select([], [descriptor], [], 0.01)
                except OSError as error:
                    self.report(f"an actuator can't be reached for its stop: {error.strerror}")
                    break
            os.close(descriptor)
        self._actuators.clear()

    def _save_black_box(self) -> Path | None:
        target = self.state / f"blackbox-{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}"
        try:
            target.mkdir(parents=True)
            for path in (self.run_folder.rows, self.run_folder.events, self.run_folder.layout, self.run_folder.launch):
                if path.exists():
                    shutil.copyfile(path, target / path.name)
        except OSError as error:
            where = self.run_folder.path
            self.report(f"the black box can't be saved in {target}: {error.strerror}; the rows are still in {where}")
            return None
        return target

    def _tend(self, helper: Helper) -> None:
        now = time.monotonic()
        if helper.process is not None:
            code = helper.process.poll()
            if code is None or (code == 0 and self._ring is not None and self._ring.closed):
                return
            helper.process = None
            if code == 0 and self._ask_to_end:
                return
            if helper.name == "bus":
                send_request(self.run_folder, "fault", "bus_loss", timeout=0.0)
            if code == 2:  # it refused its launch file: the same file would be refused again
                self.report(f"{helper.name} can't work (its reason is above); the loop goes on without it")
                helper.not_before = float("inf")
                return
            helper.deaths = [t for t in helper.deaths if t > now - 60] + [now]
            helper.restarts += 1
            helper.not_before = now + BACKOFF[min(len(helper.deaths), len(BACKOFF) - 1)]
            how = f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
            self.report(f"{helper.name} ended ({how}); it is started again, the loop goes on")
        if helper.process is None and now >= helper.not_before:
            helper.process = _spawn(helper.command)

    def _pass_on_end(self) -> None:
        """Requests the safe stop: first through the socket if the loop runs, then once a second by signal."""
        assert self.loop is not None
        now = time.monotonic()
        if now - self._asked < 1.0:
            return
        first, self._asked = self._asked == 0.0, now
        if first:
            self._first_asked = now
        if first and self.running:
            send_request(self.run_folder, "exit", timeout=0.0)
        elif not self.running and now - self._first_asked > OPENING:
            self.loop.kill()  # nothing moves before the loop runs
        else:
            self.loop.terminate()

    def finish(self) -> list[str]:
        """Lets the helpers read the remaining rows and end, then cleans up.

        Returns:
            Names of the helpers that could not finish their work.
        """
        if self.error is not None or self.death is not None:
            self._mark_closed()
        failed = []
        if self.run_folder.layout.exists():
            deadline = time.monotonic() + FINISH
            failed = [h.name for h in self.helpers if not self._finish(h, deadline)]
        for slot in list(self._actuators):
            self._drop(slot)
        return failed

    def _finish(self, helper: Helper, deadline: float) -> bool:
        """Waits until a helper ends by itself. A recorder that died at the very end is restarted to save its rows."""
        attempts = 3
        while time.monotonic() < deadline and attempts:
            if helper.process is None:
                attempts -= 1
                helper.process = _spawn(helper.command)
            code = helper.process.poll()
            if code == 0 or (code is not None and helper.name == "bus"):
                return True
            if code is not None:
                helper.process = None
                helper.restarts += 1
            time.sleep(0.01)
        if helper.process is not None:
            helper.process.terminate()
            try:
                helper.process.wait(timeout=3)
            except subprocess.TimeoutExpired:
                helper.process.kill()
        return False

    def _mark_closed(self) -> None:
        """Marks the ring as closed in place of the dead loop: no row follows."""
        from runtime.ipc.ring import RingWriter

        if self.run_folder.rows.exists():
            writer = RingWriter(self.run_folder.rows)
            writer.finish()
            writer.close()


def _spawn(command: list[str], pass_fds: Sequence[int] = ()) -> subprocess.Popen[bytes]:
    """Starts a process that ends with this one; this process's own environment stays as it is."""
    environment = os.environ | {PARENT: str(os.getpid())}
    return subprocess.Popen(
        command, stdin=subprocess.DEVNULL, start_new_session=True, pass_fds=pass_fds, env=environment
    )


def helpers(run_folder: RunFolder, bus: bool, record: Path | None, view: bool) -> list[Helper]:
    """The telemetry processes of a run."""
    found = []
    if bus:
        found.append(Helper("bus", [sys.executable, "-m", "runtime.bus", str(run_folder.path)]))
    if record is not None or view:
        command = [sys.executable, "-m", "runtime.recorder", str(run_folder.path)]
        command += ["--out", str(record)] if record is not None else []
        found.append(Helper("recorder", command + (["--view"] if view else [])))
    return found


def state_dir(name: str) -> Path:
    """The folder for an instance's data that must outlive a reboot: the mark of a running instance, black boxes."""
    for variable, below in (("STATE_DIRECTORY", ""), ("XDG_STATE_HOME", "srl")):
        if value := os.environ.get(variable):
            return Path(value.split(":")[0]) / below / name
    return Path.home() / ".local" / "state" / "srl" / name
