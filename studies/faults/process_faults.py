"""The faults of processes and of the host: how each is made, and what is expected of it."""

from __future__ import annotations

import contextlib
import os
import resource
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from srl.runtime.ipc.control_socket import send_request
from srl.studies.faults.live_run import LiveRun, lives

DIES, ENDS, GOES_ON, STOPS, REFUSED = "dies", "ends", "goes on", "stops or goes on", "refused"


@dataclass(frozen=True)
class ProcessFault:
    """One fault.

    Attributes:
        what: in words, for the table.
        make: makes it, and returns when it is over; random instants come before.
        due: DIES: the loop is gone, the run ends with exit code 1 and keeps its rows; ENDS: the limb stops and the run
            ends by itself; GOES_ON: the run goes on and ends well; STOPS: it may also stop; REFUSED: it never begins.
        safe: s in which the limb must be stopped; None: there is nothing to wait for.
        code: exit codes that are right.
        restarts: the process that is started again; "" for none.
        small, room: as in `LiveRun`.
    """

    what: str
    make: Callable[[LiveRun, np.random.Generator], None]
    due: str
    safe: float | None = None
    code: tuple[int, ...] = (0,)
    restarts: str = ""
    small: str = ""
    room: str = "1m"


def _kill(name: str, number: signal.Signals = signal.SIGKILL) -> Callable[[LiveRun, np.random.Generator], None]:
    def make(run: LiveRun, rng: np.random.Generator) -> None:
        os.kill(run.children()[name], number)

    return make


def _again(name: str) -> Callable[[LiveRun, np.random.Generator], None]:
    """Kills a helper and waits until it is there again."""

    def make(run: LiveRun, rng: np.random.Generator) -> None:
        old = run.children()[name]
        os.kill(old, signal.SIGKILL)
        run.until(lambda: run.children().get(name, old) != old, f"the {name} again")

    return make


def _pause(name: str, seconds: tuple[float, float]) -> Callable[[LiveRun, np.random.Generator], None]:
    def make(run: LiveRun, rng: np.random.Generator) -> None:
        pid = run.process.pid if name == "supervisor" else run.children()[name]
        os.kill(pid, signal.SIGSTOP)
        end = time.monotonic() + float(rng.uniform(*seconds))
        try:
            run.until(lambda: time.monotonic() > end, "the pause's end")
        finally:
            with contextlib.suppress(ProcessLookupError):  # killed while it stood still
                os.kill(pid, signal.SIGCONT)

    return make


def _pause_all(run: LiveRun, rng: np.random.Generator) -> None:
    os.killpg(run.process.pid, signal.SIGSTOP)
    time.sleep(float(rng.uniform(0.3, 1.0)))
    os.killpg(run.process.pid, signal.SIGCONT)


def _signal(number: signal.Signals) -> Callable[[LiveRun, np.random.Generator], None]:
    return lambda run, rng: os.kill(run.process.pid, number)


@contextlib.contextmanager
def _hogs(cores: set[int]) -> Iterator[None]:
    spin = f"import os\nos.sched_setaffinity(0, {cores!r})\nwhile os.getppid() == {os.getpid()}: pass"
    hogs = [subprocess.Popen([sys.executable, "-c", spin]) for _ in range(2)]
    try:
        yield
    finally:
        for hog in hogs:
            hog.kill()
            hog.wait()


def _hog(run: LiveRun, rng: np.random.Generator) -> None:
    loop = run.children()["loop"]
    core = int(Path(f"/proc/{loop}/stat").read_text().rpartition(")")[2].split()[36])
    started = time.monotonic()
    with _hogs({core}):
        run.until(lambda: time.monotonic() > started + 1.0, "a second")


def _use_up(run: LiveRun, rng: np.random.Generator) -> None:
    """The supervisor can open nothing more; then the loop dies."""
    used = {int(name) for name in os.listdir(f"/proc/{run.process.pid}/fd")}
    free = min(set(range(len(used) + 1)) - used)  # from here on nothing can be opened; what is open stays
    loop = run.children()["loop"]
    _, most = resource.prlimit(run.process.pid, resource.RLIMIT_NOFILE)
    resource.prlimit(run.process.pid, resource.RLIMIT_NOFILE, (free, most))
    os.kill(loop, signal.SIGKILL)


def _delete(run: LiveRun, rng: np.random.Generator) -> None:
    shutil.rmtree(run.run_folder.path)
    mark = run.cycles
    run.until(lambda: run.cycles > mark + 20, "further rows")


def _delete_and_kill(run: LiveRun, rng: np.random.Generator) -> None:
    loop = run.children()["loop"]
    shutil.rmtree(run.run_folder.path)
    os.kill(loop, signal.SIGKILL)


