"""Every driver with commands and the far end of its link, by name; the base, in real time."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from helpers.arm_wires import EXACT, PANDA, UR, PandaWire, UrWire
from helpers.bad_link import Hang
from helpers.can_wires import AxesWire, MitWire
from helpers.dynamixel import PRESSING
from helpers.serial_wires import DYNAMIXEL, DynamixelWire, FeetechWire, FirmataWire, SoftHandWire
from helpers.twin import bound
from helpers.under_guard import Setting, Wire
from helpers.zenoh import Served
from srl.drivers.base import BaseConfig, MobileBase
from srl.runtime.loop.device import Device
from srl.sim.devices.base.fake import FakeBase, FakeBaseOptions
from srl.sim.devices.base.twin import BaseTwin
from srl.sim.world.cell import Cell, CellConfig


class BaseWire(Wire):
    """A mobile base behind zenoh, in real time."""

    def __init__(self, patch: pytest.MonkeyPatch, to: Path) -> None:
        world = Cell(CellConfig(parts={"device": {"part": "summit-xl"}}), 0)
        options = {"port": "tcp://127.0.0.1:1"}
        config = BaseConfig.model_validate(options)
        fake = FakeBase("device", config, world, FakeBaseOptions())
        bound(fake)
        self.twin, self.valve = BaseTwin(fake), Hang()
        self.twin.keep_log = True
        self.served = Served(world, self.twin)
        self.served.start()
        (command,) = MobileBase("device", config).commands
        guard = {"velocity": 0.5, "acceleration": 0.5}
        given = {"port": self.twin.address}
        super().__init__(
            Setting("base", given, command, guard, np.zeros(3), 0.08, 100.0, 0.5, np.full(3, EXACT), late=30)
        )
        self._seen = 0

    def open(self, device: Device) -> None:
        assert isinstance(device.driver, MobileBase)
        device.driver.open()
        self.valve.fit(device.driver)
        self._urgent(True, device.driver._link.pid() or 0)
        self.now = time.monotonic_ns()

    def _urgent(self, on: bool, *processes: int) -> None:
        """What else runs on this machine is no stall."""
        policy, priority = (os.SCHED_FIFO, 10) if on else (os.SCHED_OTHER, 0)
        for process in (0, *processes):
            with contextlib.suppress(PermissionError):
                os.sched_setscheduler(process, policy, os.sched_param(priority))

    def advance(self, lost: bool) -> None:
        due = self.now + round(1e9 / self.setting.hz)
        time.sleep(max(0, due - time.monotonic_ns()) * 1e-9)
        self.now = max(due, time.monotonic_ns())

    def settle(self) -> None:
        taken = self.served.do(lambda: self.twin.taken[self._seen :])
        self._seen += len(taken)
        for _, velocity in taken:
            self.got += list(enumerate(velocity))

    def leave(self) -> None:
        self.served.do(self.twin.close)

    def come_back(self) -> None:
        self.served.do(self.twin.open)

    def close(self) -> None:
        self._urgent(False)
        self.served.__exit__()


# Devices that stop by themselves wait as long as they can, so that the law goes on during a stall.
WIRES: dict[str, Callable[[pytest.MonkeyPatch, Path], Wire]] = {
    "feetech": FeetechWire,
    "firmata": FirmataWire,
    "softhand": SoftHandWire,
    "base": BaseWire,
    "odrive": partial(AxesWire, kind="odrive"),
    "cubemars-servo": partial(AxesWire, kind="cubemars-servo"),
}
for _maker in ("damiao", "v2", "v3"):
    WIRES[f"mit-can-{_maker}"] = partial(MitWire, maker=_maker)
for _mode in ("velocity", "effort"):
    WIRES[f"mit-can-{_mode}"] = partial(MitWire, maker="damiao", mode=_mode)
for _mode in DYNAMIXEL:
    for _protocol in (1, 2):
        WIRES[f"dynamixel-{_mode}-{_protocol}"] = partial(DynamixelWire, protocol=_protocol, mode=_mode, watchdog=2.0)
WIRES["dynamixel-current-position-2"] = partial(
    DynamixelWire, protocol=2, mode="current-position", models=PRESSING, watchdog=2.0
)
for _mode in PANDA:
    WIRES[f"panda-{_mode}"] = partial(PandaWire, interface=_mode)
for _mode in UR:
    WIRES[f"ur-{_mode}"] = partial(UrWire, interface=_mode, timeout=0.2)
