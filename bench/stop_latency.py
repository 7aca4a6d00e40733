"""How soon a stop frame is at the device when the loop or its supervisor dies, on real ptys, at ordinary load.

Each trial is a whole supervisor and a whole loop at 100 Hz, forked from this process, which has imported everything:
a start takes a tenth of a second instead of two. The device is a pty whose other end this process reads at the highest
priority. Beside it a process of ordinary priority only sleeps: what it wakes late is the host's part.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import pty
import random
import resource
import select
import shutil
import signal
import statistics
import struct
import sys
import tempfile
import time
import traceback
import tty
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np

from bench.pairs import Row
from bench.pty_arm import PROFILE, SETTLED, STOP, PtyArm
from srl.runtime.contracts import registry
from srl.runtime.ipc import run_folder as folders
from srl.runtime.ipc.child import PARENT, Ending, starting
from srl.runtime.ipc.launch import Launch
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.loop import process as loop_process
from srl.runtime.loop.control_end import ControlEnd
from srl.runtime.service import supervisor as service

TRIALS = 20
OVERRUN = 1.5  # periods that an overrunning loop's cycle takes
SPAN = (0.2, 1.2)  # s of overrunning before its death: the kernel throttles by the second
TIMEOUT = 10.0  # s
_TICK = 0.01  # ms: a trial may end before the process that sleeps woke once
TURN = 0.1  # s that one turn of a wait counts at most: what takes longer is a host that stood still, and all with it
STARTS = 3  # of a trial, after which the fault is not the host's


@dataclass
class _Forked:
    """What the supervisor needs of a process that it started."""

    pid: int
    returncode: int | None = None

    def poll(self) -> int | None:
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        end = time.monotonic() + (TIMEOUT if timeout is None else timeout)
        while (code := self.poll()) is None:
            if time.monotonic() > end:
                raise service.subprocess.TimeoutExpired("loop", timeout or TIMEOUT)
            time.sleep(0.001)
        return code

    def terminate(self) -> None:
        os.kill(self.pid, signal.SIGTERM)

    def kill(self) -> None:
        os.kill(self.pid, signal.SIGKILL)


def _fork(work: Callable[[], int]) -> int:
    """Runs `work` in a process of its own and returns its number."""
    pid = os.fork()
    if pid:
        return pid
    code = 70
    try:
        code = work()
    except Exception:
        traceback.print_exc()
    finally:
        os._exit(code)


def _supervise(folder: Path, port: str, spin: float, tell: int) -> int:
    """The supervisor's process: as `srl run`, without a console. Says the loop's number, and when it has no room."""

    def spawn(command: list[str], run_folder: RunFolder, end: int) -> _Forked:
        os.set_inheritable(end, True)

        def loop() -> int:
            os.environ[PARENT] = str(os.getppid())
            sys.argv = command[2:]
            return loop_process.main(Ending(), ControlEnd(run_folder.stop_socket))

        with starting():
            forked = _Forked(_fork(loop))
        os.write(tell, struct.pack("q", forked.pid))
        return forked

    def use_up(*_: object) -> None:
        used = max(int(name) for name in os.listdir("/proc/self/fd")) + 1
        resource.setrlimit(resource.RLIMIT_NOFILE, (used, used))
        with contextlib.suppress(OSError):
            while True:
                os.open(os.devnull, os.O_RDONLY)
        os.write(tell, struct.pack("q", 0))

    signal.signal(signal.SIGUSR1, use_up)
    service.spawn = cast(Any, spawn)
    output: list[str] = []
    where = RunFolder(folder / "run")
    where.claim()
    text = PROFILE.replace("PORT", port).replace("SPIN", str(spin))
    supervisor = service.Supervisor(where, Launch("latency", text), folder / "state", [], output.append)
    supervisor.start()
    while supervisor.step():
        pass
    supervisor.finish()
    (folder / "said").write_text(f"{supervisor.error or ''} {supervisor.death or ''} {' '.join(output)}")
    return 0


@dataclass
class Trial:
    """A supervisor and a loop that commands a pty.

    Attributes:
        supervisor, loop: numbers of their processes.
        folder: holds the run folder and the state folder.
        command, stop: when the newest command and the first stop frame came, CLOCK_MONOTONIC ns; 0 for none.
        count: number of commands that have come.
    """

    spin: float
    together: bool = False
    supervisor: int = 0
    loop: int = 0
    command: int = 0
    stop: int = 0
    count: int = 0
    folder: Path = field(default_factory=lambda: Path(tempfile.mkdtemp(prefix="srl-", dir=folders.base().parent)))

    def __enter__(self) -> Trial:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(self) -> None:
        """Starts both and waits until the limb is commanded. Raises TimeoutError."""
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        self._slave = slave  # kept open: a pty whose last user leaves hangs up
        self._heard, tell = os.pipe()
        port = os.ttyname(slave)
        cores = os.sched_getaffinity(0)
        if self.together:  # inherited
            os.sched_setaffinity(0, {min(cores)})
        self.supervisor = _fork(lambda: _supervise(self.folder, port, self.spin, tell))
        os.sched_setaffinity(0, cores)
        os.close(tell)
        self.loop = self.hear()
        self.until(lambda: self.count >= SETTLED)

    def hear(self) -> int:
        """What the supervisor's process says."""
        return int(struct.unpack("q", os.read(self._heard, 8))[0])

    def until(self, condition: Callable[[], bool]) -> None:
        """Reads what comes at the pty until the condition is true."""
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        left, now = TIMEOUT, time.monotonic()
        while not condition():
            started, now = now, time.monotonic()
            left -= min(now - started, TURN)
            if left < 0:
                raise TimeoutError(f"nothing came in {TIMEOUT:g} s: {self._why()}")
            if poll.poll(1):
                data, came = os.read(self._master, 4096), time.monotonic_ns()
                commands = len(data) - data.count(STOP)
                self.count += commands
                if commands:
                    self.command = came
                if STOP in data and not self.stop:
                    self.stop = came

    def _why(self) -> str:
        """Where both processes are, and what the supervisor said at its end."""
        output = self.folder / "said"
        words = f"; {output.read_text()}" if output.exists() else ""
        return f"supervisor {_state(self.supervisor)}, loop {_state(self.loop)}, {self.count} commands{words}"

    def until_stopped(self) -> None:
        """Reads until a stop frame has come."""
        self.until(lambda: self.stop > 0)

    def close(self) -> None:
        """Kills what is left and removes the folder."""
        for pid in (self.loop, self.supervisor):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        os.waitpid(self.supervisor, 0)
        for descriptor in (self._master, self._slave, self._heard):
            os.close(descriptor)
        shutil.rmtree(self.folder, ignore_errors=True)


