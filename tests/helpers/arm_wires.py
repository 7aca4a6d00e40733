"""Drivers of arms and their twins, in lockstep; what reached the twins."""

from __future__ import annotations

import select
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import srl.drivers.panda.driver
import srl.drivers.ur.driver
from helpers import panda
from helpers.background import repeating
from helpers.bad_link import Valve
from helpers.panda import MS
from helpers.twin import Bench
from helpers.under_guard import Setting, Wire
from helpers.ur import make_fake
from helpers.wait import until
from srl.drivers.datagram import Datagrams
from srl.drivers.panda import Panda
from srl.drivers.panda.config import PandaConfig
from srl.drivers.transport import Transport
from srl.drivers.ur import Ur, UrConfig
from srl.drivers.ur.registers import MODE, VALUES, Mode
from srl.runtime.loop.device import Device
from srl.sim.devices.ur.twin import UrTwin

EXACT = 1e-6  # the wire rounds less
Guard = dict[str, float]
UR: dict[str, tuple[Guard, float, float]] = {  # by interface: guard, amplitude, rate
    "velocity": ({"velocity": 0.8, "acceleration": 4.0}, 0.3, 4.0),
    "position": ({"velocity": 2.0, "acceleration": 20.0}, 0.2, 2.0),
}
PANDA: dict[str, tuple[Guard, float, float, float]] = {  # the same, and what its limiter adds: see `Setting.filtered`
    "torque": ({"velocity": 2.0, "effort": 20.0, "effort_rate": 200.0, "inertia": 0.1}, 1.0, 200.0, 0.0),
    "velocity": ({"velocity": 0.8, "acceleration": 4.0}, 0.2, 4.0, 4e-3),  # it starts softly and catches up
    "position": ({"velocity": 0.8, "acceleration": 4.0}, 0.05, 0.8, 1e-5),
}


class UrWire(Wire):
    """A UR16e behind RTDE, 500 times a second."""

    def __init__(self, patch: pytest.MonkeyPatch, to: Path, interface: str, **options: Any) -> None:
        given = {"port": "tcp://127.0.0.1", "interface": interface} | options
        self.fake = make_fake(given)
        self.twin, self.valve = UrTwin(self.fake), Valve()
        self.bench = Bench(self.twin)
        given["port"] = self.twin.address
        (command,) = Ur("device", UrConfig(**given)).commands
        guard, amplitude, rate = UR[interface]
        centre = self.fake.controller.arm.position.copy() if interface == "position" else np.zeros(6)
        super().__init__(Setting("ur", given, command, guard, centre, amplitude, 500.0, rate, np.full(6, EXACT)))
        opening = srl.drivers.ur.driver.open_transport

        def opened(*args: Any, **options: Any) -> Transport:
            self._in = self._came()
            return self.valve.fit(opening(*args, **options))

        patch.setattr(srl.drivers.ur.driver, "open_transport", opened)
        write = self.twin.registers.write

        def written(values: dict[str, Any]) -> None:
            write(values)
            inputs = self.twin.registers.inputs
            if inputs.ints[MODE] == Mode.FOLLOW:
                self.got += list(enumerate(inputs.doubles[VALUES : VALUES + 6]))
            elif inputs.ints[MODE] == Mode.STAY and interface == "velocity":
                self.got += [(joint, 0.0) for joint in range(6)]

        patch.setattr(self.twin.registers, "write", written)

    def open(self, device: Device) -> None:
        with self.bench.running():
            device.driver.open()
        self.now = self.bench.now
        self.got.clear()

    def _came(self) -> int:
        return self.twin._rtde.bytes_in

    def advance(self, lost: bool) -> None:
        samples = self.twin._rtde.bytes_out
        self.bench.run(1 / self.setting.hz)
        self.now = self.bench.now
        if not lost and self.valve.link is not None and self.twin._rtde.bytes_out > samples:
            assert select.select([self.valve.link], [], [], 10.0)[0], "no sample"

    def settle(self) -> None:
        until(
            lambda: self._came() - self._in >= self.valve.given, lambda: self.twin.service(self.now), pause=0.0,
            what=lambda: f"{self.valve.given} bytes, {self._came() - self._in} came",
        )  # fmt: skip

    def leave(self) -> None:
        self.twin.close()

    def come_back(self) -> None:
        controller = self.fake.controller
        controller.arm._q += 0.1
        controller.motion.halt(controller.arm.position.copy())
        self.twin.open()

    def close(self) -> None:
        self.twin.close()


class PandaWire(Wire):
    """A Franka arm behind FCI, 1000 times a second: a command that the link refuses is lost."""

    def __init__(self, patch: pytest.MonkeyPatch, to: Path, interface: str) -> None:
        self.twin = panda.twin(lockstep=False, **panda.QUIET)
        self.twin.open()
        given = {"port": self.twin.address, "interface": interface}
        (command,) = Panda("device", PandaConfig.model_validate(given)).commands
        guard, amplitude, rate, filtered = PANDA[interface]
        position = self.twin.robot.part.position.copy()
        centre = position if interface == "position" else np.zeros(7)
        super().__init__(
            Setting("panda", given, command, guard, centre, amplitude, 1000.0, rate, np.full(7, EXACT), filtered)
        )
        self.valve = Valve()
        opening = srl.drivers.panda.driver.open_datagrams

        def opened(*args: Any, **options: Any) -> Datagrams:
            self._states = self.valve.fit_datagrams(opening(*args, **options))
            return self._states

        patch.setattr(srl.drivers.panda.driver, "open_datagrams", opened)
        deliver = self.twin.robot.deliver

        def delivered(setpoint: Any) -> None:
            deliver(setpoint)
            if not setpoint.finished:
                values = {"torque": setpoint.tau, "velocity": setpoint.dq, "position": setpoint.q}[interface]
                self.got += list(enumerate(np.asarray(values, float).tolist()))

        patch.setattr(self.twin.robot, "deliver", delivered)

    def _turn(self) -> None:
        self.twin.fake.world.advance(self.twin.fake.world.time + MS)
        self.twin.service(self.now)

    def open(self, device: Device) -> None:
        with repeating(self._turn, 0.0007):
            device.driver.open()
        self.now = time.monotonic_ns()
        self.got.clear()

    def advance(self, lost: bool) -> None:
        sent = self.twin.states
        self._turn()
        self.now += MS
        if not lost and self.twin.states > sent:
            assert select.select([self._states], [], [], 10.0)[0], "no state"

    def settle(self) -> None:
        self.twin.service(self.now)  # loopback datagrams arrive at once

    def leave(self) -> None:
        self.twin.close()

    def come_back(self) -> None:
        self.twin.open()

    def close(self) -> None:
        self.twin.close()
