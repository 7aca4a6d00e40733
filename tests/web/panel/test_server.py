"""The page's server against what isn't its page: other hosts, other sites, other browsers, nonsense, silence."""

from __future__ import annotations

import asyncio
import http.client
import json
import os
import signal
import threading
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import aiohttp
import numpy as np
import psutil
import pytest
from helpers.panel import SIGNAL, MadeUpLoop, shown
from helpers.run import alive
from helpers.wait import until

from srl.runtime.contracts.errors import HostError, RecordingError
from srl.runtime.ipc.header import State
from srl.runtime.web.panel.pages import PAGE, listen
from srl.runtime.web.panel.peer import LONGEST
from srl.runtime.web.panel.picture import PictureServer
from srl.runtime.web.panel.screen import Screen
from srl.runtime.web.panel.trial import ScreenTrial, Trial

Socket = aiohttp.ClientWebSocketResponse
SHORT = Trial((0.5, 0.5, 0.6), duration=0.3, settle=0.0, title="Short", number=1, of=2)
LONG = Trial((0.5, 0.5), duration=600.0, settle=0.0)


@pytest.fixture(scope="module")
def loop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[MadeUpLoop]:
    with MadeUpLoop(tmp_path_factory.mktemp("p") / "run").running() as made:
        yield made


@pytest.fixture(scope="module")
def process(loop: MadeUpLoop) -> Iterator[Screen]:
    with Screen(loop.folder, SIGNAL) as made:
        yield made


@pytest.fixture
def screen(loop: MadeUpLoop, process: Screen) -> Screen:
    """A screen that nobody has opened yet."""
    loop.state = State.ACTIVE
    process.new_address()
    return process


def place(screen: Screen) -> str:
    return urlsplit(screen.address).netloc


def get(screen: Screen, path: str, method: str = "GET", **headers: str) -> http.client.HTTPResponse:
    return asked(screen, path, method, **headers)[0]


def asked(screen: Screen, path: str, method: str, **headers: str) -> tuple[http.client.HTTPResponse, str]:
    """One request with exactly these headers; `Host` is the server's own unless given. The answer and its text."""
    connection = http.client.HTTPConnection(place(screen), timeout=20)
    connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
    for name, value in ({"Host": place(screen)} | headers).items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    words = answer.read().decode()
    connection.close()
    return answer, words


def cookie(screen: Screen) -> dict[str, str]:
    """What the browser that took the address shows from then on: the cookie, and its page's key."""
    answer, words = asked(screen, f"/?{urlsplit(screen.address).query}", "GET")
    assert answer.status == 200
    return {"Cookie": str(answer.headers["Set-Cookie"]).partition(";")[0]} | shown(words)


def talk(screen: Screen, kept: dict[str, str], what: Callable[[Socket], Awaitable[Any]]) -> Any:
    """Speaks over a websocket as the participant's page does, once the page before it has gone."""

    async def run() -> Any:
        headers = {**kept, "Origin": f"http://{place(screen)}"}
        async with aiohttp.ClientSession(headers=headers) as session:
            while True:
                async with session.ws_connect(f"ws://{place(screen)}/socket") as socket:
                    if (await heard(socket, "hello"))["participant"]:
                        return await what(socket)

    return asyncio.run(asyncio.wait_for(run(), 60))


async def heard(socket: aiohttp.ClientWebSocketResponse, kind: str, **content: object) -> dict[str, Any]:
    """The next message of a kind with this content."""
    while True:
        message: dict[str, Any] = await socket.receive_json()
        if message["kind"] == kind and content.items() <= message.items():
            return message


async def begin(socket: Socket) -> float:
    """Begins the trial that waits, as a person does: again, if the value wasn't live that moment. Returns its begin."""
    await heard(socket, "state", phase="waiting")
    while True:
        await heard(socket, "value", condition="live")
        await socket.send_json({"kind": "begin"})
        while (message := await socket.receive_json())["kind"] not in ("notice", "state"):
            pass
        if message["kind"] == "state":
            assert message["phase"] == "running"
            return float(message["began"])


def run_aside(screen: Screen, trial: Trial) -> tuple[threading.Thread, list[ScreenTrial]]:
    """Runs a trial in a thread of its own."""
    found: list[ScreenTrial] = []
    thread = threading.Thread(target=lambda: found.append(screen.run_trial(trial)), daemon=True)
    thread.start()
    return thread, found


# Who is let in


