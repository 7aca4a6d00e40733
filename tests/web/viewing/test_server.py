"""`--view` against what isn't its page: nobody without the token sees the run, and no page delays another."""

from __future__ import annotations

import asyncio
import http.client
import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
from helpers.drawn import Drawn
from helpers.operator_page import UPGRADE, Socket, asked, closed, cookie, get, heard, place, talk
from helpers.viewed import ViewedLoop, ViewerProcess
from helpers.wait import until

from srl.runtime.ipc.header import State
from srl.runtime.recording.framing import HEADER, strip
from srl.runtime.web.viewing import __main__ as command
from srl.runtime.web.viewing import assets
from srl.runtime.web.viewing.assets import listener


@pytest.fixture(scope="module")
def loop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ViewedLoop]:
    with ViewedLoop(tmp_path_factory.mktemp("v") / "run").running() as made:
        yield made


@pytest.fixture(scope="module")
def viewer(loop: ViewedLoop) -> Iterator[ViewerProcess]:
    until(lambda: loop.cycle > 2)
    with ViewerProcess(loop.folder.path) as made:
        yield made


@pytest.fixture(scope="module")
def kept(viewer: ViewerProcess) -> dict[str, str]:
    """What the browser that took the address shows."""
    return cookie(viewer)


async def part(tab: Socket) -> tuple[float, bytes]:
    """The next part of the stream, and its newest time."""
    newest = (await heard(tab, "part"))["newest"]
    message = await tab.receive_bytes()
    return newest, message


# Who is let in


def test_the_token_is_good_once_and_without_it_nothing_is_served(viewer: ViewerProcess, kept: dict[str, str]) -> None:
    assert get(viewer, f"/?{viewer.address.partition('?')[2]}").status == 403
    for path in ("/", "/viewer.js", "/age.js", "/re_viewer.js", "/re_viewer_bg.wasm", "/socket", "/?token=x"):
        assert get(viewer, path).status == 403
        assert get(viewer, path, Cookie=kept["Cookie"] + "x").status == 403
    answer, page = asked(viewer, "/", "GET", **kept)
    assert answer.status == 200
    assert kept["X-Srl-Key"] not in page
    policy = answer.headers["Content-Security-Policy"]
    assert "script-src 'self' 'wasm-unsafe-eval';" in policy
    assert f"connect-src 'self' ws://{place(viewer)}" in policy


@pytest.mark.parametrize("origin", [None, "null", "http://example.org", "http://localhost"])
def test_a_foreign_page_neither_looks_nor_stops(
    loop: ViewedLoop, viewer: ViewerProcess, kept: dict[str, str], origin: str | None
) -> None:
    headers, stops = kept | ({"Origin": origin} if origin else {}), loop.stops
    assert get(viewer, "/socket", **headers, **UPGRADE).status == 403
    assert get(viewer, "/stop", "POST", **headers).status == 403
    if origin:
        assert get(viewer, "/re_viewer_bg.wasm", **headers).status == 403
    assert loop.stops == stops


