"""The world made of parts: instants of samples, mounting, saved states, and the fakes' common base."""

from __future__ import annotations

from fractions import Fraction
from typing import Any
from xml.etree.ElementTree import Element

import mujoco
import numpy as np
import pytest
from pydantic import ValidationError

from srl.runtime.contracts import registry
from srl.runtime.contracts.driver import DeviceConfig, Sensor
from srl.runtime.contracts.errors import DeviceError, DeviceLostError, WiringError
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.world import FakeConfig, World
from srl.sim.devices.shared.sensor import SampledFake, SensorOptions
from srl.sim.world.cell import Cell, CellConfig
from srl.sim.world.mjcf import add
from srl.sim.world.part import Mjcf, Part, PartConfig

LENGTH = 0.3


class PendulumConfig(PartConfig):
    angle: float = 1.0


class Pendulum(Part):
    """A pendulum whose drive adds a torque of its own, remembered in its electronics."""

    Config = PendulumConfig

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self.every = 5
        self.torque = 0.0
        self.drives: list[int] = []
        self.truth = (Signal(name=f"{name}_angle", shape=(1,), unit="rad"),)

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        base = mjcf.body(parent, f"{self.name}/base", **self.at())
        rod = mjcf.body(base, f"{self.name}/rod")
        add(rod, "joint", name=f"{self.name}/joint", axis="0 1 0")
        add(rod, "geom", type="capsule", fromto=(0.0, 0.0, 0.0, 0.0, 0.0, -LENGTH), size=0.01, mass=1.0, contype=0)
        mjcf.body(rod, f"{self.name}/tip", pos=(0.0, 0.0, -LENGTH))

    def bind(self, model: Any, data: Any) -> None:
        self.address = model.joint(f"{self.name}/joint").qposadr[0]
        self.dof = model.joint(f"{self.name}/joint").dofadr[0]
        self.data = data
        data.qpos[self.address] = self.config.angle  # type: ignore[attr-defined]

    def drive(self, step: int) -> None:
        self.drives.append(step)
        self.torque = 0.9 * self.torque + 0.01
        self.data.qfrc_applied[self.dof] = self.torque

    def fill(self, truth: Any) -> None:
        truth[f"{self.name}_angle"][0] = self.data.qpos[self.address]

    def save(self) -> Array:
        return np.array([self.torque])

    def restore(self, state: Array) -> None:
        self.torque = state[0]


@pytest.fixture(autouse=True)
def _registered(monkeypatch: pytest.MonkeyPatch) -> None:
    known = registry.load
    monkeypatch.setattr(
        registry, "load", lambda g, n, p: Pendulum if (g, n) == ("parts", "pendulum") else known(g, n, p)
    )


def cell(**parts: dict[str, Any]) -> Cell:
    return Cell(CellConfig.model_validate({"parts": parts or {"one": {"part": "pendulum"}}}), 3)


def angle(world: Cell, name: str = "one") -> float:
    return float(world.truth_arrays[f"{name}_angle"][0])


def test_it_swings_as_mujoco_says() -> None:
    world = cell()
    world.advance(200_000_000)
    model, data = world.model, mujoco.MjData(world.model)
    data.qpos[:] = 1.0
    torque = 0.0
    for step in range(200):
        if step % 5 == 0:
            torque = 0.9 * torque + 0.01
            data.qfrc_applied[:] = torque
        mujoco.mj_step(model, data)
    assert angle(world) == data.qpos[0]
    assert world.parts["one"].drives == list(range(0, 200, 5))  # type: ignore[attr-defined]


def test_the_steps_don_t_depend_on_how_it_is_asked_to_advance() -> None:
    one, other = cell(), cell()
    one.advance(100_000_000)
    for until in (1, 999_999, 1_000_001, 3_500_000, 40_000_000, 40_000_000, 100_000_000):
        other.advance(until)
    assert np.array_equal(one.save(), other.save())


def test_parts_are_mounted_on_others_whatever_their_order() -> None:
    world = cell(
        hung={"part": "pendulum", "at": {"parent": "carrier/tip", "position": [0, 0.5, 0]}},
        carrier={"part": "pendulum", "angle": np.pi / 2},
    )
    body = world.model.body("hung/base")
    assert world.model.body(body.parentid[0]).name == "carrier/tip"
    assert world.data.body("hung/base").xpos == pytest.approx([-LENGTH, 0.5, 0])


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"a": {"part": "pendulum", "at": "b/tipp"}, "b": {"part": "pendulum"}}, "Did you mean 'b/tip'"),
        ({"a": {"part": "pendulum", "at": "a/tip"}}, r"sim\.parts\.a\.at: it stands on itself, at 'a/tip'"),
    ],
)
def test_a_mount_that_isn_t_there_is_named(parts: dict[str, Any], words: str) -> None:
    with pytest.raises(WiringError, match=words):
        cell(**parts)


def test_options_are_checked_by_the_part() -> None:
    with pytest.raises(ValidationError) as caught:
        cell(a={"part": "pendulum", "angel": 2})
    assert caught.value.errors()[0]["loc"] == ("parts", "a", "angel")