def test_the_token_is_good_for_one_browser_once(screen: Screen) -> None:
    first = get(screen, f"/?{urlsplit(screen.address).query}")
    assert first.status == 200
    given = first.headers["Set-Cookie"]
    assert "HttpOnly" in given
    assert "SameSite=Strict" in given
    assert get(screen, f"/?{urlsplit(screen.address).query}").status == 403
    kept = {"Cookie": given.partition(";")[0]}
    assert get(screen, "/", **kept).status == 200
    screen.new_address()
    assert get(screen, "/", **kept).status == 200  # until the new address is opened
    second = cookie(screen)
    assert get(screen, "/", **kept).status == 403
    assert get(screen, "/", **second).status == 200


@pytest.mark.parametrize("path", ["/", "/screen.js", "/screen.css", "/socket", "/?token=", "/?token=x"])
def test_without_a_cookie_nothing_is_served(screen: Screen, path: str) -> None:
    assert get(screen, path).status == 403
    assert get(screen, path, Cookie=f"srl-panel-{place(screen).partition(':')[2]}=").status == 403


@pytest.mark.parametrize("host", ["example.org", "localhost", "127.0.0.1", "127.0.0.1:1", "[::1]", ""])
def test_another_host_is_refused(screen: Screen, host: str) -> None:
    kept = cookie(screen)
    assert get(screen, "/", **kept, Host=host).status in (400, 421)
    assert get(screen, "/", **kept).status == 200


