"""The twin of a UR arm: RTDE, dashboard and script ports in front of the simulated controller."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from srl.drivers.ur.config import DASHBOARD, RTDE
from srl.drivers.ur.status import RuntimeState
from srl.sim.devices.shared.sockets import Client, SocketTwin, TcpDoor, UdpDoor
from srl.sim.devices.ur.fake import FakeUr
from srl.sim.devices.ur.twin_dashboard import DashboardServer
from srl.sim.devices.ur.twin_expressions import ScriptError
from srl.sim.devices.ur.twin_functions import Refusals
from srl.sim.devices.ur.twin_program_text import Programs, name_of
from srl.sim.devices.ur.twin_programs import UrScriptProgram
from srl.sim.devices.ur.twin_registers import Registers
from srl.sim.devices.ur.twin_rtde import RtdeServer

_CATCH_UP: Final = 50  # most samples sent at once
_SCRIPT_PORTS: Final = (30001, 30002, 30003)


class UrTwin(SocketTwin):
    """Sends sample k when it would reach a client of the fake, with the registers of its cycle.

    Attributes:
        rtde, dashboard: the servers, with their answers.
        registers: shared by clients and programs.
        programs: names of the programs that were started, the newest hundred.
        errors: why programs didn't start or ended early.
        texts: what programs said with textmsg and popup, the newest hundred.
        refusals: what programs and dashboard clients asked for in vain.
    """

    def __init__(self, fake: FakeUr) -> None:
        super().__init__(fake)
        options = fake.options
        self.arm = fake
        self.controller = fake.controller
        self._standard = options.standard_ports
        self._rtde, self._dashboard = TcpDoor(options.host, 8), TcpDoor(options.host, 8)
        self._scripts = [TcpDoor(options.host, 8) for _ in (_SCRIPT_PORTS if options.standard_ports else (0,))]
        self.registers = Registers(self.controller)
        self.rtde = RtdeServer(self._rtde, self.registers)
        self.refusals = Refusals()
        model = fake.config.model.removesuffix("e")
        self.dashboard = DashboardServer(self._dashboard, self.controller, model, self.refusals.note)
        self.programs: list[str] = []
        self.errors: list[str] = []
        self.texts: list[str] = []
        self._incoming: dict[Client, Programs] = {}
        self._running: UrScriptProgram | None = None
        self._sent = -1
        self._log: list[tuple[int, int]] = []
        fake.after_cycle = self._after_cycle

    def doors(self) -> list[TcpDoor | UdpDoor]:
        return [self._rtde, self._dashboard, *self._scripts]

    def open(self) -> None:
        if self._standard:
            ports = (RTDE, DASHBOARD, *_SCRIPT_PORTS)
            for door, port in zip((self._rtde, self._dashboard, *self._scripts), ports, strict=True):
                door.open(port)
            self.address = self.describe()
            self.opened()
        else:
            super().open()

    def describe(self) -> str:
        """The address, with the ports of dashboard and scripts if they aren't the usual ones."""
        plain = f"tcp://{self._rtde.host}"
        if self._standard:
            return plain
        return f"{plain}:{self._rtde.port}?dashboard={self._dashboard.port}&script={self._scripts[0].port}"

    def opened(self) -> None:
        self._sent = self.arm.newest()

    def work(self, now: int) -> None:
        self.rtde.receive()
        self.dashboard.serve()
        for door in self._scripts:
            self._incoming.update((client, Programs()) for client in door.accept())
        for client, programs in list(self._incoming.items()):
            for text in programs.feed(client.read()):
                self._load(text)
            if client.gone:
                del self._incoming[client]
        newest = self.arm.newest()
        for number in range(max(self._sent, newest - _CATCH_UP) + 1, newest + 1):
            values = self.arm.sample(number)
            if values is not None:
                self.rtde.send(number, values)
                if self.keep_log:
                    self._log.append((now, self.arm.taken_at(number)))
        self._sent = newest

    def metrics(self) -> dict[str, object]:
        """Adds to the socket twin's figures: messages by letter, clients disconnected, programs and their texts."""
        return super().metrics() | {
            "messages": dict(self.rtde.seen), "dropped": self.rtde.dropped, "programs": list(self.programs),
            "errors": list(self.errors), "texts": list(self.texts), "refused": dict(self.refusals.counts),
            "dashboard": list(self.dashboard.seen), "protective_stops": list(self.controller.stops),
        }  # fmt: skip

    def log(self) -> dict[str, NDArray[Any]]:
        """`sent_ns` (k,): when each sample was sent. `taken_ns` (k,): its world time."""
        sent, taken = np.array(self._log, np.int64).reshape(-1, 2).T
        return {"sent_ns": sent, "taken_ns": taken}

    def _load(self, text: str) -> None:
        if not self.dashboard.remote:
            self._note_error("a program was refused: the controller is in local control")
            return
        name = name_of(text)
        try:
            program = UrScriptProgram(text, self.controller, self.registers, self.refusals)
        except ScriptError as error:
            self._note_error(f"{name or 'line'}: {error}")
            return
        self._leave()
        if self.controller.run(program):
            self._running = program
            self.programs = [*self.programs[-99:], name]
        else:
            self._note_error(f"{name or 'line'}: the arm isn't ready ({self.controller.safety_mode.name})")

    def _after_cycle(self) -> None:
        if self._running is not None and self.controller.runtime_state is RuntimeState.STOPPED:
            self._leave()
        self.registers.remember()

    def _leave(self) -> None:
        """Called when the program has ended or is replaced by another."""
        program, self._running = self._running, None
        self.registers.forget_watchdogs()
        if program is None:
            return
        self.texts = [*self.texts, *program.texts][-100:]
        if program.error:
            self._note_error(f"{program.name}: {program.error}")

    def _note_error(self, words: str) -> None:
        self.errors = [*self.errors[-99:], words]
        self.rtde.remark(words, 1)
