"""The loop's sockets: who asks is what the kernel says; requests expire and are limited, stops are neither."""

from __future__ import annotations

import json
import os
import socket
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import toy
from helpers.toy import PERIOD, wired
from helpers.wait import until

from srl.runtime.ipc.control_socket import LIFETIME, NOTES, send_note, send_request
from srl.runtime.ipc.header import DEVICE, Cause, Latch, Origin, State
from srl.runtime.ipc.requests import Answer, RequestKind, RequestWriter
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.loop.control_end import ControlEnd
from srl.runtime.loop.request_queue import PendingRequest, RequestQueue


class Desk:
    """A queue, and the cycles that ask it."""

    def __init__(self, folder: Path, **options: Any) -> None:
        self.folder = RunFolder(folder)
        RequestWriter.create(self.folder.requests)
        self.ring = RequestWriter(self.folder.requests)
        self.queue = RequestQueue(self.folder, wired(**options), ControlEnd(self.folder.stop_socket))
        self.now = 0

    def take(self) -> PendingRequest | None:
        self.now += PERIOD
        return self.queue.take(self.now)

    def all(self) -> list[PendingRequest]:
        found = []
        while (pending := self.take()) is not None:
            found.append(pending)
        return found

    def send(self, path: Path, content: object, *rights: int) -> None:
        data = content if isinstance(content, bytes) else json.dumps(content).encode()
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.connect(str(path))
            socket.send_fds(sender, [data], list(rights))

    def move(self, content: object) -> tuple[PendingRequest | None, list[Answer]]:
        """Sends to the socket for what moves; returns what the cycle takes, and the answers of what it doesn't."""
        self.send(self.folder.loop_socket, content)
        pending = self.take()
        return pending, [each.answer for each in self.queue.refused]


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    made = Desk(tmp_path)
    yield made
    made.queue.close()


def soon() -> int:
    return time.monotonic_ns() + LIFETIME


def test_a_request_that_moves_says_until_when_it_is_valid(desk: Desk) -> None:
    taken, _ = desk.move({"ask": "reset", "expires": soon()})
    assert taken is not None
    assert (taken.request.kind, taken.request.origin, taken.uid) == (RequestKind.RESET, Origin.LOCAL, os.getuid())
    past, beyond = time.monotonic_ns() - 1, soon() + 10_000_000_000
    for expires in (past, beyond, None, "x", -1, 1e30, [1]):
        assert desk.move({"ask": "start", "expires": expires}) == (None, [Answer.EXPIRED]), expires
    assert desk.move({"ask": "reset"}) == (None, [Answer.EXPIRED])


@pytest.mark.parametrize(
    "content", [b"", b"\xff", b"[]", b"[" * 400, b"3", {"ask": 3}, {"ask": ["stop"]}, {"ask": "go"}]
)
def test_what_is_no_request_is_counted_and_at_the_stops_socket_a_stop(desk: Desk, content: object) -> None:
    assert desk.move(content) == (None, [])
    assert desk.queue.dropped == 1
    desk.send(desk.folder.stop_socket, content)
    taken = desk.take()
    assert taken is not None
    assert (taken.request.kind, taken.request.origin) == (RequestKind.STOP, Origin.LOCAL)


def test_a_note_is_for_an_event_and_a_flood_of_them_is_none(desk: Desk) -> None:
    assert send_note(desk.folder, "ü" * 9000)
    assert desk.take() is None
    assert desk.queue.notes == ["ü" * 200]
    for letter in ('"', "\\", "\x01"):  # JSON writes them longer
        assert send_note(desk.folder, 1000 * letter)
        assert desk.take() is None
        assert set("".join(desk.queue.notes)) == {letter}
    for content in ({"ask": "note"}, {"ask": "note", "text": 3}):
        assert desk.move(content) == (None, [])
        assert (desk.queue.notes, desk.queue.dropped) == ([], 1)
    noted = 0
    for _ in range(30):
        send_note(desk.folder, "again")
        desk.take()
        noted += len(desk.queue.notes)
    assert noted < 10


