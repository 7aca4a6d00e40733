"""A controller's dashboard: one answer line for each command line. Source: protocol sheet ur-rtde, section 4."""

from __future__ import annotations

from collections.abc import Callable

from srl.drivers.ur.dashboard import GREETING, Lines
from srl.drivers.ur.status import RobotMode, SafetyMode
from srl.sim.devices.shared.sockets import Client, TcpDoor
from srl.sim.devices.ur.controller import UrController


class DashboardServer:
    """The dashboard server; see the module's text.

    Attributes:
        polyscope: the answer to `PolyscopeVersion`.
        model, serial: the arm's model and serial number.
        remote: whether remote control was selected at the pendant.
        seen: commands received, in order; the newest hundred.
    """

    def __init__(self, door: TcpDoor, controller: UrController, model: str, refused: Callable[[str], None]) -> None:
        """`refused` is called with the name of each command that the twin knows and refuses."""
        self.door = door
        self.polyscope = "URSoftware 5.11.0.108249 (Apr 22 2021)"
        self.model, self.serial = model, "20195500001"
        self.remote = True
        self.seen: list[str] = []
        self._controller, self._refused = controller, refused
        self._lines: dict[Client, Lines] = {}
        self._answers: dict[str, Callable[[], str]] = {
            "polyscopeversion": lambda: self.polyscope,
            "get robot model": lambda: self.model,
            "get serial number": lambda: self.serial,
            "is in remote control": lambda: str(self.remote).lower(),
            "robotmode": lambda: f"Robotmode: {controller.robot_mode.name}",
            "safetymode": lambda: f"Safetymode: {self._safety()}",
            "safetystatus": lambda: f"Safetystatus: {self._safety()}",
            "running": lambda: f"Program running: {str(controller.program is not None).lower()}",
            "programstate": self._state,
            "get loaded program": lambda: "No program loaded",
            "isprogramsaved": lambda: "true",
            "power on": lambda: self._do(controller.power_on, "Powering on"),
            "power off": lambda: self._do(controller.power_off, "Powering off"),
            "brake release": self._brake_release,
            "stop": lambda: self._do(controller.end_program, "Stopped"),
            "play": lambda: self._refuse("play", "Failed to execute: play"),
            "pause": lambda: self._refuse("pause", "Failed to execute: pause"),
            "unlock protective stop": self._unlock,
            "close safety popup": lambda: "closing safety popup",
            "close popup": lambda: "closing popup",
            "restart safety": self._restart_safety,
            "quit": lambda: "Disconnected",
        }

    def serve(self) -> None:
        """Greets new clients and answers commands."""
        for client in self.door.accept():
            client.write(GREETING.encode() + b"\n", keep=True)
            self._lines[client] = Lines()
        for client, lines in list(self._lines.items()):
            for line in lines.feed(client.read()):
                if not line:
                    continue
                self.seen = [*self.seen[-99:], line]
                client.write(self.answer(line).encode() + b"\n", keep=True)
                if line.lower() == "quit":
                    client.close()
            if client.gone:
                del self._lines[client]

    def answer(self, line: str) -> str:
        """Returns the answer to one command."""
        command = line.lower()
        if command in self._answers:
            return self._answers[command]()
        for start, answer in (
            ("popup ", "showing popup"), ("addtolog ", "Added log message"), ("load ", "File not found: "),
        ):  # fmt: skip
            if command.startswith(start):
                if start == "load ":
                    self._refused("load")
                return answer + line[5:] if start == "load " else answer
        return f'could not understand: "{line}"'

    def _safety(self) -> str:
        mode = self._controller.safety_mode
        return SafetyMode(mode).name

    def _state(self) -> str:
        program = self._controller.program
        return f"PLAYING {program.name}" if program is not None else "STOPPED"

    def _do(self, action: Callable[[], None], answer: str) -> str:
        action()
        return answer

    def _refuse(self, command: str, answer: str) -> str:
        self._refused(command)
        return answer

    def _restart_safety(self) -> str:
        """It ends violations and faults, which this twin doesn't have; afterwards the arm is without power."""
        self._controller.power_off()
        return "Restarting safety"

    def _brake_release(self) -> str:
        if self._controller.robot_mode is RobotMode.POWER_OFF:
            self._controller.power_on()
        self._controller.brake_release()
        return "Brake releasing"

    def _unlock(self) -> str:
        if self._controller.unlock():
            return "Protective stop releasing"
        return "Cannot unlock protective stop until 5 seconds after occurrence. Always inspect cause first."
