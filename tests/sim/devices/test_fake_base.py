"""The simulated base: it drives as told within its limits, measures by its wheels, and stops by itself."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.zenoh import bound

from srl.drivers.base import BaseConfig, MobileBase
from srl.drivers.base.driver import COMMAND
from srl.runtime.contracts import registry
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.errors import DeviceError, DeviceLostError, WiringError
from srl.runtime.contracts.signals import Signal, Stop
from srl.runtime.contracts.terms import PLANAR_TWIST
from srl.runtime.guard import GUARDS
from srl.runtime.ipc.header import State
from srl.runtime.ipc.requests import RequestKind
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile, wiring
from srl.sim.devices.base.fake import FakeBase, FakeBaseOptions
from srl.sim.world.cell import Cell, CellConfig

STEP = 10_000_000  # ns
CONFIG = BaseConfig(port="tcp://127.0.0.1:7447")


class Drive:
    """A base in lockstep at 100 Hz."""

    def __init__(self, seed: int = 0, config: BaseConfig = CONFIG, **options: Any) -> None:
        self.world = Cell(CellConfig(parts={"base": {"part": "summit-xl"}}), seed)
        self.fake = FakeBase("base", config, self.world, FakeBaseOptions(**options))
        bound(self.fake)
        self.fake.open()
        self.command = self.fake.command_arrays[COMMAND]
        self.pose, self.twist = (self.fake.state_arrays[name] for name in ("pose", "twist"))

    def run(self, seconds: float, write: bool = True) -> None:
        for _ in range(round(seconds * 1e9 / STEP)):
            self.world.advance(self.world.time + STEP)
            self.fake.read(self.world.time)
            if write:
                self.fake.write(self.world.time)


def test_it_has_the_drivers_signals_and_limits() -> None:
    fake, real = Drive().fake, MobileBase("base", CONFIG)
    assert (fake.states, fake.commands, fake.max_age) == (real.states, real.commands, real.max_age)
    assert fake.limits[COMMAND].velocity == pytest.approx(real.limits[COMMAND].velocity)


@pytest.mark.slow
def test_it_goes_where_it_is_told_and_odometry_slips() -> None:
    drive = Drive(noise=0.0)
    drive.command[:] = 0.5, 0.0, 0.0
    drive.run(4.0)
    assert drive.twist == pytest.approx([0.5, 0, 0], abs=0.01)
    truth = drive.fake.base.pose()
    assert 1.6 < truth[0] < drive.pose[0] < 2.0  # the wheels count way that the base didn't move
    drive.command[:] = 0.0, 0.2, 0.5
    drive.run(20.0)
    assert drive.pose[2] > 2 * np.pi  # the yaw counts on over a turn


def test_the_pose_is_carried_on_between_samples() -> None:
    ages = {}
    for extrapolate in (True, False):
        drive = Drive(config=CONFIG.model_copy(update={"extrapolate": extrapolate}), noise=0.0, rate=20.0, delay=0.03)
        drive.command[:] = 0.5, 0.0, 0.0
        drive.run(3.0)
        steps = []
        for _ in range(20):
            before = drive.pose[0]
            drive.run(STEP * 1e-9)
            steps.append(drive.pose[0] - before)
        ages[extrapolate] = max(steps), drive.fake.base.odometry()[0][0] - drive.pose[0]
    assert ages[True][0] < 0.0065  # 5 mm a cycle, instead of 25 mm each fifth
    assert ages[False][0] > 0.02
    assert abs(ages[True][1]) < 0.003


def test_a_silent_loop_and_a_stop_bring_it_to_rest() -> None:
    drive = Drive()
    drive.command[:] = 0.5, 0.1, 0.2
    drive.run(2.0)
    drive.run(1.2, write=False)
    assert np.abs(drive.fake.base.twist()).max() < 0.01
    drive.run(2.0)
    drive.fake.stop(Stop.BRAKE)
    drive.run(0.5, write=False)
    assert np.abs(drive.fake.base.twist()).max() < 0.01


def test_the_emergency_stop() -> None:
    drive = Drive(pressed=((1.0, 2.0),))
    drive.command[:] = 0.5, 0.0, 0.0
    drive.run(1.5)
    assert "emergency" in drive.fake.health.fault
    assert abs(drive.fake.base.twist()[0]) < 0.02
    drive.run(2.0)
    assert drive.fake.health.fault == ""
    assert drive.fake.base.twist()[0] > 0.4


def test_commands_are_cut_and_nonsense_is_ignored() -> None:
    drive = Drive(config=CONFIG.model_copy(update={"sideways": False}))
    drive.command[:] = 9.0, 9.0, -9.0
    drive.run(3.0)
    assert drive.fake.base.odometry()[1] == pytest.approx([0.75, 0.0, -0.785], abs=0.02)
    drive.command[:] = np.nan, 0.0, 0.0
    drive.run(1.5)  # nothing is obeyed, so it stops
    assert np.abs(drive.fake.base.twist()).max() < 0.01


def test_behind_the_guard_it_brakes_within_its_limits() -> None:
    drive = Drive(noise=0.0)
    fake = drive.fake
    guard = GUARDS[fake.commands[0].kind]("guard.base", fake.commands[0], fake.limits[COMMAND], STEP * 1e-9)
    guard.bind(drive.command, drive.pose)
    guard.reset(np.zeros(3))
    last = drive.command.copy()
    for k in range(600):
        if k < 300:
            guard.step(np.array([5.0, 0.0, 0.3]), None, STEP * 1e-9)
        else:
            guard.stop(Stop.BRAKE, STEP * 1e-9)
        assert np.all(np.abs(drive.command - last) <= np.array([0.6, 0.6, 1.5]) * STEP * 1e-9 + 1e-12)
        last[:] = drive.command
        drive.run(STEP * 1e-9)
        if k == 299:
            assert drive.twist[0] == pytest.approx(0.75, abs=0.02)
    assert guard.at_rest
    assert np.abs(drive.twist).max() < 0.01


def test_loss_windows_and_the_way_back() -> None:
    drive = Drive(loss=((1.0, 1.5),))
    drive.command[:] = 0.5, 0.0, 0.0
    with pytest.raises(DeviceLostError):
        drive.run(2.0)
    assert not drive.fake.health.connected
    with pytest.raises(DeviceError):
        drive.fake.open()
    drive.world.advance(2 * 10**9)
    drive.fake.open()
    assert drive.fake.health.reconnects == 1
    drive.run(0.1)
    assert drive.fake.health.stamp > 1.9e9


def test_the_same_seed_gives_the_same_bits() -> None:
    def trace(seed: int) -> list[bytes]:
        drive = Drive(seed)
        drive.command[:] = 0.4, 0.1, 0.3
        found = []
        for _ in range(50):
            drive.run(STEP * 1e-9)
            found.append(drive.pose.tobytes() + drive.twist.tobytes())
        return found

    assert trace(3) == trace(3)
    assert trace(3) != trace(4)


class Cruise(Controller):
    """Half a metre a second, ahead."""

    Config = ControllerConfig

    def __init__(self, name: str, config: ControllerConfig) -> None:
        super().__init__(name, config)
        self.outputs = (Signal(name="twist", shape=(3,), unit="m/s, rad/s", labels=PLANAR_TWIST),)

    def reset(self) -> None:
        self.output["twist"][:] = 0.0

    def update(self, dt: float) -> None:
        self.output["twist"][:] = 0.5, 0.0, 0.0


PROFILE = """
name: cruise
rate: 100
devices:
  base: {driver: base, port: "tcp://127.0.0.1:7447"}
