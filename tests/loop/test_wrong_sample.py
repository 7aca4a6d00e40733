"""One wrong sample, of any device that is commanded, at any instant: no limb moves by it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.contracts.signals import Array
from srl.runtime.guard.samples import AGREE
from srl.runtime.ipc.header import DEVICE
from srl.runtime.testing.lab import Lab

ACTIVE, STOPPED = 40, 30  # cycles
# By profile, the commands that are looked at, and by how much they may differ from those of a run without the sample.
RUNS = {
    "human-srl": ("arm.position_command", 0.0),
    "worn-arm": ("arm.effort_command", 0.35),  # N m: a velocity that is wrong for a cycle damps otherwise
    "moca-man": ("arm.torque_command", 0.35),
    "kairos-man": ("arm.velocity_command", 0.0),
}


class Glitch:
    """Stands before a device's driver; for one read a value of it is another."""

    def __init__(self, run: Lab, device: str, signal: str, element: int, wrong: Callable[[float], float]) -> None:
        self._driver = next(d for d in run._graph.devices if d.name == device)
        self._read, self._signal, self._element, self._wrong = self._driver.read, signal, element, wrong
        self._true: Array | None = None
        self.due = False
        self._driver.read = self.read  # type: ignore[method-assign]

    def read(self, now: int) -> None:
        values = self._driver.state_arrays[self._signal]
        if self._true is not None:  # a fake fills its arrays only where they change
            values[...], self._true = self._true, None
        self._read(now)
        if self.due:
            self.due, self._true = False, values.copy()
            flat = values.reshape(-1)
            flat[self._element] = self._wrong(float(flat[self._element]))


def _rows(profile: str, when: str, signal: str, element: int, wrong: Callable[[float], float] | None) -> Array:
    """What was sent, (cycles, n)."""
    command = RUNS[profile][0]
    device = command.partition(".")[0]
    with Lab(profile, ["sim.start=auto"]) as run:
        glitch = Glitch(run, device, signal, element, wrong or float)

        def moment(name: str) -> None:
            glitch.due = glitch.due or name == when

        moment("start")
        run.step(1)
        run.until("active", most=20)
        run.step(ACTIVE)
        moment("active")
        run.step(ACTIVE)
        moment("stop")
        run.stop()
        moment("stopping")
        run.step(STOPPED)
        moment("reset")
        run.reset()
        moment("begun")
        run.step(ACTIVE)
        sent: Array = run.history(f"{command}.sent").reshape(run.cycles, -1)
        assert not glitch.due, when
        return sent


@cache
def _clean(profile: str) -> Array:
    return _rows(profile, "", "position", 0, None)


WRONG: dict[str, Callable[[float], float]] = {
    "0.3 off": lambda v: v + 0.3,
    "-3 off": lambda v: v - 3.0,
    "1e6": lambda v: 1e6,
    "-1e300": lambda v: -1e300,
    "infinite": lambda v: np.inf,
}


@pytest.mark.slow
@pytest.mark.sampled
@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("when", ["active", "stop", "stopping", "reset", "begun"])
@pytest.mark.parametrize("element", [0, 1])
@pytest.mark.parametrize("profile", RUNS)
def test_no_single_sample_moves_the_limb(profile: str, element: int, when: str, wrong: str) -> None:
    before, after = _clean(profile), _rows(profile, when, "position", element, WRONG[wrong])
    count = min(len(before), len(after))
    most = RUNS[profile][1]
    found = np.nan_to_num(np.abs(after[:count] - before[:count]))
    assert found.max() <= most + 0.02, f"{found.max()} in cycle {int(found.max(axis=1).argmax())}"


@pytest.mark.parametrize("wrong", [0.5, -3.0, 1e6])
def test_a_wrong_sample_in_the_cycle_of_a_reset_is_no_command(wrong: float) -> None:
    """It was sent: 0.5 rad in one cycle, and 1e6 became 3.14 rad, beyond the guard's limits."""
    after = _rows("human-srl", "reset", "position", 0, lambda v: wrong)
    assert np.nanmax(np.abs(np.diff(after[:, 0]))) <= 0.01


