"""From a sensor's last byte in the kernel to the first byte of the command that it makes, beside C written by hand.

One sensor and one actuator of one joint at two sockets, whose other ends are this process: the twins. Frames come at
instants spread evenly over a period, so half a period of the median is the wait for the next cycle, which both have;
what is left of it is their own work, and this process's waking up for the command.
Ours is the loop's process as it is (clock, drivers, checks, law, guard, the row), without a supervisor. By hand
(`by_hand/byte_to_byte.c`) is the same clock, parser, limits and frame for one joint, and nothing else. Both run at the
loop's real-time priority where the host allows it, one at a time, for `LONGEST` at most.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import socket
import subprocess
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from bench.by_hand import compiled
from bench.byte_ends import PROFILE, Arm, Handle, frame, values
from bench.pairs import PartlyError, Row, measure
from srl.runtime.contracts import registry
from srl.runtime.ipc.child import end_with_parent
from srl.runtime.ipc.requests import RequestWriter
from srl.runtime.ipc.ring import RingWriter
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.loop import realtime
from srl.runtime.loop.clock import SPIN, MonotonicClock
from srl.runtime.loop.control_end import ControlEnd
from srl.runtime.loop.cycle import Cycle
from srl.runtime.loop.device import Device
from srl.runtime.loop.guards import limits_of
from srl.runtime.loop.loop import Loop
from srl.runtime.loop.process import rows_kept
from srl.runtime.loop.request_queue import RequestQueue
from srl.runtime.profile import profile, wiring

FRAMES: Final = {100: 80, 500: 200, 1000: 300}  # of one measurement, by the loop's rate, Hz
LONGEST: Final = 5.0  # s that a loop runs
_ABOVE: Final = realtime.PRIORITY + 10  # this process's priority while it measures
_START: Final = 0.1  # s between the frames that a loop which begins may not see
_ANSWER: Final = 1.0  # s for a command to follow
_STEP: Final = 1e-4  # rad; from one sensor's value to the next is twice that, within the limits in one cycle
_BY_HAND: Final = "C by hand"
_PERIOD: Final = "the period"
_NAMES: Final = ("p50", "p99", "p50 without the wait of half a period")

Start = Callable[[Path, int, int], int]  # from a folder, and sensor and actuator as descriptors, to a process's number


def run() -> list[Row]:
    """Returns p50 and p99 at each rate; without a C compiler compared with the period, and PartlyError says so."""
    load = registry.load
    drivers: dict[str, Any] = {"byte-handle": Handle, "byte-arm": Arm}
    registry.load = lambda group, name, place: drivers.get(name) or load(group, name, place)
    rows: list[Row] = []
    try:
        with ExitStack() as ends:
            try:
                program, why = ends.enter_context(compiled("byte_to_byte")), ""
            except RuntimeError as error:
                program, why = None, str(error)
            for rate in FRAMES:
                rows += _at(rate, program)
    finally:
        registry.load = load
    if why:
        raise PartlyError(f"without C by hand: {why}", rows)
    return rows


def _at(rate: int, program: Path | None) -> list[Row]:
    """The rows of one rate."""
    period = 1e6 / rate
    ours = partial(metrics, rate, partial(_ours, rate))
    what = f"sensor's last byte to command's first, {rate} Hz (a period is {period:g} us), {{}}"
    if program is None:
        pairs = measure(ours, {_PERIOD: lambda: dict.fromkeys(_NAMES, period)})
        return [pairs.row("byte-to-byte", what.format(name), name, _PERIOD, "us") for name in _NAMES]
    pairs = measure(ours, {_BY_HAND: partial(metrics, rate, partial(_c, program, rate))})
    return [pairs.row("byte-to-byte", what.format(name), name, _BY_HAND, "us") for name in _NAMES]


def metrics(rate: int, start: Start) -> dict[str, float]:
    """Starts a loop at two sockets and returns percentiles of the us from byte to byte."""
    with ExitStack() as ends:
        sensor, its_sensor = map(ends.enter_context, socket.socketpair())
        actuator, its_actuator = map(ends.enter_context, socket.socketpair())
        for end in (sensor, its_sensor, actuator, its_actuator):
            end.setblocking(False)
        folder = Path(ends.enter_context(tempfile.TemporaryDirectory(prefix="srl-bench-")))
        pid = start(folder, its_sensor.fileno(), its_actuator.fileno())
        ends.callback(_end, pid)
        ends.enter_context(_above())
        frames = _Frames(sensor, actuator)
        while not frames.next(0.0, _START):  # until the loop is active, what comes moves nothing
            if os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT):
                raise RuntimeError("the loop has ended before it moved anything")
        count = FRAMES[rate]
        took = []
        for k in range(count):
            # After the command before, so in the middle of a cycle; 7 has no factor in common with the counts.
            found = frames.next((1.0 + (7 * k % count + 0.5) / count) / rate, _ANSWER)
            if found is None:
                raise RuntimeError(f"no command followed the sensor's value within {_ANSWER:g} s")
            took.append(found)
    p50, p99 = np.percentile(took, (50, 99)).tolist()
    return dict(zip(_NAMES, (p50, p99, p50 - 5e5 / rate), strict=True))


class _Frames:
    """The twins of sensor and actuator."""

    def __init__(self, sensor: socket.socket, actuator: socket.socket) -> None:
        self._sensor, self._actuator = sensor, actuator
        self._poll = select.poll()
        self._poll.register(actuator.fileno(), select.POLLIN)
        self._value, self._rest = 0.0, b""

    def next(self, wait: float, timeout: float) -> float | None:
        """Sends another value after `wait` (s); returns the us until its command came, None if none came."""
        self._value = value = -_STEP if self._value > 0.0 else _STEP  # never 0, where the arm begins
        time.sleep(wait)
        self._heard()
        self._sensor.send(frame(value))
        started = came = time.monotonic_ns()
        while came - started < timeout * 1e9:
            self._poll.poll(timeout * 1e3)
            came = time.monotonic_ns()
            if any(abs(command - value) < 1e-9 for command in self._heard()):
                return (came - started) / 1e3
        return None

    def _heard(self) -> list[float]:
        with contextlib.suppress(BlockingIOError):
            self._rest += self._actuator.recv(65536)
        found, self._rest = values(self._rest)
        return found


@contextmanager
def _above() -> Iterator[None]:
    """Meanwhile this process comes before the loop, where the host allows it."""
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(_ABOVE))
    try:
        yield
    finally:
        os.sched_setscheduler(0, policy, parameters)


def _end(pid: int) -> None:
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)


def _c(program: Path, rate: int, _: Path, sensor: int, actuator: int) -> int:
    numbers = (sensor, actuator, 10**9 // rate, round(LONGEST * rate), realtime.PRIORITY, SPIN)
    process = subprocess.Popen([str(program), *map(str, numbers)], pass_fds=(sensor, actuator))
    process.returncode = 0  # `_end` waits for it
    return process.pid


def _ours(rate: int, folder: Path, sensor: int, actuator: int) -> int:
    parent = os.getpid()
    pid = os.fork()
    if pid:
        return pid
    try:
        end_with_parent(signal.SIGKILL)
        if os.getppid() == parent:
            _loop(RunFolder(folder), PROFILE.format(rate=rate, sensor=sensor, actuator=actuator), round(LONGEST * rate))
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(1)


def _loop(folder: RunFolder, text: str, cycles: int) -> None:
    """The loop as its process makes it, for so many cycles."""
    graph = wiring.build(*profile.parse("byte-to-byte", text))
    RequestWriter.create(folder.requests)
    requests = RequestQueue(folder, graph, ControlEnd(folder.stop_socket))
    devices = [
        Device(d, graph.row.devices[i], graph.actuators_of(i), lambda text: None) for i, d in enumerate(graph.devices)
    ]
    for device in devices:
        device.driver.open()
        device.watch()
    cycle = Cycle(graph, limits_of(graph), automatic=True)
    ring = RingWriter.create(folder.rows, graph.layout.width, rows_kept(graph.profile.rate))
    clock = MonotonicClock(graph.profile.rate)
    realtime.enter(realtime.STUCK + 2 * clock.period)
    Loop(graph, devices, clock, cycle, requests, ring).run(cycles)