def test_samples_are_taken_at_their_instants() -> None:
    world = cell()
    data = world.data
    samples = world.sample(Fraction(300), lambda: np.array([data.time, data.qpos[0]]), 2)
    world.advance(50_000_000)
    assert samples.taken == 15
    for k in range(16):
        assert samples.taken_at(k) == k * 10**9 // 300
        assert samples[k][0] == pytest.approx(np.ceil(k * 1000 / 300 - 1e-9) / 1000)
    assert samples.newest(10_000_000) == 3
    assert samples.newest(9_999_999) == 2
    with pytest.raises(IndexError, match="newest is 15"):
        samples[16]


def test_a_saved_state_goes_on_bit_for_bit() -> None:
    world = cell()
    samples = world.sample(Fraction(300), world.data.qpos.copy, 1)
    world.advance(77_000_000)
    state = world.save()
    world.advance(200_000_000)
    after, kept = world.save(), samples[50].copy()
    world.restore(state)
    assert np.array_equal(world.save(), state)
    world.advance(200_000_000)
    assert np.array_equal(world.save(), after)
    assert np.array_equal(samples[50], kept)


def test_the_part_of_a_fake_is_found_or_its_lack_is_named() -> None:
    two = cell(left={"part": "pendulum"}, right={"part": "pendulum"})
    assert two.part(Pendulum, "left") is two.parts["left"]
    assert two.part(Pendulum, "gauge", "right") is two.parts["right"]
    with pytest.raises(WiringError, match="2 of them"):
        two.part(Pendulum, "gauge")
    with pytest.raises(WiringError, match="Did you mean 'right'"):
        two.part(Pendulum, "gauge", "rigth")


class Gauge(Sensor, SampledFake):
    """Measures the pendulum's angle."""

    noise_scale = 2.0

    def __init__(self, name: str, config: DeviceConfig, world: World, options: FakeConfig) -> None:
        super().__init__(name, config, world, options)
        self.states = (Signal(name="position", shape=(1,), unit="rad"),)
        data = self.cell.data
        self.sampled(1, lambda: data.qpos[:1])
        self.bind({"position": np.zeros(1)}, {})

    def fill(self, values: Array, number: int) -> None:
        self.state_arrays["position"][:] = values


def gauge(world: Cell, **options: Any) -> Gauge:
    fake = Gauge("gauge", DeviceConfig(), world, SensorOptions(**options))
    fake.open()
    return fake


def test_a_sample_arrives_late_with_the_stamp_of_when_it_was_taken() -> None:
    world = cell()
    fake = gauge(world, rate=100, delay=0.015)
    taken = {}
    for k in range(100):
        world.advance(k * 1_000_000)
        if k % 10 == 0:
            taken[k] = angle(world)
        fake.read(5_000_000_000 + k * 1_000_000)
        if k >= 15:
            at = (k - 15) // 10 * 10
            assert fake.state_arrays["position"][0] == taken[at]
            assert fake.health.stamp == 5_000_000_000 + at * 1_000_000
    assert (fake.health.frames, fake.health.errors) == (9, 0)


def test_noise_and_dropouts_depend_on_the_sample_alone() -> None:
    seen = []
    for step in (1_000_000, 7_000_000):
        world = cell()
        fake = gauge(world, rate=100, noise=0.1, dropout=0.3)
        lost = 0
        values = {}
        for now in range(0, 2_000_000_000, step):
            world.advance(now)
            fake.read(now)
            values[fake.health.stamp] = fake.state_arrays["position"][0]
            lost = fake.health.errors
        seen.append((values, lost))
    assert seen[0] == seen[1]
    values, lost = seen[0]
    assert 30 < lost < 90
    spread = np.std([v - _true(cell(), at) for at, v in list(values.items())[1:40]])
    assert 0.12 < spread < 0.28


def _true(world: Cell, at: int) -> float:
    world.advance(at)
    return angle(world)


def test_it_is_gone_in_its_windows() -> None:
    world = cell()
    fake = gauge(world, loss=[[0.1, 0.2]])
    world.advance(100_000_000)
    with pytest.raises(DeviceLostError):
        fake.read(0)
    with pytest.raises(DeviceError, match="loss"):
        fake.open()
    world.advance(200_000_000)
    fake.open()
    fake.read(0)
    assert fake.health.reconnects == 1


def test_scenery_is_what_nothing_moves() -> None:
    half = np.sqrt(0.5)
    table = {"part": "box", "size": [0.2, 0.4, 0.6], "at": {"position": [1, 2, 3], "quaternion": [half, 0, 0, half]}}
    block = {"part": "obstacles", "boxes": [{"position": [1.0, 0.0, 0.5], "size": [0.4, 0.2, 1.0]}]}
    world = cell(one={"part": "pendulum"}, table=table, block=block)
    shown = {tuple(np.round(s["position"], 9)): s for s in world.scenery}
    assert set(shown) == {(1.0, 2.0, 3.0), (1.0, 0.0, 0.5)}
    assert all(s["kind"] == "box" for s in world.scenery)
    np.testing.assert_allclose(shown[1.0, 2.0, 3.0]["size"], [0.1, 0.2, 0.3])
    np.testing.assert_allclose(shown[1.0, 2.0, 3.0]["quaternion"], [half, 0, 0, half], atol=1e-12)
