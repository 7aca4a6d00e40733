"""Requests over the loop's socket: only the loop's answer counts."""

from __future__ import annotations

import json
import socket
import threading
from pathlib import Path

import pytest

from srl.runtime.ipc.control_socket import send_request
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