@pytest.mark.parametrize("origin", [None, "null", "http://example.org", "http://127.0.0.1:1", "http://localhost"])
def test_another_origin_moves_nothing_and_hears_nothing(loop: MadeUpLoop, screen: Screen, origin: str | None) -> None:
    kept, stops = cookie(screen), loop.stops
    foreign = kept | ({"Origin": origin} if origin else {})
    assert get(screen, "/stop", "POST", **foreign).status == 403
    upgrade = {
        "Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    }  # fmt: skip
    assert get(screen, "/socket", **foreign, **upgrade).status == 403
    if origin:
        assert get(screen, "/", **foreign).status == 403
    assert loop.stops == stops
    assert get(screen, "/socket", **kept, Origin=f"http://{place(screen)}", **upgrade).status == 101


def test_every_answer_forbids_what_comes_from_elsewhere(screen: Screen) -> None:
    kept = cookie(screen)
    for answer in (get(screen, "/", **kept), get(screen, "/"), get(screen, "/none", **kept)):
        policy = answer.headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert answer.headers["Cache-Control"] == "no-store"
        assert answer.headers["X-Content-Type-Options"] == "nosniff"


@pytest.mark.parametrize("path", ["/..%2f..%2f__main__.py", "/page/index.html", "/index.html", "//etc/passwd"])
def test_nothing_but_the_page_is_served(screen: Screen, path: str) -> None:
    assert get(screen, path, **cookie(screen)).status in (400, 404)


def test_it_listens_on_loopback_only(screen: Screen) -> None:
    found = [c for c in psutil.Process(screen.pid).net_connections() if c.status == psutil.CONN_LISTEN]
    assert [c.laddr.ip for c in found] == ["127.0.0.1"]


# What a page may say


@pytest.mark.parametrize(
    "nonsense",
    [
        "", "no json", "[1]", "null", "[" * 5000, "{}", '{"kind": "none"}', '{"kind": "ping"}',
        '{"kind": "ping", "at": NaN}', '{"kind": "ping", "at": "x"}', '{"kind": "frames", "rows": 1, "round_trip": 1}',
        '{"kind": "frames", "rows": [[1, 2]], "round_trip": 1}', '{"kind": "frames", "rows": [[null, 1, 1]]}',
        '{"kind": "frames", "rows": [[1, 2, {}]], "round_trip": 1}', '{"kind": "ping", "at": 1e400}',
        '{"kind": "ping", "at": 1' + "0" * 5000 + "}", "x" * (LONGEST + 1),
    ],
)  # fmt: skip
def test_nonsense_ends_the_connection_and_nothing_else(screen: Screen, nonsense: str) -> None:
    kept = cookie(screen)

    async def nonsensical(socket: Socket) -> int | None:
        await socket.send_str(nonsense)
        while not socket.closed:
            await socket.receive()
        return socket.close_code

    assert talk(screen, kept, nonsensical) in (1008, 1009)
    assert talk(screen, kept, lambda s: heard(s, "value"))["condition"] == "live"


def test_the_clock_is_told_for_each_ping(screen: Screen) -> None:
    async def pinged(socket: Socket) -> dict[str, Any]:
        await socket.send_json({"kind": "ping", "at": 12.5})
        return await heard(socket, "pong")

    assert talk(screen, cookie(screen), pinged)["at"] == 12.5


def test_a_second_page_only_looks_on(screen: Screen) -> None:
    kept = cookie(screen)
    thread, _ = run_aside(screen, SHORT)

    async def both(first: Socket) -> None:
        headers = {**kept, "Origin": f"http://{place(screen)}"}
        async with (
            aiohttp.ClientSession(headers=headers) as session,
            session.ws_connect(f"ws://{place(screen)}/socket") as second,
        ):
            assert not (await heard(second, "hello"))["participant"]
            await heard(second, "state", phase="waiting")
            await second.send_json({"kind": "begin"})
            await second.send_json({"kind": "ping", "at": 0})
            await heard(second, "pong")
            await begin(first)
            await heard(second, "state", phase="running")
        await heard(first, "state", phase="idle")

    talk(screen, kept, both)
    thread.join(30)
    assert not thread.is_alive()


# Trials


def test_a_trial_over_the_wire_gives_the_loops_rows_and_the_pages_frames(screen: Screen, tmp_path: Path) -> None:
    thread, found = run_aside(screen, SHORT)

    async def page(socket: Socket) -> None:
        began = await begin(socket)
        while (await heard(socket, "value"))["t"] < began + 1e3 * SHORT.duration:
            pass
        rows = [[began + 10.0, 0.5, 4.0], [began + 27.0, None, None]]
        await socket.send_json({"kind": "frames", "rows": rows, "final": True, "round_trip": 0.4})
        await heard(socket, "state", phase="idle")

    talk(screen, cookie(screen), page)
    thread.join(30)
    (done,) = found
    assert done.aborted == ""
    assert done.frames[:, 0] == pytest.approx([0.010, 0.027], abs=1e-5)
    assert done.frames[0, 1:] == pytest.approx([0.5, 0.004])
    assert np.isnan(done.frames[1, 1:]).all()
    assert done.round_trip == pytest.approx(0.0004)
    assert len(done.samples) > 1
    assert (done.samples[:, 2] == 0.5).all()
    assert done.samples[:, 1] == pytest.approx(SHORT.target(done.samples[:, 0]))
    done.save(tmp_path / "one")
    assert json.loads((tmp_path / "one.json").read_text())["trial"]["title"] == "Short"
    assert {p.name for p in tmp_path.iterdir()} == {"one.json", "one-frames.parquet", "one-samples.parquet"}


def started(screen: Screen, kept: dict[str, str], then: Callable[[], object]) -> ScreenTrial:
    """A long trial that has begun, and what came of it after `then`."""
    thread, found = run_aside(screen, LONG)

    async def page(socket: Socket) -> None:
        await begin(socket)
        await asyncio.to_thread(then)

    talk(screen, kept, page)
    thread.join(30)
    return found[0]


def test_a_closed_page_breaks_the_trial_off_and_it_can_be_repeated(screen: Screen) -> None:
    kept = cookie(screen)
    for _ in range(2):
        assert started(screen, kept, lambda: None).aborted == "the page was closed"


def test_a_stop_on_the_screen_stops_the_limb(loop: MadeUpLoop, screen: Screen) -> None:
    kept, stops = cookie(screen), loop.stops
    done = started(screen, kept, lambda: get(screen, "/stop", "POST", **kept, Origin=f"http://{place(screen)}"))
    assert done.aborted == "stopped on the screen"
    assert loop.stops == stops + 1


def test_a_trial_that_nobody_begins_can_be_given_up(screen: Screen) -> None:
    assert screen.run_trial(SHORT, timeout=0.1).aborted == "the time for it was over"


# The end


@pytest.mark.slow
def test_the_process_ends_with_the_study(loop: MadeUpLoop) -> None:
    with Screen(loop.folder, SIGNAL) as screen:
        pid = screen.pid
        assert alive(pid)
    assert not alive(pid)


@pytest.mark.slow
def test_the_death_of_the_process_is_said(loop: MadeUpLoop) -> None:
    with Screen(loop.folder, SIGNAL) as screen:
        kill = threading.Timer(0.1, os.kill, (screen.pid, signal.SIGKILL))
        kill.start()
        with pytest.raises(HostError, match="has ended"):
            screen.run_trial(LONG)
        kill.join()
        until(lambda: not screen.alive)


@pytest.mark.slow
def test_a_taken_port_and_a_missing_signal_are_said(loop: MadeUpLoop) -> None:
    with listen(0) as taken, pytest.raises(HostError, match="--web-port"):
        Screen(loop.folder, SIGNAL, port=taken.getsockname()[1])
    with pytest.raises(RecordingError, match=r"law\.c"):
        Screen(loop.folder, "law.nothing")


def test_the_operators_page_is_as_short_as_its_pages_say() -> None:
    size = {name: (PAGE / name).stat().st_size for name, _ in PictureServer.files.values() if (PAGE / name).exists()}
    assert sum(n for name, n in size.items() if not name.startswith("three/")) < 100_000  # docs/panel.md
    assert sum(size.values()) < 900_000
