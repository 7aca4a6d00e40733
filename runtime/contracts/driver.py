"""The contract of a device: drivers fill it over a wire, fakes fill it from the simulated world."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict

from runtime.contracts.signals import Array, Command, Limits, Signal, Stop


class DeviceConfig(BaseModel):
    """A device's options in the profile; a driver derives from it and adds its own.

    Unknown keys are errors. Fields carry units in their description.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)


@dataclass(slots=True)
class Health:
    """What a driver reports about its link; the loop copies it into every row.

    Attributes:
        stamp: when the newest sample was taken, ns on the loop's clock; -1 before the first. From the
            device's own counter or clock where it has one.
        connected: False from the moment the driver knows that the device is gone.
        frames: good frames received.
        errors: frames thrown away (checksum, length, range).
        resyncs: times the parser had to search for the next frame.
        reconnects: times the device was opened again after a loss.
        unsent: bytes of the newest command the device has not taken yet.
        message: the newest remark in words, for people.
        fault: what keeps a connected device from moving (protective stop, reflex, hardware error), in words;
            "" while it is well. It stops the limb, and `recover` may mend it.
        was_open: it has been open before.
    """

    stamp: int = -1
    connected: bool = False
    frames: int = 0
    errors: int = 0
    resyncs: int = 0
    reconnects: int = 0
    unsent: int = 0
    message: str = ""
    fault: str = ""
    was_open: bool = False

    def opened(self) -> None:
        """The device is open; every time but the first counts as a reconnect."""
        self.connected = True
        self.reconnects += self.was_open
        self.was_open = True


class Driver(ABC):
    """One device.

    Life: `__init__` (declares, touches nothing outside) -> `bind` -> `open` -> cycles of `read`, `write`
    -> `stop` -> `close`. After `DeviceLostError` the runtime calls `close` and then `open` again, away from
    the loop's path, until it succeeds; `open` ends with `health.opened()`, which counts it.

    Attributes:
        states: signals the device gives; known after `__init__`.
        commands: signals the device obeys; known after `__init__`.
        max_age: s; older than this its newest sample is stale, unless the profile says otherwise.
            0 for a device that gives no samples.
        health: see `Health`.
        home: for commands without feedback, by name: where the limb is put before a start, and where
            `retract` goes; known after `__init__`.
        limits: the device's own limits by command name, known after `open`; the guard takes the
            narrower of these and the profile's.
    """

    Config: type[DeviceConfig] = DeviceConfig
    summary: str = ""  # one line for `srl list`
    # Names of the states it may have, for `srl list`; "<segment>.pose" where the profile chooses the name.
    gives: tuple[str, ...] = ()
    takes: tuple[str, ...] = ()  # likewise the commands
    max_age: float = 0.0

    def __init__(self, name: str, config: DeviceConfig) -> None:
        self.name = name
        self.config = config
        self.states: tuple[Signal, ...] = ()
        self.commands: tuple[Command, ...] = ()
        self.health = Health()
        self.home: dict[str, Array] = {}
        self.limits: dict[str, Limits] = {}
        self.state_arrays: Mapping[str, Array] = {}
        self.command_arrays: Mapping[str, Array] = {}

    def bind(self, states: Mapping[str, Array], commands: Mapping[str, Array]) -> None:
        """Takes the arrays, made once by the runtime, that `read` fills and `write` sends (after the guard)."""
        self.state_arrays = states
        self.command_arrays = commands

    @abstractmethod
    def open(self) -> None:
        """Connects, identifies the device, checks firmware and limits, arms its watchdog. May block.

        Leaves actuators unpowered or still. Raises `DeviceError` with place and remedy.
        """

    @abstractmethod
    def read(self, now: int) -> None:
        """Takes all that has arrived and fills the state arrays. Never blocks, never raises on garbage.

        Args:
            now: ns on the loop's clock.
        Raises:
            DeviceLostError: the device is gone.
        """

    @abstractmethod
    def write(self, now: int) -> None:
        """Sends the command arrays. Never blocks; at most one command is ever unsent.

        Called only while the device is active. The first call after `open` carries the measured state, or
        `home` for a device without feedback. Raises `DeviceLostError`.
        """

    @abstractmethod
    def stop(self, category: Stop) -> None:
        """Starts the device's own safe stop; idempotent, never blocks, never raises."""

    @abstractmethod
    def close(self) -> None:
        """Lets go of the device. Always succeeds; may be called at any time, more than once."""

    def recover(self, now: int) -> None:
        """A person has asked for a reset while `health.fault` is set: starts the device's own recovery.

        Runs in the loop: never blocks, and is never called otherwise. What takes longer goes on in later
        calls of `read`, which clears `health.fault` once the device is well; the next reset then starts it.
        Raises DeviceLostError.
        """

    def fileno(self) -> int | None:
        """The descriptor of an actuator, which the supervisor duplicates; None for sensors and fakes."""
        return None

    def stop_frame(self, category: Stop) -> bytes:
        """Bytes which, written to `fileno()` by another process at any instant, put the device into its stop.

        They begin with whatever ends a frame that was cut short. Called after each `write`: cheap, and the
        same object while nothing changed. Empty where the device's own watchdog does the work.
        """
        return b""

    def figures(self) -> dict[str, object]:
        """Figures of its own for the run's summary."""
        return {}


class Sensor(Driver):
    """A driver that takes no commands, so it has nothing to write and nothing to say about stopping."""

    def write(self, now: int) -> None:
        """Nothing to send."""

    def stop(self, category: Stop) -> None:
        """Nothing moves."""
