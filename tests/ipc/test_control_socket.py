"""Requests over the loop's socket: only the loop's answer counts."""

from __future__ import annotations

import json
import socket
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from helpers.bus import layout

from srl.runtime.ipc.control_socket import send_request
from srl.runtime.ipc.header import CYCLE, Latch, Origin, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.requests import Answer, RequestKind
from srl.runtime.ipc.ring import RingWriter
from srl.runtime.ipc.row import Row
from srl.runtime.ipc.run_folder import RunFolder


@pytest.fixture
def loop(tmp_path: Path) -> tuple[RunFolder, socket.socket]:
    """A run folder, and the socket at which a loop would listen for stops."""
    run_folder = RunFolder(tmp_path)
    end = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    end.bind(str(run_folder.stop_socket))
    end.settimeout(10)
    return run_folder, end


def test_the_answer_comes_back(loop: tuple[RunFolder, socket.socket]) -> None:
    run_folder, end = loop
    asked: list[bytes] = []

    def answer() -> None:
        data, sender = end.recvfrom(512)
        asked.append(data)
        end.sendto(b'{"ok": true, "state": "stopped"}', sender)

    thread = threading.Thread(target=answer)
    thread.start()
    assert send_request(run_folder, "fault", "bus_loss", timeout=10) == {"ok": True, "state": "stopped"}
    thread.join()
    assert [json.loads(data) for data in asked] == [{"ask": "fault", "cause": "bus_loss"}]


def test_nobody_but_the_loop_can_say_that_the_limb_has_stopped(loop: tuple[RunFolder, socket.socket]) -> None:
    run_folder, end = loop
    refused: list[type[OSError]] = []

    def forge_then_answer() -> None:
        _, sender = end.recvfrom(512)
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as other:
            try:
                other.sendto(b'{"ok": true, "state": "stopped"}', sender)
            except OSError as error:
                refused.append(type(error))
        end.sendto(b'{"ok": false, "state": "active"}', sender)

    thread = threading.Thread(target=forge_then_answer)
    thread.start()
    assert send_request(run_folder, "stop", timeout=10) == {"ok": False, "state": "active"}
    thread.join()
    assert refused == [PermissionError]


def test_no_loop_is_no_answer(tmp_path: Path) -> None:
    assert send_request(RunFolder(tmp_path), "stop", timeout=0.1) is None


def row(graph: Layout, kind: RequestKind, result: Answer, origin: Origin, at: int) -> np.ndarray:
    words = Row(graph)
    words.ints[CYCLE.request_kind], words.ints[CYCLE.request_result] = kind, result
    words.ints[CYCLE.request_origin], words.ints[CYCLE.write] = origin, at
    words.ints[CYCLE.state], words.ints[CYCLE.cause], words.ints[CYCLE.latches] = State.STOPPED, 1, Latch.PERSON
    return words.words


def test_an_answer_that_cannot_arrive_is_found_in_the_rows(loop: tuple[RunFolder, socket.socket]) -> None:
    """The loop that answers here can't reach the sender: it is as if of another network namespace."""
    run_folder, end = loop
    graph = layout("left", 100)
    graph.save(run_folder.layout)
    ring = RingWriter.create(run_folder.rows, graph.width, 64)

    def take(*results: tuple[RequestKind, Answer, Origin]) -> None:
        end.recv(512)
        for kind, result, origin in results:
            ring.append(row(graph, kind, result, origin, time.monotonic_ns()))

    stop, granted, local = RequestKind.STOP, Answer.DONE, Origin.LOCAL
    ring.append(row(graph, stop, granted, local, time.monotonic_ns()))  # before it was sent
    for results, answer in (
        ([(stop, granted, local)], True),
        ([(stop, granted, Origin.BUS)], None),
        ([(RequestKind.RESET, granted, local)], None),
        ([(stop, Answer.REFUSED_STATE, local)], False),
        ([(stop, granted, local), (stop, Answer.REFUSED_STATE, local)], True),
    ):
        thread = threading.Thread(target=take, args=results)
        thread.start()
        found = send_request(run_folder, "stop", timeout=0.5)
        thread.join()
        assert (None if found is None else found["ok"]) is answer
        if found is not None:
            assert (found["state"], found["latches"]) == ("stopped", ["person"])
            assert found.get("error") == (
                None if answer else "not possible while stopped; `srl reset` lets it move again"
            )


def test_who_doesnt_wait_doesnt_look(loop: tuple[RunFolder, socket.socket], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("srl.runtime.ipc.answers.in_rows", lambda *_: pytest.fail("the supervisor has no time for it"))
    assert send_request(loop[0], "stop", timeout=0.0) is None
