"""The Panda's twin on its sockets: sessions, states, setpoints, and what it does with nonsense."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from helpers import panda as helpers_panda
from helpers.panda import MS
from helpers.wait import until

from srl.drivers.panda.packets import Generator, RobotMode, command_record, decode_state, state_dtype
from srl.drivers.panda.protocol import Reply, ReplyParser, Status, encode_request
from srl.drivers.panda.requests import (
    AutomaticErrorRecovery,
    Body,
    Connect,
    GetCartesianLimit,
    GetRobotModel,
    LoadModelLibrary,
    Move,
    SetLoad,
    StopMove,
)
from srl.runtime.contracts.errors import HostError
from srl.runtime.models.robots import PANDA
from srl.sim.devices.panda.twin import PandaTwin

TIMEOUT = 10.0  # s of real time for loopback to deliver


class Bare:
    """A client without any library; its calls turn the twin."""

    def __init__(self, twin: PandaTwin, version: int | None = None) -> None:
        self.twin, self.version = twin, twin.robot.version
        self.number = 0
        host, port = twin.address.removeprefix("tcp://").split(":")
        self.tcp = socket.create_connection((host, int(port)))
        self.tcp.setblocking(False)
        self.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.udp.bind(("127.0.0.1", 0))
        self.udp.setblocking(False)
        self.parser = ReplyParser(self.version, largest=1 << 20)
        self.replies: list[Reply] = []
        self.state: Any = None
        self.sender: Any = None
        self.hung_up = False
        self.now = 0
        self.hello = self.ask(Connect(version or self.version, self.udp.getsockname()[1]))

    def close(self) -> None:
        self.tcp.close()
        self.udp.close()

    def turn(self, count: int = 1, hold: bool = False) -> None:
        """Lets `count` ms pass; `hold`: the world waits where the twin does."""
        for _ in range(count):
            self.now += MS
            if not (hold and self.twin.waiting(self.now)):
                self.twin.fake.world.advance(self.twin.fake.world.time + MS)
            self.twin.service(self.now)
            self.take()

    def take(self) -> None:
        """What has arrived."""
        try:
            data = self.tcp.recv(1 << 20)
            self.hung_up = self.hung_up or not data
            self.replies += self.parser.feed(data)
        except BlockingIOError:
            pass
        except OSError:
            self.hung_up = True
        while True:
            try:
                data, self.sender = self.udp.recvfrom(65536)
            except BlockingIOError:
                break
            assert len(data) == state_dtype(self.version).itemsize
            self.state = decode_state(self.version, data)

    def send(self, body: Body) -> int:
        """Sends a request; gives its number."""
        self.number += 1
        self.tcp.sendall(encode_request(self.version, self.number - 1, body))
        return self.number - 1

    def reply(self, number: int) -> Reply:
        """The next reply to a request."""

        def found() -> list[Reply]:
            return [reply for reply in self.replies if reply.number == number]

        reply = until(found, self.turn, what=f"a reply to {number}", pause=0.0)[0]
        self.replies.remove(reply)
        return reply

    def ask(self, body: Body) -> Reply:
        return self.reply(self.send(body))

    def answer(self, finished: bool = False, **fields: Any) -> None:
        """A setpoint for the newest state, and the millisecond in which it counts."""
        command = command_record(self.version)
        command["message_id"] = self.state["message_id"]
        command["motion_generation_finished"] = finished
        for name, value in fields.items():
            command[name] = value
        before = self.twin.setpoints
        self.udp.sendto(command.tobytes(), self.sender)
        until(
            lambda: self.twin.setpoints > before or self.twin.robot.controller.mode is not RobotMode.MOVE,
            self.turn,
            pause=0.0,
        )

    def run(self, count: int, **fields: Any) -> None:
        for _ in range(count):
            self.answer(**fields)

    def start(self, move: Move) -> int:
        """A motion with its first state seen."""
        number = self.send(move)
        assert self.reply(number).status is Status.MOTION_STARTED
        self.turn(2)
        assert self.mode is RobotMode.MOVE
        return number

    @property
    def mode(self) -> RobotMode:
        return RobotMode(int(self.state["robot_mode"]))


@pytest.fixture(params=["panda", "fr3"])
def client(request: pytest.FixtureRequest) -> Iterator[Bare]:
    twin = helpers_panda.twin(request.param, **helpers_panda.QUIET)
    twin.open()
    bare = Bare(twin)
    yield bare
    bare.close()
    twin.close()


def torque(client: Bare) -> Move:
    return Move(2, 1 if client.version == 5 else 4)


def last(client: Bare) -> dict[str, Any]:
    return {"finished": True} if client.version == 5 else {"torque_command_finished": True}


def test_a_session_begins_with_connect_and_a_state_each_millisecond(client: Bare) -> None:
    assert (client.hello.status, client.hello.version) == (Status.SUCCESS, client.version)
    client.turn(3)
    first = int(client.state["message_id"])
    client.turn(100)
    assert int(client.state["message_id"]) == first + 100
    np.testing.assert_allclose(client.state["q"], PANDA.home, atol=1e-4)
    assert client.mode is RobotMode.IDLE
    assert (client.state["motion_generator_mode"], client.state["controller_mode"]) == (0, 3)
    assert client.state["control_command_success_rate"] == 0
    # Sheet panda: the flange at `ready`, column by column; no end effector is set.
    np.testing.assert_allclose(client.state["O_T_EE"][12:15], [0.306891, 0, 0.590282], atol=1e-5)
    np.testing.assert_allclose(client.state["tau_J"], [0, -1.7714, -0.6440, 18.5736, 0.6338, 1.6937, 0], atol=0.01)


def test_a_client_of_another_version_is_told_and_hung_up_on() -> None:
    twin = helpers_panda.twin()
    twin.open()
    bare = Bare(twin, version=4)
    assert (bare.hello.status, bare.hello.version) == (Status.INCOMPATIBLE_VERSION, 5)
    bare.turn(5)
    assert bare.hung_up
    assert Bare(twin).hello.status is Status.SUCCESS
    twin.close()


def test_one_client_at_a_time(client: Bare) -> None:
    host, port = client.twin.address.removeprefix("tcp://").split(":")
    second = socket.create_connection((host, int(port)))
    client.turn(5)
    second.settimeout(TIMEOUT)
    assert second.recv(1) == b""
    assert client.ask(StopMove()).status is Status.SUCCESS


def test_before_connect_nothing_is_answered() -> None:
    twin = helpers_panda.twin()
    twin.open()
    host, port = twin.address.removeprefix("tcp://").split(":")
    stranger = socket.create_connection((host, int(port)))
    stranger.sendall(encode_request(5, 0, StopMove()))
    stranger.settimeout(0.1)
    for number in range(20):
        twin.fake.world.advance(twin.fake.world.time + MS)
        twin.service(number * MS)
    with pytest.raises(TimeoutError):
        stranger.recv(1)
    twin.close()


def test_a_motion_has_two_replies(client: Bare) -> None:
    number = client.start(torque(client))
    expected = Generator.JOINT_VELOCITY if client.version == 5 else Generator.NONE
    assert (client.state["motion_generator_mode"], client.state["controller_mode"]) == (expected, 2)
    client.run(50, tau_J_d=[0, 0, 0, 0.5, 0, 0, 0])
    assert client.state["control_command_success_rate"] == 1
    assert client.state["tau_J_d"][3] == 0.5
    client.answer(**last(client))
    assert client.reply(number).status is Status.SUCCESS
    client.turn(2)
    assert client.mode is RobotMode.IDLE


def test_stop_preempts_a_motion(client: Bare) -> None:
    number = client.start(torque(client))
    client.run(5)
    assert client.ask(StopMove()).status is Status.SUCCESS
    assert client.reply(number).status is Status.PREEMPTED


def test_a_reflex_ends_a_motion_with_its_bits_and_recovery_clears_them(client: Bare) -> None:
    number = client.start(torque(client))
    client.run(5)
    client.answer(tau_J_d=[0, 0, 0, 0, 0, 0, 3.0])
    assert client.reply(number).status is Status.REFLEX_ABORTED
    client.turn(2)
    assert client.mode is RobotMode.REFLEX
    assert (client.state["errors"][32], client.state["errors"].sum(), client.state["reflex_reason"].sum()) == (1, 1, 1)
    assert client.ask(torque(client)).status is Status.NOT_POSSIBLE
    assert client.ask(AutomaticErrorRecovery()).status is Status.SUCCESS
    client.turn(2)
    assert client.mode is RobotMode.IDLE
    assert (client.state["errors"].sum(), client.state["reflex_reason"].sum()) == (0, 1)


def test_settings_show_in_the_state_and_are_refused_in_a_motion(client: Bare) -> None:
    load = SetLoad(0.5, (0.1, 0.2, 0.3), (0.1, 0, 0, 0, 0.2, 0, 0, 0, 0.3))
    assert client.ask(load).status is Status.SUCCESS
    client.turn(2)
    assert client.state["m_load"] == 0.5
    np.testing.assert_allclose(client.state["F_x_Cload"], [0.1, 0.2, 0.3], atol=1e-6)
    client.start(torque(client))
    client.run(2)
    assert client.ask(load).status is Status.NOT_POSSIBLE
    assert client.ask(SetLoad(-1.0, (0.0,) * 3, (0.0,) * 9)).status is Status.NOT_POSSIBLE


def test_a_client_that_vanishes_in_a_motion_leaves_a_reflex_to_the_next(client: Bare) -> None:
    client.start(torque(client))
    client.run(5)
    client.close()
    for _ in range(5):
        client.now += MS
        client.twin.fake.world.advance(client.twin.fake.world.time + MS)
        client.twin.service(client.now)
    heir = Bare(client.twin)
    heir.turn(3)
    assert heir.mode is RobotMode.REFLEX
    assert heir.state["errors"][25]
    assert heir.ask(AutomaticErrorRecovery()).status is Status.SUCCESS
    heir.start(torque(heir))


def test_what_only_one_protocol_has() -> None:
    for robot in ("panda", "fr3"):
        twin = helpers_panda.twin(robot)
        twin.open()
        client = Bare(twin)
        if robot == "panda":
            limit = client.ask(GetCartesianLimit(0))
            assert (limit.status, len(limit.data)) == (Status.SUCCESS, 153)
            assert client.ask(GetCartesianLimit(99)).status is Status.INVALID_ARGUMENT
            assert client.ask(LoadModelLibrary(0, 1)).status is Status.ERROR  # Windows
            library = client.ask(LoadModelLibrary(0, 0))
            assert library.status is Status.ERROR or library.data.startswith(b"\x7fELF")
        else:
            model = client.ask(GetRobotModel())
            assert b'<robot name="fr3">' in model.data
        twin.close()


def test_a_silent_client_loses_packets_once_its_patience_is_over(client: Bare) -> None:
    number = client.start(torque(client))
    client.run(5)
    client.turn(200, hold=True)
    assert client.mode is RobotMode.MOVE
    assert client.twin.robot.controller.reception.total == 0
    client.turn(100, hold=True)
    assert client.reply(number).status is Status.REFLEX_ABORTED
    client.turn(3)
    assert client.state["errors"][25]


def test_out_of_lockstep_each_millisecond_without_an_answer_is_a_packet_lost() -> None:
    twin = helpers_panda.twin(lockstep=False, **helpers_panda.QUIET)
    twin.open()
    client = Bare(twin)
    client.start(Move(2, 1))
    client.run(5)
    lost = twin.robot.controller.reception.total
    client.turn(10)
    assert twin.robot.controller.reception.total == lost + 10
    client.turn(15)
    assert client.mode is RobotMode.REFLEX
    twin.close()


def test_old_and_foreign_datagrams_move_nothing(client: Bare) -> None:
    client.start(torque(client))
    stale = int(client.state["message_id"])
    client.run(30)
    command = command_record(client.version)
    command["message_id"] = stale
    command["tau_J_d"] = 1.0
    client.udp.sendto(command.tobytes(), client.sender)
    client.udp.sendto(b"hello", client.sender)
    until(lambda: client.twin.late + client.twin.wrong >= 2, lambda: client.twin.service(client.now))
    client.run(5)
    assert not client.state["tau_J_d"].any()
    metrics = client.twin.metrics()
    assert (metrics["late_setpoints"], metrics["wrong_datagrams"]) == (1, 1)


def test_a_robot_whose_program_hangs_says_nothing_and_stops_the_motion(client: Bare) -> None:
    client.start(torque(client))
    client.run(5)
    client.turn(3)
    client.twin.muted = True
    shown = int(client.state["message_id"])
    client.turn(100)
    assert int(client.state["message_id"]) == shown
    assert client.twin.robot.controller.mode is RobotMode.REFLEX
    client.twin.muted = False
    client.turn(3)
    assert client.mode is RobotMode.REFLEX


def test_a_loss_window_ends_the_session() -> None:
    twin = helpers_panda.twin(loss=[[0.1, 0.2]])
    twin.open()
    client, address = Bare(twin), twin.address
    client.turn(110)
    assert client.hung_up
    assert twin.address == ""
    client.turn(100)
    assert twin.address == address
    assert Bare(twin).hello.status is Status.SUCCESS
    twin.close()


def test_a_twin_listens_on_loopback_only_and_where_it_is_told() -> None:
    host = helpers_panda.host()
    twin = helpers_panda.twin(host=host, port=1337)
    twin.open()
    assert twin.address == f"tcp://{host}:1337"
    other = helpers_panda.twin(host=host, port=1337)
    with pytest.raises(HostError, match="Choose another port"):
        other.open()
    twin.close()
    with pytest.raises(ValueError, match="loopback"):
        helpers_panda.twin(host="0.0.0.0")
