"""A page stops the limb while somebody else holds more connections to its server than that has descriptors."""

from __future__ import annotations

import asyncio
import contextlib
import http.client
import json
import os
import resource
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import pytest
from aiohttp import WSMsgType
from helpers.operator_page import Socket, cookie, place, talk
from helpers.operator_seen import Seen
from helpers.panel import SIGNAL
from helpers.viewed import ViewedLoop
from helpers.wait import until

from srl.runtime.ipc import control_socket
from srl.runtime.ipc.header import State
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.web.operator.client import OperatorPage
from srl.runtime.web.panel.client import PageProcess
from srl.runtime.web.panel.screen import Screen

pytestmark = pytest.mark.slow

LIMIT: Final = 160  # descriptors of the server's process: fewer are cheaper to use up
HELD: Final = 2 * LIMIT  # connections that the other one holds, again as soon as one is ended
TRIES: Final = 5  # new connections within which a stop gets through
FLOOD: Final = """
import os, selectors, socket, sys
if os.geteuid() == 0:
    os.setgid(65534), os.setuid(65534)
port, count, mode = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
BEGIN = {"idle": b"", "slow": b"GET / HTTP/1.1\\r\\nX: ", "asks": b"GET / HTTP/1.1\\r\\nHost: x\\r\\n\\r\\n"}[mode]
MORE = {"idle": b"", "slow": b"x", "asks": BEGIN}[mode]
poll, opened, ended = selectors.DefaultSelector(), set(), 0
def add():
    made = socket.socket()
    made.setblocking(False)
    made.connect_ex(("127.0.0.1", port))
    poll.register(made, selectors.EVENT_WRITE)
def drop(made):
    poll.unregister(made)
    opened.discard(made)
    made.close()
for _ in range(count):
    add()
while True:
    for key, event in poll.select(0.05):
        made = key.fileobj
        try:
            if event & selectors.EVENT_WRITE:
                made.getpeername()
                made.send(BEGIN)
                poll.modify(made, selectors.EVENT_READ)
                opened.add(made)
            elif not made.recv(4096):
                raise ConnectionError
        except OSError:
            drop(made)
            ended += 1
            add()
    for made in list(opened) if MORE else ():
        try:
            made.send(MORE)
        except OSError:
            pass
    print(len(opened), ended, flush=True)
"""


