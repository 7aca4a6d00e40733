"""Signals of another machine, one zenoh key each, read as a device's states with a device's staleness.

A sample's age comes from its sender's own stamp: from the message's header, otherwise from the attachment (which
another runtime's bus sends with messages that have no header). So a sample that waited in a network's buffers is old
on arrival. The same holds for samples that a runtime repeats after its own device was lost.
"""

from __future__ import annotations

import json
import time
from typing import Any

from srl.drivers.zenoh.config import SignalEntry, ZenohConfig
from srl.drivers.zenoh.values import TERMS, TYPES, Values, type_of
from srl.drivers.zenoh_link import Link, wire
from srl.drivers.zenoh_link.stamps import SourceTime
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.errors import DeviceError, DeviceLostError, RequestError, nearest
from srl.runtime.contracts.signals import Array, Signal

FIRST = 4.0  # s that two samples of each signal may take
_KEY = "Correct the key or the signal's lines in the profile"


class _Source:
    """One signal's samples."""

    def __init__(self, signal: Signal, entry: SignalEntry) -> None:
        self.entry, self.signal = entry, signal
        self.values = Values(signal.name, signal.size, signal.labels, entry.field, entry.nan)
        self.time = SourceTime()
        self.forget()

    def forget(self) -> None:
        """Resets to the state before the first sample."""
        self.newest: Array | None = None
        self.stamp = -1  # ns, loop clock
        self.arrived = -1  # ns, arrival of the newest sample that was newer than the one before
        self.fresh = 0  # number of such samples
        self.repeated = -1  # ns, arrival of the newest sample whose stamp wasn't newer
        self.stamped = True
        self.problem = ""
        self.time.restart()

    def take(self, sample: wire.Sample) -> bool:
        """Keeps a sample's values if it is newer. Returns False if it is invalid; `problem` says why."""
        declared = type_of(sample.encoding)
        kind = declared or self.entry.type or ""
        try:
            if self.entry.type is not None and kind != self.entry.type:
                raise RequestError(self.entry.key, f"it carries {kind}, expected {self.entry.type}", _KEY)
            if not kind:
                raise RequestError(
                    self.entry.key, f"its encoding '{sample.encoding}' names no message", f"Add `type`: one of {TYPES}"
                )
            reading = self.values.read(kind, sample.payload)
        except RequestError as error:
            self.problem = f"{error.problem}. {error.remedy}"
            return False
        # The header has the time when the values were taken; other nodes' attachment only has the time of sending.
        source = reading.stamp if reading.stamp > 0 else sample.stamp
        self.stamped = source > 0
        stamp = self.time.stamp(source, sample.arrived) if self.stamped else sample.arrived
        if stamp is None:
            self.repeated = sample.arrived
        else:
            self.newest, self.stamp, self.arrived = reading.values, stamp, sample.arrived
            self.fresh += 1
        return True