def _state(pid: int) -> str:
    """A process's state as in proc(5), and where in the kernel it waits."""
    try:
        stat, waits = (Path(f"/proc/{pid}/{name}").read_text() for name in ("stat", "wchan"))
    except OSError:
        return "gone"
    return f"{stat[stat.rindex(')') + 2]} in {waits}"


def _kill(trial: Trial, number: signal.Signals = signal.SIGKILL) -> int:
    started = time.monotonic_ns()
    os.kill(trial.loop, number)
    return started


def _kill_supervisor(trial: Trial) -> int:
    started = time.monotonic_ns()
    os.kill(trial.supervisor, signal.SIGKILL)
    return started


def _stuck(trial: Trial) -> int:
    trial.until(lambda: trial.count > SETTLED)
    return trial.command


def _overrun(trial: Trial) -> int:
    end = time.monotonic() + random.uniform(*SPAN)
    trial.until(lambda: time.monotonic() > end)
    return _kill(trial)


def _delete(trial: Trial) -> int:
    shutil.rmtree(trial.folder / "run")
    return _kill(trial)


def _use_up(trial: Trial) -> int:
    os.kill(trial.supervisor, signal.SIGUSR1)
    trial.hear()
    return _kill(trial)


@dataclass(frozen=True)
class Case:
    """`fault` happens once the limb is commanded; `spin` is the driver's; `together`: all on one processor."""

    what: str
    fault: Callable[[Trial], int]  # returns when it began, CLOCK_MONOTONIC ns
    spin: float = 0.0
    together: bool = False


