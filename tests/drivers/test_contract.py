"""What every device must do, whatever its wire: the contract of runtime/contracts/driver.py, put to all registered."""

from __future__ import annotations

import re
import time
from typing import Any

import numpy as np
import pytest
from helpers.peer import bound, make

from runtime.contracts import registry
from runtime.contracts.driver import Driver
from runtime.contracts.errors import DeviceError, DeviceLostError
from runtime.contracts.signals import Stop
from runtime.contracts.world import Fake
from sim.devices.examples import DEVICES

OWN = [name for name in registry.names("drivers") if name not in ("replay", "lever")]  # a recording is no wire


def driver(name: str, called: str = "") -> Driver:
    config, _, _, port = DEVICES[name]
    cls = registry.load("drivers", name, "test")
    made: Driver = bound(cls(called or name, cls.Config.model_validate({"port": port} | config)))
    return made


def simulated(name: str) -> tuple[Any, Fake]:
    config, options, world, port = DEVICES[name]
    order = {"driver": name, "config": {"port": port} | config, "options": options, "world": world, "seed": 3}
    made, fake, _ = make(order)
    return made, fake


def test_every_registered_device_is_known_here() -> None:
    assert set(OWN) == set(DEVICES)
    assert set(registry.names("fakes")) >= set(OWN)
    assert set(registry.names("twins")) >= set(OWN)


@pytest.mark.parametrize("name", OWN)
def test_it_declares_itself_before_it_is_opened(name: str) -> None:
    made = driver(name)
    assert made.summary
    for names, signals in ((made.gives, made.states), (made.takes, made.commands)):
        # <name> stands for names that the profile chooses
        patterns = [re.compile(re.sub("<[a-z]+>", "[a-z0-9_-]+", name.replace(".", "[.]"))) for name in names]
        for signal in signals:
            assert any(pattern.fullmatch(signal.name) for pattern in patterns), signal.name
    assert made.states or made.commands
    assert not made.states or made.max_age > 0
    for command in made.commands:
        assert command.stops
        if command.feedback is not None:
            (measured,) = [s for s in made.states if s.name == command.feedback]
            assert measured.shape == command.shape
        else:
            assert command.name in made.home
    for signal in (*made.states, *made.commands):
        assert not signal.naming_fault(), signal.name


@pytest.mark.parametrize("name", OWN)
def test_what_isnt_open_can_be_stopped_and_closed_and_is_lost(name: str) -> None:
    made = driver(name)
    made.close()
    made.stop(Stop.HOLD)
    frames = made.stop_frames(Stop.HOLD)
    assert isinstance(frames, tuple)
    assert all(isinstance(frame, bytes) for frame in frames)
    assert made.fileno() in (None, -1)
    with pytest.raises(DeviceLostError):
        made.read(time.monotonic_ns())
    if made.commands:
        with pytest.raises(DeviceLostError):
            made.write(time.monotonic_ns())
    made.close()
    assert not made.health.connected


@pytest.mark.parametrize("name", OWN)
def test_nobody_there_is_an_error_with_place_and_remedy(name: str) -> None:
    made = driver(name)
    with pytest.raises(DeviceError) as caught:
        made.open()
    assert name in caught.value.place
    assert len(caught.value.problem) > 10
    assert len(caught.value.remedy) > 10
    assert not made.health.connected
    assert made.health.reconnects == 0
    made.close()


@pytest.mark.parametrize("name", OWN)
def test_the_fake_is_the_same_device(name: str) -> None:
    _, fake = simulated(name)
    real = driver(name, fake.name)  # an arm's frame has the device's name
    assert fake.states == real.states
    assert fake.commands == real.commands
    assert fake.max_age == real.max_age
    assert fake.home.keys() == real.home.keys()
    assert fake.summary == real.summary


@pytest.mark.parametrize("name", OWN)
def test_the_fake_gives_fresh_finite_samples_and_the_same_bits_again(name: str) -> None:
    runs = []
    for _ in range(2):
        world, fake = simulated(name)
        fake.open()
        seen = []
        for k in range(1, 81):
            now = k * 10_000_000
            world.advance(now)
            fake.read(now)
            assert fake.health.stamp <= now
            seen.append(np.concatenate([v.ravel() for v in fake.state_arrays.values()] or [np.zeros(1)]))
        assert fake.health.connected
        assert fake.health.fault == ""
        if fake.states:
            assert now - fake.health.stamp < fake.max_age * 1e9
            assert np.isfinite(seen[-1]).all()
        fake.close()
        assert not fake.health.connected
        runs.append(np.array(seen))
        world.close()
    np.testing.assert_array_equal(runs[0], runs[1])
