"""A driver of drives on a CAN bus: its life, what it hears and sends each cycle, its stops."""

from __future__ import annotations

import contextlib
import time
from abc import abstractmethod
from collections.abc import Sequence
from typing import Final

import can
import numpy as np

from srl.drivers.can_axes.config import CanAxesConfig
from srl.drivers.can_axes.drive import FAR, Drive
from srl.drivers.can_axes.signals import command, states
from srl.drivers.canbus import CanLink, open_can, shared_bus
from srl.drivers.linked import Linked
from srl.runtime.contracts.driver import Traffic
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Stop

SILENT: Final = 500_000_000  # ns without a sign of life after which a drive is a fault
GONE: Final = 1_000_000_000  # ns without a word of any drive after which the bus is lost
REFUSED: Final = 250_000_000  # ns for which a bus may take no command before it is a fault
PAUSE: Final = 100_000_000  # ns without a command, after which an axis may have gone away from it
WAKING: Final = 1_000_000_000  # ns within which a drive must obey after its first command
REPEAT: Final = 20_000_000  # ns after which a stop that isn't confirmed is sent again
LEAST: Final = 3  # times that it is sent: what a drive said may be older than it
_TIMEOUT: Final = 0.2  # s that a request may wait for its answer while the bus is opened


class CanAxes(Linked[CanLink]):
    """Axes of a limb behind one CAN bus.

    A drive gets its first command only while it is heard, says nothing is wrong, and stands near that command. If one
    drive is silent or fails, the limb stops and the others go on to obey: only a bus on which nobody speaks is lost.
    """

    NAMES: tuple[str, ...] = ()  # of the states
    usb = ("16d0",)  # of slcan adapters

    def __init__(self, name: str, config: CanAxesConfig) -> None:
        super().__init__(name, config)
        self.config: CanAxesConfig = config
        self._place = name
        axes = config.all_axes
        self.labels = tuple(axes)
        self.states = states(self.NAMES, self.labels)
        homes = [axis.home for axis in axes.values() if axis.home is not None]
        self.commands = (command(config.mode, self.labels, bool(homes), self.resolution()),)
        self._command = config.command
        if homes:
            self.home[self._command] = np.array(homes)
        self.limits[self._command] = config.limits
        each, second = self.bits()
        self.traffic = Traffic(shared_bus(config.port), config.bitrate, each, second, self.identifiers())
        self.drives = [Drive(key, axis, axis.place is None) for key, axis in axes.items()]
        self._of = {axis.number: i for i, axis in enumerate(axes.values())}
        self._let_go = False  # LIMP was requested, and no command since
        self._since = self._repeated = -REPEAT  # ns, when LIMP was requested, and last sent
        self._repeats = 0
        self._now = 0
        self._foreign = self._blocked = ""
        self._started = False  # all obeyed since the last LIMP
        self._counts = [0, 0]  # frames, errors
        self._message = ""
        self._held: dict[int, can.Message] = {}  # the newest command by drive
        self._frames: dict[Stop, tuple[dict[int, can.Message], tuple[bytes, ...]]] = {}

    # -- what a protocol adds

    @abstractmethod
    def resolution(self) -> tuple[float, ...]:
        """What the wire rounds a command to, (n,), in its unit."""

    @abstractmethod
    def bits(self) -> tuple[float, float]:
        """Bits on the bus for each cycle, and for each second besides."""

    @abstractmethod
    def identifiers(self) -> dict[int, str]:
        """What the drives obey and send; see `Traffic`."""

    @abstractmethod
    def identify(self, link: CanLink) -> str:
        """Finds and checks all drives, moves nothing; returns a remark. Raises DeviceError."""

    @abstractmethod
    def hear(self, message: can.Message, now: int) -> None:
        """Takes a frame of another node, which arrived at `now`."""

    @abstractmethod
    def ask(self, link: CanLink, now: int) -> None:
        """Sends what is to be requested in this cycle."""

    @abstractmethod
    def waking(self, i: int, value: float) -> Sequence[can.Message]:
        """Frames that make drive `i` obey without a motion; `value` is its first command, in the axis' unit."""

    @abstractmethod
    def obeys(self, i: int) -> bool:
        """Whether drive `i` was heard to obey since it was woken."""

    @abstractmethod
    def input(self, i: int, value: float) -> can.Message:
        """The command `value` for drive `i`, in the axis' unit."""

    @abstractmethod
    def limp(self, i: int) -> can.Message:
        """The frame that takes the torque from drive `i`."""

    @abstractmethod
    def limp_at(self, i: int) -> int:
        """ns, when drive `i` last said that it has no torque; -1 if it says something else."""

    @abstractmethod
    def halt(self, i: int) -> Sequence[can.Message]:
        """What leaves drive `i` at rest without the loop: repeats a position, brakes a velocity, damps a torque."""

    @abstractmethod
    def clearing(self, i: int) -> Sequence[can.Message]:
        """Frames with which drive `i` recovers, without torque."""

    # -- life cycle

    def connect(self) -> CanLink:
        return open_can(self.config.port, place=self.name)

    def _set_up(self, link: CanLink) -> None:
        """Blocks a second or two. Nothing moves, and no drive gets torque."""
        first, self._let_go = not self.health.was_open, False
        for drive in self.drives:
            drive.forget()
            drive.heard, drive.left, drive.refused, drive.silent = -1, -1, -1, False
        self._foreign = self._blocked = ""
        self._started = False
        self._message = self.identify(link)
        for drive in self.drives:
            self._check_parked(drive, first)
        self._held = {}
        self._frames.clear()
        self._judge(-1)

    def _check_parked(self, drive: Drive, first: bool) -> None:
        """Refuses an axis that isn't where it must be parked. Later, a position must fit to the one before."""
        parked, tolerance = drive.axis.place, self.config.park_tolerance
        if not first or parked is None or abs(drive.position - parked) <= tolerance:
            return
        raise self._error(
            f"'{drive.name}' says that it is at {drive.position:.2f} rad; it must be parked at {parked:g} rad, within "
            f"{tolerance:g} rad, when a run opens",
            "Put the limb into its parked pose. If it is there, its drive was switched on elsewhere and counts from a "
            "wrong place: switch it off and on in this pose. If not, compare 'parked', 'reversed' and the id",
        )

    def _receive(self, link: CanLink, now: int) -> None:
        self._now = now
        for message in link.read():
            self.hear(message, link.stamp(message, now))
        for drive in self.drives:
            if drive.heard < 0:
                drive.heard = now
        self._judge(now)
        if all(now - drive.heard > GONE for drive in self.drives):
            raise self._lost("no drive has been heard for a second", "Check the bus' cable and the drives' supply")
        if self._let_go:
            self._send_limp(link, now)
        self.ask(link, now)
        for key in self.NAMES:
            self.state_arrays[key][:] = [getattr(drive, key) for drive in self.drives]
        if all(drive.sampled >= 0 for drive in self.drives):
            self.health.stamp = min(drive.sampled for drive in self.drives)
        self.health.frames, self.health.errors = self._counts

    def _judge(self, now: int) -> None:
        """Names what is wrong, and takes the torque from a drive whose position can't be trusted."""
        for i, drive in enumerate(self.drives):
            drive.silent = now >= 0 and now - drive.heard > SILENT
            if drive.woken >= 0 and (drive.lost or drive.dropped or drive.error):
                drive.release()
                self._dismiss(i)
            elif drive.woken >= 0 and not drive.armed and now - drive.woken > WAKING:
                drive.release()
                drive.dropped = drive.dropped or "didn't begin to obey within a second"
                self._dismiss(i)
        if any(0 <= drive.refused < now - REFUSED for drive in self.drives):
            self._blocked = (
                "the bus takes no commands: nobody acknowledges them, or the adapter is bus-off. Check cable, supply "
                "and terminators"
            )
        troubles = [trouble for drive in self.drives if (trouble := drive.trouble())]
        self.health.fault = "; ".join([*troubles, *filter(None, (self._foreign, self._blocked))])
        self.health.message = self._message

    def _dismiss(self, i: int) -> None:
        if self._link is not None:
            self._send(self._link, [self.limp(i)])
        self._held = {k: message for k, message in self._held.items() if k != i}

    def write(self, now: int) -> None:
        """Until every drive obeys, none goes on from its first command; a torque is given at once.

        Each drive has a frame of its own, so of a bus that takes some of them those count as sent.
        """
        link = self._open_link()
        self._now = now
        values = self.command_arrays[self._command]
        if not np.isfinite(values).all():
            return
        self._let_go, held = False, dict(self._held)
        try:
            for i, (drive, wanted) in enumerate(zip(self.drives, values.tolist(), strict=True)):
                if drive.stopped or self._foreign or self._strayed(drive, wanted, now):
                    continue
                if not drive.armed and not self._wake(link, i, wanted, now):
                    continue
                value = wanted if self._started or self.config.mode == "torque" else drive.first
                message = self.input(i, value)
                if link.write(message):
                    held[i], drive.left, drive.refused = message, now, -1
                    self.sent_arrays[self._command][i] = value
                elif drive.refused < 0:
                    drive.refused = now
        except DeviceLostError as error:
            self.health.lost(error.problem)
            raise
        self._held = held
        self._started = self._started or all(drive.armed or drive.stopped for drive in self.drives)

    def _strayed(self, drive: Drive, value: float, now: int) -> bool:
        """Whether an axis went, or may have gone, away from its command while none left: it would be pulled back."""
        if not drive.armed or self.config.mode != "position" or now - drive.left <= PAUSE:
            return False
        if now - drive.sampled > PAUSE:  # only frames from within the pause have been read so far
            return True
        if abs(value - drive.position) <= self.config.start_tolerance:
            return False
        drive.dropped = f"moved by {drive.position - value:.2f} rad while no command reached it: it was let go"
        return True

    def _wake(self, link: CanLink, i: int, value: float, now: int) -> bool:
        """Begins with a drive; returns whether it obeys. Till then it is given its first command; without one, rest."""
        drive = self.drives[i]
        if drive.woken < 0:
            if self.config.mode == "position" and abs(value - drive.position) > self.config.start_tolerance:
                drive.far = FAR
                return False
            drive.first = value if self.config.mode == "position" else 0.0
            left = self._send(link, self.waking(i, value))
            drive.woken = now if left else -1
        elif self.obeys(i):
            drive.armed = True
            return True
        else:
            left = link.write(self.input(i, drive.first))
        if left:
            self.sent_arrays[self._command][i] = drive.first
        return False

    def stop(self, category: Stop) -> None:
        """LIMP takes the torque from all drives, until each of them says so."""
        link = self._link
        if link is None:
            return
        with contextlib.suppress(DeviceError):  # the next read reports a lost link
            if category is Stop.LIMP:
                if not self._let_go:
                    self._let_go, self._started, self._since, self._held = True, False, self._now, {}
                    self._repeated, self._repeats = self._now - REPEAT, 0
                    for drive in self.drives:
                        drive.release()
                self._send_limp(link, self._now)
            else:
                for i, drive in enumerate(self.drives):
                    if drive.armed:
                        self._send(link, self.halt(i))

    def _send_limp(self, link: CanLink, now: int) -> None:
        waiting = self._waiting()
        if waiting and now - self._repeated >= REPEAT and self._send(link, [self.limp(i) for i in waiting]):
            self._repeated, self._repeats = now, self._repeats + 1

    def _waiting(self) -> list[int]:
        """Drives that haven't said since the request that they have no torque; all, until it was sent some times."""
        return [i for i in range(len(self.drives)) if self._repeats < LEAST or self.limp_at(i) <= self._since]

    def _end(self, link: CanLink) -> None:
        """A drive that was told to hold does so until its own time limit ends it."""
        if self._let_go:
            self._send(link, [self.limp(i) for i in self._waiting()])

    def recover(self, now: int) -> None:
        """Clears the drives' errors. They are without torque from then on."""
        link = self._open_link()
        self._foreign = self._blocked = ""
        for i, drive in enumerate(self.drives):
            drive.refused = -1
            if drive.stopped:
                drive.forget()
                self._send(link, self.clearing(i))
        self._judge(now)

    # -- for the supervisor

    def fileno(self) -> int | None:
        return self._link.stop_fileno() if self._link is not None else None

    def stop_frames(self, category: Stop) -> tuple[bytes, ...]:
        """A frame or two for each drive."""
        link = self._link
        if link is None:
            return ()
        kept = self._frames.get(category)
        if kept is not None and kept[0] is self._held:
            return kept[1]
        if category is Stop.LIMP:
            messages = [self.limp(i) for i in range(len(self.drives))]
        else:
            messages = [m for i, drive in enumerate(self.drives) if drive.armed for m in self.halt(i)]
        frames = tuple(frame for message in messages if (frame := link.stop_frame(message)))
        self._frames[category] = self._held, frames
        return frames

    # -- for the protocols

    def held(self, i: int) -> can.Message | None:
        """The newest command of drive `i`."""
        return self._held.get(i)

    def strange(self, what: str) -> None:
        """Somebody else commands these drives."""
        self._foreign = f"another program commands these drives ({what}); they obey both. End it: a bus has one host"

    def question(self, link: CanLink, message: can.Message, answer: int, seconds: float = _TIMEOUT) -> list[bytes]:
        """Sends a request and returns all answers with this identifier; blocks, for `identify` only."""
        link.read()
        link.write(message)
        deadline, found = time.monotonic() + seconds, list[bytes]()
        while not found:
            left = deadline - time.monotonic()
            for got in link.read_wait(max(left, 0.0)):
                if got.arbitration_id == answer and not got.is_remote_frame and len(got.data):
                    found.append(bytes(got.data))
            if left <= 0:
                break
        return found

    def _send(self, link: CanLink, messages: Sequence[can.Message]) -> bool:
        return all([link.write(message) for message in messages])
