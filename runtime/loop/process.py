"""The loop's process: `python -m runtime.loop.process RUNDIR CHANNEL`, started by the supervisor.

Opens the devices, hands the actuators' descriptors to the supervisor, becomes a real-time process, runs the
loop, and lets the devices go.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import signal
import socket
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from runtime.contracts.errors import DeviceError, ProfileError, SrlError, nearest
from runtime.contracts.signals import Limits, Stop
from runtime.contracts.world import Fake
from runtime.ipc.channel import Channel
from runtime.ipc.events import Level, NotesWriter
from runtime.ipc.launch import Order
from runtime.ipc.layout import Cause, State
from runtime.ipc.notify import Notifier
from runtime.ipc.ring import RingWriter
from runtime.ipc.run_folder import RunDir
from runtime.ipc.stop_slots import StopSlots
from runtime.loop import realtime
from runtime.loop.clock import Clock, DeviceClock, MonotonicClock, SimClock
from runtime.loop.cycle import Cycle, limits_of
from runtime.loop.device import Device
from runtime.loop.loop import Loop
from runtime.loop.request_queue import Inbox
from runtime.profile import profile, wiring
from runtime.profile.graph import Graph

KEPT = 30  # s of rows the ring holds: what a recorder may be away
LEAST = 4096  # rows
READS = 16  # before the first cycle: more than any buffer holds


class Process:
    """What belongs to one run; see the module's text."""

    def __init__(self, rundir: RunDir, channel: Channel) -> None:
        self.rundir, self.channel = rundir, channel
        self.order = Order.load(rundir.order)
        self.notes = NotesWriter(rundir.notes)
        self.graph: Graph | None = None
        self.devices: list[Device] = []

    def note(self, text: str, level: Level = Level.WARNING) -> None:
        """A remark for people."""
        cycle = int(self.graph.board.ints[0]) if self.graph is not None else 0
        self.notes.write(time.monotonic_ns(), level, cycle, text)

    def run(self) -> None:
        """The whole run. Raises SrlError for what the user can mend."""
        order = self.order
        checked, source = profile.parse(order.label, order.text, order.overrides)
        graph = self.graph = wiring.build(checked, source, order.sim)
        self.devices = [Device(d, i, graph.board, self.note) for i, d in enumerate(graph.devices)]
        try:
            for device in self.devices:
                device.driver.open()
                device.watch()
            self._loop(graph)
        finally:
            for device in self.devices:
                device.close()
            if graph.world is not None:
                graph.world.close()

    def _loop(self, graph: Graph) -> None:
        limits = limits_of(graph)
        clock = self._clock(graph)
        cycle = Cycle(
            graph, limits, self.order.automatic, Cause.RESTART if self.order.crashed else Cause.NONE, self.note
        )
        meta = graph.layout.meta
        meta["limits"] = {name: _plain(value) for name, value in limits.items()}
        meta["clock"] = type(clock).__name__
        meta["automatic"], meta["crashed"] = self.order.automatic, self.order.crashed
        unpaced = isinstance(clock, SimClock) and self.order.fast
        meta["unpaced"] = unpaced
        if unpaced:
            meta["wall"] = time.time_ns()  # simulated time begins at 0
        graph.layout.save(self.rundir.layout)
        capacity = max(LEAST, KEPT * round(float(graph.profile.rate)))
        ring = RingWriter.create(self.rundir.rows, graph.layout.width, capacity)
        inbox = Inbox(self.rundir, graph)
        self._ring = ring
        loop = Loop(graph, self.devices, clock, cycle, inbox, ring)
        self._watch(loop, graph)
        if not unpaced:
            for refused in realtime.enter():
                self.note(refused)
        signal.signal(signal.SIGTERM, lambda *_: setattr(inbox, "end_asked", True))
        ring.touch(time.monotonic_ns())
        if not unpaced:
            self._catch_up()
        self.channel.send({"say": "running", "period": clock.period, "unpaced": unpaced})
        try:
            loop.run(self.order.cycles)
            ring.finish()
        finally:
            for device in loop.actuators:
                device.stop(self._category(loop, device), 0)
            inbox.close()
        self.rundir.result.write_text(json.dumps(self._figures(loop)))

    def _catch_up(self) -> None:
        """Reads what came from the first device while the last was opened.

        A full buffer has lost the newest, and nothing tells how old a device's first sample is.
        """
        for _ in range(READS):
            for device in self.devices:
                if not isinstance(device.driver, Fake):
                    device.read(time.monotonic_ns())

    def _clock(self, graph: Graph) -> Clock:
        name, rate = graph.profile.clock, graph.profile.rate
        pace: Clock = MonotonicClock(rate)
        if name != "monotonic":
            robot = next((d for d in self.devices if d.driver.name == name), None)
            if robot is None:
                remedy = nearest(name, ["monotonic", *graph.profile.devices])
                raise ProfileError(graph.source.place("clock"), f"there is no device '{name}'", remedy)
            if name not in graph.simulated:
                pace = DeviceClock(rate, lambda: None if robot.lost else robot.driver.fileno())
        if graph.world is None:
            return pace
        if not self.order.fast:
            return SimClock(rate, graph.world, pace)
        return SimClock(rate, graph.world, None, self._throttle if self.order.recorded else None)

    def _throttle(self) -> None:
        """Simulation ahead of its recorder waits: nothing recorded is ever lost."""
        ring = self._ring
        while ring.head - ring.consumed > ring.capacity // 2:
            time.sleep(0.001)
            ring.touch(time.monotonic_ns())

    def _watch(self, loop: Loop, graph: Graph) -> None:
        """Keeps the supervisor able to stop the actuators, and systemd content."""
        slots = StopSlots(self.rundir.stops, len(loop.actuators), create=True)
        notifier = Notifier()

        def hand_over(device: Device) -> None:
            number = loop.actuators.index(device)
            fileno = device.driver.fileno()
            if fileno is not None:
                self.channel.send({"say": "actuator", "slot": number, "name": device.driver.name}, fileno)

        numbers = {d: i for i, d in enumerate(loop.actuators)}

        def lost(device: Device) -> None:
            slots.clear(numbers[device])
            self.channel.send({"say": "lost", "slot": numbers[device]})

        def after_write(device: Device) -> None:
            slots.write(numbers[device], device.driver.stop_frame(self._category(loop, device)))

        for device in loop.actuators:
            hand_over(device)
            device.on_loss, device.on_return = lost, hand_over

        loop.after_write = after_write
        said = State.STARTING

        def each_cycle(state: State) -> None:
            nonlocal said
            notifier.ping()
            if state is not said:
                cause = loop.cycle.machine.cause
                level = Level.INFO if cause in (Cause.NONE, Cause.END) else Level.WARNING
                why = f" ({cause.name.lower()} {loop.culprit()})".replace(" )", ")") if cause else ""
                self.note(f"{state.name.lower()}{why}", level)
                if said is State.STARTING:
                    notifier.ready()
                said = state

        loop.each_cycle = each_cycle

    def _category(self, loop: Loop, device: Device) -> Stop:
        """How the device stops without the loop: retracting needs the loop, so it holds."""
        own = next(a for a in loop.graph.actuators if loop.graph.devices[a.device] is device.driver)
        category = loop.cycle.category(own)
        return Stop.HOLD if category is Stop.RETRACT else category

    def _figures(self, loop: Loop) -> dict[str, Any]:
        graph = loop.graph
        figures: dict[str, Any] = {c.name: c.figures() for c in graph.controllers}
        figures |= {d.name: f for d in graph.devices if (f := d.figures())}
        figures["guard"] = {
            a.name: {"rejected": g.rejections, "limited": g.limitations, "fallback": g.fallbacks}
            for a, g in zip(graph.actuators, loop.cycle.guards, strict=True)
        }
        return {str(name): _finite(value) for name, value in figures.items()}


def _finite(value: Any) -> Any:
    """JSON knows no infinity: what has no figure becomes null."""
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


def main() -> int:
    """Entry of the process."""
    realtime.die_with_parent(signal.SIGTERM)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to the supervisor, which asks for the safe stop
    channel = Channel(socket.socket(fileno=int(sys.argv[2])))
    os.set_inheritable(channel.socket.fileno(), False)
    process = Process(RunDir(Path(sys.argv[1])), channel)
    try:
        process.run()
    except SrlError as error:
        kind = "device" if isinstance(error, DeviceError) else "other"
        channel.send(
            {"say": "failed", "kind": kind, "place": error.place, "problem": error.problem, "remedy": error.remedy}
        )
        return 2
    return 0


if __name__ == "__main__":
    code = main()
    sys.stderr.flush()
    # Garbage collection is frozen here: an orderly teardown would only complain about what it can't free.
    os._exit(code)
