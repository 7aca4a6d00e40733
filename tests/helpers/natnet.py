"""A simulated Motive with an arm of two rigid bodies and a person, and the driver on it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

from helpers.twin import bound
from srl.drivers.natnet import NatNet
from srl.sim.devices.natnet.fake import FakeNatNet
from srl.sim.devices.natnet.twin import NatNetTwin
from srl.sim.world.cell import Cell, CellConfig
from srl.testing import TwinBench

TOOL = {
    "part": "mocap-body",
    "subject": "Drill",
    "at": {"position": [0.4, -0.2, 1.1], "quaternion": [0.5, 0.5, -0.5, 0.5]},
    "markers": {"A": [0.0, 0.0, 0.05], "B": [0.06, 0.0, 0.0], "C": [0.0, 0.04, 0.0], "D": [-0.03, 0.0, 0.0]},
}
EXACT = {"noise": 0.0, "delay": 0.006}
BONES = {"Hip": "wearer/Hips", "Chest": "wearer/Spine3", "Head": "wearer/Head", "RUArm": "wearer/RightArm"}
WANTED: dict[str, Any] = {"segments": {"tool": "Drill"}, "markers": {"a": "Drill/A", "d": "Drill/D"}}


def motive(
    config: dict[str, Any] | None = None,
    options: dict[str, Any] | None = None,
    parts: dict[str, Any] | None = None,
) -> TwinBench:
    """The twin in its bench; arguments as in a profile."""
    world = Cell(CellConfig.model_validate({"parts": parts or {"tool": TOOL}}), seed=2)
    settings = NatNet.Config.model_validate({"port": "udp://127.0.0.1"} | (config or WANTED))
    fake = FakeNatNet("mocap", settings, world, FakeNatNet.Options.model_validate(EXACT | (options or {})))
    bound(fake)
    return TwinBench.of(NatNetTwin(fake))


@contextlib.contextmanager
def opened(bench: TwinBench, config: dict[str, Any] | None = None) -> Iterator[NatNet]:
    """The driver, open on it. The twin's bench is left open."""
    driver: NatNet = bound(NatNet("mocap", NatNet.Config.model_validate({"port": bench.address} | (config or WANTED))))
    with bench.serving():
        driver.open()
    try:
        yield driver
    finally:
        driver.close()


def step(bench: TwinBench, driver: NatNet, cycles: int = 1, period: float = 0.01) -> None:
    """Lets cycles pass, each of `period` s."""
    for _ in range(cycles):
        bench.run(period)
        driver.read(bench.now)
