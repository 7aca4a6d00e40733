"""A driver in the loop: calls it, catches what it may raise, and opens it again after a loss.

A lost device is opened again by a thread of ordinary priority, away from the loop's path; until it is back
the loop doesn't touch the driver. Simulated devices are opened again in the loop itself, so that a run keeps
its bits.
"""

from __future__ import annotations

import threading
import traceback
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from runtime.contracts.driver import Driver
from runtime.contracts.errors import DeviceLostError, SrlError
from runtime.contracts.signals import Stop
from runtime.contracts.world import Fake
from runtime.ipc.words import DEVICE, LINK_ACTIVE, LINK_CONNECTED, LINK_ERROR, LINK_FAULT, LINK_STALE
from runtime.profile.graph import Actuator

RETRY = 0.5  # s between attempts to open a lost device
_KEPT = ~(LINK_CONNECTED | LINK_ERROR | LINK_STALE | LINK_FAULT)


class Device:
    """See the module's text.

    Attributes:
        driver: the driver.
        actuators: its commands, as the guard bounds them; empty for a sensor.
        words: (6,) int64, its words in the row (`DEVICE`).
        lost: it is away.
        on_loss, on_return: called in the loop's thread.
    """

    def __init__(
        self, driver: Driver, words: NDArray[np.int64], actuators: list[Actuator], report: Callable[[str], None]
    ) -> None:
        """`report` takes an event in words; the rest is described above."""
        self.driver, self.words, self.actuators = driver, words, actuators
        self.lost = False
        self.on_loss: Callable[[Device], None] = lambda device: None
        self.on_return: Callable[[Device], None] = lambda device: None
        self.words[DEVICE.stamp] = -1
        self._report = report
        self._failing: set[str] = set()  # which of read, write and stop failed when last called
        self._events: deque[str] = deque()  # the reopening thread's: only the loop writes events
        self._wanted, self._back, self._closing = threading.Event(), threading.Event(), threading.Event()
        self._reopener: threading.Thread | None = None
        self._next_try = 0
        self._fault = ""  # the newest that was reported

    @property
    def active(self) -> bool:
        """Commands reach it."""
        return bool(self.words.item(DEVICE.link) & LINK_ACTIVE)

    def watch(self) -> None:
        """Starts the thread that will open the device again; before the loop, as starting one takes milliseconds."""
        if not isinstance(self.driver, Fake):
            self._reopener = threading.Thread(target=self._reopen, name=f"reopen-{self.driver.name}", daemon=True)
            self._reopener.start()

    def read(self, now: int) -> None:
        """Reads the driver and copies its health into the row."""
        was_lost = self.lost
        if was_lost:
            self._await_return(now)
        else:
            self._call("read", self.driver.read, now)
        health, words = self.driver.health, self.words
        link = words.item(DEVICE.link) & _KEPT
        # A return shows one cycle late, so that every loss is seen, however short.
        if not was_lost and not self.lost and health.connected:
            link |= LINK_CONNECTED
            if health.fault:
                link |= LINK_FAULT
        if health.fault != self._fault:
            self._fault = health.fault
            self._report(
                f"'{self.driver.name}': {health.fault}" if health.fault else f"'{self.driver.name}' is well again"
            )
        if self._failing:
            # What isn't called now can't show that it is well again.
            if not link & LINK_ACTIVE:
                self._failing.discard("write")
            if not health.fault:
                self._failing.discard("recover")
            link |= LINK_ERROR * bool(self._failing)
        words[:] = health.stamp, link, health.frames, health.errors, health.resyncs, health.reconnects

    def write(self, now: int) -> None:
        """Sends the commands; not while the device is away."""
        if not self.lost:
            self._call("write", self.driver.write, now)

    def stop(self, category: Stop, now: int) -> None:
        """Starts the device's own stop; not while the device is away."""
        if not self.lost:
            self._call("stop", lambda _: self.driver.stop(category), now)

    def recover(self, now: int) -> None:
        """Starts the recovery of a device that refuses to move; not while the device is away."""
        if not self.lost and self.driver.health.fault:
            self._report(f"'{self.driver.name}' is told to recover from: {self.driver.health.fault}")
            self._call("recover", self.driver.recover, now)

    def _call(self, what: str, function: Callable[[int], None], now: int) -> None:
        try:
            function(now)
            if self._failing:
                self._failing.discard(what)
        except DeviceLostError as error:
            self._lose(str(error), now)
        except Exception:
            # A driver's defect must not end the loop while a person wears the limb.
            if what not in self._failing:
                self._report(f"driver '{self.driver.name}' failed to {what}: {traceback.format_exc(limit=-3)}")
            self._failing.add(what)

    def _lose(self, reason: str, now: int) -> None:
        self.lost = True
        self._failing.clear()
        self._next_try = now + round(RETRY * 1e9)
        self._report(f"lost {reason}")
        self.on_loss(self)
        self._back.clear()
        self._wanted.set()

    def _reopen(self) -> None:
        """The thread: opens the device whenever it is wanted back."""
        said = ""
        while not self._closing.is_set():
            if not self._wanted.wait(RETRY):
                said = ""
                continue
            try:
                self.driver.close()
                self.driver.open()
                self._wanted.clear()
                self._back.set()
                continue
            except SrlError as error:
                if str(error) != said:
                    said = str(error)
                    self._events.append(f"still away: {said}")
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
        """Lets go of the device, and of an attempt to open it that is under way."""
        self._closing.set()
        if self._reopener is not None and self._wanted.is_set():
            self._reopener.join(2.0)
        self.driver.close()
