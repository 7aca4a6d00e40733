"""A simulated Franka robot's answers on its command channel: one client's session. No sockets.

Source: protocol sheet franka-fci, sections 3 and 5.
"""

from __future__ import annotations

import struct
from collections import Counter
from typing import Final

from srl.drivers.panda.packets import RobotMode
from srl.drivers.panda.protocol import Reply, Request, RequestParser, Status, connect_reply, encode_reply, statuses
from srl.drivers.panda.requests import (
    AutomaticErrorRecovery,
    Connect,
    GetCartesianLimit,
    GetRobotModel,
    LoadModelLibrary,
    Move,
    StopMove,
)
from srl.sim.devices.panda.robot import PandaRobot
from srl.sim.devices.panda.twin_library import Build
from srl.sim.devices.panda.twin_urdf import urdf

_X64_LINUX: Final = (0, 0)
_LIMIT: Final = struct.Struct("<3d16d?")  # extents, pose, active
_IDENTITY: Final = (1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1)


class Session:
    """Answers one client's requests.

    Attributes:
        udp_port: the port to which states are sent; None before Connect.
        refused: the client uses another version; it must be disconnected once its answer is sent.
    """

    def __init__(self, robot: PandaRobot, seen: Counter[str]) -> None:
        """`seen`: counter of requests by kind."""
        self.udp_port: int | None = None
        self.refused = False
        self._seen, self._robot, self._version = seen, robot, robot.version
        self._parser = RequestParser(robot.version)
        self._move: Request | None = None  # in progress; its second answer is still due
        self._recovery: Request | None = None
        self._build: tuple[Request, Build] | None = None

    def receive(self, data: bytes) -> bytes:
        """Carries out the requests and returns the answers."""
        return b"".join(self._answer(request) for request in self._parser.feed(data))

    def due(self) -> bytes:
        """Returns answers that have become due: a motion has ended, recovery is over, or the model library is built."""
        answers, controller = b"", self._robot.controller
        if self._move is not None and (outcome := controller.take_outcome()) is not None:
            answers += self._reply(self._move, outcome)
            self._move = None
        if self._recovery is not None and controller.mode is not RobotMode.AUTOMATIC_ERROR_RECOVERY:
            stopped = controller.mode is RobotMode.USER_STOPPED
            answers += self._reply(self._recovery, Status.EMERGENCY_ABORTED if stopped else Status.SUCCESS)
            self._recovery = None
        if self._build is not None and self._build[1].poll():
            request, build = self._build
            answers += self._reply(
                request, Status.SUCCESS if build.shared_object else Status.ERROR, build.shared_object or b""
            )
            self._build = None
        return answers

    def close(self) -> None:
        """Called when the client has disconnected."""
        if self._build is not None:
            self._build[1].close()
            self._build = None

    def _answer(self, request: Request) -> bytes:
        body, controller = request.body, self._robot.controller
        self._seen[type(body).__name__] += 1
        if isinstance(body, Connect):
            return self._connect(request, body)
        if self.udp_port is None:
            return b""  # a client must connect first
        match body:
            case Move():
                status = controller.move(body)
                if status is Status.MOTION_STARTED:
                    self._move = request
                    self._robot.forget()
                return self._reply(request, status)
            case StopMove():
                return self._reply(request, controller.stop_move()) + self.due()
            case AutomaticErrorRecovery():
                refusal = controller.recover() if self._recovery is None else Status.NOT_POSSIBLE
                if refusal is not None:
                    return self._reply(request, refusal)
                self._recovery = request
                return b""
            case GetCartesianLimit(number):
                if not 0 <= number < 8:
                    return self._reply(request, Status.INVALID_ARGUMENT)
                return self._reply(request, Status.SUCCESS, _LIMIT.pack(0.0, 0.0, 0.0, *_IDENTITY, False))
            case LoadModelLibrary(architecture, system):
                if (architecture, system) != _X64_LINUX or self._build is not None:
                    return self._reply(request, Status.ERROR)
                self._build = request, Build()
                return self.due()
            case GetRobotModel():
                return self._reply(request, Status.SUCCESS, urdf(self._robot.model).encode())
        return self._reply(request, controller.apply(body))

    def _connect(self, request: Request, body: Connect) -> bytes:
        accepted = body.version == self._version
        self.refused = not accepted
        if accepted:
            self.udp_port = body.port
        return connect_reply(self._version, request.number, accepted)

    def _reply(self, request: Request, status: Status, data: bytes = b"") -> bytes:
        command = type(request.body)
        assert status in statuses(self._version, command), f"{command.__name__} can't be answered by {status}"
        return encode_reply(self._version, Reply(command, request.number, status, data))