def _spray(run: LiveRun, payload: Callable[[], bytes], seconds: float) -> None:
    """Datagrams to the loop's socket without a pause, from two threads."""
    end = time.monotonic() + seconds

    def spray() -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.setblocking(False)
            sender.connect(str(run.run_folder.loop_socket))
            while time.monotonic() < end:
                with contextlib.suppress(OSError):
                    sender.send(payload())

    threads = [threading.Thread(target=spray) for _ in range(2)]
    for thread in threads:
        thread.start()
    time.sleep(seconds / 2)
    run.stopped_in = _stop(run)
    for thread in threads:
        thread.join()


def _stop(run: LiveRun) -> float:
    """A person's stop; returns how long the loop took to answer, s; inf: it didn't."""
    started = time.monotonic()
    answer = send_request(run.run_folder, "stop")
    return time.monotonic() - started if answer is not None else float("inf")


def _flood(run: LiveRun, rng: np.random.Generator) -> None:
    _spray(run, lambda: b'{"ask": "reset", "expires": 9000000000000000000}', 1.0)


def _hostile(run: LiveRun, rng: np.random.Generator) -> None:
    shapes = (
        b"",
        b"\0" * 60_000,
        b'{"ask": ["reset"]}',
        b'{"ask": "exit", "cause": {}}',
        b"[" * 5000,
        b'{"ask": 1e999}',
    )

    def payload() -> bytes:
        choice = int(rng.integers(len(shapes) + 2))
        return shapes[choice] if choice < len(shapes) else rng.bytes(int(rng.integers(1, 2000)))

    bus = run.run_folder.bus_socket
    if bus.exists():
        with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as sender:
            sender.connect(str(bus))
            sender.sendall(rng.bytes(5000))
    _spray(run, payload, 1.0)


def _fill(run: LiveRun, rng: np.random.Generator) -> None:
    """The disk of the recording is full for a while, and then has room again."""
    inside = run.kept.parent / "filler"
    with contextlib.suppress(OSError), inside.open("wb", buffering=0) as filler:
        while True:
            filler.write(bytes(65536))
    mark = run.cycles
    run.until(lambda: run.cycles > mark + 150, "further rows")
    inside.unlink()


def _nothing(run: LiveRun, rng: np.random.Generator) -> None:
    pass


FAULTS: Final = {
    "loop-killed": ProcessFault("the loop killed", _kill("loop"), DIES, 0.1, (1,)),
    "loop-stopped": ProcessFault("the loop stopped (SIGSTOP)", _kill("loop", signal.SIGSTOP), DIES, 0.5, (1,)),
    "loop-paused": ProcessFault("the loop paused for 10 to 50 ms", _pause("loop", (0.01, 0.05)), STOPS),
    "bus-killed": ProcessFault("the bus killed", _again("bus"), STOPS, restarts="bus"),
    "bus-paused": ProcessFault("the bus stopped for 1 s", _pause("bus", (1.0, 1.2)), GOES_ON),
    "recorder-killed": ProcessFault("the recorder killed", _again("recorder"), GOES_ON, restarts="recorder"),
    "recorder-paused": ProcessFault("the recorder stopped for 1 s", _pause("recorder", (1.0, 1.2)), GOES_ON),
    "supervisor-killed": ProcessFault(
        "the supervisor killed", _signal(signal.SIGKILL), ENDS, 1.0, (-signal.SIGKILL,)
    ),
    "supervisor-paused": ProcessFault("the supervisor stopped for 1 s", _pause("supervisor", (1.0, 1.2)), GOES_ON),
    "all-paused": ProcessFault("everything stopped for 0.3 to 1 s", _pause_all, STOPS, None, (0, 1)),
    "sigterm": ProcessFault("SIGTERM", _signal(signal.SIGTERM), ENDS, 1.0),
    "sigint": ProcessFault("SIGINT", _signal(signal.SIGINT), ENDS, 1.0),
    "sighup": ProcessFault("SIGHUP", _signal(signal.SIGHUP), ENDS, 1.0),
    "cpu-hog": ProcessFault("two programs that compute on the loop's core for 1 s", _hog, STOPS),
    "no-descriptors": ProcessFault("no descriptor left, the loop killed", _use_up, DIES, 0.1, (1,)),
    "folder-deleted": ProcessFault("the run folder deleted", _delete, GOES_ON),
    "folder-deleted-killed": ProcessFault("the run folder deleted, the loop killed", _delete_and_kill, DIES, 0.1, (1,)),
    "flood": ProcessFault("two clients that send resets without a pause, and a person's stop", _flood, STOPS, 0.25),
    "hostile": ProcessFault("hostile payloads at every socket, and a person's stop", _hostile, STOPS, 0.25),
    "disk-full": ProcessFault("the recording's disk full for a while", _fill, GOES_ON, small="record", room="80m"),
    "no-shared-memory": ProcessFault("no shared memory at the start", _nothing, REFUSED, None, (2,), small="run",
                                     room="64k"),
}  # fmt: skip


def ended(run: LiveRun, children: dict[str, int]) -> Callable[[], bool]:
    """Whether nothing of a run is left."""
    return lambda: run.process.poll() is not None and not any(lives(pid) for pid in children.values())
