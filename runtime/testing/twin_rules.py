"""What every driver must do in front of its twin: one rule a function. Each raises AssertionError with what is wrong.

The driver is the real one. The twin speaks the device's protocol, and its world moves only when the rule lets it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from random import Random
from unittest import SkipTest

import numpy as np

from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.testing.twin_bench import TwinBench

CYCLE = 0.01  # s of world time between two reads
MOST = 300  # cycles that something may take

MakeDriver = Callable[[str], Driver]
"""Makes a bound driver at this port."""


@contextmanager
def opened(bench: TwinBench, make: MakeDriver) -> Iterator[Driver]:
    """The driver, open in front of its twin."""
    with bench:
        driver = make(bench.address)
        try:
            with bench.serving():
                driver.open()
            yield driver
        finally:
            driver.close()


def reads_its_twin(bench: TwinBench, make: MakeDriver) -> None:
    """It opens, and good samples come; no frame of its own device is bad to it."""
    with opened(bench, make) as driver:
        name = _name(driver)
        assert driver.health.connected, f"{name} is open and says that it isn't connected"
        assert _until(bench, driver, lambda: driver.health.frames > 0), f"{name} counts no frame of its twin"
        if driver.states:
            assert _until(bench, driver, lambda: driver.health.stamp >= 0), f"{name} has no sample: no `health.stamp`"
            assert driver.health.stamp <= bench.now, f"{name}: a stamp lies in the future"
            for state, values in driver.state_arrays.items():
                assert np.isfinite(values).all(), f"{name}.{state} isn't finite: {values}"
        _read(bench, driver, 10)  # what overflowed while it opened isn't counted
        before = driver.health.errors
        assert _read(bench, driver, 50), f"{name} says that its twin is lost, and it is there"
        bad = driver.health.errors - before
        assert bad == 0, f"{name} and its twin disagree: {bad} bad frames"


def a_pulled_cable_is_a_loss(bench: TwinBench, make: MakeDriver) -> None:
    """With the port gone, `read` raises DeviceLostError soon, and it isn't connected any more."""
    with opened(bench, make) as driver:
        bench.twin.close()
        lost = not _read(bench, driver, MOST)
        assert lost, f"{_name(driver)}: its port is gone, and `read` goes on"
        assert not driver.health.connected, f"{_name(driver)}: its port is gone, and it says that it is connected"


def a_hang_makes_samples_old(bench: TwinBench, make: MakeDriver) -> None:
    """While the device says nothing, the stamp stays; it may also be told as a loss."""
    if not hasattr(bench.twin, "muted"):
        raise SkipTest("the twin can't be muted")
    with opened(bench, make) as driver:
        if not driver.states:
            raise SkipTest("the device gives no samples")
        _until(bench, driver, lambda: driver.health.stamp >= 0)
        bench.twin.muted = True
        if not _read(bench, driver, 10):  # what was on its way comes still
            return
        stamp = driver.health.stamp
        _read(bench, driver, 50)
        assert driver.health.stamp == stamp, f"{_name(driver)}: nothing came, and `health.stamp` went on"


def noise_is_counted(bench: TwinBench, make: MakeDriver) -> None:
    """Noise on the line raises nothing and is counted; afterwards good frames are found again."""
    if not hasattr(bench.twin, "link") or not hasattr(bench.twin, "muted"):
        raise SkipTest("the twin isn't on a serial line")
    with opened(bench, make) as driver:
        name, chance = _name(driver), Random(1)
        assert hasattr(bench.twin, "door"), "a serial twin has a door"
        assert _until(bench, driver, lambda: driver.health.frames > 0), f"{name} counts no frame of its twin"
        before = driver.health.errors + driver.health.resyncs
        bench.twin.muted = True
        for _ in range(20):
            bench.twin.door.write(chance.randbytes(200))
            assert _read(bench, driver, 1), f"{name} takes noise on the line for a loss"
        bench.twin.muted = False
        noted = _until(bench, driver, lambda: driver.health.errors + driver.health.resyncs > before)
        assert noted, f"{name} got noise, and counts it neither in `errors` nor in `resyncs`"
        frames = driver.health.frames
        assert _until(bench, driver, lambda: driver.health.frames > frames + 2), f"{name} finds no frame after noise"
        for state, values in driver.state_arrays.items():
            assert np.isfinite(values).all(), f"{name}.{state} isn't finite after noise: {values}"


def _until(bench: TwinBench, driver: Driver, condition: Callable[[], bool]) -> bool:
    """Reads until it is so; whether it became so before a loss, and in time."""
    for _ in range(MOST):
        if not _read(bench, driver, 1):
            return False
        if condition():
            return True
    return False


def _read(bench: TwinBench, driver: Driver, cycles: int) -> bool:
    """Runs so many cycles; False: the driver said that the device is lost."""
    for _ in range(cycles):
        bench.run(CYCLE)
        try:
            driver.read(bench.now)
        except DeviceLostError:
            return False
    return True


def _name(driver: Driver) -> str:
    return type(driver).__name__
