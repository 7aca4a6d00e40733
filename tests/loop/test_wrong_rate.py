"""A wrong velocity, a glove for one sample, ranges that are none, a stamp that lies ahead: no limb moves by them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from helpers.toy import wired

from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.signals import Array
from srl.runtime.loop.device import Device
from srl.runtime.loop.guards import limits_of
from srl.runtime.testing.lab import Lab


class Wrong:
    """Stands before a device's driver; `change` is called with its values of a signal after each read."""

    def __init__(self, run: Lab, device: str, signal: str) -> None:
        self._driver = next(d for d in run._graph.devices if d.name == device)
        self._read, self._values = self._driver.read, self._driver.state_arrays[signal]
        self._true: Array | None = None
        self.change: Callable[[Array], object] | None = None
        self._driver.read = self.read  # type: ignore[method-assign]

    def read(self, now: int) -> None:
        if self._true is not None:  # a fake fills its arrays only where they change
            self._values[...], self._true = self._true, None
        self._read(now)
        if self.change is not None:
            self._true = self._values.copy()
            self.change(self._values)


def _to(value: float, every: int = 1, of: int = 1) -> Callable[[Array], None]:
    """The first element is this in `every` of `of` reads."""
    count = 0

    def change(values: Array) -> None:
        nonlocal count
        if count % of < every:
            values[0] = value
        count += 1

    return change


def _travel(run: Lab, seconds: float) -> float:
    """How far joint 0 gets, in truth, from where it is."""
    start, first = float(run["world.arm_position"][0]), run.cycles
    run.run(seconds)
    return float(np.abs(run.history("world.arm_position")[first:, 0] - start).max())


@pytest.mark.parametrize(("wrong", "after"), [(-1.0, 0), (1.0, 100), (14.0, 0)])  # rad/s, cycles
def test_a_velocity_that_is_stuck_in_a_stop_drives_no_joint(wrong: float, after: int) -> None:
    """Its damping does. Without the fault the joint moves by 0.02 rad in this second."""
    with Lab("worn-arm", ["sim.start=auto"]) as run:
        arm = Wrong(run, "arm", "velocity")
        run.until("active", most=20)
        run.run(0.5)
        run.stop()
        run.step(after)
        arm.change = _to(wrong)
        assert _travel(run, 1.0) < 0.1
        assert any("isn't how fast its position changes" in text for text in run.events)


@pytest.mark.parametrize(("wrong", "every"), [(-14.0, 2), (-14.0, 3)])
def test_a_velocity_that_is_wrong_in_most_samples_stops_the_limb(wrong: float, every: int) -> None:
    with Lab("worn-arm", ["sim.start=auto"]) as run:
        arm = Wrong(run, "arm", "velocity")
        run.until("active", most=20)
        run.run(0.5)
        arm.change = _to(wrong, every, 3)
        run.until(lambda: run.state != "active", most=0.6)
        assert run.cause in ("device_loss", "device_fault"), run.situation()
        assert run.fault_source == "arm"
        assert _travel(run, 1.0) < 0.2


def test_a_velocity_that_is_true_is_never_refused() -> None:
    with Lab("worn-arm", ["sim.start=auto"]) as run:
        run.until("active", most=20)
        run.run(1.0)
        run.stop()
        run.run(0.5)
        run.reset()
        run.until("active", most=5)
        assert not any("isn't how fast" in text for text in run.events)


def _finger(change: Callable[[Array, Array], object], when: int) -> Array:
    """What was sent to it, (cycles, 4); `change` is given the glove's sample of one cycle, and the one before."""
    with Lab("sixth-finger", ["sim.start=auto"]) as run:
        glove = Wrong(run, "glove", "position")
        run.until("active", most=20)
        run.step(when)
        before = run["glove.position"]
        glove.change = lambda values: change(values, before)
        run.step(1)
        glove.change = None
        run.step(40)
        return run.history("finger.position_command.sent")[-41:]


@cache
def _usual(when: int, missing: bool) -> Array:
    return _finger(lambda values, before: np.copyto(values, before) if missing else None, when)


@pytest.mark.parametrize("when", [60, 150])  # cycles
@pytest.mark.parametrize("off", [1.5, -1.5])
def test_one_wrong_sample_of_a_glove_is_one_that_is_missing(off: float, when: int) -> None:
    """One that is missing is worth 0.02 to 0.033 rad by itself, as the hand has moved on."""
    after = _finger(lambda values, before: np.add(values, off, out=values), when)
    assert np.ptp(_usual(when, False), axis=0).max() > 0.03, "the finger moves"
    assert np.array_equal(after, _usual(when, True))
    assert np.abs(after - _usual(when, False)).max() < 0.04


RANGES: dict[str, dict[str, Any]] = {
    "of an unknown state": {"positon": (np.full(2, -1.0), np.full(2, 1.0))},
    "turned round": {"position": (np.full(2, 1.0), np.full(2, -1.0))},
    "empty": {"position": (np.array([-1.0, 1.0]), np.full(2, 1.0))},
    "of another size": {"position": (np.full(3, -1.0), np.full(3, 1.0))},
    "unknown": {"position": (np.full(2, np.nan), np.full(2, 1.0))},
    "one end": {"position": (np.full(2, -1.0),)},
    "no numbers": {"position": ("low", "high")},
    "nothing": {"position": None},
}


@pytest.mark.parametrize("ranges", RANGES)
def test_a_driver_whose_ranges_are_none_is_refused_by_name(ranges: str) -> None:
    graph = wired()
    arm = next(d for d in graph.devices if d.name == "arm")
    arm.ranges = RANGES[ranges]
    i = graph.devices.index(arm)
    device = Device(arm, graph.row.devices[i], graph.actuators_of(i), lambda text: None)
    with pytest.raises(DeviceError, match="arm") as found:
        device.expect(limits_of(graph))
    assert next(iter(RANGES[ranges])) in str(found.value)
    assert "position" in str(found.value), "it says what there is"


def test_a_driver_whose_ranges_are_some_is_not() -> None:
    graph = wired()
    arm = next(d for d in graph.devices if d.name == "arm")
    arm.ranges = {"position": (np.full(2, -1.0), np.full(2, 1.0))}
    i = graph.devices.index(arm)
    Device(arm, graph.row.devices[i], graph.actuators_of(i), lambda text: None).expect(limits_of(graph))


@pytest.mark.parametrize("ahead", [0.0, 0.095])  # s
def test_a_device_whose_stamps_lie_ahead_is_found_silent_all_the_same(ahead: float) -> None:
    with Lab("human-srl", ["sim.start=auto"]) as run:
        driver = next(d for d in run._graph.devices if d.name == "arm")
        read, health, shown = driver.read, driver.health, driver.state_arrays["position"]
        silent, true, held, now = False, -1, -1, 0

        def ahead_of_now(at: int) -> None:
            nonlocal true, held, now
            now, before, health.stamp = at, shown.copy(), true
            read(at)
            true = health.stamp
            if silent:
                shown[...], health.stamp = before, held
            else:
                held = health.stamp = true + round(ahead * 1e9) * (true >= 0)

        driver.read = ahead_of_now  # type: ignore[method-assign, assignment]
        run.until("active", most=20)
        run.step(20)
        assert not run.stale("arm")
        silent, last = True, now
        run.until(lambda: run.stale("arm"), most=5)
        assert (now - last) * 1e-9 <= driver.max_age + 2 * run.time / run.cycles
        assert run.state in ("stopping", "stopped")
        assert (run.cause, run.fault_source) == ("device_loss", "arm"), run.events
