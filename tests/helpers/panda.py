"""A simulated Franka robot for tests: its cell, its cabinet, its twin, and a client in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from helpers.wait import until
from srl.drivers.panda import Panda
from srl.sim.devices.panda.controller import PandaController
from srl.sim.devices.panda.fake import FakePanda
from srl.sim.devices.panda.motion import Setpoint
from srl.sim.devices.panda.robot import FakePandaConfig, PandaRobot
from srl.sim.devices.panda.twin import PandaTwin
from srl.sim.world.cell import Cell, CellConfig

MS = 1_000_000  # ns
QUIET = {"position_noise": 0.0, "velocity_noise": 0.0, "effort_noise": 0.0}


def host() -> str:
    """A loopback address of this process's own, so that tests side by side can all have port 1337."""
    high, low = divmod(os.getpid() % 65536, 256)
    return f"127.13.{high}.{low}"


def cell(robot: str = "panda", seed: int = 1, **parts: Any) -> Cell:
    """A world with an arm called `arm`."""
    arm = {"part": "panda", "robot": robot} | parts.pop("arm", {})
    return Cell(CellConfig.model_validate({"parts": {"arm": arm} | parts}), seed)


class Cabinet:
    """A robot whose time a test turns."""

    def __init__(self, robot: str = "panda", parts: dict[str, Any] | None = None, **options: Any) -> None:
        self.world = cell(robot, **(parts or {}))
        self.robot = PandaRobot("arm", self.world, FakePandaConfig.model_validate(QUIET | options))

    @property
    def control(self) -> PandaController:
        return self.robot.controller

    @property
    def position(self) -> np.ndarray[Any, Any]:
        return self.robot.part.position

    def run(self, count: int, setpoint: Callable[[int], Setpoint | None] | Setpoint | None = None) -> None:
        """`count` ms; the setpoint of ms i, or the same each time; None: none is sent."""
        for i in range(count):
            self.world.advance(self.world.time + MS)
            sent = setpoint(i) if callable(setpoint) else setpoint
            if sent is not None:
                self.robot.deliver(sent)
            self.robot.step()


def fake(world: Cell, **options: Any) -> FakePanda:
    """A fake on the cell's arm."""
    config = Panda.Config.model_validate({"port": "tcp://127.0.0.1:1"})
    return FakePanda("arm", config, world, FakePandaConfig.model_validate(options))


def twin(robot: str = "panda", host: str = "127.0.0.1", port: int = 0, parts: Any = None, **options: Any) -> PandaTwin:
    """A twin in lockstep, not yet open."""
    options = {"lockstep": True, "host": host, "port": port} | options
    return PandaTwin(fake(cell(robot, **(parts or {})), **options))


def turn(served: PandaTwin, pause: bool = True) -> None:
    """Lets the twin do what it can: wait for its client, or go on by a millisecond."""
    now = time.monotonic_ns()
    waits = served.waiting(now)
    if not waits:
        served.fake.world.advance(served.fake.world.time + MS)
    served.service(now)
    if not pause:
        return
    # A motion goes as fast as the client answers; else the pace is a robot's, about.
    time.sleep(5e-5 if waits else 0.0 if served.robot.controller.wait() else 7e-4)


def serve(served: PandaTwin, program: str, timeout: float = 60.0) -> dict[str, Any]:
    """Runs a client's program against the twin; gives what it printed, a JSON object on its last line."""
    served.open()
    client = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        until(
            lambda: client.poll() is not None,
            lambda: turn(served),
            what=lambda: f"the client's end; {served.metrics()}",
            timeout=timeout,
            pause=0.0,
        )
        out, complaints = client.communicate()
    finally:
        client.kill()
        client.communicate()
        served.close()
    assert client.returncode == 0, f"{client.returncode} {out} {complaints}"
    result: dict[str, Any] = json.loads(out.splitlines()[-1])
    return result