class Zenoh(Sensor):
    """Signals of another machine over zenoh; the states are those that the profile lists.

    `health.stamp` is that of the signal whose newest sample is the oldest.

    Source: docs/bus.md (keys, messages, metadata); protocol sheet summit-xl-zenoh, sections 2 and 3.
    """

    Config = ZenohConfig
    gives = ("<signal>",)
    summary = "signals of another machine: another runtime's, or ROS 2 topics, over zenoh"
    max_age = 0.3
    here = False

    def __init__(self, name: str, config: ZenohConfig) -> None:
        super().__init__(name, config)
        self._config = config
        self.states = config.states()
        self._sources = [_Source(s, config.signals[s.name]) for s in self.states]
        self._instances = sorted({i for e in config.signals.values() if (i := e.instance) is not None})
        self._link = Link(name)
        self._silence = round(config.silence * 1e9)
        self._was_lost = False

    def open(self) -> None:
        """Blocks up to about 10 s.

        Raises:
            DeviceError: no connection, no such signal, a signal of another form, or all its samples are old.
        """
        self.close()
        for source in self._sources:
            source.forget()
        link = self._link
        try:
            alive = [f"srl/{name}/alive" for name in self._instances]
            link.open(self._config, [s.entry.key for s in self._sources], [], alive)
            for source in self._sources:
                if source.entry.instance is not None:
                    self._check(source)
            self._await_samples()
        except BaseException:
            link.close()
            raise
        self.health.connected = True
        self.health.reconnects += self._was_lost
        self._was_lost = False
        unstamped = [s.signal.name for s in self._sources if not s.stamped]
        self.health.message = f"no stamps in {', '.join(unstamped)}: taken as new on arrival" if unstamped else ""

    def read(self, now: int) -> None:
        try:
            events = self._link.read()
            if events:
                self._take(events)
            self._check_silence()
        except DeviceLostError:
            self.health.connected = False
            self._was_lost = True
            raise
        for source in self._sources:
            if source.newest is not None:
                self.state_arrays[source.signal.name].reshape(-1)[:] = source.newest
        self.health.stamp = min(source.stamp for source in self._sources)

    def close(self) -> None:
        self.health.connected = False
        self._link.close()

    def metrics(self) -> dict[str, object]:
        """Returns the ns by which each signal's newest sample was slower than its fastest."""
        return {"delay_ns": {s.signal.name: s.time.delay for s in self._sources}}

    def _take(self, events: list[wire.Event]) -> None:
        waiting: dict[int, list[wire.Sample]] = {}
        for event in events:
            if isinstance(event, wire.Sample):
                waiting.setdefault(event.source, []).append(event)
            elif isinstance(event, wire.Token) and not event.alive:
                raise DeviceLostError(
                    self.name,
                    f"the runtime '{self._instances[event.source]}' has gone from {self._config.port}",
                    "Start it again",
                )
        for number, samples in waiting.items():
            source = self._sources[number]
            # Of a backlog only the newest valid sample is used.
            while samples:
                if source.take(samples.pop()):
                    self.health.frames += 1 + len(samples)
                    break
                self.health.errors += 1

    def _check_silence(self) -> None:
        now = time.monotonic_ns()
        for source in self._sources:
            if now - source.arrived > self._silence:
                raise DeviceLostError(
                    self.name,
                    (
                        f"nothing new came on '{source.entry.key}': its samples' stamp stands still or went back"
                        if source.repeated > source.arrived
                        else f"nothing new came on '{source.entry.key}' for {self._config.silence:g} s"
                    )
                    + (f" ({source.problem})" if source.problem else ""),
                    "Check the device at the other end, its runtime, and the network",
                )

    def _await_samples(self) -> None:
        """Waits until each signal has come twice with rising stamps: a first sample may be of any age."""
        deadline = time.monotonic() + FIRST
        while waiting := [s for s in self._sources if s.fresh < (2 if s.stamped else 1)]:
            source = waiting[0]
            rest = deadline - time.monotonic()
            if source.problem and not source.fresh:
                raise DeviceError(self.name, f"'{source.entry.key}': {source.problem.rstrip('.')}", _KEY)
            if rest <= 0:
                what = (
                    "all samples have the same stamp: the device at the other end is lost or paused"
                    if source.fresh
                    else f"nothing came in {FIRST:g} s"
                )
                raise DeviceError(
                    self.name, f"'{source.entry.key}': {what}", "Check the device at the other end, and the key"
                )
            for event in self._link.wait(rest):
                if isinstance(event, wire.Sample):
                    self._sources[event.source].take(event)

    def _check(self, source: _Source) -> None:
        """Compares the other runtime's metadata of the signal with what the profile expects."""
        key = source.entry.key
        meta = self._ask(f"{key}/meta").get(f"{key}/meta")
        if meta is None:
            known = self._ask(f"srl/{source.entry.instance}/state/**")
            if not known:
                raise DeviceError(
                    self.name, f"no runtime '{source.entry.instance}' answers at {self._config.port}", "Is it running?"
                )
            keys = [name.removesuffix("/meta") for name in known]
            raise DeviceError(self.name, f"there is no signal '{key}'", nearest(key, keys))
        signal, entry = source.signal, source.entry
        if entry.type is not None and meta.get("type") != entry.type:
            raise DeviceError(self.name, f"'{key}' carries {meta.get('type')}, expected {entry.type}", _KEY)
        shape, labels = (value if isinstance(value := meta.get(name), list) else [] for name in ("shape", "labels"))
        # A sender of an earlier version doesn't name the elements of a pose, nor any components.
        names: tuple[str, ...] = tuple(map(str, labels)) or TERMS.get(str(meta.get("type")), ())
        components = meta.get("components") or list(map(list, signal.components))
        for what, there, here in (
            ("shape", tuple(shape), signal.shape),
            ("unit", meta.get("unit"), signal.unit),
            ("frame", meta.get("frame") if entry.frame else None, entry.frame),
            ("labels", sorted(names) if signal.labels else [], sorted(signal.labels)),
            ("components", components, list(map(list, signal.components))),
        ):
            if there != here:
                raise DeviceError(
                    self.name,
                    f"'{key}' has the {what} {_text(there)}, the profile expects {_text(here)}",
                    _KEY,
                )
        if signal.labels:
            source.values.follow(names)

    def _ask(self, key: str) -> dict[str, dict[str, Any]]:
        found = {}
        for name, payload in self._link.ask(key).items():
            try:
                content = json.loads(payload)
            except (ValueError, RecursionError):
                continue
            if isinstance(content, dict):
                found[name] = content
        return found


def _text(value: object) -> str:
    return str(list(value)) if isinstance(value, tuple) else repr(value)
