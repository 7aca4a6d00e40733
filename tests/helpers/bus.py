"""A run without devices: a layout, a ring with rows at a rate, and a loop that takes the ring's requests.

`python -m helpers.bus RUN_FOLDER RATE [JOINTS]` runs one until it is killed, to look at and to measure with.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from helpers.wait import until
from srl.runtime.bus.client import Client, connect
from srl.runtime.contracts.errors import RequestError
from srl.runtime.ipc.events import EventWriter, Level
from srl.runtime.ipc.header import CYCLE, DEVICE, LINK_ACTIVE, LINK_CONNECTED, Cause, Latch, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.requests import Answer, RequestKind, RequestReader, RequestWriter, permitted
from srl.runtime.ipc.ring import RingWriter
from srl.runtime.ipc.row import Row
from srl.runtime.ipc.run_folder import RunFolder

JOINTS = ("thumb", "index-1", "index-2")
FINGERS = ("thumb", "index", "middle", "ring", "little")


def layout(name: str, rate: int, **bus: Any) -> Layout:
    """Glove, finger, one of each kind of signal, one parameter, one setpoint."""
    made = Layout(["glove", "finger", "client"])
    made.add("glove.position", "state", (3,), "rad", labels=JOINTS)
    made.add("glove.wrench", "state", (6,), "N", frame="wrist")
    made.add("glove.pose", "state", (7,), "m", frame="world")
    made.add("glove.twist", "state", (6,), "m/s", frame="world")
    named = {"labels": FINGERS, "components": (("x", "y", "z"),)}
    made.add("hand.tips", "internal", (5, 3), "m", frame="palm", visual="points", **named)
    made.add("finger.position_command", "command", (2,), "rad")
    made.add("finger.position_command.applied", "applied", (2,), "rad")
    made.add("finger.position_command.sent", "sent", (2,), "rad")
    made.add("object-mapping.pull", "parameter", (), "N")
    made.add("client.force", "setpoint", (3,), "N")
    made.meta = {
        "name": name,
        "rate": [rate, 1],
        "wall": time.time_ns() - time.monotonic_ns(),
        "devices": {"glove": {"driver": "cyberglove"}, "finger": {"driver": "firmata"}},
        "controllers": [{"name": "object-mapping", "use": "object-mapping"}],
        "emergency": ["panel.buttons[0]"],
        "parameters": [
            {
                "name": "object-mapping.pull",
                "lower": 0.0,
                "upper": 5.0,
                "unit": "N",
                "text": "pull",
                "default": 1.0,
            }
        ],
        "setpoints": [{"name": "client.force", "max_age": 0.5}],
        "bus": {"decimate": 10} | bus,
    }
    return made


class Run(threading.Thread):
    """The loop's outside: rows, and requests answered as the machine does.

    Attributes:
        setpoints: what was taken, with its expiry.
        fault: a fault that is present, so that a reset is refused.
        latches, refused: words of the rows.
        paused: no rows and no sign of life, as a dead loop.
        started: requests that set in motion, by kind.
    """

    def __init__(self, run_folder: RunFolder, rate: int, **bus: Any) -> None:
        super().__init__(daemon=True)
        run_folder.path.mkdir(parents=True, exist_ok=True)
        self.run_folder, self.rate = run_folder, rate
        self.layout = layout(run_folder.path.name, rate, **bus)
        self.layout.save(run_folder.layout)
        self.ring = RingWriter.create(run_folder.rows, self.layout.width, 4096)
        RequestWriter.create(run_folder.requests)
        self.requests = RequestReader(run_folder.requests)
        self.events = EventWriter(run_folder.events)
        self.row = Row(self.layout)
        self.state, self.cause, self.fault_source = State.READY, Cause.NONE, -1
        self.fault = False
        self.latches, self.refused = Latch(0), 0
        self.paused = threading.Event()
        self.setpoints: list[tuple[int, np.ndarray]] = []
        self.taken: list[RequestKind] = []
        self.ending = threading.Event()
        self.row.views["object-mapping.pull"][()] = 1.0
        self.events.write(time.monotonic_ns(), Level.INFO, 0, "ready")

    def run(self) -> None:
        start, cycle, waiting = time.monotonic_ns(), 0, []
        words, views = self.row.ints, self.row.views
        client, *others = (self.row.devices[self.layout.devices.index(d)] for d in ("client", "glove", "finger"))
        client[DEVICE.stamp] = -1
        while not self.ending.is_set():
            if self.paused.is_set():
                time.sleep(0.01)
                continue
            wake = time.monotonic_ns()
            cycle += 1
            words[CYCLE.cycle], words[CYCLE.now], words[CYCLE.wake] = cycle, wake, wake
            for i, phase in enumerate(("read", "control", "guard", "write")):
                words[getattr(CYCLE, phase)] = wake + (i + 1) * 20_000
            words[CYCLE.log] = 3_000
            for request in self.requests.take():
                if request.kind is RequestKind.SETPOINT:
                    self.setpoints.append((request.expires, request.values.copy()))
                    views["client.force"][:] = request.values
                    client[DEVICE.stamp] = wake
                    client[DEVICE.frames] += 1
                else:
                    waiting.append(request)
            words[CYCLE.request] = words[CYCLE.request_origin] = 0
            if waiting:
                request = waiting.pop(0)
                self.taken.append(request.kind)
                if permitted(request.origin, request.kind):
                    answer = self._answer(request.kind, request.values)
                else:
                    answer, self.refused = Answer.REFUSED_ROLE, self.refused + 1
                words[CYCLE.request : CYCLE.request_result + 1] = (
                    request.id,
                    request.kind,
                    request.target,
                    answer,
                )
                words[CYCLE.request_origin] = request.origin
            words[CYCLE.state], words[CYCLE.cause], words[CYCLE.fault_source] = (
                self.state,
                self.cause,
                self.fault_source,
            )
            words[CYCLE.latches], words[CYCLE.refused] = self.latches, self.refused
            client[DEVICE.link] = LINK_CONNECTED
            for device, active in zip(others, (0, LINK_ACTIVE), strict=True):
                device[DEVICE.stamp], device[DEVICE.link] = wake - 2_000_000, LINK_CONNECTED | active
                device[DEVICE.frames] = cycle
            views["glove.position"][:] = 0.1, 0.2, math.sin(cycle / self.rate)
            views["glove.wrench"][:] = 1, 2, 3, 4, 5, 6
            views["glove.pose"][:] = 1, 2, 3, 0.5, -0.5, 0.5, -0.5
            views["hand.tips"][:] = np.arange(15).reshape(5, 3)
            views["finger.position_command"][:] = math.sin(cycle / self.rate), 2.0
            views["finger.position_command.applied"][:] = views["finger.position_command"] / 2
            views["finger.position_command.sent"][:] = views["finger.position_command.applied"]
            self.ring.append(self.row.words)
            self.ring.touch(time.monotonic_ns())
            rest = start + cycle * 1_000_000_000 // self.rate - time.monotonic_ns()
            if rest > 0:
                time.sleep(rest / 1e9)

    def _answer(self, kind: RequestKind, values: np.ndarray) -> Answer:
        if kind is RequestKind.STOP:
            self.state, self.cause = State.STOPPED, Cause.REQUEST
            return Answer.DONE
        if kind is RequestKind.PARAMETER:
            self.row.views["object-mapping.pull"][()] = values[0]
            return Answer.DONE
        if self.state is not (State.READY if kind is RequestKind.START else State.STOPPED):
            return Answer.REFUSED_STATE
        if self.fault:
            self.cause, self.fault_source = Cause.DEVICE_LOSS, 1
            return Answer.REFUSED_FAULT
        self.state, self.cause, self.fault_source = State.ACTIVE, Cause.NONE, -1
        return Answer.DONE

    def end(self) -> None:
        self.ending.set()
        self.join()
        self.ring.finish()


def spawn(run_folder: RunFolder, **options: Any) -> subprocess.Popen[bytes]:
    """The bus process, as the supervisor starts it."""
    return subprocess.Popen([sys.executable, "-m", "srl.runtime.bus", str(run_folder.path)], **options)


def reach(run_folder: RunFolder) -> Client:
    """A client, once the bus is there."""
    output = ""

    def client() -> Client | None:
        nonlocal output
        try:
            return connect(run_folder, timeout=1.5)
        except RequestError as error:
            output = str(error)
            return None

    found = until(client, what=lambda: f"the bus; {output}", pause=0.01)
    assert found is not None
    return found


class Instance:
    """A run, its bus process and a client."""

    def __init__(self, path: Path, rate: int = 200, **bus: Any) -> None:
        self.run_folder = RunFolder(path)
        self.run = Run(self.run_folder, rate, **bus)
        self.run.start()
        self.process = spawn(self.run_folder, stderr=subprocess.PIPE)
        self.client = reach(self.run_folder)

    def close(self) -> None:
        self.client.close()
        self.run.end()
        if self.process.poll() is None:
            self.process.wait(10)
        assert self.process.stderr is not None
        self.process.stderr.close()


def sockets(pid: int) -> set[str]:
    """What a process listens on, by the kernel's own tables."""
    links = [os.readlink(path) for path in Path(f"/proc/{pid}/fd").iterdir() if path.is_symlink()]
    own = {link[8:-1] for link in links if link.startswith("socket:")}
    found = set()
    for table in ("tcp", "tcp6", "udp", "udp6"):
        for line in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]:
            words = line.split()
            if words[9] in own and (words[3] == "0A" or table.startswith("udp")):
                found.add(f"{table} {words[1]}")
    for line in Path(f"/proc/{pid}/net/unix").read_text().splitlines()[1:]:
        words = line.split()
        if words[6] in own and int(words[3], 16) & 0x10000:  # SO_ACCEPTCON: it listens
            found.add(f"unix {words[7]}")
    return found


if __name__ == "__main__":
    Run(RunFolder(Path(sys.argv[1])), int(sys.argv[2])).run()
