"""What a cycle costs as a profile grows: 1 to 8 limbs of two servos each, and one limb of 1 to 12 servos.

The profiles are the shipped `servo-jog`, its limb repeated or longer, and each limb going between two postures
by itself. Drivers, checks, laws, guards and rows are the loop's; each limb's bus is a pty with the twin's servos behind
it. Twins and world go on between the cycles, and aren't in the figures: those are the processor time of the loop's
thread, by phase, medians of cycles in which all sizes take turns.
"""

from __future__ import annotations

import gc
import json
import select
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final

import numpy as np

from bench.pairs import Row, interval, measure
from srl.runtime.contracts import registry
from srl.runtime.contracts.world import Twin, World
from srl.runtime.ipc.header import CYCLE, DEVICE, State
from srl.runtime.ipc.ring import RingWriter
from srl.runtime.loop.cycle import Cycle
from srl.runtime.loop.device import Device
from srl.runtime.loop.guards import limits_of
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.graph import Graph

SHIPPED: Final = "servo-jog"
LIMBS: Final = (1, 2, 4, 8)  # in one profile
SERVOS: Final = (1, 2, 4, 8, 12)  # on one board
EACH: Final = 2  # servos of a limb where limbs are counted
PHASES: Final = ("read", "control", "guard", "write", "log", "whole")
BLOCK: Final = 30  # cycles of one measurement; in nine of ten each limb must be told its angles
_LONGEST: Final = 2000  # cycles until all must have moved
_AWAY: Final = 0.1  # rad from where it began: it moves
_TIMEOUT: Final = 20  # ms, for what a pty hands on: some cycles have nothing


def run() -> list[Row]:
    """Returns rows of the whole cycle by size, and of each phase's slope."""
    with ExitStack() as ends:
        growing = {
            "limb": {count: ends.enter_context(_system(count, EACH)) for count in LIMBS},
            "servo": {count: ends.enter_context(_system(1, count)) for count in SERVOS},
        }
        gc.collect()
        gc.freeze()  # as in the loop
        gc.disable()
        return [row for what, systems in growing.items() for row in _grown(what, systems)]


def text(limbs: int, servos: int, ports: Sequence[str] = ()) -> str:
    """Returns the profile of so many limbs with so many servos each, as YAML.

    `ports`: of the buses; none where all is simulated.
    """
    given, _ = profile.tree(*profile.find(SHIPPED)[:2])
    limb = given["devices"]["finger"]
    motor = next(iter(limb["motors"].values()))
    joints = [f"j{k}" for k in range(1, servos + 1)]
    names = [f"limb{k}" for k in range(1, limbs + 1)]
    bus = {key: value for key, value in limb.items() if key not in ("port", "motors", "robot")}
    bus["motors"] = {joint: motor | {"id": k} for k, joint in enumerate(joints, 1)}
    axis = {"model": motor["model"], "link": [0.02, 0, 0], "mass": 0.02}  # m, kg: twelve of them are no burden
    # All is near, so each half second it turns back, before it would be there: the limb is always on its way.
    postures = [dict.fromkeys(joints, angle) for angle in (-0.5, 0.5)]  # rad
    made = given | {
        "name": "growth",
        "devices": {n: bus | {"port": port} for n, port in zip(names, ports or ["/dev/null"] * limbs, strict=True)},
        "setpoints": {},
        "controllers": [
            {
                "use": "posture-cycle", "name": f"{name}-motion", "postures": postures, "near": 6.0, "rest": 0.5,
                "in": {"position": f"{name}.position"},
                "out": {"q": f"{name}.position_command", "q_velocity": f"{name}.position_command.velocity"},
            }
            for name in names
        ],
        "guard": {f"{name}.position_command": given["guard"]["finger.position_command"] for name in names},
        "stop": dict.fromkeys(names, given["stop"]["finger"]),
        "frames": {"world": {}},
        "sim": {
            "world": "cell",
            "gravity": [0, 0, 0],
            "timestep": 0.002,
            "parts": {
                name: {
                    "part": "dynamixel-chain",
                    "at": {"parent": "world", "position": [0, k, 0]},  # m: out of each other's reach
                    "axes": dict.fromkeys(joints, axis),
                }
                for k, name in enumerate(names)
            },
        },
    }  # fmt: skip
    return json.dumps(made)


