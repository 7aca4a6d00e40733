"""A simulated suit on a person who reaches, and the driver on it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

from helpers.twin import bound
from srl.drivers.xsens_mvn import XsensMvn
from srl.sim.devices.xsens_mvn.fake import FakeMvn
from srl.sim.devices.xsens_mvn.twin import XsensMvnTwin
from srl.sim.world.cell import Cell, CellConfig
from srl.testing import TwinBench

PERSON: dict[str, Any] = {"wearer": {"part": "body", "script": "reach"}}
EXACT = {"rate": 100.0, "noise": 0.0, "delay": 0.0}


def mvn(
    config: dict[str, Any] | None = None, options: dict[str, Any] | None = None, parts: dict[str, Any] | None = None
) -> TwinBench:
    """The twin in its bench; arguments as in a profile."""
    world = Cell(CellConfig.model_validate({"parts": parts or PERSON}), seed=2)
    settings = XsensMvn.Config.model_validate({"port": "udp://127.0.0.1:0"} | (config or {}))
    fake = FakeMvn("suit", settings, world, FakeMvn.Options.model_validate(EXACT | (options or {})))
    bound(fake)
    return TwinBench.of(XsensMvnTwin(fake))


@contextlib.contextmanager
def opened(bench: TwinBench, config: dict[str, Any] | None = None) -> Iterator[XsensMvn]:
    """The driver, open on it."""
    driver: XsensMvn = bound(XsensMvn("suit", XsensMvn.Config.model_validate({"port": bench.address} | (config or {}))))
    with bench.serving():
        driver.open()
    try:
        yield driver
    finally:
        driver.close()


def step(bench: TwinBench, driver: XsensMvn, cycles: int = 1, period: float = 0.01) -> None:
    """Lets cycles pass, each of `period` s."""
    for _ in range(cycles):
        bench.run(period)
        driver.read(bench.now)
