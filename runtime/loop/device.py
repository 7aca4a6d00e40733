"""A driver in the loop: calls the driver, catches its exceptions, and opens it again after a loss.

A separate thread of ordinary priority reopens a lost device. Until the device is back, the loop does not use
the driver. The loop itself reopens simulated devices, so that a run stays the same bit for bit.
"""

from __future__ import annotations

import threading
import traceback
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from math import inf, isfinite, nan
from operator import attrgetter, is_not
from struct import Struct
from typing import ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.compiled import bind_or_python
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import DeviceLostError, SrlError
from srl.runtime.contracts.signals import Limits, Stop
from srl.runtime.contracts.world import Fake
from srl.runtime.guard.samples import SampleCheck
from srl.runtime.ipc.header import DEVICE, LINK_ACTIVE, LINK_CONNECTED, LINK_ERROR, LINK_FAULT, LINK_STALE
from srl.runtime.loop.expected import expect
from srl.runtime.profile.graph import Actuator

RETRY = 0.5  # s between attempts to open a lost device
REPORT_EVERY = 1_000_000_000  # ns between two events about samples that aren't taken
SILENT = 2_000_000_000  # ns that an active device may take for its first command
_HEALTH = DEVICE.commands  # number of header fields that `Health` gives
_KEPT = ~(LINK_CONNECTED | LINK_ERROR | LINK_STALE | LINK_FAULT)
_COMMANDS = DEVICE.commands
_bound = attrgetter("state_arrays", "command_arrays", "sent_arrays")  # what a driver is given by `bind`

P = ParamSpec("P")
T = TypeVar("T")


