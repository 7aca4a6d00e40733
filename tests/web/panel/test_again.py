"""New addresses of pages that are there, asked for on this machine."""

from __future__ import annotations

import asyncio
import os
import socket
from contextlib import AsyncExitStack
from pathlib import Path

import pytest

from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.web.panel import again


async def asked(run: RunFolder, *pages: str) -> list[tuple[str, str]]:
    """What one hears while these pages are served."""
    async with AsyncExitStack() as stack:
        for page in pages:
            await stack.enter_async_context(again.answering(run, page, lambda page=page: f"http://{page}"))
        return await asyncio.to_thread(again.ask, run)


def test_each_page_that_is_served_gives_a_new_address(tmp_path: Path) -> None:
    run = RunFolder(tmp_path)
    assert asyncio.run(asked(run, "one", "two")) == [("one", "http://one"), ("two", "http://two")]
    assert again.ask(run) == []
    assert list(tmp_path.iterdir()) == []


def test_another_page_that_begins_leaves_the_address_of_the_first(tmp_path: Path) -> None:
    made: list[str] = []

    def address() -> str:
        made.append("new")
        return "http://one"

    async def both() -> None:
        async with again.answering(run, "one", address), again.answering(run, "two", lambda: "http://two"):
            await asyncio.to_thread(again.ask, run)

    run = RunFolder(tmp_path)
    asyncio.run(both())
    assert made == ["new"]


def test_what_a_killed_page_left_is_no_hindrance(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as killed:
        killed.bind(str(tmp_path / "page0.sock"))
    assert asyncio.run(asked(RunFolder(tmp_path), "one")) == [("one", "http://one")]


def test_another_user_hears_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: own + 1)
    assert asyncio.run(asked(RunFolder(tmp_path), "one")) == []


def test_a_page_whose_socket_has_no_room_is_served_all_the_same(tmp_path: Path) -> None:
    deep = tmp_path / ("d" * 100)
    deep.mkdir()
    assert asyncio.run(asked(RunFolder(deep), "one")) == []