class Limited(subprocess.Popen[Any]):
    """A process that has few descriptors from its beginning."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        resource.prlimit(self.pid, resource.RLIMIT_NOFILE, (LIMIT, LIMIT))


class Flood:
    """Somebody without rights who holds connections. `held`, `ended`: of them, and so far by the server."""

    def __init__(self, port: int, mode: str) -> None:
        command = [sys.executable, "-S", "-c", FLOOD, str(port), str(HELD), mode]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.held = self.ended = 0
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def _listen(self) -> None:
        assert self.process.stdout is not None
        with self.process.stdout as output:
            for line in output:
                if line.endswith("\n"):  # the last one may be cut
                    self.held, self.ended = map(int, line.split())

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        self._thread.join()


class Served:
    """A server of pages under a small limit: its address, process, loop, and what it told the loop for its events."""

    def __init__(self, process: PageProcess, loop: ViewedLoop, notes: list[str]) -> None:
        self.process, self.loop, self.notes = process, loop, notes
        self.kept = cookie(process)
        self.pid = process.pid

    @property
    def port(self) -> int:
        return int(place(self.process).partition(":")[2])

    @contextlib.contextmanager
    def flooded(self, mode: str) -> Iterator[Flood]:
        """Meanwhile somebody holds all its descriptors, or as many connections as the server lets stand."""
        flood = Flood(self.port, mode)
        try:
            until(lambda: flood.ended or len(os.listdir(f"/proc/{self.pid}/fd")) >= LIMIT)
            yield flood
        finally:
            flood.close()

    def stop(self, patience: float = 2.0) -> bool:
        """A stop over a new connection; whether it was confirmed."""
        connection = http.client.HTTPConnection(place(self.process), timeout=patience)
        headers = self.kept | {"Origin": f"http://{place(self.process)}"}
        try:
            connection.request("POST", "/stop", headers=headers)
            answer = connection.getresponse()
            return answer.status == 200 and bool(json.loads(answer.read())["ok"])
        except (OSError, http.client.HTTPException):
            return False
        finally:
            connection.close()


@contextlib.contextmanager
def noted(folder: RunFolder) -> Iterator[list[str]]:
    """The loop's socket for what isn't a stop: the texts that became events."""
    found, over = list[str](), threading.Event()
    end = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    end.bind(str(folder.loop_socket))
    end.settimeout(0.01)

    def run() -> None:
        while not over.is_set():
            with contextlib.suppress(TimeoutError):
                found.append(json.loads(end.recv(2048)).get("text", ""))

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield found
    finally:
        over.set()
        thread.join()
        end.close()


async def heard(tab: Socket, kind: str, at: int) -> dict[str, Any]:
    """The next answer of a kind; what is drawn is left out."""
    while True:
        message = await tab.receive(10)
        assert message.type in (WSMsgType.TEXT, WSMsgType.BINARY), "the page was let go"
        content = json.loads(message.data) if message.type is WSMsgType.TEXT else {}
        if (content.get("kind"), content.get("at")) == (kind, at):
            return dict(content)


KINDS: Final[dict[str, Callable[[RunFolder], PageProcess]]] = {
    "panel": lambda folder: OperatorPage(folder, folder.path),
    "screen": lambda folder: Screen(folder, SIGNAL),
}


@pytest.fixture(params=list(KINDS))
def served(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Served]:
    loop = ViewedLoop(tmp_path / "run")
    with loop.running(), noted(loop.folder) as notes:
        with monkeypatch.context() as limited:
            limited.setattr(subprocess, "Popen", Limited)
            process = KINDS[request.param](loop.folder)
        with process:
            yield Served(process, loop, notes)


def test_the_open_connection_stops_while_no_other_can_be_had(served: Served) -> None:
    async def page(tab: Socket) -> None:
        with served.flooded("idle"):
            await tab.send_json({"kind": "stop", "at": 7})
            output = await asyncio.wait_for(heard(tab, "stopped", 7), 20)
            assert (output["ok"], served.loop.stops, served.loop.state) == (True, 1, State.STOPPED)

    talk(served.process, page, kept=served.kept)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("mode", ["idle", "slow", "asks"])
def test_a_new_connection_stops_during_a_flood_and_it_is_told(served: Served, mode: str) -> None:
    async def page(tab: Socket) -> None:
        with served.flooded(mode) as flood:
            assert any([await asyncio.to_thread(served.stop) for _ in range(TRIES)])
            await asyncio.to_thread(until, lambda: flood.ended > 0 and served.notes)
            await tab.send_json({"kind": "ping", "at": 8})
            await asyncio.wait_for(heard(tab, "pong", 8), 20)  # the page itself was never let go
        assert any("connection" in note for note in served.notes)
        assert len(served.notes) <= 10  # it is told, and doesn't fill the events

    talk(served.process, page, kept=served.kept)


@pytest.mark.sampled(1)
def test_a_connection_that_shows_no_key_is_ended(served: Served) -> None:
    for output in (b"", b"GET / HTTP/1.1\r\nHost: x\r\n"):
        with socket.create_connection(("127.0.0.1", served.port), timeout=15) as idle:
            idle.sendall(output)
            while idle.recv(4096):
                pass
    assert served.stop(20)
    assert not served.notes  # a browser itself opens some that it never uses


def test_whatever_stands_in_a_stop_it_stops(served: Served) -> None:
    async def page(tab: Socket) -> None:
        odd: tuple[object, ...] = (None, -1, "x", {}, [1], 1e308, True)
        for count, at in enumerate(odd, 1):
            await tab.send_json({"kind": "stop", "at": at})
            await asyncio.to_thread(until, lambda count=count: served.loop.stops == count)

    talk(served.process, page, kept=served.kept)


def test_a_stop_leaves_without_an_address_for_its_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Any user can hold all abstract addresses of a host: then no answer comes, and the stop must all the same."""

    class Refused(socket.socket):
        def bind(self, address: Any, /) -> None:
            raise OSError(28, "No space left on device")

    folder = RunFolder(tmp_path)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as loop:
        loop.bind(str(folder.stop_socket))
        loop.settimeout(5)
        with monkeypatch.context() as full, contextlib.suppress(OSError):
            full.setattr(socket, "socket", Refused)
            assert control_socket.send_request(folder, "stop", timeout=0.2) is None
        assert json.loads(loop.recv(2048)) == {"ask": "stop"}


def test_without_its_second_door_the_page_stops_over_the_connection_that_is_open(seen: Seen) -> None:
    seen.page.ask("Network.enable")
    seen.page.ask("Network.setBlockedURLs", urls=["*/stop"])
    seen.page.key("Escape", "Escape", 27)
    until(lambda: seen.loop.stops == 1)
    until(lambda: "Stopping" not in seen.text("warning"))
    assert "hardware stop" not in seen.text("warning")
