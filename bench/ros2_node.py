"""How old a signal is at a subscriber of ROS 2, and what the node costs the loop and the bus.

One run of the simulated sixth finger with `bus.ros2`, and a zenoh router as ROS 2 has it. In this process the glove has
a subscriber at the router, and one at the bus. The node works and stands still in turn.
"""

from __future__ import annotations

import json
import os
import queue
import signal
import socket
import time
from collections.abc import Callable

import numpy as np
import psutil
import zenoh

from bench.live import running
from bench.pairs import PAIRS, Row, measure
from srl.runtime.bus.client import connect
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.messages import attachment, messages
from srl.runtime.ros2.names import dds_type, type_hash

SETTLE, BLOCK = 0.3, 1.5  # s before a block counts, and of a block
TIMEOUT = 20.0  # s for the node to join
PUBLISHED = 50  # Hz


def run(rate: int) -> list[Row]:
    """Returns the node's ages and costs at `rate` Hz."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    quiet = {"multicast": {"enabled": False}}
    content = {"mode": "router", "listen": {"endpoints": [endpoint]}, "scouting": quiet}
    ages: queue.SimpleQueue[float] = queue.SimpleQueue()

    def take(sample: zenoh.Sample) -> None:
        given = sample.attachment
        assert given is not None
        ages.put((time.time_ns() - attachment.stamp_of(given.to_bytes())) / 1e6)

    kind = messages.JOINT_STATE
    key = f"0/bench/glove/position/{dds_type(kind)}/{type_hash(kind, 'jazzy')}"
    ros2 = json.dumps({"router": endpoint, "rate": PUBLISHED})
    with (
        zenoh.open(zenoh.Config.from_json5(json.dumps(content))) as router,
        running(rate, "--set", f"bus.ros2={ros2}") as folder,
    ):
        subscriber = router.declare_subscriber(key, take)
        theirs: queue.SimpleQueue[float] = queue.SimpleQueue()
        ages.get(timeout=TIMEOUT)  # the node is there, and the bus
        try:
            with connect(folder, timeout=TIMEOUT) as client:
                client.subscribe(lambda update: theirs.put((time.time() - (update.stamp or 0)) * 1e3), "glove/position")
                return _rows(rate, folder, ages, theirs)
        finally:
            subscriber.undeclare()


def _rows(
    rate: int, folder: RunFolder, ours: queue.SimpleQueue[float], theirs: queue.SimpleQueue[float]
) -> list[Row]:  # fmt: skip
    layout, reader = Layout.load(folder.layout), RingReader(folder.rows)
    node, bus = _process("srl.runtime.ros2"), _process("srl.runtime.bus")

    def block(works: bool, ages: queue.SimpleQueue[float]) -> Callable[[], dict[str, float]]:
        def metrics() -> dict[str, float]:
            os.kill(node.pid, signal.SIGCONT if works else signal.SIGSTOP)
            time.sleep(SETTLE)
            reader.take(1 << 20)
            while not ages.empty():
                ages.get_nowait()
            before = _seconds(node), _seconds(bus)
            time.sleep(BLOCK)
            rows = reader.take(1 << 20)
            used = [after - b for after, b in zip((_seconds(node), _seconds(bus)), before, strict=True)]
            cycle = (layout.header(rows, "write") - layout.header(rows, "wake")) / 1e3
            taken = [ages.get() for _ in range(ages.qsize())] or [0.0]
            return {
                "cycle": float(np.median(cycle)), "cycle99": float(np.percentile(cycle, 99)),
                "age": float(np.median(taken)), "age99": float(np.percentile(taken, 99)),
                # At the bus, the figure to compare the node's time with is its own.
                "node": 100 * used[ages is theirs and works] / BLOCK, "bus": 100 * used[1] / BLOCK,
            }  # fmt: skip

        return metrics

    still, at_bus = "the node stands still", "at a client of the bus"
    try:
        pairs = measure(block(True, ours), {still: block(False, theirs), at_bus: block(True, theirs)}, PAIRS)
    finally:
        os.kill(node.pid, signal.SIGCONT)
    id, what = "ros2-node", f"{rate} Hz, at most {PUBLISHED} Hz to ROS 2, "
    return [
        *(
            pairs.row(id, what + words, figure, still, unit)
            for figure, words, unit in (
                ("cycle", "the loop's cycle, p50", "us"), ("cycle99", "the loop's cycle, p99", "us"),
                ("bus", "the bus's processor time", "%"),
            )
        ),
        pairs.row(id, what + "age at a subscriber, p50", "age", at_bus, "ms"),
        pairs.row(id, what + "age at a subscriber, p99", "age99", at_bus, "ms"),
        pairs.row(id, what + "the node's processor time", "node", at_bus, "%"),
    ]  # fmt: skip


def _process(module: str) -> psutil.Process:
    """The process of this run that runs a module."""
    (found,) = [p for p in psutil.Process().children(recursive=True) if module in p.cmdline()]
    return found


def _seconds(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)