def test_a_rebound_name_and_another_users_cookie_are_refused(viewer: ViewerProcess, kept: dict[str, str]) -> None:
    origin = f"http://{place(viewer)}"
    assert get(viewer, "/socket", **kept, Host="rebound.example.org", Origin=origin, **UPGRADE).status in (400, 421)
    assert get(viewer, "/", **kept, Host="localhost").status in (400, 421)
    stolen = {"Cookie": kept["Cookie"], "Origin": origin}  # whoever serves another port of this host sees it
    assert get(viewer, "/socket", **stolen, **UPGRADE).status == 403
    assert get(viewer, "/stop", "POST", **stolen).status == 403


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
def test_another_users_process_sees_nothing(viewer: ViewerProcess, kept: dict[str, str]) -> None:
    script = """
import encodings.idna, http.client, json, os, sys
os.setgid(65534), os.setuid(65534)
found = []
for path, more in (("/", {}), ("/socket", json.loads(sys.argv[2])), ("/re_viewer.js", {})):
    connection = http.client.HTTPConnection(sys.argv[1], timeout=20)
    connection.request("GET", path, headers={"Origin": "http://" + sys.argv[1]} | more)
    found.append(connection.getresponse().status)
print(found)
"""
    command = [sys.executable, "-c", script, place(viewer), json.dumps(UPGRADE)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == "[403, 403, 403]"


def test_reruns_viewer_is_served_and_no_other_server_is_left(viewer: ViewerProcess, kept: dict[str, str]) -> None:
    connection = http.client.HTTPConnection(place(viewer), timeout=60)
    connection.request("GET", "/re_viewer_bg.wasm", headers=kept)
    answer = connection.getresponse()
    assert (answer.status, answer.headers["Content-Type"]) == (200, "application/wasm")
    assert answer.read(4) == b"\0asm"
    connection.close()
    assert "wasm_bindgen" in asked(viewer, "/re_viewer.js", "GET", **kept)[1]
    process = psutil.Process(viewer.process.pid)
    assert process.children(recursive=True) == []
    ears = [c.laddr for c in process.net_connections("inet") if c.status == psutil.CONN_LISTEN]
    assert [(a.ip, a.port) for a in ears] == [("127.0.0.1", int(place(viewer).partition(":")[2]))]


def test_a_listeners_user_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket() as made:
        made.bind(("127.0.0.1", 0))
        port = made.getsockname()[1]
        assert listener(port) is None
        made.listen(1)
        assert listener(port) == os.geteuid()
        monkeypatch.setattr(os, "geteuid", lambda: -1)
        assert listener(port) != -1


# What a page gets


@pytest.mark.slow
def test_a_part_follows_when_the_one_before_is_drawn(
    loop: ViewedLoop, viewer: ViewerProcess, kept: dict[str, str], tmp_path: Path
) -> None:
    found = tmp_path / "seen.rrd"

    async def page(tab: Socket) -> int:
        reported = await heard(tab, "run")
        assert (reported["name"], reported["wall"]) == ("made-up", loop.layout.meta["wall"] / 1e6)
        _, head = await part(tab)
        loop.state = State.STOPPED
        now = await heard(tab, "now", condition="stopped")  # rows go on, and none is sent to a page that hasn't drawn
        assert now["words"].startswith("The limb is stopped")
        cycle = loop.cycle
        loop.state = State.ACTIVE
        await heard(tab, "now", condition="live")
        await tab.send_json({"kind": "drawn"})
        data, newest = b"", 0.0
        while newest < loop.time_of(cycle):
            newest, more = await part(tab)
            data += strip(more)
            await tab.send_json({"kind": "drawn"})
        found.write_bytes(head[:HEADER] + strip(head) + data)
        return cycle

    cycle = talk(viewer, page, kept=kept)
    drawn = Drawn(found)
    assert drawn.static  # what is drawn once came with the first part
    assert max(max(rows) for rows in drawn.moving.values()) >= cycle
    # The stop of a moment is told, also where no row of it is.
    shown = subprocess.run(
        [Path(sys.prefix) / "bin" / "rerun", "rrd", "print", "-vvv", "--entity", "/loop/state", found],
        capture_output=True, text=True, env=os.environ | {"CI": "1"}, check=True,
    ).stdout  # fmt: skip
    assert "stopped" in shown


def test_what_a_slow_page_missed_comes_as_one_part(
    loop: ViewedLoop, viewer: ViewerProcess, kept: dict[str, str]
) -> None:
    async def page(quick: Socket, slow: Socket) -> tuple[list[float], int]:
        sizes = []
        for tab in (quick, slow):
            await part(tab)  # the head
        times = []
        for _ in range(4):
            await quick.send_json({"kind": "drawn"})
            newest, data = await part(quick)
            times.append(newest)
            sizes.append(len(data))
        await slow.send_json({"kind": "drawn"})
        newest, _ = await part(slow)
        assert newest >= times[-1]
        return times, len(sizes)

    times, _ = talk(viewer, page, kept=kept)
    assert times == sorted(set(times))


@pytest.mark.parametrize("nonsense", ["", "[1]", "{}", '{"kind": "none"}', '{"kind": "ping", "at": NaN}'])
def test_nonsense_ends_the_connection_and_nothing_else(
    viewer: ViewerProcess, kept: dict[str, str], nonsense: str
) -> None:
    async def page(tab: Socket) -> int | None:
        await tab.send_str(nonsense)
        return await closed(tab)

    assert talk(viewer, page, kept=kept) == 1008
    assert viewer.process.poll() is None


def test_a_page_that_does_not_read_delays_nobody(loop: ViewedLoop, viewer: ViewerProcess, kept: dict[str, str]) -> None:
    address, _, port = place(viewer).partition(":")
    origin = {"Host": place(viewer), "Origin": f"http://{place(viewer)}"}
    deaf = []
    for _ in range(7):
        made = socket.create_connection((address, int(port)))
        lines = [f"{name}: {value}" for name, value in (kept | origin | UPGRADE).items()]
        made.sendall(("\r\n".join(["GET /socket HTTP/1.1", *lines]) + "\r\n\r\n").encode())
        assert made.recv(12) == b"HTTP/1.1 101"
        deaf.append(made)

    async def page(tab: Socket) -> Any:
        await part(tab)
        first = None
        for _ in range(5):
            await tab.send_json({"kind": "drawn"})
            newest, _ = await part(tab)
            first = first or newest
        return await asyncio.to_thread(get, viewer, "/stop", "POST", **kept, Origin=origin["Origin"]), newest > first

    stops = loop.stops
    try:
        answer, moved = talk(viewer, page, kept=kept)
        assert (answer.status, moved, loop.stops) == (200, True, stops + 1)
    finally:
        loop.state = State.ACTIVE
        for made in deaf:
            made.close()


# The end


@pytest.mark.slow
def test_the_runs_end_is_said_and_nothing_is_kept(tmp_path: Path) -> None:
    loop = ViewedLoop(tmp_path / "run")
    for _ in range(5):
        loop.step()
    before = sorted(p.name for p in tmp_path.rglob("*"))
    with ViewerProcess(loop.folder.path) as viewer:

        async def page(tab: Socket) -> None:
            await part(tab)
            loop.ring.finish()
            await tab.send_json({"kind": "drawn"})
            newest, _ = await part(tab)
            assert newest > 0
            await tab.send_json({"kind": "drawn"})
            assert (await heard(tab, "now", condition="ended"))["words"] == "The run is over"
            assert await closed(tab) == 1001

        talk(viewer, page)
        assert viewer.process.wait(30) == 0
        assert viewer.process.stderr is not None
        assert viewer.process.stderr.read() == ""
    assert sorted(p.name for p in tmp_path.rglob("*")) == before
    assert loop.ring.consumed == 0  # the recorder's mark


def test_without_a_run_or_reruns_viewer_it_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "Ending", lambda **_: None)  # it would be this process's
    monkeypatch.setattr(os, "nice", lambda _: 0)
    monkeypatch.setattr(sys, "argv", ["srl.runtime.web.viewing", str(tmp_path)])
    assert command.main() == 2
    assert "Is the run up?" in capsys.readouterr().err
    monkeypatch.setattr(assets, "find_spec", lambda _: None)
    assert command.main() == 2
    assert "Install rerun-sdk anew" in capsys.readouterr().err
