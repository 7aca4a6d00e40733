"""A scripted FCI server: protocol 5 or 10, one client, no physics. Each millisecond of its time is asked for.

What it gets in a motion becomes its desired and its measured state at once; it checks nothing.
"""

from __future__ import annotations

import contextlib
import socket
import threading
from contextlib import AbstractContextManager

import numpy as np

from helpers.background import repeating
from srl.drivers.panda import packets
from srl.drivers.panda.packets import Controller, Generator, RobotMode
from srl.drivers.panda.protocol import Reply, Request, RequestParser, Status, connect_reply, encode_reply
from srl.drivers.panda.requests import AutomaticErrorRecovery, Body, Connect, Move, StopMove

HOME = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)


class Robot:
    """See the module's text.

    Attributes:
        state: the RobotState that the next tick sends; a test may change any field.
        commands: what arrived in motions, newest last.
        requests: bodies of all requests, Connect included.
        answers: status of the reply to a command, where it isn't SUCCESS.
        deaf: requests are taken but not replied to.
        shy: motions end without their second reply.
    """

    def __init__(self, version: int = 10, claims: int | None = None) -> None:
        """`claims`: the version it names to a client; as spoken if left out."""
        self.version, self.claims = version, claims or version
        self.state = packets.state_record(version)
        self.state["q"] = self.state["q_d"] = HOME
        self._q, self._dq = np.array(HOME), np.zeros(7)  # the state's own may be float32
        self.state["O_T_EE"] = np.eye(4).T.ravel()
        self.commands: list[np.ndarray] = []
        self.requests: list[Body] = []
        self.answers: dict[type[Body], Status] = {}
        self.deaf = self.shy = False
        self._lock = threading.RLock()
        self._door = socket.create_server(("127.0.0.1", 0))
        self._door.setblocking(False)
        self.address = f"tcp://127.0.0.1:{self._door.getsockname()[1]}"
        self._client: socket.socket | None = None
        self._udp: socket.socket | None = None
        self._move: int | None = None
        self.idle()

    def idle(self) -> None:
        """The modes between motions."""
        self.state["motion_generator_mode"], self.state["controller_mode"] = Generator.IDLE, Controller.OTHER
        self.state["robot_mode"], self.state["control_command_success_rate"] = RobotMode.IDLE, 0.0

    @property
    def moving(self) -> bool:
        """A motion runs."""
        return self._move is not None

    def serve(self) -> None:
        """Takes and answers requests; takes commands."""
        with self._lock:
            with contextlib.suppress(OSError):
                self._accept()
            self._take_requests()
            self._take_commands()

    def tick(self, count: int = 1) -> None:
        """Milliseconds of the robot's time, each with its state."""
        with self._lock:
            for _ in range(count):
                self.serve()
                self.state["message_id"] += 1
                if self._udp is not None:
                    with contextlib.suppress(OSError):
                        self._udp.send(self.state.tobytes())

    def running(self) -> AbstractContextManager[None]:
        """Ticks by itself for as long, some 1000 times a second."""
        return repeating(self.tick, 0.001)

    def abort(self, *errors: str, status: Status = Status.REFLEX_ABORTED, mode: RobotMode = RobotMode.REFLEX) -> None:
        """Ends the motion as a reflex does."""
        with self._lock:
            self.idle()
            self.state["robot_mode"] = mode
            self.state["errors"] = self.state["reflex_reason"] = packets.error_bits(errors)
            self._end(status)

    def hang_up(self) -> None:
        """Ends the session."""
        with self._lock:
            for end in (self._client, self._udp):
                if end is not None:
                    end.close()
            self._client = self._udp = None
            if self._move is not None:
                self._move = None
                self.idle()

    def close(self) -> None:
        self.hang_up()
        self._door.close()

    def _accept(self) -> None:
        client, _ = self._door.accept()
        self.hang_up()
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client, self._parser = client, RequestParser(self.version)

    def _take_requests(self) -> None:
        if self._client is None:
            return
        try:
            data = self._client.recv(65536)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self.hang_up()
            return
        for request in self._parser.feed(data):
            self.requests.append(request.body)
            if not self.deaf:
                self._handle(request)

    def _handle(self, request: Request) -> None:
        body = request.body
        assert self._client is not None
        if isinstance(body, Connect):
            accepted = body.version == self.claims
            data = bytearray(connect_reply(self.version, request.number, accepted))
            data[13:15] = self.claims.to_bytes(2, "little")
            self._client.sendall(data)
            if not accepted:
                self.hang_up()
                return
            self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._udp.bind(("127.0.0.1", 0))
            self._udp.connect(("127.0.0.1", body.port))
            self._udp.setblocking(False)
            return
        status = self.answers.get(type(body), Status.SUCCESS)
        if isinstance(body, Move) and status is Status.SUCCESS:
            status, self._move = Status.MOTION_STARTED, request.number
            self.state["motion_generator_mode"], self.state["controller_mode"] = body.generator + 1, body.controller
            self.state["robot_mode"], self.state["reflex_reason"] = RobotMode.MOVE, False
            self.state["control_command_success_rate"] = 1.0
        self._say(type(body), request.number, status)
        if isinstance(body, StopMove):
            self.idle()
            self._end(Status.PREEMPTED)
        if isinstance(body, AutomaticErrorRecovery) and status is Status.SUCCESS:
            self.state["errors"] = False
            self.idle()

    def _say(self, command: type[Body], number: int, status: Status) -> None:
        if self._client is not None:
            self._client.sendall(encode_reply(self.version, Reply(command, number, status)))

    def _end(self, status: Status) -> None:
        number, self._move = self._move, None
        if number is not None and not self.shy:
            self._say(Move, number, status)

    def _take_commands(self) -> None:
        while self._udp is not None:
            try:
                data = self._udp.recv(65536)
            except OSError:
                return
            command = packets.decode_command(self.version, data)
            assert command is not None, f"{len(data)} bytes"
            self.commands.append(command)
            if self.moving:
                self._obey(command)

    def _obey(self, command: np.ndarray) -> None:
        state, dt = self.state, 1e-3
        if state["controller_mode"] == Controller.EXTERNAL:
            state["tau_J_d"] = state["tau_J"] = command["tau_J_d"]
        elif state["motion_generator_mode"] == Generator.JOINT_VELOCITY:
            self._move_to(self._q + command["dq_c"] * dt, command["dq_c"])
        else:
            self._move_to(command["q_c"], (command["q_c"] - self._q) / dt)
        torque_alone = state["motion_generator_mode"] == Generator.NONE
        finished = command["torque_command_finished"] if torque_alone else command["motion_generation_finished"]
        if finished:
            self.idle()
            self._end(Status.SUCCESS)

    def _move_to(self, q: np.ndarray, dq: np.ndarray) -> None:
        self.state["ddq_d"] = (dq - self._dq) / 1e-3
        self.state["dq_d"] = self.state["dq"] = self._dq = dq
        self.state["q_d"] = self.state["q"] = self._q = q
