"""The contract of a device. Drivers implement it over a wire, fakes in the simulated world."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf

import numpy as np

from srl.runtime.contracts.options import Options
from srl.runtime.contracts.renamed import refuse_old_names
from srl.runtime.contracts.signals import Array, Arrays, Command, Limits, Signal, Stop


class DeviceConfig(Options):
    """A device's options in the profile. A driver subclasses this class and adds its own options.

    Unknown keys are errors. Fields carry units in their description.
    """


EXTENDED = 0x8000_0000  # in `Traffic.identifiers`: of 29 bits, which no frame of 11 bits is taken for


@dataclass(frozen=True)
class Traffic:
    """What a device's frames take of a line that it shares with other devices, and by what they are told apart.

    Attributes:
        bus: the line, e.g. "can://socketcan/can0"; equal for all devices on it.
        bitrate: bit/s.
        per_cycle: bits on the line for each cycle of the loop, in the worst case.
        per_second: bits/s besides, whatever the loop's rate.
        identifiers: of all frames that the device obeys or sends, and what each is, for people. No other device on the
            line may obey or send one of them. An extended CAN identifier has bit 31 set (`EXTENDED`).
        common: of those, the identifiers that another device may have in common if it says so, too: what is in the
            frame tells whose it is.
    """

    bus: str
    bitrate: float
    per_cycle: float
    per_second: float = 0.0
    identifiers: Mapping[int, str] = field(default_factory=dict)
    common: frozenset[int] = frozenset()


@dataclass(slots=True)
class Health:
    """What a driver reports about its link; the loop copies it into every row.

    Attributes:
        stamp: when the newest sample was taken, ns on the loop's clock; -1 before the first. It comes from
            the device's own counter or clock where the device has one.
        connected: False from the moment the driver knows that the device is lost.
        frames: number of good frames received.
        errors: number of frames discarded (checksum, length, range).
        resyncs: number of times the parser had to search for the next frame.
        reconnects: number of times the device was opened again after a loss.
        unsent: number of bytes of the newest command that the device has not taken yet.
        message: the newest message of the driver, for people to read.
        fault: the text of a fault that keeps a connected device from moving (protective stop, reflex,
            hardware error); "" without a fault. A fault stops the limb, and `recover` may clear it.
        was_open: True once the device has been open.
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
        """Records that the device is open. Every call but the first counts as a reconnect."""
        self.connected = True
        self.reconnects += self.was_open
        self.was_open = True

    def lost(self, why: str) -> None:
        """Records that the device is lost; `why`, for people."""
        self.connected, self.message = False, why


