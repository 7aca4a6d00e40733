"""A simulated capture system in a small cell, for tests of Vicon's fake, twin and driver."""

from __future__ import annotations

import time
from contextlib import AbstractContextManager
from typing import Any

from helpers.background import repeating
from helpers.twin import bound
from srl.drivers.vicon import Vicon
from srl.drivers.vicon.config import ViconConfig
from srl.sim.devices.vicon.fake import FakeVicon
from srl.sim.devices.vicon.twin import ViconTwin
from srl.sim.world.cell import Cell, CellConfig

PARTS: dict[str, Any] = {
    "hand": {"part": "mocap-body", "subject": "Hand", "at": {"position": [0.3, 0.1, 1.0]}, "motion": {"kind": "sine"}},
    "tool": {
        "part": "mocap-body",
        "subject": "Tool",
        "segment": "Tip",
        "at": {"position": [-0.4, 0.2, 0.8]},
        "motion": {"kind": "circle"},
    },
}
WANTED: dict[str, Any] = {
    "segments": {"hand": "Hand", "tip": "Tool/Tip"},
    "markers": {"first": "Hand/M1", "second": "Tool/M2"},
    "unlabelled": 2,
}


def config(port: str = "tcp://127.0.0.1:801", **options: Any) -> ViconConfig:
    """A device's options; the wanted ones where none are given."""
    return ViconConfig.model_validate({"port": port, **(options or WANTED)})


def fake(device: ViconConfig | None = None, parts: Any = None, seed: int = 1, **options: Any) -> FakeVicon:
    """A fake with its cell."""
    cell = Cell(CellConfig.model_validate({"parts": parts or PARTS}), seed)
    return FakeVicon("mocap", device or config(), cell, FakeVicon.Options.model_validate(options))


def twin(device: ViconConfig | None = None, parts: Any = None, seed: int = 1, **options: Any) -> ViconTwin:
    """A twin with its fake and its cell."""
    return ViconTwin(fake(device, parts, seed, **options))


def driver(port: str, **options: Any) -> Vicon:
    """A driver with arrays of its own."""
    device = Vicon("mocap", config(port, **options))
    bound(device)
    return device


def live(served: ViconTwin) -> AbstractContextManager[None]:
    """Runs an open twin in real time, in a thread."""
    start = time.monotonic_ns() - served.fake.world.time

    def serve() -> None:
        now = time.monotonic_ns()
        served.fake.world.advance(now - start)
        served.service(now)

    return repeating(serve, 0.001)