def test_the_loop_takes_as_many_notes_at_once_as_the_recorder_sends(desk: Desk) -> None:
    noted: list[str] = []
    for i in range(NOTES):
        assert send_note(desk.folder, str(i))
        desk.take()
        noted += desk.queue.notes
    assert noted == [str(i) for i in range(NOTES)]


def test_no_loop_no_note(tmp_path: Path) -> None:
    assert not send_note(RunFolder(tmp_path), "nobody is there")


def test_what_was_sent_before_a_stop_does_not_move_after_it(desk: Desk) -> None:
    expires = soon()
    desk.send(desk.folder.stop_socket, {"ask": "stop"})
    assert [p.request.kind for p in desk.all()] == [RequestKind.STOP]
    assert desk.move({"ask": "reset", "expires": expires}) == (None, [Answer.OVERTAKEN])
    assert desk.move({"ask": "reset", "expires": soon()})[0] is not None


def test_of_a_reset_and_a_stop_in_one_cycle_the_stop_counts(desk: Desk) -> None:
    desk.send(desk.folder.stop_socket, {"ask": "stop"})
    desk.send(desk.folder.loop_socket, {"ask": "reset", "expires": soon()})
    desk.ring.send(RequestKind.RESET, 1 << 62)
    assert [(p.request.kind, p.answer) for p in desk.all()] == [
        (RequestKind.STOP, Answer.NONE),
        (RequestKind.RESET, Answer.OVERTAKEN),
        (RequestKind.RESET, Answer.OVERTAKEN),
    ]


def test_a_role_asks_for_what_it_may(desk: Desk) -> None:
    """An observer's stop stops nothing and overtakes nothing; an operator sets no parameter."""
    refused = [
        (Origin.OBSERVER, RequestKind.STOP),
        (Origin.OBSERVER, RequestKind.START),
        (Origin.OBSERVER, RequestKind.PARAMETER),
        (Origin.OPERATOR, RequestKind.PARAMETER),
    ]
    allowed = [(Origin.OPERATOR, RequestKind.RESET), (Origin.ENGINEER, RequestKind.START)]
    for origin, kind in refused + allowed:
        desk.ring.send(kind, soon(), origin=origin)
    found = [(p.request.origin, p.request.kind, p.answer) for p in desk.all()]
    assert found == [(*each, Answer.REFUSED_ROLE) for each in refused] + [(*each, Answer.NONE) for each in allowed]
    desk.ring.send(RequestKind.STOP, soon(), origin=Origin.OPERATOR)
    assert [(p.request.origin, p.request.kind) for p in desk.all()] == [(Origin.OPERATOR, RequestKind.STOP)]


def test_what_a_client_asked_for_too_long_ago_is_refused(desk: Desk) -> None:
    """Whoever asked has been told that it failed, and has gone on: the bus drops it, the loop looks again."""
    for kind in (RequestKind.START, RequestKind.RESET, RequestKind.PARAMETER):
        desk.ring.send(kind, time.monotonic_ns() - 1)
    assert [p.answer for p in desk.all()] == [Answer.EXPIRED] * 3


def test_an_old_setpoint_or_one_that_is_no_number_moves_nothing(tmp_path: Path) -> None:
    desk = Desk(tmp_path, client=True)
    row = desk.queue.graph.row
    view, words = row.views["client.position"], row.devices[desk.queue.graph.layout.devices.index("client")]
    desk.ring.send(RequestKind.SETPOINT, soon(), 0, np.array([0.1, 0.2]))
    assert desk.take() is None
    assert (view.tolist(), words[DEVICE.stamp]) == ([0.1, 0.2], desk.now)
    first = desk.now
    far = np.array([2.0, 2.0])
    desk.ring.send(RequestKind.SETPOINT, time.monotonic_ns() - 1, 0, far)
    desk.ring.send(RequestKind.SETPOINT, soon(), 1, far)
    desk.ring.send(RequestKind.SETPOINT, soon(), 0, far, Origin.OBSERVER)
    for values in ([2.0, np.nan], [np.inf, 2.0], [2.0], [2.0] * 3):
        desk.ring.send(RequestKind.SETPOINT, soon(), 0, np.array(values))
    assert desk.take() is None
    assert (view.tolist(), words[DEVICE.stamp]) == ([0.1, 0.2], first)
    assert words[DEVICE.errors] == 4
    desk.queue.close()