class Driver(ABC):
    """One device.

    Life cycle: `__init__` (declares the signals, does no I/O) -> `bind` -> `open` -> cycles of `read`, `write`
    -> `stop` -> `close`. After `DeviceLostError` the runtime calls `close` and then `open` again until `open`
    succeeds. It does so outside the loop's thread (for a fake, in the loop). `open` ends with
    `health.opened()`, which counts the reconnects.

    Attributes:
        states: signals the device gives; known after `__init__`.
        commands: signals the device obeys; known after `__init__`.
        max_age: s; the newest sample is stale when it is older than this, unless the profile sets another
            value. 0 for a device that gives no samples.
        health: see `Health`.
        sent_arrays: by command name, what has left for the device and can't be taken back, in the command's unit
            and before it was rounded for the wire. Fill the array, all elements at once, when a command leaves (in
            `write`, or in the next `read` if that sends it). Where each element has a frame of its own, as on a bus,
            fill those that left: the guard goes on with each from what was sent of it. The runtime takes the array
            once a cycle, after all writes, and sets it to NaN. Where a device stops by itself after a silence, report
            that, too.
        ranges: by state, the least and the greatest value that this very device can give, (size,) each, where it is
            known once it is open: of a force sensor twice its rating, as its zero may be anywhere in it. Narrower than
            `Signal.plausible`; a jump by an eighth of it isn't taken on one sample's word.
        traffic: what its frames take of a shared line, known after `__init__`; None where they share none. `srl check`
            adds up a line's devices and refuses more than it carries, and an identifier that two of them use.
    """

    Config: type[DeviceConfig] = DeviceConfig
    summary: str = ""  # one line for `srl list`
    # Names of the states it may have, for `srl list`. "<segment>.pose" means that the profile chooses the name.
    gives: tuple[str, ...] = ()
    takes: tuple[str, ...] = ()  # the same for the commands
    # USB numbers of the device or of the adapter that usually carries it, for `srl find-port`: "2341:0043", or the
    # vendor's alone where its products are many. They tell a person what a port may be; nothing is opened by them.
    usb: tuple[str, ...] = ()
    # Words of `port` for which it looks among the kernel's input devices, for `srl doctor`.
    among_inputs: tuple[str, ...] = ()
    max_age: float = 0.0
    # Its links that move with its joints; frames of the profile may hang on `DEVICE/LINK`. Its base has its own name.
    links: tuple[str, ...] = ()
    # What `srl calibrate PROFILE` calls its calibration; "" for none.
    calibrated: str = ""
    # Which description of `srl.runtime.models.robots` it is, for pictures; {model} stands for an option's value.
    pictured_as: str = ""
    # Whether its signals are given by what stands here, now. A button of anything else releases no person's stop.
    here: bool = True

    def __init_subclass__(cls) -> None:
        """Refuses a driver with a method's name of before."""
        super().__init_subclass__()
        refuse_old_names(cls, {"figures": "metrics"})

    def __init__(self, name: str, config: DeviceConfig) -> None:
        self.name = name
        self.config = config
        self.simulated = ""  # the option whose file was made in simulation
        self.states: tuple[Signal, ...] = ()
        self.commands: tuple[Command, ...] = ()
        self.health = Health()
        self.traffic: Traffic | None = None
        self.home: dict[str, Array] = {}
        self.limits: dict[str, Limits] = {}
        self.ranges: dict[str, tuple[Array, Array]] = {}
        self.state_arrays: Mapping[str, Array] = {}
        self.command_arrays: Mapping[str, Array] = {}
        self.sent_arrays: Mapping[str, Array] = {}

    def bind(self, states: Mapping[str, Array], commands: Mapping[str, Array]) -> None:
        """Takes the arrays, which the runtime allocates once.

        `read` fills the state arrays. `write` sends the command arrays, which hold the guarded commands, and fills
        the sent arrays.
        """
        self.state_arrays = Arrays(states)
        self.command_arrays = Arrays(commands)
        self.sent_arrays = Arrays({c.name: np.full(c.shape, np.nan) for c in self.commands})

    @abstractmethod
    def open(self) -> None:
        """Connects, identifies the device, checks firmware and limits, arms its watchdog. May block.

        Leaves actuators unpowered or at rest. Raises `DeviceError` with place and remedy.
        """

    @abstractmethod
    def read(self, now: int) -> None:
        """Reads all data that has arrived and fills the state arrays. Never blocks, never raises on invalid data.

        Args:
            now: ns on the loop's clock.
        Raises:
            DeviceLostError: the device is lost.
        """

    @abstractmethod
    def write(self, now: int) -> None:
        """Sends the command arrays. Never blocks; at most one command is ever unsent.

        Copies what left into the sent arrays. A command that the link refuses isn't sent.
        The loop calls it only while the device is active. The first call after `open` carries the measured
        state, or `home` for a device without feedback. Raises `DeviceLostError`.
        """

    @abstractmethod
    def stop(self, category: Stop) -> None:
        """Starts the device's own safe stop; idempotent, never blocks, never raises."""

    @abstractmethod
    def close(self) -> None:
        """Releases the device. Always succeeds; may be called at any time, more than once."""

    @classmethod
    def who_is_at(cls, port: str) -> str:
        """Says in one line who answers at a serial port, for `srl find-port --ask`; "" if the driver can't ask.

        It sends requests that only read: nothing is set, nothing moves. May block some seconds.

        Raises:
            DeviceError: nobody answers, or not in this device's protocol.
        """
        return ""

    def recover(self, now: int) -> None:
        """Starts the device's own recovery, after a user has requested a start or reset while `health.fault` is set.

        The loop calls it in this case only. It must never block. A longer recovery continues in later calls
        of `read`, which clears `health.fault` once the device has recovered. The next reset then starts the
        limb again. Raises DeviceLostError.
        """

    def fileno(self) -> int | None:
        """The file descriptor of an actuator, which the supervisor duplicates; None for sensors and fakes."""
        return None

    def stop_frames(self, category: Stop) -> tuple[bytes, ...]:
        """Frames that put the device into its stop when another process writes them to `fileno()` at any instant.

        Each is given to a write of its own, in this order: a stream takes one, a CAN socket one for each motor. They
        begin with the bytes that end an incomplete frame, and are written twice: once when the loop's death is
        found, and once when nothing of it can follow any more. The second time they change nothing. The loop calls
        this after each `write`: it must be cheap and return the same object while nothing has changed. Empty where
        the device's own watchdog stops it.
        """
        return ()

    def frames_good_for(self, category: Stop) -> float:
        """How long after the last write `stop_frames` of this category may be written, s; inf: always.

        A device that lets go when it hears nothing for a while, and obeys the next frame, would be pulled back by a
        position of before. Without frames it goes on with its last command, or has let go anyway.
        """
        return inf

    def metrics(self) -> dict[str, object]:
        """Returns the driver's own figures for the run's summary."""
        return {}


class Sensor(Driver):
    """A driver that takes no commands. It has nothing to write and nothing to stop."""

    def write(self, now: int) -> None:
        """Does nothing: a sensor takes no commands."""

    def stop(self, category: Stop) -> None:
        """Does nothing: a sensor does not move."""
