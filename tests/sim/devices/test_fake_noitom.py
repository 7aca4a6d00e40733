"""The simulated suit: what the wire leaves of a pose, its noise, its gloves, and chance that repeats."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.twin import bound
from pydantic import ValidationError

from srl.drivers.noitom import Noitom
from srl.drivers.noitom.protocol import COUNTS
from srl.drivers.noitom.skeleton import Skeleton, is_finger
from srl.runtime.contracts.errors import DeviceError, DeviceLostError, WiringError
from srl.runtime.contracts.signals import Array
from srl.sim.devices.noitom.fake import FakeNoitom
from srl.sim.parts.body.body import BodyPart
from srl.sim.world.cell import Cell, CellConfig

MS = 1_000_000
QUIET = {"noise": 0.0, "delay": 0.0}
FINGERS = [i for i, joint in enumerate(Skeleton("axis-neuron").names) if is_finger(joint)]


def suit(body: dict[str, Any] | None = None, config: dict[str, Any] | None = None, **options: Any) -> FakeNoitom:
    parts = {"person": {"part": "body", "script": "t-pose"} | (body or {})}
    world = Cell(CellConfig.model_validate({"parts": parts}), seed=5)
    settings = FakeNoitom.Config.model_validate({"port": "tcp://127.0.0.1:7001"} | (config or {}))
    fake = FakeNoitom("suit", settings, world, FakeNoitom.Options.model_validate(options))
    bound(fake)
    return fake


def person(fake: FakeNoitom) -> BodyPart:
    return fake.cell.part(BodyPart, "suit")


def run(fake: FakeNoitom, seconds: float) -> Array:
    """`rotation`, every 10 ms."""
    found, start = [], fake.world.time
    for k in range(round(seconds * 100)):
        fake.world.advance(start + (k + 1) * 10 * MS)
        fake.read(fake.world.time)
        found.append(fake.state_arrays["rotation"].copy())
    return np.array(found)


def off(a: Array, b: Array) -> Array:
    """Angles between unit quaternions, rad; exact where they are small."""
    sign = np.sign(np.sum(a * b, axis=-1))[..., None]
    angles: Array = 4 * np.arcsin(np.clip(np.linalg.norm(a - sign * b, axis=-1) / 2, 0, 1))
    return angles


def test_it_declares_what_the_driver_does() -> None:
    fake = suit()
    real = Noitom("suit", fake.suit)
    assert (fake.states, fake.commands, fake.max_age) == (real.states, (), real.max_age)


@pytest.mark.parametrize(("form", "error"), [("binary", 1e-6), ("text", 3e-6)])
@pytest.mark.parametrize("order", ["YXZ", "XYZ"])
def test_it_gives_the_bodys_pose_as_the_wire_rounds_it(form: str, error: float, order: str) -> None:
    fake = suit({"script": "reach"}, {"order": order}, format=form, rate=100.0, **QUIET)
    fake.open()
    for _ in range(100):
        fake.world.advance(fake.world.time + 10 * MS)
        fake.read(fake.world.time)
        pose = person(fake).pose()
        assert off(fake.state_arrays["rotation"], pose[:, 3:]).max() < error
        np.testing.assert_allclose(fake.state_arrays["translation"], pose[:, :3], atol=1e-6)
        assert fake.health.stamp == fake.world.time
    assert fake.health.frames == 101


@pytest.mark.parametrize(("count", "flags"), list(COUNTS.items()))
def test_a_samples_numbers_are_a_frames(count: int, flags: tuple[bool, bool]) -> None:
    fake = suit(displacement=flags[0], reference=flags[1], **QUIET)
    values = fake.sample(0)
    assert values is not None
    assert values.size == count
    hips = values[6:9] if flags[1] else values[:3]
    np.testing.assert_allclose(hips, person(fake).pose()[0, :3] * 100, rtol=1e-6)


def test_without_displacements_bones_are_those_the_profile_tells_not_the_persons() -> None:
    fake = suit({"scale": 1.2}, {"scale": 1.1}, displacement=False, **QUIET)
    fake.open()
    run(fake, 0.1)
    translation, default = fake.state_arrays["translation"], Skeleton("axis-neuron").offsets
    np.testing.assert_allclose(translation[1:], 1.1 * default[1:])
    np.testing.assert_allclose(translation[0], 1.2 * default[0], atol=1e-5)


@pytest.mark.slow
def test_every_joint_is_as_noisy_as_it_says_and_no_bone_is() -> None:
    fake = suit(noise=0.01, rate=100.0, delay=0.0)
    fake.open()
    rotations = run(fake, 4.0)
    about = 2 * rotations[..., 1:] * np.sign(rotations[..., :1])  # rad about x, y, z: the T-pose is no rotation
    spread = about.std(axis=0)
    assert (spread > 0.008).all()
    assert (spread < 0.0125).all()
    assert abs(about.mean()) < 1e-3
    np.testing.assert_allclose(np.linalg.norm(rotations, axis=2), 1.0)
    np.testing.assert_allclose(fake.state_arrays["translation"], fake.body.offsets, atol=1e-5)


def test_without_gloves_fingers_stay_as_at_the_start() -> None:
    fake = suit({"script": "still"}, gloves=False, noise=0.01, rate=100.0)
    fake.open()
    rotations = run(fake, 0.5)[10:]
    assert off(rotations[:, FINGERS], rotations[:1, FINGERS]).max() < 1e-12
    assert off(rotations[:, 1:3], rotations[:1, 1:3]).max() > 1e-3
    bent = Skeleton("axis-neuron").names.index("LeftHandIndex2")
    assert off(rotations[0, bent], np.array([1.0, 0, 0, 0])) == pytest.approx(np.deg2rad(25), abs=1e-4)


def test_samples_come_at_their_rate_late_and_stamped() -> None:
    fake = suit(rate=60.0, delay=0.03, dropout=0.2)
    fake.open()
    stamps = set()
    for k in range(1000):
        fake.world.advance((k + 1) * 2 * MS)
        fake.read(fake.world.time)
        if fake.health.stamp >= 0:
            stamps.add(fake.health.stamp)
            assert fake.world.time - fake.health.stamp >= 30 * MS - 1
    assert len(stamps) == fake.health.frames
    assert fake.health.frames + fake.health.errors == 119
    assert 10 < fake.health.errors < 40
    assert all(abs(stamp * 60e-9 - round(stamp * 60e-9)) < 1e-6 for stamp in stamps)


def test_a_run_repeats_bit_for_bit_and_seeds_differ() -> None:
    one, two = suit({"script": "walk"}), suit({"script": "walk"})
    one.open()
    two.open()
    np.testing.assert_array_equal(run(one, 0.5), run(two, 0.5))
    state = one.world.save()
    first = run(one, 0.3)
    one.world.restore(state)
    np.testing.assert_array_equal(run(one, 0.3)[10:], first[10:])


def test_it_is_gone_in_its_loss_windows() -> None:
    fake = suit(loss=[[0.2, 0.4]])
    fake.open()
    run(fake, 0.19)
    with pytest.raises(DeviceLostError):
        run(fake, 0.05)
    with pytest.raises(DeviceError):
        fake.open()
    fake.world.advance(410 * MS)
    fake.open()
    run(fake, 0.1)
    assert fake.health.reconnects == 1


def test_a_suit_needs_a_person_of_its_skeleton() -> None:
    with pytest.raises(WiringError, match="axis-studio"):
        suit({}, {"skeleton": "axis-studio"})
    studio = suit({"skeleton": "axis-studio"}, {"skeleton": "axis-studio"})
    assert studio.states[0].labels[10] == "Neck"
    world = Cell(CellConfig.model_validate({"parts": {"box": {"part": "box", "size": [1, 1, 1]}}}), seed=0)
    with pytest.raises(WiringError, match="none"):
        FakeNoitom("suit", FakeNoitom.Config(port="tcp://h:1"), world, FakeNoitom.Options())


def test_options_are_checked() -> None:
    for wrong in ({"format": "calc"}, {"rate": 0}, {"others": 9}, {"noise": -1}):
        with pytest.raises(ValidationError):
            suit(**wrong)