CASES = (
    Case("loop killed", _kill),
    Case("loop stopped (SIGSTOP)", lambda trial: _kill(trial, signal.SIGSTOP)),
    Case("loop stuck in a call", _stuck, spin=-1.0),
    Case("the same, supervisor on its processor", _stuck, spin=-1.0, together=True),
    Case("loop overrunning, then killed", _overrun, spin=OVERRUN / 100),
    Case("run folder deleted, loop killed", _delete),
    Case("no descriptor left, loop killed", _use_up),
    Case("supervisor killed", _kill_supervisor),
)


def _started(case: Case) -> Trial:
    """A trial whose limb is commanded. A start may fail on a busy host: it is said, and begun again.

    Raises:
        TimeoutError: it failed `STARTS` times in a row.
    """
    for attempt in range(1, STARTS + 1):
        trial = Trial(case.spin, case.together)
        try:
            trial.start()
        except TimeoutError as error:
            trial.close()
            if attempt == STARTS:
                raise
            print(f"a start failed: {error}", file=sys.stderr)
        else:
            break
    return trial


@contextlib.contextmanager
def _sleeper() -> Iterator[Callable[[], float]]:
    """A process that only sleeps, 1 ms at a time. Gives a function: the worst wake-up since its last call, ms."""
    shared = mmap.mmap(-1, 8)

    def sleep() -> int:
        while os.getppid() == parent:
            started = time.monotonic_ns()
            time.sleep(0.001)
            late = time.monotonic_ns() - started - 1_000_000
            if late > struct.unpack("q", shared[:8])[0]:
                shared[:8] = struct.pack("q", late)
        return 0

    def worst() -> float:
        late = struct.unpack("q", shared[:8])[0] / 1e6
        shared[:8] = bytes(8)
        return float(late)

    parent = os.getpid()
    pid = _fork(sleep)
    try:
        yield worst
    finally:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)


def run(trials: int = TRIALS) -> list[Row]:
    """Measures each case `trials` times, interleaved. Takes about 0.5 s a trial."""
    load = registry.load
    registry.load = lambda group, name, place: PtyArm if name == "pty-arm" else load(group, name, place)
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    after: dict[str, list[float]] = {case.what: [] for case in CASES}
    since: dict[str, list[float]] = {case.what: [] for case in CASES}
    late: dict[str, list[float]] = {case.what: [] for case in CASES}
    try:
        with _sleeper() as worst:
            with contextlib.suppress(PermissionError):
                os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(90))
            for _ in range(trials):
                for case in CASES:
                    with _started(case) as trial:
                        worst()
                        started = case.fault(trial)
                        try:
                            trial.until_stopped()
                        except TimeoutError as error:
                            host = f"worst wake-up of a process that only sleeps {worst():.0f} ms"
                            raise TimeoutError(f"{case.what}: {error}; {host}") from None
                        late[case.what].append(worst())
                    after[case.what].append((trial.stop - started) / 1e6)
                    since[case.what].append((trial.stop - trial.command) / 1e6)
    finally:
        os.sched_setscheduler(0, policy, parameters)
        registry.load = load
    return [
        _row(f"{case.what}: {named}, {figure}", found[case.what], figure, max(late[case.what]))
        for case in CASES
        for named, found in (("after the fault", after), ("after the last command", since))
        for figure in ("p50", "p99", "worst")
    ]


def _row(what: str, values: list[float], figure: str, sleeper: float) -> Row:
    shares = {"p50": statistics.median(values), "p99": float(np.percentile(values, 99)), "worst": max(values)}
    return Row(
        id="stop-latency", what=what, ours=round(shares[figure], 2), other=round(sleeper, 2),
        other_name="worst wake-up of a process that only sleeps", ratio=round(shares[figure] / max(sleeper, _TICK), 2),
        control=None, unit="ms",
    )  # fmt: skip
