"""Functions for tests of drivers, control laws and profiles. They do not need pytest.

driver = bound(Lever("lever", LeverConfig(port="loop://a")))   # arrays of its own, as the runtime gives them
check_driver(Lever("lever", LeverConfig(port="loop://b")))     # what every driver must declare and survive
run = simulate(PROFILE, seconds=5)                             # a whole profile, simulated, in this process
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Self, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from runtime.contracts import registry
from runtime.contracts.controller import Controller
from runtime.contracts.driver import Driver
from runtime.contracts.errors import DeviceLostError
from runtime.contracts.frames import IDENTITY
from runtime.contracts.signals import Array, Stop
from runtime.contracts.terms import POSITION_OF
from runtime.contracts.world import Twin
from runtime.ipc.layout import Layout
from runtime.ipc.words import State
from runtime.loop.lockstep import Lockstep
from runtime.profile import profile, wiring

__all__ = ["Simulated", "TwinBench", "bound", "check_controller", "check_driver", "simulate"]

D = TypeVar("D", bound=Driver)
C = TypeVar("C", bound=Controller)


@overload
def bound(part: D) -> D: ...
@overload
def bound(part: C, transforms: Mapping[str, Sequence[float]] | None = None) -> C: ...
def bound(part: Driver | Controller, transforms: Mapping[str, Sequence[float]] | None = None) -> Driver | Controller:
    """Returns the driver or controller bound to its own arrays: zeros, and the parameters' defaults.

    Every output of a controller counts as wired to a device, so `applied` has an array for it.

    Args:
        transforms: a controller's, by name: x y z (m), w x y z; the others are the identity.
    """
    if isinstance(part, Driver):
        part.bind({s.name: np.zeros(s.shape) for s in part.states}, {c.name: np.zeros(c.shape) for c in part.commands})
    else:
        part.bind(
            {s.name: np.zeros(s.shape) for s in part.inputs},
            {s.name: np.zeros(s.shape) for s in part.outputs},
            {s.name: np.zeros(s.shape) for s in part.outputs},
            {p.name: np.array(p.default) for p in part.parameters},
            {t.name: np.array((transforms or {}).get(t.name, IDENTITY), float) for t in part.transforms},
        )
    return part


def check_driver(driver: Driver) -> None:
    """Checks what every driver must declare before `open`, and how it behaves while it is closed.

    The driver must not be open.

    Raises:
        AssertionError: its text says what is wrong.
    """
    name = type(driver).__name__
    assert driver.summary, f"{name}: `srl list` wants a line of text in `summary`"
    assert driver.states or driver.commands, f"{name} declares neither states nor commands"
    assert not driver.states or driver.max_age > 0, f"{name} gives samples, so `max_age` must say when they are stale"
    for signal in (*driver.states, *driver.commands):
        assert not (fault := signal.naming_fault()), f"{name}.{signal.name}: {fault}"
    states = {s.name: s for s in driver.states}
    for command in driver.commands:
        assert command.stops, f"{name}.{command.name} can't be stopped: `stops` is empty"
        assert command.period, f"{name}.{command.name} declares no `period`: how often does a command leave?"
        if command.feedback is None:
            assert command.name in driver.home, f"{name}.{command.name} has no feedback, so it needs a `home`"
        else:
            measured = states.get(command.feedback)
            assert measured is not None, f"{name}.{command.name}: there is no state '{command.feedback}'"
            assert measured.shape == command.shape, f"{name}.{command.name} and its feedback differ in shape"
            elements, planar = set(measured.names), {POSITION_OF.get(n, n) for n in command.names}
            same = command.size == 1 or elements in (set(command.names), planar)
            assert same, f"{name}.{command.name} and its feedback differ in the names of their elements"
    bound(driver)
    driver.close()
    driver.stop(Stop.HOLD)
    frames = driver.stop_frames(Stop.HOLD)
    whole = isinstance(frames, tuple) and all(isinstance(frame, bytes) for frame in frames)
    assert whole, f"{name}.stop_frames must give a tuple of bytes"
    assert driver.fileno() in (None, -1), f"{name} isn't open and has a descriptor"
    for what in (driver.read, driver.write) if driver.commands else (driver.read,):
        try:
            what(time.monotonic_ns())
        except DeviceLostError:
            continue
        raise AssertionError(f"{name} isn't open: {what.__name__} must raise DeviceLostError")
    driver.close()
    assert not driver.health.connected, f"{name} is closed and says that it is connected"


def check_controller(controller: Controller, inputs: Mapping[str, Array], start: Mapping[str, Array]) -> None:
    """Checks what every control law must do: name its elements, start without a jump, stay finite, repeat exactly.

    Args:
        controller: a bound controller, see `bound`.
        inputs: values for its inputs, by name.
        start: values of the commanded outputs at the reset, by output name.
    Raises:
        AssertionError: its text says what is wrong.
    """
    name = type(controller).__name__
    for signal in (*controller.inputs, *controller.outputs):
        assert not (fault := signal.naming_fault()), f"{name}.{signal.name}: {fault}"

    def run() -> list[bytes]:
        for key, value in inputs.items():
            controller.input[key][...] = value
        for key, value in start.items():
            controller.applied[key][...] = value
        controller.reset()
        controller.update(1e-9)
        for key, value in start.items():
            jump = float(np.max(np.abs(controller.output[key] - value), initial=0.0))
            assert jump < 1e-6, f"{name}.{key} jumps by {jump:g} at its reset"
        made = []
        for _ in range(100):
            controller.update(0.01)
            for key, output in controller.output.items():
                assert np.isfinite(output).all(), f"{name}.{key} isn't finite for finite inputs"
                made.append(output.tobytes())
                if key in controller.applied:
                    controller.applied[key][...] = output
        return made

    assert run() == run(), f"{name} isn't pure: the same inputs gave other outputs after a reset"


@dataclass(frozen=True)
class Simulated:
    """The result of a simulated run, row by row.

    Attributes:
        layout: the signals' names, shapes and units.
        rows: (k, width) int64, as a recording holds them.
        events: the loop's events, as text.
    """

    layout: Layout
    rows: NDArray[np.int64]
    events: list[str]

    def value(self, signal: str) -> Array:
        """The values `(k, *shape)` of a signal in every cycle, e.g. "finger.position_command.applied"."""
        return self.layout.value(self.rows, signal)

    def states(self) -> list[State]:
        """The state of the state machine in every cycle."""
        return [State(int(state)) for state in self.layout.word(self.rows, "state")]


def simulate(text: str, seconds: float) -> Simulated:
    """Runs a profile with all its devices simulated: without service or clock, as fast as possible.

    Args:
        text: the profile's YAML.
        seconds: duration in world time.
    Raises:
        ProfileError, WiringError: with the same text as from `srl check`.
    """
    checked, source = profile.parse("profile.yaml", text, [])
    events: list[str] = []
    lockstep = Lockstep(wiring.build(checked, source, []), events.append)
    rows = []
    for _ in range(round(seconds * 1e9 / lockstep.period)):
        lockstep.step()
        rows.append(lockstep.graph.row.words.copy())
    return Simulated(lockstep.graph.layout, np.array(rows), events)


class TwinBench:
    """The twin of one device of a profile, in a simulated world that moves only when it is told to.

    Use it as a context manager. The driver under test opens `address` and reads while `run` lets time pass.

    Attributes:
        twin: the twin, open.
        address: what the driver's `port` should be.
        now: ns of the twin's clock and of the world's.
    """

    def __init__(self, text: str, device: str) -> None:
        """
        Args:
            text: the profile's YAML.
            device: its name in the profile.
        Raises:
            ProfileError, WiringError: as `srl check` says it; also where the device has no twin.
        """
        checked, source = profile.parse("profile.yaml", text, [])
        graph = wiring.build(checked, source, [])
        (fake,) = [d for d in graph.devices if d.name == device]
        assert graph.world is not None
        self._world, self.now = graph.world, 0
        cls = registry.load("twins", checked.devices[device].driver, source.place(f"devices.{device}"))
        self.twin: Twin = cls(fake)

    def __enter__(self) -> Self:
        self.twin.open()
        self.address = self.twin.address
        return self

    def __exit__(self, *_: object) -> None:
        self.twin.close()
        self._world.close()

    def run(self, seconds: float) -> None:
        """Lets so much of the world's time pass, in steps of a millisecond; takes as long as the physics does."""
        for _ in range(round(seconds * 1e3)):
            self.now += 1_000_000
            self._world.advance(self.now)
            self.twin.service(self.now)

    @contextmanager
    def serving(self) -> Iterator[None]:
        """Lets time pass in a thread: for what waits for the twin, as a driver's `open` does."""
        ended = threading.Event()

        def serve() -> None:
            while not ended.is_set():
                self.run(0.01)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()