@pytest.mark.parametrize("wrong", [1e6, 1000.0])
def test_one_force_beyond_the_sensor_moves_no_arm(wrong: float) -> None:
    """The admittance integrated it: the arm went on by 2.1 rad."""
    found = []
    for value in (0.0, wrong):
        with Lab("kairos-man", ["sim.start=auto"]) as run:
            glitch = Glitch(run, "sensor", "wrench", 2, lambda v, value=value: v + value)  # type: ignore[misc]
            run.until("active", most=20)
            while not run.history("keys.modes")[-1].any():  # till then nobody guides the arm
                run.step(50)
            run.step(400)
            glitch.due = True
            run.step(200)
            assert not glitch.due
            found.append(run.history("arm.velocity_command.applied")[-200:])
            events = list(run.events)
    assert np.abs(found[1] - found[0]).max() < 1e-3
    assert any("a sample isn't taken: wrench[fz]" in text for text in events)


def test_a_jump_that_stays_stops_the_limb_and_a_second_reset_starts_it_there() -> None:
    with Lab("human-srl", ["sim.start=auto"]) as run:
        run.until("active", most=20)
        run.step(20)
        driver = next(d for d in run._graph.devices if d.name == "arm")
        read, own = driver.read, driver.state_arrays["position"].copy()

        def moved(now: int) -> None:
            driver.state_arrays["position"][...] = own
            read(now)
            own[...] = driver.state_arrays["position"]
            driver.state_arrays["position"][0] += 0.5

        driver.read = moved  # type: ignore[method-assign]
        run.until("stopped", most=5)
        assert run.cause == "device_fault"
        assert any("jumped" in text for text in run.events)
        run.reset()
        assert run.state == "stopped"
        driver.read = read  # type: ignore[method-assign]
        run.step(20)
        run.reset()
        run.until("active", most=5)


def test_what_a_device_left_behind_is_no_sample_of_the_one_that_is_back() -> None:
    """Its arrays still hold what was measured before the loss, with its time."""
    with Lab("human-srl", ["sim.start=auto"]) as run:
        run.until("active", most=20)
        driver = next(d for d in run._graph.devices if d.name == "arm")
        stamps = run._graph.row.devices[run._graph.layout.devices.index("arm")]
        read = driver.read

        def lost(now: int) -> None:
            raise DeviceLostError("arm", "gone", "Wait")

        driver.read = lost  # type: ignore[method-assign]
        run.until("stopped", most=5)
        driver.read = lambda now: None  # type: ignore[method-assign]
        run.until(lambda: any("is back" in text for text in run.events), most=5)
        run.step(20)
        assert stamps[DEVICE.stamp] == -1
        run.reset()
        assert run.state == "stopped"
        driver.read = read  # type: ignore[method-assign]
        run.step(AGREE - 1)
        assert stamps[DEVICE.stamp] == -1, "it doesn't count as the first that agrees"
        run.step(2)
        assert stamps[DEVICE.stamp] > 0


def test_a_device_that_is_wrong_for_long_is_told_ever_more_rarely_and_what_to_look_at() -> None:
    """A sensor in another unit said the same thing each second, for ever."""
    with Lab("human-srl", ["sim.start=auto"]) as run:
        run.until("active", most=20)
        driver = next(d for d in run._graph.devices if d.name == "arm")
        read = driver.read

        def degrees(now: int) -> None:
            read(now)
            driver.state_arrays["position"][...] = 1e6

        driver.read = degrees  # type: ignore[method-assign]
        run.step(round(20 / (run.time / run.cycles)))
        reported = [text for text in run.events if "taken" in text and "position" in text]
        assert 3 <= len(reported) <= 7, reported
        assert "no sample has been taken for" in reported[-1]
        assert "Look at its units" in reported[-1]
