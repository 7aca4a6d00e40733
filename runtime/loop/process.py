"""The loop's process: `python -m srl.runtime.loop RUN_FOLDER CHANNEL`, started by the supervisor.

It opens the devices, passes the actuators' descriptors to the supervisor, becomes a real-time process, runs the
loop, and releases the devices.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import socket
import sys
import time
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from srl.runtime.contracts.errors import DeviceError, SrlError
from srl.runtime.contracts.files import Files, decoded
from srl.runtime.contracts.signals import Limits, Stop
from srl.runtime.contracts.world import Fake
from srl.runtime.ipc import latches, private_file
from srl.runtime.ipc.channel import Channel
from srl.runtime.ipc.child import Ending
from srl.runtime.ipc.events import EventWriter, Level
from srl.runtime.ipc.header import CYCLE, Cause, State
from srl.runtime.ipc.launch import Launch
from srl.runtime.ipc.notify import Notifier
from srl.runtime.ipc.ring import RingWriter
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.ipc.stop_slots import StopSlots
from srl.runtime.loop import realtime
from srl.runtime.loop.clock import Clock, DeviceClock, MonotonicClock, SimClock
from srl.runtime.loop.control_end import ControlEnd
from srl.runtime.loop.cycle import Cycle
from srl.runtime.loop.device import Device
from srl.runtime.loop.guards import limits_of
from srl.runtime.loop.loop import Loop
from srl.runtime.loop.request_queue import RequestQueue
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.graph import Graph

KEPT = 30  # s of rows that the ring holds: how long a recorder may be absent
LEAST = 4096  # least number of rows in the ring
READS = 16  # reads before the first cycle: more than any buffer holds
_NOW = CYCLE.now
_RETRACT, _HOLD = Stop.RETRACT, Stop.HOLD  # looking a member up takes longer than comparing it


def rows_kept(rate: Fraction) -> int:
    """How many rows the ring of a loop at this rate (Hz) holds."""
    return max(LEAST, KEPT * round(float(rate)))


class AskedToEndError(BaseException):
    """A request to end came before the loop ran. No `except Exception` of a driver may hold it up."""


class Process:
    """The process of one run; see the module's docstring."""

    def __init__(self, run_folder: RunFolder, channel: Channel, ending: Ending, stops: ControlEnd) -> None:
        """Raises SrlError."""
        self.run_folder, self.channel, self.ending, self.stops = run_folder, channel, ending, stops
        self.launch = Launch.load(run_folder.launch)
        self.events = EventWriter(run_folder.events)
        self.graph: Graph | None = None
        self.devices: list[Device] = []

    def report(self, text: str, level: Level = Level.WARNING) -> None:
        """Writes an event, for people to read."""
        cycle = int(self.graph.row.ints[CYCLE.cycle]) if self.graph is not None else 0
        self.events.write(time.monotonic_ns(), level, cycle, text)

    def run(self) -> None:
        """Carries out the whole run. Raises SrlError for errors that the user can correct."""
        launch = self.launch
        # The command that wrote the launch file has refused code that may not be run.
        files = Files(Path(launch.folder), decoded(launch.files, "the launch file"), run_code=True)
        checked, source = profile.parse(launch.label, launch.text, launch.overrides, files)
        graph = self.graph = wiring.build(checked, source, launch.sim)
        for text in launch.said:
            self.report(text)
        for warning in graph.warnings:
            self.report(f"warning: {warning}")
        for remark in graph.remarks:
            self.report(remark, Level.INFO)
        self.devices = [
            Device(d, graph.row.devices[i], graph.actuators_of(i), self.report) for i, d in enumerate(graph.devices)
        ]
        try:
            try:
                self._end_at_once()
                for device in self.devices:
                    device.driver.open()
                    device.watch()
                self._loop(graph)
            finally:
                self.ending.on_ask = lambda: None  # what follows must not be cut short
        except AskedToEndError:
            pass
        finally:
            for device in self.devices:
                device.close()
            if graph.world is not None:
                graph.world.close()

    def _end_at_once(self) -> None:
        """Until the loop runs, a request to end breaks off what is going on: a device may take long to open."""

        def give_up() -> None:
            self.ending.on_ask = lambda: None  # once is enough
            raise AskedToEndError

        self.ending.on_ask = give_up
        if self.ending.asked:
            give_up()

    def _end_safely(self, requests: RequestQueue) -> None:
        """From here on a request to end is one of the loop's."""

        def ask() -> None:
            requests.end_asked = True

        self.ending.on_ask = ask
        if self.ending.asked:
            ask()

    def _loop(self, graph: Graph) -> None:
        limits = limits_of(graph)
        for device in self.devices:
            device.expect(limits)
        clock = self._clock(graph)
        cycle = Cycle(graph, limits, self.launch.automatic, latches.of_names(self.launch.latches), self.report)
        meta = graph.layout.meta
        meta["limits"] = {name: _plain(value) for name, value in limits.items()}
        meta["clock"] = type(clock).__name__
        meta["automatic"], meta["latches"] = self.launch.automatic, self.launch.latches
        if self.launch.person:
            meta["person"] = self.launch.person
        if self.launch.twins:
            meta["twins"] = self.launch.twins
        unpaced = isinstance(clock, SimClock) and self.launch.fast
        meta["unpaced"] = unpaced
        if unpaced:
            meta["wall"] = time.time_ns()  # simulated time begins at 0
        graph.layout.save(self.run_folder.layout)
        requests = RequestQueue(self.run_folder, graph, self.stops)
        self._end_safely(requests)
        slots = self._slots(graph)
        ring = RingWriter.create(self.run_folder.rows, graph.layout.width, rows_kept(graph.profile.rate))
        self._ring = ring
        loop = Loop(graph, self.devices, clock, cycle, requests, ring)
        self._watch(loop, graph, slots)
        if not unpaced:
            for refused in realtime.enter(realtime.STUCK + 2 * clock.period):
                self.report(refused)
        ring.touch(time.monotonic_ns())
        if not unpaced:
            self._catch_up()
        self.channel.send({"say": "running", "period": clock.period, "unpaced": unpaced})
        try:
            loop.run(self.launch.cycles)
            ring.finish()
        finally:
            for device in loop.commanded:
                device.stop(self._category(loop, device), 0)
            realtime.leave()
            requests.close()
        try:
            private_file.replace(self.run_folder.result, json.dumps(self._metrics(loop)).encode())
        except Exception as error:  # whatever a driver's figures are: the run itself went well
            self.report(f"the run's own figures can't be kept: {error!r}")

    def _catch_up(self) -> None:
        """Reads what the first devices have sent while the last one was opened.

        A full buffer has lost its newest data, and the age of a device's first sample is not known.
        """
        for _ in range(READS):
            for device in self.devices:
                if not isinstance(device.driver, Fake):
                    device.read(time.monotonic_ns())

    def _clock(self, graph: Graph) -> Clock:
        name, rate = graph.profile.clock, graph.profile.rate
        pace: Clock = MonotonicClock(rate)
        if name != "monotonic":
            robot = next(d for d in self.devices if d.driver.name == name)
            if name not in graph.simulated:
                pace = DeviceClock(rate, lambda: None if robot.lost else robot.driver.fileno())
        if graph.world is None:
            return pace
        if not self.launch.fast:
            return SimClock(rate, graph.world, pace)
        return SimClock(rate, graph.world, None, self._throttle if self.launch.recorded else None)

    def _throttle(self) -> None:
        """Makes the simulation wait for its recorder, so that no recorded row is ever lost."""
        ring = self._ring
        while ring.head - ring.consumed > ring.capacity // 2:
            time.sleep(0.001)
            ring.touch(time.monotonic_ns())

    def _slots(self, graph: Graph) -> StopSlots:
        return StopSlots(self.run_folder.stops)

    def _watch(self, loop: Loop, graph: Graph, slots: StopSlots) -> None:
        """Gives the supervisor what it needs to stop the actuators, and keeps systemd notified."""
        notifier = Notifier()

        numbers = {d: i for i, d in enumerate(loop.commanded)}

        def now() -> int:
            return graph.row.ints.item(_NOW)

        def hand_over(device: Device) -> None:
            fileno = device.fileno(now())
            if fileno is not None:
                self.channel.send({"say": "actuator", "slot": numbers[device], "name": device.driver.name}, fileno)

        def lost(device: Device) -> None:
            slots.clear(numbers[device])
            self.channel.send({"say": "lost", "slot": numbers[device]})

        def after_write(device: Device) -> None:
            if not device.framed:
                return  # its slot stays empty
            category, moment = self._category(loop, device), now()
            frames = device.stop_frames(category, moment)
            if frames is None:
                return  # those before stay in force
            good = device.frames_good_for(category, moment)
            until = 0 if good == math.inf else time.monotonic_ns() + round(good * 1e9)
            if not slots.write(numbers[device], frames, until):
                name, size = device.driver.name, sum(map(len, frames))
                self.report(f"'{name}' has stop frames of {size} bytes, too long for the supervisor", Level.WARNING)

        for device in loop.commanded:
            hand_over(device)
            device.on_loss, device.on_return = lost, hand_over

        loop.after_write = after_write
        loop.remark = lambda text: self.report(text, Level.INFO)
        said = State.STARTING

        def each_cycle(state: State) -> None:
            nonlocal said
            notifier.ping()
            if state is not said:
                cause = loop.cycle.machine.cause
                level = Level.INFO if cause in (Cause.NONE, Cause.END) else Level.WARNING
                why = f" ({cause.name.lower()} {loop.fault_source()})".replace(" )", ")") if cause else ""
                self.report(f"{state.name.lower()}{why}", level)
                if said is State.STARTING:
                    notifier.ready()
                said = state

        loop.each_cycle = each_cycle

    def _category(self, loop: Loop, device: Device) -> Stop:
        """The device's stop category without the loop. Retracting needs the loop, so the device holds instead."""
        category = loop.cycle.category(device.actuators[0])
        return _HOLD if category is _RETRACT else category

    def _metrics(self, loop: Loop) -> dict[str, Any]:
        graph = loop.graph
        metrics: dict[str, Any] = {**loop.cycle.metrics()}
        metrics |= {d.name: f for d in graph.devices if (f := d.metrics())}
        metrics["guard"] = {
            a.name: {
                "rejected": g.rejections,
                "limited": g.limitations,
                "fallback": g.fallbacks,
                "resynchronised": g.resyncs,
            }
            | ({"held": g.verified.holds} if g.verified is not None else {})
            for a, g in zip(graph.actuators, loop.cycle.guards, strict=True)
        }
        return {str(name): _finite(value) for name, value in metrics.items()}


def _finite(value: Any) -> Any:
    """Replaces numbers that are not finite with None, which JSON writes as null. JSON has no infinity."""
    if isinstance(value, dict):
        return {str(k): _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if isinstance(value, np.generic | np.ndarray):
        return _finite(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _plain(limits: Limits) -> dict[str, Any]:
    return {
        f.name: value.tolist() for f in dataclasses.fields(limits) if (value := getattr(limits, f.name)) is not None
    }


def main(ending: Ending, stops: ControlEnd) -> int:
    """Entry point of the process; `ending`, and the socket for stops, were made before this module's imports."""
    if ending.orphan:
        print("loop: the supervisor that started it has ended, so it doesn't begin", file=sys.stderr)
        return 1
    channel = Channel(socket.socket(fileno=int(sys.argv[2])))
    os.set_inheritable(channel.socket.fileno(), False)
    try:
        Process(RunFolder(Path(sys.argv[1])), channel, ending, stops).run()
    except SrlError as error:
        kind = "device" if isinstance(error, DeviceError) else "other"
        channel.send(
            {"say": "failed", "kind": kind, "place": error.place, "problem": error.problem, "remedy": error.remedy}
        )
        return 2
    return 0
