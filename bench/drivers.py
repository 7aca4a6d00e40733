"""The cost of each driver to the loop: `read` and `write` per received frame, with the driver's own twin.

Absolute times say more about the machine than about the driver. So each is compared with a bare frame, measured in the
same run in turn with it: the least that any driver does in Python for a frame.
"""

from __future__ import annotations

import gc
import math
import socket
import struct
import threading
import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from bench.pairs import PartlyError, Row
from srl.runtime.contracts import registry
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import Fake, Twin, World
from srl.runtime.testing.bound import bound
from srl.sim.devices.examples import DEVICES

FRAMES: Final = 500
LEAST: Final = 100
LONGEST: Final = 10.0  # s a device may take to deliver the frames
STEP: Final = 1_000_000  # ns of world time between two calls of the twin
MOST: Final = 20_000_000  # ns of world time in one step while a driver opens: a slow world isn't ever further behind


def run() -> list[Row]:
    """Returns a row per device and percentile. Raises PartlyError: devices failed; it has the rows of the others."""
    rows, failed = [], []
    for name in DEVICES:
        if name == "lsl":  # its library can't be bound to loopback; a process of its own bears its cost
            continue
        try:
            rows += _rows(name)
        except Exception as error:
            failed.append(f"{name}: {error}")
    if failed:
        raise PartlyError("; ".join(failed), rows)
    return rows


def _rows(name: str) -> list[Row]:
    """Returns a device's rows; the control compares the ratios of the two halves of the same run."""
    costs, bare = cost(name)
    if len(costs) < LEAST:
        raise RuntimeError(f"{len(costs)} frames in {LONGEST:g} s")
    half, rows = len(costs) // 2, []
    for what in (50, 99):
        ours, other = (float(np.percentile(values, what)) for values in (costs, bare))
        first, second = (
            float(np.percentile(costs[part], what) / np.percentile(bare[part], what))
            for part in (slice(half), slice(half, None))
        )
        rows.append(
            Row(
                id="drivers", what=f"{name}, p{what} of one frame", ours=round(ours, 1), other=round(other, 1),
                other_name="a bare frame", ratio=round(ours / other, 2), control=round(first / second, 3), unit="us",
            )
        )  # fmt: skip
    return rows


def cost(name: str, frames: int = FRAMES) -> tuple[Array, Array]:
    """Returns the us per frame of each cycle in which frames came (`read`, and `write` if it accepts commands).

    The second array has the us of the bare frame that was measured after each.
    """
    world, twin, driver = pair(name)
    bare, end_of_bare = bare_frame()
    found: list[float] = []
    bares: list[float] = []
    gc.collect()
    gc.freeze()  # as in the loop
    gc.disable()
    clock = time.thread_time_ns  # time that other threads take on this processor isn't the driver's
    commands = list(driver.commands)
    try:
        served(world, twin, driver.open)
        seen = driver.health.frames
        behind = time.monotonic_ns() - world.time  # from here on all clocks go by the world's steps
        end = time.monotonic() + LONGEST
        feedback = [(driver.command_arrays[c.name], c.feedback, c.kind) for c in commands]
        while len(found) < frames and time.monotonic() < end:
            world.advance(world.time + STEP)
            now = behind + world.time
            twin.service(now)
            time.sleep(5e-5)  # a pty takes a moment
            for array, measured, kind in feedback:
                array[:] = driver.state_arrays[measured] if measured and kind == "position" else 0.0
            start = clock()
            driver.read(now)
            if commands:
                driver.write(now)
            took = clock() - start
            if (new := driver.health.frames - seen) > 0:
                found.append(took / new / 1000)
                bares.append(bare())
                seen += new
    finally:
        gc.enable()
        served(world, twin, driver.close)
        twin.close()
        world.close()
        end_of_bare()
    return np.array(found), np.array(bares)


def bare_frame() -> tuple[Callable[[], float], Callable[[], None]]:
    """Returns what measures one bare frame, us of thread time, and what closes it.

    A datagram of 64 bytes is received without blocking, unpacked into 8 numbers, looked through for what isn't finite,
    and written into an array.
    """
    there, here = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    here.setblocking(False)
    layout, values = struct.Struct(">8d"), np.zeros(8)
    content = layout.pack(*range(8))
    clock = time.thread_time_ns

    def once() -> float:
        there.send(content)
        start = clock()
        numbers = layout.unpack(here.recv(4096))
        if math.isfinite(sum(numbers)):
            values[:] = numbers
        return (clock() - start) / 1000

    def close() -> None:
        there.close()
        here.close()

    return once, close


def pair(name: str) -> tuple[World, Twin, Driver]:
    """Returns a device's world, its open twin, and its driver, which isn't open yet."""
    config, options, there, port = DEVICES[name]
    there = dict(there)
    cls = registry.load("worlds", there.pop("world"), "bench")
    world: World = cls(cls.Config.model_validate(there), 0)
    fake_class, driver_class = registry.load("fakes", name, "bench"), registry.load("drivers", name, "bench")
    settings = driver_class.Config.model_validate({"port": port} | config)
    fake: Fake = fake_class(name, settings, world, fake_class.Options.model_validate(options))
    bound(fake)
    twin: Twin = registry.load("twins", name, "bench")(fake)
    twin.open()
    driver: Driver = driver_class(name, driver_class.Config.model_validate(config | {"port": twin.address}))
    bound(driver)
    return world, twin, driver


def served(world: World, twin: Twin, what: Any) -> None:
    """Runs a blocking call while the world and the twin go on by the real clock, as it does; never faster.

    A driver may measure its device's rate meanwhile. One that is too high makes all later samples seem late.
    """
    done = threading.Event()

    def serve() -> None:
        now = time.monotonic_ns()
        while not done.wait(0.0005):
            before, now = now, time.monotonic_ns()
            world.advance(world.time + min(now - before, MOST))
            twin.service(now)

    server = threading.Thread(target=serve)
    server.start()
    try:
        what()
    finally:
        done.set()
        server.join()