def test_of_a_clients_setpoints_the_oldest_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is still sent doesn't hide that another one isn't any more."""
    one = "{shape: [2], unit: rad, labels: [shoulder, elbow], max_age: 0.05}"
    monkeypatch.setattr(toy, "CLIENT", f"setpoints: {{client.position: {one}, client.other: {one}}}")
    second = "  - {{use: law, name: second, in: {{x: client.other}}}}\n"
    monkeypatch.setattr(toy, "PROFILE", toy.PROFILE.replace("guard:", f"{second}guard:"))
    desk = Desk(tmp_path, client=True)
    words = desk.queue.graph.row.devices[desk.queue.graph.layout.devices.index("client")]
    stamps = []
    for targets in ((0, 1), (0,), (0,), (0, 1), (1,)):
        for target in targets:
            desk.ring.send(RequestKind.SETPOINT, soon(), target, np.zeros(2))
        desk.take()
        stamps.append(words[DEVICE.stamp] // PERIOD)
    assert stamps == [1, 1, 1, 4, 4]
    desk.queue.close()


def test_only_the_supervisors_process_is_the_service(desk: Desk) -> None:
    for claim in ({"origin": 4}, {"pid": os.getppid(), "uid": 0}, {"cause": "bus_loss"}, {"cause": "end"}):
        desk.send(desk.folder.stop_socket, {"ask": "fault"} | claim)
        (taken,) = desk.all()
        assert (taken.request.kind, taken.request.origin, taken.request.target) == (RequestKind.STOP, Origin.LOCAL, 0)
    desk.queue.supervisor = os.getpid()
    desk.send(desk.folder.stop_socket, {"ask": "fault", "cause": "bus_loss"})
    (taken,) = desk.all()
    assert (taken.request.kind, taken.request.origin) == (RequestKind.FAULT, Origin.SERVICE)
    assert taken.request.target == Cause.BUS_LOSS


def test_a_plain_stop_of_the_supervisors_process_is_a_persons(desk: Desk) -> None:
    """`srl jog` supervises its run and has the keys: its stop is latched as that of `srl stop`."""
    desk.queue.supervisor = os.getpid()
    for content in ({"ask": "stop"}, {"ask": "stop", "cause": "end"}, {"ask": ["stop"]}, b"noise"):
        desk.send(desk.folder.stop_socket, content)
        (taken,) = desk.all()
        assert (taken.request.kind, taken.request.origin, taken.request.target) == (RequestKind.STOP, Origin.LOCAL, 0)


def test_the_ring_asks_for_nothing_that_is_the_services(desk: Desk) -> None:
    for kind in (RequestKind.EXIT, RequestKind.FAULT, RequestKind.STOP):
        desk.ring.send(kind, 1 << 62)
    assert [(p.request.kind, p.request.origin) for p in desk.all()] == [(RequestKind.STOP, Origin.BUS)]


def test_a_client_of_the_bus_cant_pass_for_a_person_or_the_service(desk: Desk) -> None:
    """Not even where the bus's process writes so."""
    for origin in (Origin.LOCAL, Origin.INPUT, Origin.SERVICE, Origin.NONE):
        for kind in (RequestKind.RESET, RequestKind.STOP):
            desk.ring.send(kind, soon(), origin=origin)
    assert desk.all() == []


def test_the_sockets_are_for_the_services_user_and_its_group(desk: Desk) -> None:
    for path in (desk.folder.loop_socket, desk.folder.stop_socket):
        assert stat.S_IMODE(path.stat().st_mode) == 0o660


def test_descriptors_that_a_sender_passes_are_dropped(desk: Desk) -> None:
    before = set(os.listdir("/proc/self/fd"))
    with open("/dev/null") as file:
        for _ in range(4):
            desk.send(desk.folder.loop_socket, {"ask": "reset", "expires": soon()}, file.fileno())
            desk.send(desk.folder.stop_socket, {"ask": "stop"}, file.fileno())
        desk.all()
    assert set(os.listdir("/proc/self/fd")) == before


