"""Drivers of motors on a CAN bus and the twins at its other end, in lockstep; what reached the motors.

Three motors: of a bus that takes each other frame, each gets every second command.
"""

from __future__ import annotations

import itertools
import os
import struct
import time
from abc import abstractmethod
from math import radians
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import can
import numpy as np
import pytest

import srl.drivers.can_axes.driver
import srl.drivers.canbus
import srl.drivers.cubemars_servo.driver
import srl.drivers.mit_can.driver
import srl.drivers.mit_can.opening
import srl.drivers.odrive.opening
import srl.drivers.timeout
from helpers import can_drives, mit_can
from helpers.bad_link import CanValve
from helpers.serial_wires import DYNAMIXEL
from helpers.twin import Bench
from helpers.under_guard import Setting, Wire
from srl.drivers.canbus import CanLink
from srl.drivers.cubemars_servo import protocol as servo_protocol
from srl.drivers.mit_can import MitCan, protocol
from srl.drivers.odrive import protocol as odrive_protocol
from srl.runtime.contracts.driver import Driver
from srl.runtime.loop.device import Device
from srl.sim.devices.cubemars_servo.twin import CubemarsServoTwin
from srl.sim.devices.odrive.twin import OdriveTwin
from srl.sim.devices.shared.can import CanTwin

JOINTS = ("shoulder", "elbow", "wrist")
HZ = 100.0
_CLOCKED = (
    *(srl.drivers.canbus, srl.drivers.can_axes.driver, srl.drivers.mit_can.opening, srl.drivers.odrive.opening),
    *(srl.drivers.cubemars_servo.driver, srl.drivers.timeout),
)
_buses = itertools.count()


def bus() -> str:
    """A bus in memory of this process, which nobody else has."""
    return f"can://virtual/wires{os.getpid()}.{next(_buses)}"


class CanWire(Wire):
    """A twin on a bus in memory.

    A subclass gives, as `heard`, what a frame commands: (joint, value), or None.
    """

    twin: CanTwin

    def __init__(self, setting: Setting, twin: CanTwin, module: ModuleType, patch: pytest.MonkeyPatch) -> None:
        super().__init__(setting)
        self.twin, self.valve = twin, CanValve()
        self.bench = Bench(twin)
        setting.options["port"] = twin.address
        opening, take = module.open_can, twin.take

        def opened(*args: Any, **options: Any) -> CanLink:
            link = self.valve.fit(opening(*args, **options))
            patch.setattr(link, "stamp", lambda message, now: now)  # frames don't age by the test's own pauses
            return link

        def taken(message: can.Message, now: int) -> None:
            found = self.heard(message)
            take(message, now)
            if found is not None:
                self.got.append(found)

        patch.setattr(module, "open_can", opened)
        patch.setattr(twin, "take", taken)

    @abstractmethod
    def heard(self, message: can.Message) -> tuple[int, float] | None:
        """What a frame commands a motor that obeys."""

    def open(self, device: Device) -> None:
        clock = SimpleNamespace(monotonic=lambda: self.bench.now * 1e-9, sleep=self.bench.run, time=time.time)
        with pytest.MonkeyPatch.context() as patch:
            for module in _CLOCKED:
                patch.setattr(module, "time", clock)
            device.driver.open()
        self.now = self.bench.now
        self.got.clear()

    def advance(self, lost: bool) -> None:
        self.bench.run(1 / self.setting.hz)
        self.now = self.bench.now

    def settle(self) -> None:
        self.twin.service(self.now)

    def leave(self) -> None:
        self.twin.close()

    def come_back(self) -> None:
        """Just switched on, at other angles."""
        self._dip()
        self.twin.open()

    def _dip(self) -> None:
        chain = self.twin.fake.chain  # type: ignore[attr-defined]
        chain._data.qpos[chain._q] += 0.4
        chain._data.qvel[chain._v] = 0.0
        chain.measure()

    def close(self) -> None:
        self.twin.close()


def setting_of(driver: Driver, kind: str, options: dict[str, Any], mode: str, swing: float | None = None) -> Setting:
    """The wave of the bus servos, about 0. The wire cuts off, so it rounds to a step."""
    (command,) = driver.commands
    guard, amplitude, rate = DYNAMIXEL[mode]
    grain = 1.01 * np.abs(np.array(command.resolution))
    centre = np.zeros(len(JOINTS))
    return Setting(kind, options, command, guard, centre, swing or amplitude, HZ, rate, grain, by_joint=True)


