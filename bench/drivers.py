"""The cost of each driver to the loop: us of `read` and `write` per received frame, with the driver's own twin."""

from __future__ import annotations

import gc
import threading
import time
from typing import Any, Final

import numpy as np

from bench.pairs import Row
from runtime.contracts import registry
from runtime.contracts.driver import Driver
from runtime.contracts.world import Fake, Twin, World
from sim.devices.examples import DEVICES

FRAMES: Final = 1500
LEAST: Final = 100
LONGEST: Final = 30.0  # s a device may take to deliver the frames
AIM: Final = 100.0  # us
STEP: Final = 1_000_000  # ns of world time between two calls of the twin


def run() -> list[Row]:
    """Returns a row per device and percentile; the control compares the two halves of the same run."""
    rows = []
    for name in DEVICES:
        if name == "lsl":  # its library can't be bound to loopback; a process of its own bears its cost
            continue
        costs = cost(name)
        if len(costs) < LEAST:
            raise RuntimeError(f"{name} gave {len(costs)} frames in {LONGEST:g} s")
        half = len(costs) // 2
        for what in (50, 99):
            found = float(np.percentile(costs, what))
            again = [float(np.percentile(part, what)) for part in (costs[:half], costs[half:])]
            rows.append(
                Row(
                    id="drivers", what=f"{name}, p{what} of one frame", ours=round(found, 1), other=AIM,
                    other_name="aim", ratio=round(found / AIM, 3), control=round(again[0] / again[1], 3), unit="us",
                    aim="p99 < 100 us" if what == 99 else "", holds=found < AIM if what == 99 else None,
                )
            )  # fmt: skip
    return rows


def cost(name: str, frames: int = FRAMES) -> list[float]:
    """Returns the us per frame of each cycle in which frames came (`read`, and `write` if it accepts commands)."""
    world, twin, driver = pair(name)
    found: list[float] = []
    gc.collect()
    gc.freeze()  # as in the loop
    gc.disable()
    clock = time.thread_time_ns  # time that other threads take on this processor isn't the driver's
    commands = list(driver.commands)
    try:
        _served(world, twin, driver.open)
        seen = driver.health.frames
        end = time.monotonic() + LONGEST
        feedback = [(driver.command_arrays[c.name], c.feedback, c.kind) for c in commands]
        while len(found) < frames and time.monotonic() < end:
            world.advance(world.time + STEP)
            twin.service(time.monotonic_ns())
            time.sleep(5e-5)  # a pty takes a moment
            for array, measured, kind in feedback:
                array[:] = driver.state_arrays[measured] if measured and kind == "position" else 0.0
            now = time.monotonic_ns()
            start = clock()
            driver.read(now)
            if commands:
                driver.write(now)
            took = clock() - start
            if (new := driver.health.frames - seen) > 0:
                found.append(took / new / 1000)
                seen += new
    finally:
        gc.enable()
        _served(world, twin, driver.close)
        twin.close()
        world.close()
    return found


def pair(name: str) -> tuple[World, Twin, Driver]:
    """Returns a device's world, its open twin, and its driver, which isn't open yet."""
    config, options, there, port = DEVICES[name]
    there = dict(there)
    cls = registry.load("worlds", there.pop("world"), "bench")
    world: World = cls(cls.Config.model_validate(there), 0)
    fake_class, driver_class = registry.load("fakes", name, "bench"), registry.load("drivers", name, "bench")
    settings = driver_class.Config.model_validate({"port": port} | config)
    fake: Fake = fake_class(name, settings, world, fake_class.Options.model_validate(options))
    _bind(fake)
    twin: Twin = registry.load("twins", name, "bench")(fake)
    twin.open()
    driver: Driver = driver_class(name, driver_class.Config.model_validate(config | {"port": twin.address}))
    _bind(driver)
    return world, twin, driver


def _bind(driver: Driver) -> None:
    driver.bind(
        {s.name: np.zeros(s.shape) for s in driver.states}, {c.name: np.zeros(c.shape) for c in driver.commands}
    )


def _served(world: World, twin: Twin, what: Any) -> None:
    """Runs a blocking call while the world and the twin advance."""
    done = threading.Event()

    def serve() -> None:
        while not done.wait(0.0005):
            world.advance(world.time + STEP)
            twin.service(time.monotonic_ns())

    server = threading.Thread(target=serve)
    server.start()
    try:
        what()
    finally:
        done.set()
        server.join()