controllers:
  - {use: cruise, out: {twist: base.twist_command}}
stop: {base: brake}
sim: {world: cell, parts: {base: {part: summit-xl}}, devices: {base: {pressed: [[4.0, 5.0]]}}}
"""


def test_a_profile_wires_it_and_its_fault_stops_it(monkeypatch: pytest.MonkeyPatch) -> None:
    load = registry.load
    monkeypatch.setattr(registry, "load", lambda g, n, p: Cruise if n == "cruise" else load(g, n, p))
    graph = wiring.build(*profile.parse("cruise.yaml", PROFILE), [])
    lockstep = Lockstep(graph)
    seen: dict[int, tuple[State, float]] = {}
    for k in range(1, 601):
        state = lockstep.step(RequestKind.RESET if k == 550 else RequestKind.NONE)
        seen[k] = state, float(graph.row.views["base.twist"][0])
    assert seen[390][0] is State.ACTIVE
    assert seen[390][1] == pytest.approx(0.5, abs=0.03)
    assert seen[540][0] is State.STOPPED
    assert abs(seen[540][1]) < 0.02
    assert seen[600][0] is State.ACTIVE


def test_a_world_without_a_base_is_refused() -> None:
    world = Cell(CellConfig(parts={"thing": {"part": "box", "size": [1, 1, 1]}}), 0)
    with pytest.raises(WiringError):
        FakeBase("base", CONFIG, world, FakeBaseOptions())
