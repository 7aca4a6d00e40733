"""A stand-in for the loop's process: a process that only sleeps, and its end of the channel in the test's hand."""

from __future__ import annotations

import os
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from helpers.recording import make_layout
from srl.runtime.ipc.channel import Channel
from srl.runtime.ipc.events import EventWriter
from srl.runtime.ipc.header import CYCLE, State
from srl.runtime.ipc.launch import Launch
from srl.runtime.ipc.ring import RingWriter
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.ipc.stop_slots import StopSlots
from srl.runtime.service import supervisor as service


class _Sleeper(subprocess.Popen[bytes]):
    """Tells when it is waited for."""

    before_wait: Callable[[], None] = staticmethod(lambda: None)

    def wait(self, timeout: float | None = None) -> int:
        self.before_wait()
        return super().wait(timeout)


class LoopDouble:
    """A supervisor in the test's own process, and what it takes for its loop.

    Attributes:
        supervisor: started.
        process: what it supervises.
        output: the lines it reported.
    """

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def spawn(command: list[str], run_folder: RunFolder, end: int) -> subprocess.Popen[bytes]:
            self.channel = Channel(socket.socket(fileno=os.dup(end)))
            self.process = _Sleeper(["sleep", "1000"])
            return self.process

        monkeypatch.setattr(service, "spawn", spawn)
        self.output: list[str] = []
        run_folder = self.run_folder = RunFolder(folder / "run")
        run_folder.path.mkdir()
        self.state = folder / "state"
        launch = Launch("made-up", "name: made-up\n")
        self.supervisor = service.Supervisor(run_folder, launch, self.state, [], self.output.append)
        self.supervisor.start()
        self.slots = StopSlots(run_folder.stops)

    def hand_over(self, slot: int, descriptor: int, frame: bytes) -> None:
        """As the loop does when an actuator is open, and after its first command."""
        self.channel.send({"say": "actuator", "slot": slot, "name": f"servo {slot}"}, descriptor)
        assert self.supervisor.step()
        self.slots.write(slot, (frame,))

    def run(
        self, rows: int = 3, period: int = 1_000_000, unpaced: bool = True, moves: bool = True,
        state: State = State.ACTIVE,
    ) -> None:  # fmt: skip
        """Makes the run's files, and says that the loop runs. `period`: ns; `moves`: it commands something."""
        layout = make_layout()
        if moves and not any(field.role == "sent" for field in layout.fields.values()):
            layout.add("finger.position_command.sent", "sent", (1,), "rad")
        layout.save(self.run_folder.layout)
        EventWriter(self.run_folder.events).close()
        self.ring = RingWriter.create(self.run_folder.rows, layout.width, 16)
        for k in range(rows):
            row = self.ring.rows[k, 1:-1]
            row[CYCLE.state] = state
            self.ring.append(row)
        self.ring.touch(time.monotonic_ns())
        self.say_running(period, unpaced)

    def say_running(self, period: int = 1_000_000, unpaced: bool = True) -> None:
        """The message alone."""
        self.channel.send({"say": "running", "period": period, "unpaced": unpaced})

    def close(self) -> None:
        """Ends what is left."""
        self.process.kill()
        self.process.wait()
        self.channel.socket.close()
        self.supervisor.finish()