class MitWire(CanWire):
    """Damiaos, or CubeMars of a firmware. A Damiao has a watchdog; a CubeMars swings near its park."""

    def __init__(
        self, patch: pytest.MonkeyPatch, to: Path, maker: str, mode: str = "position", watchdog: float = 0.5
    ) -> None:
        model, gains = ("DM4340" if maker == "damiao" else "AK80-9"), {"kp": 40, "kd": 2}
        if mode == "effort":
            gains = {"kd": 1}
        motors = {name: {"model": model} | gains for name in JOINTS}
        options: dict[str, Any] = {}
        if maker == "damiao":
            options |= {"watchdog": watchdog, "interface": "torque" if mode == "effort" else mode}
        else:
            # In silence it goes on with its last command, its speed included: not far, if it is stiff.
            motors = {name: motor | {"kp": 100, "kd": 4, "park": 0.0} for name, motor in motors.items()}
        self._config = mit_can.config(motors, maker, **options)
        twin = mit_can.twin(motors, maker, mit_can.cell(motors, hanging=False), bus(), **options)
        driver = MitCan("device", self._config)
        given = self._config.model_dump(exclude_unset=True, mode="json")
        swing = None if maker == "damiao" else 0.1  # so that it is still within `start_tolerance` then
        super().__init__(setting_of(driver, "mit-can", given, mode, swing), twin, srl.drivers.mit_can.driver, patch)
        self._mode, self._driver = mode, driver

    def heard(self, message: can.Message) -> tuple[int, float] | None:
        drives, data = self.twin.drives, bytes(message.data)  # type: ignore[attr-defined]
        v3 = self._config.generation == "v3"
        listen = [id + protocol.V3_COMMAND * v3 for id in drives.ids]
        if message.arbitration_id not in listen or data in protocol.SPECIAL:
            return None
        k = listen.index(message.arbitration_id)
        if not drives.motors.torque[drives.numbers[k]]:
            return None
        wanted, motor = protocol.parse_command(data, drives.spans[k], v3), self._motors[k]
        if self._mode == "position":
            return (k, (wanted.position - motor.zero) * motor.scale) if wanted.kp else None
        if abs(wanted.kd - motor.damping) < 0.01:
            return None  # it is damped
        return k, wanted.velocity * motor.scale if self._mode == "velocity" else wanted.torque / motor.scale

    @property
    def _motors(self) -> list[Any]:
        return list(self._config.motors.values())

    def _dip(self) -> None:
        self.twin.drives.power_down()  # type: ignore[attr-defined]
        super()._dip()
        self.twin.drives.power_up()  # type: ignore[attr-defined]


class AxesWire(CanWire):
    """ODrives, or CubeMars in servo mode, that don't know their place after a loss of power."""

    def __init__(self, patch: pytest.MonkeyPatch, to: Path, kind: str) -> None:
        self._kind = kind
        odrive = kind == "odrive"
        self._config: Any = can_drives.odrive(JOINTS, firmware="0.5") if odrive else can_drives.servo(JOINTS)
        world = can_drives.cell(kind, JOINTS, gravity=False)
        fake = can_drives.make_fake(self._config, world, bus=bus())
        twin = (OdriveTwin if odrive else CubemarsServoTwin)(fake)
        options = self._config.model_dump(exclude_unset=True, mode="json")
        super().__init__(setting_of(fake.driver, kind, options, "position"), twin, srl.drivers.can_axes.driver, patch)
        self._driver = fake.driver

    def heard(self, message: can.Message) -> tuple[int, float] | None:
        drives: Any = self._driver
        for k, node in enumerate(self.twin.nodes):  # type: ignore[attr-defined]
            if not node.motors.torque[node.i]:
                continue
            data = bytes(message.data)
            if self._kind == "odrive":
                to, command = odrive_protocol.split(message.arbitration_id)
                if (to, command) == (node.node, odrive_protocol.Command.INPUT_POSITION):
                    return k, drives._axes[k].scale.position(struct.unpack_from("<f", data)[0])
            elif message.arbitration_id == servo_protocol.identifier(servo_protocol.Mode.POSITION_SPEED, node.id):
                degrees = struct.unpack_from(">i", data)[0] / 1e4
                return k, radians(degrees)
        return None

    def _dip(self) -> None:
        nodes = self.twin.nodes  # type: ignore[attr-defined]
        for node in nodes:
            node.power_down()
        super()._dip()
        for node in nodes:
            node.power_up()
