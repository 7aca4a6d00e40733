"""`srl run --view`: the panel's process beside a run. It ends with the run, and its address is on a line of its own."""

from __future__ import annotations

import asyncio
import json
import os
import pty
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import aiohttp
import numpy as np
import pytest
from helpers.held_up import HELD_UP, unless_held_up
from helpers.panel import shown
from helpers.viewed import ViewedLoop
from helpers.wait import until

from srl.runtime.web.panel import again

pytestmark = pytest.mark.slow

_HELD = 100.0  # ms without a row, in which the loop may have been silent for the panel
ADDRESS = re.compile(r"viewer: (http://127\.0\.0\.1:\d+/\?token=[\w-]{32})")


@contextmanager
def viewing(folder: Path, **options: Any) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "srl.runtime.web.viewing", str(folder)]
    process = subprocess.Popen(command, **{"stderr": subprocess.PIPE, "text": True} | options)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


async def scene(address: str) -> dict[str, Any]:
    """What the page gets first."""
    origin = address.partition("/?")[0]
    async with aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as session:
        async with session.get(address) as answer:
            headers = shown(await answer.text()) | {"Origin": origin}
        async with session.ws_connect(f"{origin}/socket", headers=headers) as socket:
            return dict(json.loads((await socket.receive(30)).data))


def test_the_page_is_the_panel_and_ends_with_the_run(tmp_path: Path) -> None:
    loop = ViewedLoop(tmp_path / "run")
    with viewing(loop.folder.path) as process:
        with loop.running():
            assert process.stderr is not None
            found = ADDRESS.fullmatch(process.stderr.readline().strip())
            assert found
            first = asyncio.run(scene(found[1]))
            assert (first["kind"], first["name"]) == ("scene", "made-up")
            ((page, address),) = again.ask(loop.folder)
            assert page == "the panel"
            assert asyncio.run(scene(address))["name"] == "made-up"
        assert process.poll() is None  # a loop that hangs isn't over
        loop.ring.finish()
        assert process.wait(30) == 0
    assert again.ask(loop.folder) == []


def test_asked_to_end_it_does_so_once_the_loop_is_silent(tmp_path: Path) -> None:
    unless_held_up(_ends_once_the_loop_is_silent, tmp_path)


def _ends_once_the_loop_is_silent(folder: Path) -> None:
    loop = ViewedLoop(folder / "run")
    with viewing(loop.folder.path) as process:
        with loop.running():
            assert process.stderr is not None
            found = ADDRESS.fullmatch(process.stderr.readline().strip())
            assert found
            asyncio.run(scene(found[1]))  # it has read rows: before, a loop is silent for it
            cycle = loop.cycle
            until(lambda: loop.cycle > cycle + 50)
            process.send_signal(signal.SIGTERM)
            cycle = loop.cycle
            until(lambda: loop.cycle > cycle + 50)
            longest = float(np.diff(loop.times).max())  # ms without a row
            assert process.poll() is None, HELD_UP if longest > _HELD else f"it ended beside a loop with {longest} ms"
        assert process.wait(30) == 0


def test_without_a_run_it_says_so(tmp_path: Path) -> None:
    with viewing(tmp_path) as process:
        assert process.wait(60) == 2
        assert process.stderr is not None
        assert "Is the run up?" in process.stderr.read()


def test_on_a_terminal_its_address_begins_a_line(tmp_path: Path) -> None:
    loop = ViewedLoop(tmp_path / "run")
    own, other = pty.openpty()
    try:
        with loop.running(), viewing(loop.folder.path, stderr=other, text=False):
            os.write(other, b"ACTIVE 3.1 s")  # the run's status, which has no end
            said = b""

            def came() -> bool:
                nonlocal said
                said += os.read(own, 4096)
                return said.endswith(b"\n")

            until(came)
        status, _, line = said.decode().partition("\r\x1b[2K")
        assert status == "ACTIVE 3.1 s"  # it is erased
        assert ADDRESS.fullmatch(line.strip())
    finally:
        os.close(own)
        os.close(other)