class Device:
    """One device in the loop; see the module's docstring.

    Attributes:
        driver: the driver.
        actuators: its commands, as the guard bounds them; empty for a sensor.
        header: (7,) int64, its header fields in the row (`DEVICE`).
        lost: True while the device is lost.
        framed: whether its driver has stop frames at all.
        on_loss, on_return: called in the loop's thread.
    """

    def __init__(
        self, driver: Driver, header: NDArray[np.int64], actuators: list[Actuator], report: Callable[[str], None]
    ) -> None:
        """`report` takes the text of an event. The other arguments are described above."""
        self.driver, self.header, self.actuators = driver, header, actuators
        self.lost = False
        self._arrays = _bound(driver)
        self.on_loss: Callable[[Device], None] = lambda device: None
        self.on_return: Callable[[Device], None] = lambda device: None
        self.header[DEVICE.stamp] = -1
        # Writes the health's fields: a quarter of the time of numpy's.
        self._tell = partial(Struct(f"{_HEALTH}q").pack_into, header.data.cast("B"), 0)
        # What the arrays of `sent_arrays` hold while nothing has left.
        self._nothing = [np.full(a.command.shape, nan).tobytes() for a in actuators]
        self._leave = [  # in C: what left goes into the row, and the driver's array is cleared
            bind_or_python("command-left", driver.sent_arrays[a.command.name], a.sent) for a in actuators
        ]
        self.framed = type(driver).stop_frames is not Driver.stop_frames
        self._always_good = type(driver).frames_good_for is Driver.frames_good_for
        self._report = report
        self._failing: set[str] = set()  # which of read, write, report, stop and recover failed in their last call
        self._events: deque[str] = deque()  # from the reopening thread: only the loop writes events
        self._wanted, self._back, self._closing = threading.Event(), threading.Event(), threading.Event()
        self._reopener: threading.Thread | None = None
        self._next_try = 0
        self._samples = SampleCheck(driver.states, driver.state_arrays)
        self._stamp = self._given = -1  # of the newest sample that was taken: that in the row, its driver's
        self._left = -1  # of the sample that it left behind when it was lost
        self._jump = ""  # a fault: where it is measured isn't where it can have moved to
        self._reported = -REPORT_EVERY  # ns, when it was last reported that a sample isn't taken
        self._odd_since = -1  # ns, since when none is taken; -1: the newest one was
        self._fault = ""  # the newest reported fault
        # ns, since when it is active without a command; -1 while it isn't active; None once it has sent one
        self._active_since: int | None = -1

    @property
    def active(self) -> bool:
        """True while commands are sent to the device."""
        return bool(self.header.item(DEVICE.link) & LINK_ACTIVE)

    def watch(self) -> None:
        """Starts the thread that reopens the device. Call it before the loop: starting a thread takes milliseconds."""
        if not isinstance(self.driver, Fake):
            self._reopener = threading.Thread(target=self._reopen, name=f"reopen-{self.driver.name}", daemon=True)
            self._reopener.start()

    def expect(self, limits: Mapping[str, Limits]) -> None:
        """From now on its samples must be what can be (`srl.runtime.loop.expected`).

        Args:
            limits: by command name, what the guard keeps to.
        Raises:
            DeviceError: its driver says of its states what no range is.
        """
        expect(self._samples, self.driver, self.actuators, limits)

    def read(self, now: int) -> None:
        """Reads the driver, judges what it has read, and copies its health into the row."""
        was_lost = self.lost
        if was_lost:
            self._await_return(now)
        else:
            self._call("read", now, self._read, now)
            # What a device left behind when it was lost is no sample of the one that is back.
            if not self.lost and self.driver.health.stamp not in (-1, self._left):
                self._left = -1
                self._judge(now)
        health, words = self.driver.health, self.header
        link = words.item(DEVICE.link) & _KEPT
        # The row shows a return one cycle late, so that every loss is seen, however short.
        if not was_lost and not self.lost and health.connected:
            link |= LINK_CONNECTED
            if health.fault or self._jump:
                link |= LINK_FAULT
        if (fault := health.fault or self._jump) != self._fault:
            self._fault = fault
            self._report(f"'{self.driver.name}': {fault}" if fault else f"'{self.driver.name}' is well again")
        if self._failing:
            # A method that is not called now can't show that it works again.
            if not link & LINK_ACTIVE:
                self._failing -= {"write", "send", "give its stop frame"}
            if not health.fault:
                self._failing.discard("recover")
            link |= LINK_ERROR * bool(self._failing)
        errors = health.errors + self._samples.refused
        self._tell(self._stamp, link, health.frames, errors, health.resyncs, health.reconnects)

    def _read(self, now: int) -> None:
        self.driver.read(now)
        if any(map(is_not, _bound(self.driver), self._arrays)):
            raise TypeError("it has put something else in the place of self.state_arrays, or another that is bound")

    def _judge(self, now: int) -> None:
        """Takes the sample that the driver has read, unless it can't be true; then the one before stays."""
        samples, name = self._samples, self.driver.name
        if samples.take(self.driver.health.stamp, now):
            self._odd_since = -1
            if samples.settled and self._given != (stamp := self.driver.health.stamp):
                # One that lies ahead would hide a silence; one that lies far ahead is told by its age.
                near = stamp - now <= (self.driver.max_age or RETRY) * 1e9
                self._given, self._stamp = stamp, min(stamp, now) if near else stamp
            if samples.untrue and not self._jump:
                if self.active:
                    self._jump = samples.untrue
                elif now - self._reported >= REPORT_EVERY:
                    self._reported = now
                    self._report(f"'{name}': {samples.untrue}")
            if samples.jumped:
                text = f"it jumped: {samples.last}"
                if self.active:
                    self._jump = text
                else:
                    self._report(f"'{name}': {text}")
        elif samples.odd is not None:
            self._odd_since = now if self._odd_since < 0 else self._odd_since
            lasts = now - self._odd_since
            if now - self._reported >= max(REPORT_EVERY, lasts // 2):
                self._reported = now
                signal, element, _, why = samples.odd
                what = (
                    f"no sample has been taken for {lasts * 1e-9:.0f} s"
                    if lasts > REPORT_EVERY
                    else "a sample isn't taken"
                )
                more = ". Look at its units and wiring, and at what it measures" if lasts > REPORT_EVERY else ""
                self._report(f"'{name}': {what}: {signal}{f'[{element}]' if element else ''} {why}{more}")

    def write(self, now: int) -> None:
        """Sends the commands, except while the device is lost."""
        if not self.lost:
            self._call("write", now, self.driver.write, now)

    def publish(self, now: int) -> None:
        """Takes what has left into the row. Called once a cycle, after all writes, also while nothing is written."""
        self._call("report", now, self._take_sent)
        if self._active_since is not None:
            self._await_first(now)

    def _take_sent(self) -> None:
        left = False
        for actuator, nothing, leave in zip(self.actuators, self._nothing, self._leave, strict=True):
            if (done := leave(0.0)) >= 0:
                left = left or done > 0
                continue
            found = self.driver.sent_arrays[actuator.command.name]
            if found.tobytes() == nothing:
                continue
            if isfinite(sum(found.ravel().tolist())):  # all elements; else each is looked at
                actuator.sent[:] = found
            else:
                given = np.isfinite(found)
                if not given.any():
                    continue
                np.copyto(actuator.sent, found, where=given)
            found.fill(nan)
            left = True
        if left:
            self.header[_COMMANDS] += 1

    def _await_first(self, now: int) -> None:
        """Refuses a driver that is active and reports no command as sent: its limb would never move, or unseen."""
        if all(np.isfinite(actuator.sent).all() for actuator in self.actuators):
            self._active_since = None
        elif not self.active:
            self._active_since = -1
        elif self._active_since is not None and self._active_since < 0:
            self._active_since = now
        elif self._active_since is not None and now - self._active_since > SILENT and "send" not in self._failing:
            self._failing.add("send")
            self._report(f"driver '{self.driver.name}' reports no command as sent, {SILENT / 1e9:g} s after the start")

    def stop(self, category: Stop, now: int) -> None:
        """Starts the device's own stop, except while the device is lost."""
        if not self.lost:
            self._call("stop", now, self.driver.stop, category)

    def stop_frames(self, category: Stop, now: int) -> tuple[bytes, ...] | None:
        """The device's stop frames; None if its driver fails to make them: those before stay in force."""
        return self._call("give its stop frames", now, self.driver.stop_frames, category)

    def frames_good_for(self, category: Stop, now: int) -> float:
        """How long the device's stop frames may be written, s; 0 if its driver fails to say it."""
        if self._always_good:
            return inf
        return self._call("say how long its stop frames hold good", now, self.driver.frames_good_for, category) or 0.0

    def fileno(self, now: int) -> int | None:
        """The device's descriptor; None if it has none, or its driver fails to give it."""
        return self._call("give its descriptor", now, self.driver.fileno)

    def recover(self, now: int) -> None:
        """Starts the recovery of a device with a fault, except while the device is lost."""
        self._jump = ""  # a person has seen to it
        if not self.lost and self.driver.health.fault:
            self._report(f"'{self.driver.name}' is told to recover from: {self.driver.health.fault}")
            self._call("recover", now, self.driver.recover, now)

    def _call(self, what: str, now: int, function: Callable[P, T], *arguments: P.args, **named: P.kwargs) -> T | None:
        """Returns what `function` gives; None where the driver fails, or is lost: `what` it was to do is reported."""
        try:
            found = function(*arguments, **named)
            if self._failing:
                self._failing.discard(what)
            return found
        except DeviceLostError as error:
            self._lose(str(error), now)
        except Exception:
            # A defect in a driver must not end the loop while a person wears the limb.
            if what not in self._failing:
                self._report(f"driver '{self.driver.name}' failed to {what}: {traceback.format_exc(limit=-3)}")
            self._failing.add(what)
        return None

    def _lose(self, reason: str, now: int) -> None:
        self.lost = True
        self._failing.clear()
        self._samples.forget()
        self._stamp = self._given = self._odd_since = -1
        self._left, self._jump = self.driver.health.stamp, ""
        self._next_try = now + round(RETRY * 1e9)
        self._report(f"lost {reason}")
        self.on_loss(self)
        self._back.clear()
        self._wanted.set()

    def _reopen(self) -> None:
        """Runs in the thread: reopens the device after each loss."""
        last = ""
        while not self._closing.is_set():
            if not self._wanted.wait(RETRY):
                last = ""
                continue
            if self._closing.is_set():
                return
            try:
                self.driver.close()
                self.driver.open()
                self._wanted.clear()
                self._back.set()
                continue
            except SrlError as error:
                if str(error) != last:
                    last = str(error)
                    self._events.append(f"still away: {last}")
            except Exception:
                self._events.append(f"driver '{self.driver.name}' failed to open: {traceback.format_exc(limit=-3)}")
            self._closing.wait(RETRY)

    def _await_return(self, now: int) -> None:
        while self._events:
            self._report(self._events.popleft())
        if isinstance(self.driver, Fake):
            if now < self._next_try:
                return
            self._next_try = now + round(RETRY * 1e9)
            try:
                self.driver.close()
                self.driver.open()
            except SrlError:
                return
        elif not self._back.is_set():
            return
        self.lost = False
        self._report(f"'{self.driver.name}' is back")
        self.on_return(self)

    def close(self) -> None:
        """Releases the device and ends the thread that reopens it, idle or at work."""
        self._closing.set()
        self._wanted.set()  # wakes it
        if self._reopener is not None:
            self._reopener.join(2.0)
        self.driver.close()
