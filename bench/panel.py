"""What the operator's panel costs the loop: one run, with the panel's process stopped and working in turn.

While it works, a page follows it: one that only reads, as a browser's own work isn't the panel's. All of a run is on
this machine, with whatever else it does; so the control (stopped / stopped) says what noise alone makes.
"""

from __future__ import annotations

import asyncio
import os
import re
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import aiohttp
import numpy as np

from bench.live import running
from bench.pairs import Row, measure
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.ring import RingReader
from srl.runtime.web.operator.client import OperatorPage

RATES = (100, 1000)  # Hz
PAIRS = 20
SETTLE, BLOCK = 0.3, 1.2  # s before a block counts, and of a block
_METRICS = {
    "cycle": "cycle, median",
    "cycle99": "cycle, 99th percentile",
    "late99": "lateness of a wake-up, 99th percentile",
}


def run() -> list[Row]:
    """Returns the cost to a simulated sixth finger's loop at each of RATES."""
    return [row for rate in RATES for row in _at(rate)]


def _at(rate: int) -> list[Row]:
    with running(rate) as folder, OperatorPage(folder) as page, _followed(page):
        layout, reader = Layout.load(folder.layout), RingReader(folder.rows)

        def block(awake: bool) -> Callable[[], dict[str, float]]:
            def metrics() -> dict[str, float]:
                os.kill(page.pid, signal.SIGCONT if awake else signal.SIGSTOP)
                time.sleep(SETTLE)
                reader.take(1 << 20)
                time.sleep(BLOCK)
                rows = reader.take(1 << 20)
                wake, written = (layout.header(rows, word) for word in ("wake", "write"))
                cycle = (written - wake) / 1e3
                late = np.maximum(np.diff(wake) / 1e3 - 1e6 / rate, 0.0)
                found = np.median(cycle), np.percentile(cycle, 99), np.percentile(late, 99)
                return dict(zip(_METRICS, map(float, found), strict=True))

            return metrics

        try:
            pairs = measure(block(False), {"with the panel": block(True)}, PAIRS)
        finally:
            os.kill(page.pid, signal.SIGCONT)
    return [
        pairs.row("panel", f"{rate} Hz without the panel: {words}", figure, "with the panel", "us")
        for figure, words in _METRICS.items()
    ]


@contextmanager
def _followed(page: OperatorPage) -> Iterator[None]:
    """A page that takes every picture, in a thread of its own."""
    over, there = threading.Event(), threading.Event()

    async def follow() -> None:
        origin, _, _ = page.address.rpartition("/")
        async with aiohttp.ClientSession(headers={"Origin": origin}) as session:
            async with session.get(page.address) as answer:
                found = re.search('name="key" content="([^"]+)"', await answer.text())
            assert found is not None
            shown = {"Sec-WebSocket-Protocol": f"srl, {found[1]}"}
            async with session.ws_connect(f"{origin}/socket", headers=shown) as socket:
                await socket.receive()
                there.set()
                while not over.is_set():
                    try:
                        await asyncio.wait_for(socket.receive(), 0.5)
                    except TimeoutError:
                        continue

    thread = threading.Thread(target=lambda: asyncio.run(follow()))
    thread.start()
    there.wait(30.0)
    try:
        yield
    finally:
        over.set()
        thread.join()
