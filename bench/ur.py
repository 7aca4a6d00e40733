"""RTDE's data received by this driver and by ur_rtde (C++), the same variables at 500 Hz: CPU time per packet.

Both receive at the same time in one process, from one twin, each in a thread of its own; what is compared is the CPU
time of those two threads. Ours waits for each packet, parses it and fills the driver's states.
"""

from __future__ import annotations

import os
import select
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

import numpy as np

from bench.pairs import PAIRS, Pairs, Row, rounds
from srl.drivers.transport import Transport, open_transport
from srl.drivers.ur import rtde, sample
from srl.drivers.ur.handshake import Handshake
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.testing.twin_bench import TwinBench

SECONDS: Final = 0.37  # of one window: the kernel throttles, and others work, by the second
TIMEOUT: Final = 60.0  # s for the twin to begin
_THREADS: Final = Path("/proc/self/task")
_STATES: Final = {"position": 6, "velocity": 6, "effort": 6, "wrench": 6, "pose": 7, "speed_scaling": 1, "buttons": 0}
_PROFILE: Final = """\
name: bench-ur
rate: 500
devices:
  arm: {{driver: ur, port: "tcp://{host}", interface: position}}
setpoints:
  client.position:
    {{shape: [6], unit: rad, labels: [shoulder_pan, shoulder_lift, elbow, wrist_1, wrist_2, wrist_3]}}
controllers:
  - use: joint-setpoint
    name: jog
    joints: [shoulder_pan, shoulder_lift, elbow, wrist_1, wrist_2, wrist_3]
    in: {{target: client.position}}
    out: {{q: arm.position_command, q_velocity: arm.position_command.velocity}}
guard:
  arm.position_command: {{velocity: 1.0, acceleration: 5.0}}
sim:
  world: cell
  parts: {{arm: {{part: ur16e}}}}
  devices: {{arm: {{host: {host}, standard_ports: true}}}}
"""


def run() -> list[Row]:
    """Runs the comparison as the machine is, and again with a busy process for each processor."""
    host = f"127.{os.getpid() % 200 + 20}.{os.getpid() // 200 % 250}.9"
    with _process(_serve, host), _both(host) as window:
        rows = [_measured(window, "")]
        with ExitStack() as busy:
            for _ in os.sched_getaffinity(0):
                busy.enter_context(_process(_compute))
            rows.append(_measured(window, ", every processor busy with another process"))
    return rows


def _measured(window: Callable[[], tuple[float, float]], where: str) -> Row:
    """Both receive at the same time, and each window gives both figures; ours again is that of the next window."""
    both = [window()]
    for _ in rounds(PAIRS):
        both.append(window())
    ours, vendors = ([{"cpu": metrics[side]} for metrics in both] for side in (0, 1))
    what = f"RTDE at 500 Hz, CPU time of the receiving thread a packet{where}"
    pairs = Pairs(ours[:-1], ours[1:], {"ur_rtde": vendors[:-1]})
    return pairs.row("ur-rtde-receive", what, "cpu", "ur_rtde", "us", "not more", lambda ratio: ratio <= 1.0)


@contextmanager
def _process(work: Callable[..., None], *arguments: object) -> Iterator[None]:
    process = get_context("fork").Process(target=work, args=arguments)
    process.start()
    try:
        yield
    finally:
        process.kill()
        process.join()


def _serve(host: str) -> None:
    with TwinBench(_PROFILE.format(host=host), "arm") as twin:
        started = time.monotonic()
        while True:
            twin.run(max(0.0, time.monotonic() - started - twin.now / 1e9))
            time.sleep(0.0005)


def _compute() -> None:
    while True:
        pass


@contextmanager
def _both(host: str) -> Iterator[Callable[[], tuple[float, float]]]:
    """What receives for a while: us of CPU time a packet of our thread, and of ur_rtde's."""
    import rtde_receive  # type: ignore[import-not-found,unused-ignore]

    handshake, link = _greeted(host)
    handshake.start(*handshake.outputs(500.0, sample.names("target"), sample.TYPES))
    threads = set(os.listdir(_THREADS))
    vendor: Any = rtde_receive.RTDEReceiveInterface(host, 500.0, list(sample.names("target")))
    theirs = set(os.listdir(_THREADS)) - threads
    found, parser = sample.Sample(), handshake.parser
    arrays = {name: np.zeros(count) for name, count in _STATES.items()}
    poll = select.poll()
    poll.register(link.fileno(), select.POLLIN)

    def window() -> tuple[float, float]:
        frames, since = parser.frames, vendor.getTimestamp()
        cpu, vendors = time.thread_time_ns(), _computed(theirs)
        until = time.monotonic() + SECONDS
        while time.monotonic() < until:
            poll.poll(100)
            data = link.read()
            newest = parser.sole(data)
            if newest is None:
                for message in parser.feed(data):
                    if message.kind == rtde.Kind.DATA:
                        newest = message.body
            if newest is not None and found.take(newest):
                found.fill(arrays, ())
        cpu, vendors = time.thread_time_ns() - cpu, _computed(theirs) - vendors
        count, others = parser.frames - frames, (vendor.getTimestamp() - since) * 500
        if count <= 0 or others <= 0:
            raise RuntimeError(f"{count} packets for us and {others:.0f} for ur_rtde in {SECONDS:g} s")
        return cpu / count / 1e3, vendors / others / 1e3

    try:
        yield window
    finally:
        vendor.disconnect()
        link.close()


def _greeted(host: str) -> tuple[Handshake, Transport]:
    """Connects as soon as the twin listens."""
    until = time.monotonic() + TIMEOUT
    while True:
        try:
            link = open_transport(f"tcp://{host}:30004", place="bench")
            break
        except DeviceError:
            if time.monotonic() > until:
                raise
            time.sleep(0.1)
    handshake = Handshake(link, "bench")
    handshake.greet()
    return handshake, link


def _computed(threads: set[str]) -> int:
    """The ns that these threads of this process have computed, as the scheduler counts them."""
    return sum(int((_THREADS / thread / "schedstat").read_text().split()[0]) for thread in threads)
