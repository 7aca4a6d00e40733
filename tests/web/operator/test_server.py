"""The panel's server: who may command, what reaches the loop, and what never does."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from helpers.bus import Instance
from helpers.operated import OperatedLoop
from helpers.operator_page import Socket, closed, cookie, get, heard, place, ponged, take, talk
from helpers.recording import make_layout, make_rows
from helpers.wait import until

from srl.runtime.ipc.control_socket import LIFETIME
from srl.runtime.ipc.header import State
from srl.runtime.ipc.presses import FRESH
from srl.runtime.recorder.stream import Stream
from srl.runtime.web.operator.client import OperatorPage
from srl.runtime.web.operator.server import FLOOD, OperatorServer
from srl.runtime.web.panel import again

# What a page may say


NONSENSE = [
    '{"kind": "none"}', '{"kind": "control"}', '{"kind": "control", "take": 1}', '{"kind": "ask", "what": "exit"}',
    '{"kind": "ask", "what": "stop", "seen": 1}', '{"kind": "ask", "what": "reset"}', '{"kind": "ask", "seen": 1}',
    '{"kind": "ask", "what": "reset", "seen": NaN}', '{"kind": "ask", "what": ["reset"], "seen": 1}',
    '{"kind": "set", "name": "jog.gain", "value": NaN}', '{"kind": "set", "name": "jog.gain", "value": "1"}',
    '{"kind": "set", "name": "jog.gain", "value": 1e400}', '{"kind": "set", "name": "jog.gain", "value": null}',
    '{"kind": "set", "name": "jog.gain", "value": true}', '{"kind": "set", "name": "other", "value": 1}',
    '{"kind": "set", "name": {}, "value": 1}', '{"kind": "jog", "joint": 2, "way": 1, "heard": 1}',
    '{"kind": "jog", "joint": -1, "way": 1, "heard": 1}', '{"kind": "jog", "joint": 0, "way": 2, "heard": 1}',
    '{"kind": "jog", "joint": 0, "way": NaN, "heard": 1}', '{"kind": "jog", "joint": 0, "way": 1}',
    '{"kind": "jog", "joint": true, "way": 1, "heard": 1}', '{"kind": "jog", "joint": 0.5, "way": 1, "heard": 1}',
    '{"kind": "jog", "joint": 0, "way": 1, "heard": "now"}', '{"kind": "jog", "joint": [], "way": {}, "heard": 1}',
]  # fmt: skip


@pytest.mark.parametrize("nonsense", NONSENSE)
def test_nonsense_ends_the_connection_and_reaches_nobody(loop: OperatedLoop, page: OperatorPage, nonsense: str) -> None:
    async def output(tab: Socket) -> int | None:
        await take(tab)
        await tab.send_str(nonsense)
        return await closed(tab)

    assert talk(page, output) == 1008
    assert not loop.asked
    assert not loop.presses


def test_a_flood_ends_the_connection_and_the_next_one_is_served(loop: OperatedLoop, page: OperatorPage) -> None:
    kept = cookie(page)

    async def flood(tab: Socket) -> int | None:
        try:
            for _ in range(3 * FLOOD):
                await tab.send_json({"kind": "ping", "at": 0})
        except ConnectionError:
            pass
        return await closed(tab)

    assert talk(page, flood, kept=kept) in (1006, 1008)  # the words may be lost among what wasn't read

    async def calm(tab: Socket) -> None:
        await heard(tab, "frame", condition="live")

    talk(page, calm, kept=kept)


# Who may command


def test_without_control_a_page_only_stops(loop: OperatedLoop, page: OperatorPage) -> None:
    kept, stops = cookie(page), loop.stops

    async def without(first: Socket, second: Socket) -> None:
        await take(first)
        frame = await heard(second, "frame")
        await second.send_json({"kind": "ask", "what": "reset", "seen": frame["seen"]})
        assert "control" in (await heard(second, "answer"))["words"]
        await second.send_json({"kind": "set", "name": "jog.gain", "value": 1.0})
        assert "control" in (await heard(second, "answer"))["words"]
        await second.send_json({"kind": "jog", "joint": 0, "way": 1, "heard": (await heard(second, "frame"))["told"]})
        await ponged(second)

    talk(page, without, kept=kept)
    assert not loop.asked
    assert not loop.presses
    assert get(page, "/stop", "POST", **kept, Origin=f"http://{place(page)}").status == 200
    assert loop.stops == stops + 1


def test_control_goes_to_the_tab_that_takes_it_and_ends_with_it(page: OperatorPage) -> None:
    async def both(first: Socket, second: Socket) -> None:
        await take(first)
        await heard(second, "control", yours=False, held=True)
        await take(second)
        await heard(first, "control", yours=False, held=True)
        await second.close()
        await heard(first, "control", yours=False, held=False)

    talk(page, both)


@pytest.mark.slow
def test_the_browser_that_takes_a_new_address_ends_the_one_before(loop: OperatedLoop, page: OperatorPage) -> None:
    async def replaced(tab: Socket) -> int | None:
        await take(tab)
        ((_, address),) = await asyncio.to_thread(again.ask, loop.folder)
        await ponged(tab)  # the address alone changes nothing
        assert (await asyncio.to_thread(get, page, f"/?{urlsplit(address).query}")).status == 200
        return await closed(tab)

    assert talk(page, replaced) == 1008


def test_of_several_panels_of_a_run_one_has_control(loop: OperatedLoop, page: OperatorPage, tmp_path: Path) -> None:
    refused: list[str] = []

    with OperatorPage(loop.folder, tmp_path) as other:
        kept, others = cookie(page), cookie(other)

        async def second(tab: Socket) -> bool:
            await tab.send_json({"kind": "control", "take": True})
            while (message := await tab.receive_json())["kind"] != "answer":
                if message["kind"] == "control" and message["yours"]:
                    return True
            refused.append(message["words"])
            await tab.send_json({"kind": "jog", "joint": 0, "way": 1, "heard": (await heard(tab, "frame"))["told"]})
            await ponged(tab)
            return False

        async def first(tab: Socket) -> None:
            await take(tab)
            assert not await asyncio.to_thread(talk, other, second, kept=others)
            await tab.send_json({"kind": "control", "take": False})
            await heard(tab, "control", yours=False, held=False)
            assert await asyncio.to_thread(talk, other, second, kept=others)
            await take(tab)

        talk(page, first, kept=kept)
        assert not loop.presses
        assert "Another `srl panel`" in refused[0]

        async def killed(tab: Socket) -> None:
            await take(tab)
            os.kill(other.pid, signal.SIGKILL)

        talk(other, killed, kept=others)
        until(lambda: not other.alive)
    assert talk(page, second, kept=kept)


def test_a_reset_is_that_of_srl_reset_as_of_what_the_page_saw(loop: OperatedLoop, page: OperatorPage) -> None:
    loop.state = State.STOPPED

    async def reset(tab: Socket) -> tuple[dict[str, Any], int]:
        await take(tab)
        seen = (await heard(tab, "frame", state="stopped"))["seen"]
        await tab.send_json({"kind": "ask", "what": "reset", "seen": seen})
        return await heard(tab, "answer"), seen

    answer, seen = talk(page, reset)
    assert answer == {"kind": "answer", "what": "reset", "ok": True, "words": "reset: done, active"}
    assert loop.asked == [{"ask": "reset", "expires": seen * 1000 + LIFETIME}]


def test_a_run_of_srl_jog_judges_its_resets_itself(loop: OperatedLoop, page: OperatorPage) -> None:
    async def reset(tab: Socket) -> dict[str, Any]:
        await take(tab)
        await tab.send_json({"kind": "ask", "what": "reset", "seen": (await heard(tab, "frame"))["seen"]})
        return await heard(tab, "answer")

    loop.state = State.STOPPED
    kept = cookie(page)
    assert talk(page, reset, kept=kept)["ok"]
    assert [asked["ask"] for asked in loop.judged] == ["reset"]
    # The keys, and so the reset, are a terminal's.
    loop.state, socket = State.STOPPED, loop.folder.press_socket
    away = socket.rename(socket.with_name("away"))
    try:
        answer = talk(page, reset, kept=kept)
    finally:
        away.rename(socket)
    assert not answer["ok"]
    assert "on its terminal" in answer["words"]
    assert len(loop.asked) == 1


def test_what_a_refusal_said_is_told(loop: OperatedLoop, page: OperatorPage) -> None:
    loop.state, loop.refuses = State.STOPPED, "what caused the stop is still there"

    async def reset(tab: Socket) -> dict[str, Any]:
        await take(tab)
        await tab.send_json({"kind": "ask", "what": "reset", "seen": (await heard(tab, "frame"))["seen"]})
        return await heard(tab, "answer")

    answer = talk(page, reset)
    assert answer["words"] == "reset refused, stopped: what caused the stop is still there"
    assert not answer["ok"]


def test_a_page_cannot_see_the_future(loop: OperatedLoop, page: OperatorPage) -> None:
    async def ahead(tab: Socket) -> None:
        await take(tab)
        frame = await heard(tab, "frame")
        await tab.send_json({"kind": "ask", "what": "reset", "seen": frame["seen"] + 60_000_000})
        await heard(tab, "answer")
        await tab.send_json({"kind": "jog", "joint": 0, "way": 1, "heard": frame["told"] + 60_000})
        await ponged(tab)

    talk(page, ahead)
    assert loop.asked[0]["expires"] <= time.monotonic_ns() + LIFETIME
    assert not loop.presses


# Jog


def test_a_press_lives_from_the_picture_that_it_answers(loop: OperatedLoop, page: OperatorPage) -> None:
    async def press(tab: Socket) -> float:
        await take(tab)
        reported = 0.0
        while not loop.presses:  # on a busy machine a press may be too late
            reported = (await heard(tab, "frame"))["told"]
            await tab.send_json({"kind": "jog", "joint": 1, "way": -1, "heard": reported})
            await ponged(tab)
        return reported

    reported = talk(page, press)
    _, newest = loop.presses[-1]
    assert (newest["joint"], newest["way"]) == (1, -1)
    assert newest["expires"] <= round((reported / 1e3 + FRESH) * 1e9)


def test_a_press_that_waited_somewhere_is_dropped(loop: OperatedLoop, page: OperatorPage) -> None:
    async def late(tab: Socket) -> None:
        await take(tab)
        first = (await heard(tab, "frame"))["told"]
        while (await heard(tab, "frame"))["told"] < first + 1e3 * FRESH:
            pass
        await tab.send_json({"kind": "jog", "joint": 0, "way": 1, "heard": first})
        await ponged(tab)

    talk(page, late)
    assert not loop.presses


# Recordings


def save(path: Path, name: str) -> None:
    layout = make_layout(extra=1)
    layout.meta |= {"name": name}
    stream = Stream(layout.text)
    stream.recording.save(path)
    stream.prologue(None)
    stream.rows(np.arange(1, 51), make_rows(layout, 50))
    stream.recording.disconnect()


@pytest.mark.slow
def test_recordings_of_the_profile_are_listed(loop: OperatedLoop, tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    save(tmp_path / "sub" / "one.rrd", "made-up")
    save(tmp_path / "other.rrd", "another")
    (tmp_path / "<b>.rrd").write_bytes(b"no recording")

    async def listed(tab: Socket) -> dict[str, Any]:
        await tab.send_json({"kind": "recordings"})
        return await heard(tab, "recordings")

    with OperatorPage(loop.folder, tmp_path) as page:
        found = talk(page, listed)
    assert [row["name"] for row in found["rows"]] == ["sub/one.rrd"]
    assert found["rows"][0]["bytes"] == (tmp_path / "sub" / "one.rrd").stat().st_size
    with OperatorPage(loop.folder, tmp_path / "none") as page:
        assert "no such folder" in talk(page, listed)["words"]


# Parameters, over a bus


@pytest.fixture(scope="module")
def instance(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Instance]:
    made = Instance(tmp_path_factory.mktemp("b") / "panel")
    yield made
    made.close()


@pytest.mark.slow
def test_a_parameter_is_set_over_the_bus_and_read_back_from_the_loop(instance: Instance) -> None:
    async def change(tab: Socket) -> list[str]:
        scene = await heard(tab, "scene")
        assert [p["name"] for p in scene["parameters"]] == ["object-mapping.pull"]
        await take(tab)
        await tab.send_json({"kind": "set", "name": "object-mapping.pull", "value": 2.5})
        words = [(await heard(tab, "answer"))["words"]]
        while (await heard(tab, "frame"))["values"] != [2.5]:
            pass
        taken = len(instance.run.taken)
        for value in (5.1, -0.1, 1e14):
            await tab.send_json({"kind": "set", "name": "object-mapping.pull", "value": value})
            words.append((await heard(tab, "answer", ok=False))["words"])
        assert len(instance.run.taken) == taken
        return words

    with OperatorPage(instance.run_folder) as page:
        words = talk(page, change)
    assert words[0] == "object-mapping.pull: 2.5"
    assert all("out of bounds (0 to 5)" in output for output in words[1:])


@pytest.mark.slow
def test_of_many_changes_the_loop_gets_the_newest(instance: Instance) -> None:
    async def many(tab: Socket) -> None:
        await take(tab)
        for value in range(200):
            await tab.send_json({"kind": "set", "name": "object-mapping.pull", "value": value / 100})
        while (await heard(tab, "frame"))["values"] != [1.99]:
            pass

    before = len(instance.run.taken)
    with OperatorPage(instance.run_folder) as page:
        talk(page, many)
    assert len(instance.run.taken) - before < 200


def test_a_run_without_a_bus_says_so(loop: OperatedLoop, page: OperatorPage) -> None:
    async def change(tab: Socket) -> dict[str, Any]:
        await take(tab)
        await tab.send_json({"kind": "set", "name": "jog.gain", "value": 1.0})
        return await heard(tab, "answer")

    answer = talk(page, change)
    assert not answer["ok"]
    assert "has no bus" in answer["words"]


# The end


@pytest.mark.slow
def test_the_loop_goes_on_when_the_panel_is_killed(loop: OperatedLoop) -> None:
    with OperatorPage(loop.folder) as page:
        os.kill(page.pid, 9)
        until(lambda: not page.alive)
    cycle = loop.cycle
    until(lambda: loop.cycle > cycle + 5)
    assert loop.state is State.ACTIVE or loop.stops
    assert OperatorServer.files["/"][0] == "picture.html"
