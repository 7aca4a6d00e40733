"""Drivers on serial lines and the twins at the far end of their ptys, in lockstep; what reached the twins."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import srl.drivers.firmata.driver
import srl.drivers.servo_bus.driver
import srl.drivers.softhand.driver
from helpers import dynamixel, feetech
from helpers.bad_link import Valve
from helpers.dynamixel import waiting
from helpers.sim import world
from helpers.twin import Bench
from helpers.under_guard import Setting, Wire
from helpers.wait import until
from srl.drivers.dynamixel import Dynamixel
from srl.drivers.dynamixel.config import DynamixelConfig
from srl.drivers.dynamixel.family import Family, signed
from srl.drivers.feetech import Feetech
from srl.drivers.feetech.config import FeetechConfig
from srl.drivers.firmata import Firmata
from srl.drivers.firmata.config import FirmataConfig
from srl.drivers.softhand import SoftHand
from srl.drivers.softhand.config import SoftHandConfig
from srl.drivers.transport import Transport
from srl.runtime.loop.device import Device
from srl.sim.devices.dynamixel.twin import DynamixelTwin
from srl.sim.devices.feetech.twin import FeetechTwin
from srl.sim.devices.firmata.fake import FakeFirmata, FakeFirmataConfig
from srl.sim.devices.firmata.twin import FirmataTwin
from srl.sim.devices.shared.serial import SerialTwin
from srl.sim.devices.softhand.fake import FakeSoftHand, FakeSoftHandOptions
from srl.sim.devices.softhand.twin import SoftHandTwin
from srl.sim.world.cell import Cell, CellConfig

PINS = (9, 10)
JOINTS = ("abduction", "flexion_1")  # as the world calls its servos
RANGE = (100, 17_500)  # ticks of the SoftHand
Motors = dict[str, dict[str, Any]]
DYNAMIXEL: dict[str, tuple[dict[str, float], float, float]] = {  # by mode: guard, amplitude, rate
    "position": ({"velocity": 3.0, "acceleration": 30.0}, 0.3, 3.0),
    "velocity": ({"velocity": 2.0, "acceleration": 10.0}, 0.8, 10.0),
    "effort": ({"velocity": 6.0, "effort": 1.0, "effort_rate": 5.0, "inertia": 0.01, "acceleration": 100.0}, 0.6, 5.0),
}
GOALS = {  # registers of both protocols
    "position": {"goal_position"},
    "current-position": {"goal_position"},
    "velocity": {"goal_velocity", "moving_speed"},
    "effort": {"goal_current", "goal_torque"},
}


class SerialWire(Wire):
    """A twin on a pty."""

    def __init__(
        self, setting: Setting, twin: SerialTwin, module: ModuleType, patch: pytest.MonkeyPatch, to: Path
    ) -> None:
        super().__init__(setting)
        self.twin, self.valve = twin, Valve()
        self.valve.clock = lambda: self.now
        twin.keep_log = True
        twin.link = to / "port"
        self.bench = Bench(twin)
        setting.options["port"] = twin.address
        self._in = self._out = 0
        opening = module.open_transport

        def opened(*args: Any, **options: Any) -> Transport:
            self._in, self._out = twin.door.bytes_in, twin.door.bytes_out
            return self.valve.fit(opening(*args, **options))

        patch.setattr(module, "open_transport", opened)

    def open(self, device: Device) -> None:
        with self.bench.running(frozen=True):
            device.driver.open()
        self.now = self.bench.now
        self.got.clear()

    def advance(self, lost: bool) -> None:
        self.bench.run(1 / self.setting.hz)
        self.now = self.bench.now
        link = self.valve.link
        if lost or link is None or not self.twin.door.is_open:
            return
        door, valve = self.twin.door, self.valve
        until(lambda: valve.received + waiting(link.fileno()) >= door.bytes_out - self._out, pause=0.0)

    def settle(self) -> None:
        door, valve = self.twin.door, self.valve
        if not door.is_open:
            return
        until(
            lambda: door.bytes_in - self._in >= valve.given, lambda: self.twin.service(self.now), pause=0.0,
            what=lambda: f"{valve.given} bytes, {door.bytes_in - self._in} came",
        )  # fmt: skip
        self.collect()

    def collect(self) -> None:
        """Takes what the twin has noted into `got`."""

    def leave(self) -> None:
        self.twin.close()

    def come_back(self) -> None:
        self.twin.open()

    def close(self) -> None:
        self.twin.close()


class FirmataWire(SerialWire):
    """Two hobby servos: no feedback, no watchdog, 1 us on the wire."""

    def __init__(self, patch: pytest.MonkeyPatch, to: Path) -> None:
        reach = {"lower": -1.5, "upper": 1.5, "home": 0.1}
        servos = {joint: {"pin": pin, **reach} for joint, pin in zip(JOINTS, PINS, strict=True)}
        options = {"port": "/dev/null", "servos": servos}
        config = FirmataConfig.model_validate(options)
        driver = Firmata("device", config)
        (command,) = driver.commands
        twin = FirmataTwin(FakeFirmata("device", config, world(), FakeFirmataConfig()))
        setting = Setting(
            "firmata", options, command, {"velocity": 4.0, "acceleration": 40.0}, np.array([0.1, -0.1]), 0.6,
            100.0, 4.0, 0.51 * np.array(command.resolution),
        )  # fmt: skip
        super().__init__(setting, twin, srl.drivers.firmata.driver, patch, to)
        pulse = twin.servo_pulse

        def servo_pulse(pin: int, width: int) -> None:
            pulse(pin, width)
            joint = PINS.index(pin)
            self.got.append((joint, driver.calibrations[joint].angle(width)))

        patch.setattr(twin, "servo_pulse", servo_pulse)


class SoftHandWire(SerialWire):
    """One closure, by position."""

    def __init__(self, patch: pytest.MonkeyPatch, to: Path) -> None:
        options: dict[str, Any] = {"port": "/dev/null", "limits": RANGE}
        config = SoftHandConfig.model_validate(options)
        (command,) = SoftHand("device", config).commands
        world = Cell(CellConfig.model_validate({"parts": {"hand": {"part": "softhand"}}, "gravity": [0, 0, 0]}), 1)
        twin = SoftHandTwin(FakeSoftHand("device", config, world, FakeSoftHandOptions(noise=0.0)))
        setting = Setting(
            "softhand", options, command, {"velocity": 2.0, "acceleration": 20.0}, np.array([0.5]), 0.3, 100.0, 2.0,
            np.array([0.51 / (RANGE[1] - RANGE[0])]),
        )  # fmt: skip
        super().__init__(setting, twin, srl.drivers.softhand.driver, patch, to)
        self._seen = 0

    def collect(self) -> None:
        assert isinstance(self.twin, SoftHandTwin)
        low, high = RANGE
        references = self.twin._references
        self.got += [(0, (ticks - low) / (high - low)) for _, ticks in references[self._seen :]]
        self._seen = len(references)

    def come_back(self) -> None:
        self.twin.fake.part._angle += 0.3  # type: ignore[attr-defined]
        super().come_back()


class DynamixelWire(SerialWire):
    """Two servos; those of `models` have their own units."""

    def __init__(
        self, patch: pytest.MonkeyPatch, to: Path, protocol: int, mode: str, models: Motors = dynamixel.TWO,
        **options: Any,
    ) -> None:  # fmt: skip
        motors = {name: {"id": k} | motor for k, (name, motor) in enumerate(models.items(), 1)}
        given = {"port": "/dev/null", "baudrate": 1_000_000, "protocol": protocol, "mode": mode, "motors": motors}
        given |= options
        twin = dynamixel.make_twin(models, protocol=protocol, mode=mode, **options)
        driver = Dynamixel("device", DynamixelConfig.model_validate(given))
        (command,) = driver.commands
        guard, amplitude, rate = DYNAMIXEL[mode if mode in DYNAMIXEL else "position"]
        family = driver._units
        setting = Setting(
            "dynamixel", given, command, guard, np.zeros(2), amplitude, 100.0, rate,
            0.51 * np.abs(np.array(command.resolution)),
        )  # fmt: skip
        super().__init__(setting, twin, srl.drivers.servo_bus.driver, patch, to)
        for joint, servo in enumerate(twin.servos):
            self._listen(joint, servo, family)

    def come_back(self) -> None:
        """Other servos in their place, with other firmware: without torque, at other angles."""
        assert isinstance(self.twin, DynamixelTwin)
        chain = self.twin.bus.chain
        chain._data.qpos[chain._q] += 0.4
        chain._data.qvel[chain._v] = 0.0
        for servo in self.twin.servos:
            servo.put("firmware_version", 44)
            servo.restart()
        super().come_back()

    def _listen(self, joint: int, servo: Any, family: Family) -> None:
        effect = servo.take_effect

        def take_effect(name: str, value: int) -> None:
            effect(name, value)
            if name in GOALS[family.mode]:
                if name in ("moving_speed", "goal_torque"):
                    value = int(signed(np.uint16(value)))
                self.got.append((joint, float(value * family.unit[joint] + family._zero[joint])))

        servo.take_effect = take_effect


class FeetechWire(SerialWire):
    """Two STS servos: no watchdog, by position."""

    def __init__(self, patch: pytest.MonkeyPatch, to: Path) -> None:
        motors = {name: {"id": k} | motor for k, (name, motor) in enumerate(feetech.TWO.items(), 1)}
        given = {"port": "/dev/null", "motors": motors}
        twin = feetech.make_twin()
        driver = Feetech("device", FeetechConfig.model_validate(given))
        (command,) = driver.commands
        guard, amplitude, rate = DYNAMIXEL["position"]
        setting = Setting(
            "feetech", given, command, guard, np.zeros(2), amplitude, 100.0, rate,
            0.51 * np.abs(np.array(command.resolution)),
        )  # fmt: skip
        super().__init__(setting, twin, srl.drivers.servo_bus.driver, patch, to)
        for joint, servo in enumerate(twin.servos):
            self._listen(joint, servo, driver)

    def come_back(self) -> None:
        """Other servos in their place: without torque, at other angles."""
        assert isinstance(self.twin, FeetechTwin)
        chain = self.twin.bus.chain
        chain._data.qpos[chain._q] += 0.4
        chain._data.qvel[chain._v] = 0.0
        chain.measure()
        for servo in self.twin.servos:
            servo.restart()
        super().come_back()

    def _listen(self, joint: int, servo: Any, driver: Feetech) -> None:
        effect, units = servo.take_effect, driver._units

        def take_effect(name: str) -> None:
            effect(name)
            if name == "goal_position":
                value = float(servo.get(name) * units.unit[joint] + units._zero[joint])
                self.got.append((joint, value))

        servo.take_effect = take_effect
