"""The Panda driver's cost per millisecond: read, rate limits and write, over real sockets.

It is compared with the kernel alone: the same datagrams received and sent, with nothing computed in between.
"""

from __future__ import annotations

import select
import socket
import threading
import time
from dataclasses import replace

import numpy as np

from bench.pairs import PAIRS, Row, measure
from srl.drivers.panda import Panda, packets
from srl.drivers.panda.config import PandaConfig
from srl.drivers.panda.packets import RobotMode
from srl.drivers.panda.protocol import Reply, RequestParser, Status, connect_reply, encode_reply
from srl.drivers.panda.requests import Connect, Move

CYCLES = 1000
AIM = 100.0  # us, of a cycle of 1000 us


def run() -> list[Row]:
    """Measures both required interfaces, each with the larger of the two protocols' states."""
    rows = []
    for version, interface in ((5, "torque"), (10, "velocity")):
        with _Robot(version, interface) as robot:
            pairs = measure(robot.driver_cycles, {"kernel alone": robot.kernel_cycles}, PAIRS)
        for figure in ("p50", "p90"):
            row = pairs.row("panda-cycle", f"{interface}, protocol {version}, {figure}", figure, "kernel alone", "us")
            rows.append(replace(row, aim=f"under {AIM:g} us", holds=row.ours < AIM))
    return rows


class _Robot:
    """A robot that answers every request, and the driver in a running motion with it."""

    def __init__(self, version: int, interface: str) -> None:
        self._version = version
        self._state = packets.state_record(version)
        self._state["q"] = self._state["q_d"] = 0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785
        self._state["O_T_EE"] = np.eye(4).ravel()
        self._state["robot_mode"] = RobotMode.IDLE
        self._state["controller_mode"] = 3
        self._door = socket.create_server(("127.0.0.1", 0))
        port = f"tcp://127.0.0.1:{self._door.getsockname()[1]}"
        self._driver = Panda("arm", PandaConfig.model_validate({"port": port, "interface": interface}))
        (command,) = self._driver.commands
        self._command = np.full(7, 0.1)
        self._driver.bind({s.name: np.zeros(s.shape) for s in self._driver.states}, {command.name: self._command})
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._over = threading.Event()
        self._lock = threading.Lock()

    def __enter__(self) -> _Robot:
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()
        self._driver.open()
        while not self._driver.metrics()["moves"]:
            self._tick()
            self._driver.read(time.monotonic_ns())
            self._driver.write(time.monotonic_ns())
            time.sleep(0.001)
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self._driver.close()
        for end in (self._door, self._udp):
            end.close()

    def driver_cycles(self) -> dict[str, float]:
        """Returns the us of one read and write of the driver, with one state to read."""
        took = []
        for _ in range(CYCLES):
            self._tick()
            start = time.perf_counter_ns()
            now = time.monotonic_ns()
            self._driver.read(now)
            self._driver.write(now)
            took.append(time.perf_counter_ns() - start)
            self._udp.recv(4096)
        return _metrics(took)

    def kernel_cycles(self) -> dict[str, float]:
        """Returns the us of receiving a state and sending a command."""
        command = packets.command_record(self._version).tobytes()
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as there,
        ):
            here.bind(("127.0.0.1", 0))
            there.bind(("127.0.0.1", 0))
            here.connect(there.getsockname())
            there.connect(here.getsockname())
            state, took = self._state.tobytes(), []
            for _ in range(CYCLES):
                there.send(state)
                start = time.perf_counter_ns()
                here.recv(4096)
                here.send(command)
                took.append(time.perf_counter_ns() - start)
                there.recv(4096)
        return _metrics(took)

    def _tick(self) -> None:
        with self._lock:
            self._state["message_id"] += 1
            self._udp.send(self._state.tobytes())
        fileno = self._driver.fileno()
        if fileno is not None:
            select.select([fileno], [], [], 1)

    def _serve(self) -> None:
        """Answers requests; sends states until the driver is open."""
        client, _ = self._door.accept()
        parser = RequestParser(self._version)
        connected = False
        while not self._over.is_set():
            opening = self._driver.fileno() is None
            if not select.select([client], [], [], 0.002 if opening else 0.2)[0]:
                if opening and connected:
                    with self._lock:
                        self._state["message_id"] += 1
                        self._udp.send(self._state.tobytes())
                continue
            data = client.recv(4096)
            if not data:
                client.close()
                client, _ = self._door.accept()
                parser = RequestParser(self._version)
                continue
            for request in parser.feed(data):
                body = request.body
                if isinstance(body, Connect):
                    client.sendall(connect_reply(self._version, request.number, body.version == self._version))
                    self._udp.connect(("127.0.0.1", body.port))
                    connected = body.version == self._version
                    continue
                if isinstance(body, Move):
                    self._state["motion_generator_mode"] = body.generator + 1
                    self._state["controller_mode"], self._state["robot_mode"] = body.controller, RobotMode.MOVE
                status = Status.MOTION_STARTED if isinstance(body, Move) else Status.SUCCESS
                client.sendall(encode_reply(self._version, Reply(type(body), request.number, status)))
        client.close()


def _metrics(took: list[int]) -> dict[str, float]:
    p50, p90 = np.percentile(np.array(took) / 1e3, [50, 90])
    return {"p50": float(p50), "p90": float(p90)}