def test_requests_are_limited_by_origin_on_the_loops_clock_and_stops_are_not(desk: Desk) -> None:
    answers = [desk.move({"ask": "reset", "expires": soon()})[1] for _ in range(50)]  # half a second
    assert answers[:5] == [[]] * 5
    assert answers.count([]) == 7
    for _ in range(50):
        desk.ring.send(RequestKind.START, 1 << 62)
    assert [p.answer for p in desk.all()].count(Answer.NONE) == 5
    desk.now += 10_000_000_000
    assert sum(desk.move({"ask": "reset", "expires": soon()})[0] is not None for _ in range(50)) == 7
    for _ in range(200):
        desk.ring.send(RequestKind.STOP, 0)
    assert all(p.answer is Answer.NONE for p in desk.all())
    for _ in range(200):
        desk.send(desk.folder.stop_socket, {"ask": "stop"})
        taken = desk.take()
        assert taken is not None
        assert (taken.request.kind, taken.answer) == (RequestKind.STOP, Answer.NONE)


def test_a_persons_stop_and_an_exit_pass_a_crowd_of_stops_at_the_bus(desk: Desk) -> None:
    for _ in range(300):
        desk.ring.send(RequestKind.STOP, 1 << 62)
    desk.queue.end_asked = True
    desk.send(desk.folder.stop_socket, {"ask": "stop"})
    first = [desk.take() for _ in range(2)]
    assert [(p.request.kind, p.request.origin) for p in first if p] == [
        (RequestKind.EXIT, Origin.SERVICE),
        (RequestKind.STOP, Origin.LOCAL),
    ]


@contextmanager
def flood(path: Path, count: int = 2) -> Iterator[None]:
    """Other processes that send resets to a socket as fast as they can."""
    code = (
        "import socket, sys, time\ns = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)\ns.connect(sys.argv[1])\n"
        "print('begun', flush=True)\n"
        'while True:\n    s.send(b\'{"ask": "reset", "expires": %d}\' % (time.monotonic_ns() + 1_900_000_000))'
    )
    crowd = [subprocess.Popen([sys.executable, "-c", code, path], stdout=subprocess.PIPE) for _ in range(count)]
    try:
        for each in crowd:
            assert each.stdout is not None
            each.stdout.readline()
        yield
    finally:
        for each in crowd:
            each.kill()
            each.wait()
            assert each.stdout is not None
            each.stdout.close()


def test_a_flood_of_resets_leaves_room_for_a_stop(desk: Desk) -> None:
    """The kernel keeps ten datagrams at a socket: in that of the flood there is never room."""
    got: list[Any] = []
    with flood(desk.folder.loop_socket):
        until(lambda: desk.take() is not None or desk.queue.refused)
        asker = threading.Thread(target=lambda: got.append(send_request(desk.folder, "stop", timeout=20)))
        asker.start()

        def cycle() -> None:
            pending = desk.take()
            if pending is not None and pending.request.kind is RequestKind.STOP:
                pending.answer = Answer.DONE
                desk.queue.reply(pending, State.STOPPED, Cause.REQUEST, "", Latch.PERSON)

        until(lambda: not asker.is_alive(), cycle)
        asker.join()
    assert got == [{"ok": True, "state": "stopped", "cause": "request", "fault_source": "", "latches": ["person"]}]


def test_everybody_who_asks_for_the_same_stop_is_answered(desk: Desk) -> None:
    senders = [socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) for _ in range(3)]
    for sender in senders:
        sender.bind("")
        sender.sendto(b'{"ask": "stop"}', str(desk.folder.stop_socket))
    (pending,) = desk.all()
    pending.answer = Answer.DONE
    desk.queue.reply(pending, State.STOPPED, Cause.REQUEST, "", Latch.PERSON)
    for sender in senders:
        sender.setblocking(False)
        assert json.loads(sender.recv(2048))["ok"] is True
        sender.close()
