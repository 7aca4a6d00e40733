"""How old a signal is when a client of the bus has it, and what the bus costs the loop.

One run of the simulated sixth finger; three more buses follow its rows, each with a client: the bus as the service
runs it, at a nice value of -5 and looking at the ring when a row is due; the same at 0; and one at -5 that looks every
20 ms. Only one of them works at a time, the others stand still. Their clients have the ordinary nice value.
"""

from __future__ import annotations

import os
import queue
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from pathlib import Path

import numpy as np

from bench.live import running
from bench.pairs import PAIRS, Row, measure
from srl.runtime.bus import process as bus_process
from srl.runtime.bus.client import Client, connect
from srl.runtime.ipc.child import Ending
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.requests import RequestWriter
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder

SIGNAL = "finger/position_command/applied"  # stamped with the cycle's beginning
NICE = -5  # as deploy/srl@.service sets it
POLL = 0.02  # s, of the bus that polls
TIMEOUT = 20.0  # s for a bus to begin, or to end
SETTLE, BLOCK = 0.3, 1.2  # s before a block counts, and of a block
_POLLING, _ORDINARY = "a bus that polls every 20 ms", "the bus at a nice value of 0"


def run(rate: int) -> list[Row]:
    """Returns the age at a client and the loop's cycle at `rate` Hz, of which every tenth cycle is published."""
    with running(rate) as run_folder, _buses(run_folder) as (due, ordinary, polling):
        layout, reader = Layout.load(run_folder.layout), RingReader(run_folder.rows)

        def block(works: _Bus | None) -> Callable[[], dict[str, float]]:
            def metrics() -> dict[str, float]:
                for bus in (due, ordinary, polling):
                    bus.send(signal.SIGCONT if bus is works else signal.SIGSTOP)
                time.sleep(SETTLE)
                reader.take(1 << 20)
                if works is not None:
                    works.ages()
                time.sleep(BLOCK)
                rows = reader.take(1 << 20)
                cycle = (layout.header(rows, "write") - layout.header(rows, "wake")) / 1e3
                found = {"cycle": float(np.median(cycle)), "cycle99": float(np.percentile(cycle, 99))}
                if works is not None:
                    ages = works.ages()
                    found |= {"age": float(np.median(ages)), "age99": float(np.percentile(ages, 99))}
                return found

            return metrics

        others = {_POLLING: block(polling), _ORDINARY: block(ordinary), "without": block(None)}
        pairs = measure(block(due), others, PAIRS)
        what = f"{rate} Hz, nice value {due.nice}, "
    id, aim = f"bus-age-{rate}hz", "under 5 ms"
    row = pairs.row(id, what + "age at a client, p50", "age", _POLLING, "ms", aim)
    return [
        replace(row, holds=row.ours < 5.0),
        pairs.row(id, what + "age at a client, p50", "age", _ORDINARY, "ms"),
        pairs.row(id, what + "age at a client, p99", "age99", _POLLING, "ms"),
        *(
            pairs.row(id, what + f"the loop's cycle, {words}", figure, other, "us")
            for figure, words in (("cycle", "p50"), ("cycle99", "p99"))
            for other in (_POLLING, "without")
        ),
    ]


class _Bus:
    """A bus of its own at a run's rows, and its client."""

    def __init__(self, process: BaseProcess, client: Client) -> None:
        self._process = process
        self._ages: queue.SimpleQueue[float] = queue.SimpleQueue()
        self._taken = client.subscribe(lambda update: self._ages.put((time.time() - (update.stamp or 0)) * 1e3), SIGNAL)

    @property
    def nice(self) -> int:
        """Its nice value: not NICE where the host refuses that."""
        assert self._process.pid is not None
        return os.getpriority(os.PRIO_PROCESS, self._process.pid)

    def send(self, number: signal.Signals) -> None:
        """Sends a signal to the bus."""
        assert self._process.pid is not None
        os.kill(self._process.pid, number)

    def ages(self) -> list[float]:
        """Returns the ages in ms that came since the last call. Raises RuntimeError: the bus has ended."""
        if not self._process.is_alive():
            raise RuntimeError("the bus has ended")
        found = []
        while not self._ages.empty():
            found.append(self._ages.get())
        return found


@contextmanager
def _buses(run_folder: RunFolder) -> Iterator[list[_Bus]]:
    """The three buses, each in a folder with the run's rows and layout."""
    with tempfile.TemporaryDirectory(prefix="srl-") as scratch, ExitStack() as ends:
        started = []
        for kind in ("due", "ordinary", "polling"):  # both before this process has a session: it has threads then
            folder = RunFolder(Path(scratch) / f"bench-{kind}")
            folder.path.mkdir()
            for file in ("rows", "events", "layout"):
                getattr(folder, file).symlink_to(getattr(run_folder, file))
            RequestWriter.create(folder.requests)
            process = get_context("fork").Process(target=_serve, args=(kind, folder))
            process.start()
            ends.callback(_end, process)
            started.append((process, folder))
        buses = []
        for process, folder in started:
            until = time.monotonic() + TIMEOUT
            while not folder.bus_socket.exists():
                if not process.is_alive() or time.monotonic() > until:
                    raise RuntimeError("the bus doesn't begin")
                time.sleep(0.02)
            buses.append(_Bus(process, ends.enter_context(connect(folder, timeout=TIMEOUT))))
        yield buses


def _end(process: BaseProcess) -> None:
    assert process.pid is not None
    os.kill(process.pid, signal.SIGCONT)
    process.terminate()
    process.join(TIMEOUT)
    process.kill()
    process.join()


def _serve(kind: str, folder: RunFolder) -> None:
    """The process of one bus."""
    ending = Ending()
    if kind != "ordinary":
        with suppress(PermissionError):
            os.setpriority(os.PRIO_PROCESS, 0, NICE)  # zenoh's threads, made from here on, have it from this one
    if kind == "polling":
        bus_process.next_look = lambda *_: round(POLL * 1e9)
    bus_process.Bus(folder).run(ending)