class _System:
    """A profile in this thread: its drivers at ptys, the twins behind them, and the loop's cycle."""

    def __init__(self, graph: Graph, world: World, twins: list[Twin], ring: RingWriter) -> None:
        self._graph, self._world, self._twins, self._ring = graph, world, twins, ring
        self.devices = [
            Device(d, graph.row.devices[i], graph.actuators_of(i), self._say) for i, d in enumerate(graph.devices)
        ]
        self._cycle = Cycle(graph, limits_of(graph), automatic=True, report=self._say)
        self._period = round(1e9 / graph.profile.rate)
        self._messages: list[str] = []
        self._count, self._behind = 0, 0
        self._there: list[select.poll] = []
        self._here: list[select.poll] = []

    def _say(self, text: str) -> None:
        self._messages.append(text)

    def begin(self) -> None:
        """Opens the drivers and goes on until all servos have moved."""
        with self._served():
            for device in self.devices:
                device.driver.open()
        self._there = [_waiting(twin.door._fd) for twin in self._twins]  # type: ignore[attr-defined]
        self._here = [_waiting(device.driver.fileno()) for device in self.devices]
        self._behind = time.monotonic_ns() - self._world.time  # from here on all clocks go by the world's steps
        for _ in range(_LONGEST):
            self.step()
            if all(np.abs(device.driver.state_arrays["position"]).min() > _AWAY for device in self.devices):
                return
        raise RuntimeError(f"not all of {len(self.devices)} limbs move after {_LONGEST} cycles: {self._messages[-3:]}")

    @contextmanager
    def _served(self) -> Iterator[None]:
        """Meanwhile the twins answer in a thread: opening waits for them."""
        done = threading.Event()

        def serve() -> None:
            while not done.wait(2e-4):
                self._world.advance(self._world.time + 1_000_000)
                for twin in self._twins:
                    twin.service(time.monotonic_ns())

        server = threading.Thread(target=serve)
        server.start()
        try:
            yield
        finally:
            done.set()
            server.join()

    @property
    def commanded(self) -> int:
        """How many commands each limb was sent, at least; none may have been lost or stopped."""
        if self._cycle.machine.state is not State.ACTIVE:
            raise RuntimeError(f"{len(self.devices)} limbs have stopped: {self._messages[-3:]}")
        return min(device.header.item(DEVICE.commands) for device in self.devices)

    def step(self) -> list[int]:
        """One cycle; returns the ns of each of PHASES."""
        self._count += 1
        started = self._behind + self._world.time
        self._world.advance(self._world.time + self._period)
        for moment in (started + self._period // 10, started + self._period):  # asked, and once all have answered
            for twin, there in zip(self._twins, self._there, strict=True):
                there.poll(_TIMEOUT * (moment < started + self._period))
                twin.service(moment)
        for here in self._here:
            here.poll(_TIMEOUT)
        now, ints, cycle, clock = started + self._period, self._graph.row.ints, self._cycle, time.thread_time_ns
        ints[CYCLE.cycle], ints[CYCLE.now], ints[CYCLE.dt] = self._count, now, self._period
        start = clock()
        for device in self.devices:
            device.read(now)
        read = clock()
        cycle.check(0)
        cycle.control()
        controlled = clock()
        cycle.guard()
        guarded = clock()
        for device in self.devices:
            if device.active:
                device.write(now)
        for device in self.devices:
            device.publish(now)
        written = clock()
        self._ring.append(self._graph.row.words)
        logged = clock()
        return [*np.diff([start, read, controlled, guarded, written, logged]).tolist(), logged - start]


def _waiting(descriptor: int | None) -> select.poll:
    assert descriptor is not None
    waiting = select.poll()
    waiting.register(descriptor, select.POLLIN)
    return waiting


@contextmanager
def _system(limbs: int, servos: int) -> Iterator[_System]:
    """Opens twins and drivers of so many limbs, once they move."""
    simulated = wiring.build(*profile.parse("growth", text(limbs, servos)), [])
    assert simulated.world is not None
    twins: list[Twin] = [registry.load("twins", "dynamixel", "growth")(fake) for fake in simulated.devices]
    with ExitStack() as ends:
        ends.callback(simulated.world.close)
        for twin in twins:
            twin.open()
            ends.callback(twin.close)
        graph = wiring.build(*profile.parse("growth", text(limbs, servos, [twin.address for twin in twins])))
        folder = Path(ends.enter_context(tempfile.TemporaryDirectory(prefix="srl-bench-")))
        system = _System(graph, simulated.world, twins, RingWriter.create(folder / "rows", graph.layout.width, 4096))
        for device in system.devices:
            ends.callback(device.close)
        system.begin()
        yield system


def _grown(what: str, systems: dict[int, _System]) -> list[Row]:
    """Returns the rows of these systems, which are there by their number of limbs or servos; the first has one."""
    one, sizes = f"one {what}", list(systems)
    first: dict[str, float] = {}  # the figures of one limb or servo, from the newest pass

    def grown() -> dict[str, float]:
        found = _block(systems)
        slopes = {p: float(np.polyfit(sizes, [found[size][p] for size in sizes], 1)[0]) for p in PHASES}
        first.update(found[1] | {str(size): found[1]["whole"] for size in sizes})
        return slopes | {str(size): found[size]["whole"] for size in sizes}

    pairs = measure(grown, {one: lambda: dict(first)})
    cycle = "a cycle of {} {}s, processor time, p50"
    rows = [pairs.row("growth", cycle.format(size, what), str(size), one, "us") for size in sizes[1:]]
    for phase in PHASES:
        low, high = interval([found[phase] for found in pairs.first])
        title = f"{phase}, each {what} more up to {sizes[-1]}, least squares ({low:.1f} to {high:.1f} us)"
        rows.append(pairs.row("growth", title, phase, one, "us"))
    return rows


def _block(systems: dict[int, _System]) -> dict[int, dict[str, float]]:
    """Returns the us of each phase by size, medians of some cycles; all sizes take turns, cycle by cycle."""
    took: dict[int, list[list[int]]] = {size: [] for size in systems}
    before = {size: system.commanded for size, system in systems.items()}
    for _ in range(BLOCK):
        for size, system in systems.items():
            took[size].append(system.step())
    for size, system in systems.items():
        if (commanded := system.commanded - before[size]) < 0.9 * BLOCK:
            raise RuntimeError(f"a limb got a command in {commanded} of {BLOCK} cycles only")
    medians = {size: (np.median(cycles, axis=0) / 1e3).tolist() for size, cycles in took.items()}
    return {size: dict(zip(PHASES, median, strict=True)) for size, median in medians.items()}
