"""The supervisor: starts the loop, the bus and the recorder, and outlives them.

It has no real-time priority, and the loop never waits for it. The worst fault is that the loop dies or gives no
sign of life. The supervisor then kills what is left of it, sends the actuators' prebuilt stop frames through its own
duplicates of their descriptors, saves the ring as a black box, and ends the run. All it needs for that it holds from
the start. It starts the bus and the recorder again when they die.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from srl.runtime.contracts.errors import DeviceError, HostError, SrlError
from srl.runtime.ipc import private_file
from srl.runtime.ipc.channel import Channel
from srl.runtime.ipc.control_socket import send_request
from srl.runtime.ipc.events import EventReader
from srl.runtime.ipc.header import State
from srl.runtime.ipc.launch import Launch
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.notify import Notifier
from srl.runtime.ipc.requests import RequestWriter
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.ipc.stop_slots import StopSlots
from srl.runtime.loop import realtime
from srl.runtime.service import crash_dump
from srl.runtime.service.actuators import Actuators
from srl.runtime.service.helpers import Helper, spawn
from srl.runtime.service.process_exit import ProcessExit

POLL = 0.005  # s between two checks of the loop's sign of life
HUNG = 100_000_000  # ns without a sign of life, plus two periods, after which the loop counts as hung
HUNG_STILL = 1_000_000_000  # ns, the same where nothing is commanded, as in a calibration: nothing can move
HUNG_UNPACED = 10_000_000_000  # ns, the same for an unpaced simulation
HELD_UP = 50_000_000  # ns by which a check is late when the whole machine, and not the loop alone, stood still
LET_GO = 5_000_000_000  # ns that the loop's process may take to release its devices after its last row
OPENING = 10.0  # s after a request to end, during which devices may still be opening; then the loop is killed
REAP = 2.0  # s that a killed process may take to go; one that writes to a stuck device takes longer


@dataclass
class Death:
    """How the loop ended without a request."""

    how: str
    stopped_after_ms: float
    black_box: Path | None


class Supervisor:
    """Supervises one run; see the module's docstring.

    Attributes:
        rows, events, layout: the run's rows, events and their layout, once the loop runs; None before.
        death: how the loop died, if it did.
        error: an error that the user can correct, if the loop could not start.
        metrics: the own figures of controllers, devices and guard.
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
        self.metrics: dict[str, Any] = {}
        self.rows: RingReader | None = None
        self.events: EventReader | None = None
        self.layout: Layout | None = None
        self._layout_text = b""
        self._hung_after = HUNG
        self._checked = 0  # CLOCK_MONOTONIC ns, of the last check
        self._excused = -1  # the sign of life that was there in the last late check: it excuses no second one
        self._ask_to_end = False
        self._asked = self._first_asked = 0.0
        self._notifier = Notifier()
        self._spare: int | None = None

    def start(self) -> None:
        """Starts the loop. The helpers follow once it runs. Raises SrlError."""
        run_folder = self.run_folder
        crash_dump.rescue(run_folder, self.state, self.report)
        try:
            for path in (*run_folder.evidence, run_folder.result):
                path.unlink(missing_ok=True)
            RequestWriter.create(run_folder.requests)
            self._actuators = Actuators(StopSlots.create(run_folder.stops), self.report)
            self.launch.save(run_folder.launch)
        except OSError as error:
            problem = f"the run's files can't be made: {error.strerror}"
            raise HostError(str(run_folder.path), problem, "Make room there, or set SRL_RUNTIME_DIR") from None
        self._keep_spare()
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.channel = Channel(ours)
        end = theirs.fileno()
        command = [sys.executable, "-m", "srl.runtime.loop", str(run_folder.path), str(end)]
        self.loop = spawn(command, run_folder, end)
        self._exit = ProcessExit(self.loop.pid)
        theirs.close()

    def end(self) -> None:
        """Requests the loop's safe stop and end. May also be called from a signal handler."""
        self._ask_to_end = True

    def step(self, timeout: float = POLL) -> bool:
        """Checks the loop and the helpers once. Returns False when the run is over."""
        if self._ask_to_end:
            self._pass_on_end()
        ready, _, _ = select.select([self.channel.socket], [], [], timeout)
        if ready and not self._hear():
            self._loop_ended()
            return False
        if self.running and self.rows is not None:
            # The rows are closed before the process ends, so that is asked last: a check may be held up in between.
            if self._exit.seen() and not self.rows.closed:
                self._loop_died("the loop's process ended")
                return False
            now, before = time.monotonic_ns(), self._checked
            beat = self.rows.beat
            self._checked, silent = now, now - beat
            # After a stall of the whole machine the loop has one check's time to show that it goes on.
            late = before > 0 and now - before > HELD_UP + timeout * 1e9
            excused, self._excused = late and beat != self._excused, beat if late else self._excused
            if not excused and self._is_hung(silent):
                self._loop_died(f"the loop gave no sign of life for {silent / 1e6:.0f} ms")
                return False
        for helper in self.helpers if self.running else ():
            self._tend(helper)
        return self.death is None

    def _is_hung(self, silent: int) -> bool:
        """Whether a loop that gave no sign of life for so many ns counts as hung."""
        assert self.rows is not None
        assert self.layout is not None
        if self.rows.closed:
            return silent > LET_GO
        if silent <= self._hung_after:
            return False
        row = self.rows.newest()
        # Before its start a limb was commanded nothing in this run, so nothing goes on while the machine stands still.
        waits = row is not None and int(self.layout.header(row, "state")) in (State.STARTING, State.READY)
        return not waits or silent > HUNG_STILL

    # Where the process has no descriptor left, this one is closed for what can't wait.

    def _keep_spare(self) -> None:
        if self._spare is None:
            try:
                self._spare = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)
            except OSError as error:
                self.report(f"no descriptor can be kept for an emergency: {error.strerror}")

    def _free_spare(self) -> None:
        if self._spare is not None:
            os.close(self._spare)
            self._spare = None

    def _hear(self) -> bool:
        self._free_spare()  # room for a descriptor that comes with the message
        message = self.channel.receive()
        if message is None:
            return False
        content, descriptor = message
        match content["say"]:
            case "actuator" | "lost":
                self._take_over(content, descriptor)
            case "running":
                self._watch_over(content)
            case "failed":
                cls = DeviceError if content["kind"] == "device" else SrlError
                self.error = cls(content["place"], content["problem"], content["remedy"])
        self._keep_spare()
        return True

    def _take_over(self, content: dict[str, Any], descriptor: int | None) -> None:
        if descriptor is not None:
            self._actuators.hold(content["slot"], content["name"], descriptor)
            return
        self._actuators.drop(content["slot"])
        if content["say"] == "actuator":
            self.report(f"'{content['name']}' could not be stopped if the loop died: no descriptor is left")

    def _take_over_the_rest(self) -> bool:
        """Takes over what the loop handed over last and nobody has read yet. Returns whether there was anything."""
        found = False
        self._free_spare()
        while select.select([self.channel.socket], [], [], 0)[0] and (message := self.channel.receive()) is not None:
            if message[0]["say"] in ("actuator", "lost"):
                self._take_over(*message)
                found = True
        return found

    def _watch_over(self, content: dict[str, Any]) -> None:
        """Maps what the loop has made. A loop that can't be watched doesn't get to move anything."""
        try:
            text = private_file.read_text(self.run_folder.layout)
            self.layout = Layout.from_json(text, str(self.run_folder.layout))
            self._layout_text = text.encode()
            self.events = EventReader(self.run_folder.events)
            self.rows = RingReader(self.run_folder.rows, marks=True, width=self.layout.width)
        except SrlError as error:
            self._loop_died(f"the loop can't be watched: {error}")
            return
        self.running = True
        moves = any(field.role == "sent" for field in self.layout.fields.values())
        usual = (HUNG if moves else HUNG_STILL) + 2 * content["period"]
        self._hung_after = HUNG_UNPACED if content["unpaced"] else usual

    def _loop_ended(self) -> None:
        """The channel is closed: the process has ended, or is about to."""
        assert self.loop is not None
        settled = self.rows is not None and self.rows.closed
        if self.running and not settled:
            self._loop_died("the loop's process ended")
            return
        code = self._reap(LET_GO / 1e9)
        if self.error is None and code != 0 and (self.running or not self._ask_to_end):
            self._loop_died("the loop's process ended")
            return
        if code is None:
            self.loop.kill()  # it said why it can't run and hangs
        self._notifier.stopping()
        self._actuators.close()
        self._read_metrics()
        self.running = False

    def _loop_died(self, how: str) -> None:
        """Handles the loop's death or hang.

        Nothing before the first frame waits or can fail. What is left of the loop is killed first, so that it can't
        wake up and move the limb. A last write of it may still come between: the frames are sent again once it is gone.
        It ends at ordinary priority: freeing its locked memory takes long, and would take this processor meanwhile.
        """
        assert self.loop is not None
        started = time.monotonic_ns()
        if self.loop.returncode is None:  # not reaped, so the number is still its own
            with contextlib.suppress(OSError):
                realtime.leave(self.loop.pid)
            os.kill(self.loop.pid, signal.SIGKILL)
        self._actuators.stop()
        if self._take_over_the_rest():
            self._actuators.stop()
        stopped = time.monotonic_ns()
        code = self._reap(REAP)
        self._actuators.stop()
        self._actuators.close()
        self._notifier.stopping()
        if code is None:
            self.report(f"the killed loop is still there after {REAP:g} s: a device may hold it. Use the hardware stop")
        # Counted from the last complete cycle, as the person wearing the limb sees it.
        since = self.rows.beat if self.rows is not None and self.rows.beat else started
        self.running = False
        self.death = Death(how + _by(code), (stopped - since) / 1e6, self._save_black_box())

    def _reap(self, patience: float) -> int | None:
        """The loop's exit code; None if it isn't gone in time."""
        assert self.loop is not None
        try:
            return self.loop.wait(patience)
        except subprocess.TimeoutExpired:
            return None

    def _save_black_box(self) -> Path | None:
        """Saves what is mapped: the run folder may be gone, and one descriptor is enough."""
        if self.rows is None or self.events is None:
            return None
        self._free_spare()
        contents: dict[str, bytes | memoryview | Path] = {
            self.run_folder.rows.name: self.rows.content,
            self.run_folder.events.name: self.events.content,
            self.run_folder.layout.name: self._layout_text,
            self.run_folder.launch.name: self.launch.content,
        }
        try:
            return crash_dump.save(self.state, contents)
        except OSError as error:
            where = self.run_folder.path
            self.report(f"the black box can't be saved in {self.state}: {error.strerror}; the rows stay in {where}")
            return None

    def _read_metrics(self) -> None:
        if not self.run_folder.result.exists():
            return
        try:
            self.metrics = json.loads(private_file.read_text(self.run_folder.result))
        except (SrlError, ValueError) as error:
            self.report(f"the run's own figures can't be read: {error}")

    def _tend(self, helper: Helper) -> None:
        """Starts a helper, and starts it again when it has died."""
        code = helper.ended()
        if code is not None and not (code == 0 and self.rows is not None and self.rows.closed):
            if code == 0 and self._ask_to_end:
                helper.give_up()
                return
            if helper.name == "bus":
                self._ask("fault", "bus_loss")
            if code == 2:  # it refused its launch file: the same file would be refused again
                self.report(f"{helper.name} can't work (its reason is above); the loop goes on without it")
                helper.give_up()
                return
            helper.retry_later()
            self.report(f"{helper.name} ended{_by(code)}; it is started again, the loop goes on")
        if helper.due:
            try:
                helper.start(self.run_folder)
            except OSError as error:
                helper.retry_later()
                self.report(f"{helper.name} can't be started: {error.strerror}; the loop goes on")

    def _ask(self, what: str, cause: str | None = None) -> None:
        """Sends the loop a request; without a descriptor for a socket, none."""
        try:
            send_request(self.run_folder, what, cause, timeout=0.0)
        except OSError as error:
            self.report(f"the loop can't be asked for {what}: {error.strerror}")

    def _pass_on_end(self) -> None:
        """Requests the safe stop: first through the socket, if there is one, then once a second by signal."""
        assert self.loop is not None
        now = time.monotonic()
        if now - self._asked < 1.0:
            return
        first, self._asked = self._asked == 0.0, now
        if first:
            self._first_asked = now
        if first and self.running and self.run_folder.stop_socket.exists():
            self._ask("exit")
        elif not self.running and now - self._first_asked > OPENING:
            self.loop.kill()  # nothing moves before the loop runs
        else:
            self.loop.terminate()

    def finish(self) -> list[str]:
        """Lets the helpers read the remaining rows and end, then cleans up.

        Returns:
            Names of the helpers that could not finish their work.
        """
        if self.rows is not None and not self.rows.closed:
            self.rows.finish(saved=self.death is not None and self.death.black_box is not None)
        failed = [h.name for h in self.helpers if h.keeps]  # without rows, nothing was kept
        if self.rows is not None:
            now = time.monotonic()
            failed = [h.name for h in self.helpers if not h.finish(self.run_folder, now)]
        self._actuators.close()
        self._exit.close()
        self._free_spare()
        return failed


def _by(code: int | None) -> str:
    """How a process ended, in brackets."""
    if code is None:
        return ""
    if code == -signal.SIGXCPU:
        return " (killed by SIGXCPU: it computed for too long without a pause)"
    return f" (killed by {signal.Signals(-code).name})" if code < 0 else f" (exit code {code})"


def state_dir(name: str) -> Path:
    """The folder for an instance's data that must outlive a reboot: the mark of a running instance, black boxes."""
    for variable, below in (("STATE_DIRECTORY", ""), ("XDG_STATE_HOME", "srl")):
        if value := os.environ.get(variable):
            return Path(value.split(":")[0]) / below / name
    return Path.home() / ".local" / "state" / "srl" / name
