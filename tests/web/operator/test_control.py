"""The control of a run: one `srl panel` has it, and one that hangs, or whose page does, loses it."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from pathlib import Path

import aiohttp
import pytest
from helpers.operated import OperatedLoop
from helpers.operator_page import Socket, cookie, heard, place, take, talk

from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.web.operator import control
from srl.runtime.web.operator.client import OperatorPage
from srl.runtime.web.operator.control import LAPSE, Control


def test_one_that_gives_no_sign_of_life_is_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = RunFolder(tmp_path)
    hung, other, third = Control(folder), Control(folder), Control(folder)
    assert hung.take() == ""
    assert "Another `srl panel`" in other.take()
    now = time.monotonic_ns()
    monkeypatch.setattr(control.time, "monotonic_ns", lambda: now + round((LAPSE + 0.1) * 1e9))
    hung.live()
    assert "Another `srl panel`" in other.take()
    monkeypatch.setattr(control.time, "monotonic_ns", lambda: now + round((2.0 * LAPSE + 0.2) * 1e9))
    assert other.take() == ""
    assert (hung.held, other.held) == (False, True)
    assert os.stat(folder.panel_lock).st_mode & 0o777 == 0o600
    hung.live()  # what it still does, it does to its own file
    assert "Another `srl panel`" in hung.take()
    assert "Another `srl panel`" in third.take()
    other.release()
    assert third.take() == ""
    third.release()


@pytest.mark.slow
def test_a_silent_page_and_a_hung_panel_lose_the_control(
    loop: OperatedLoop, page: OperatorPage, tmp_path: Path
) -> None:
    kept = cookie(page)

    async def silent() -> None:
        headers = {**kept, "Origin": f"http://{place(page)}"}
        async with (
            aiohttp.ClientSession(headers=headers) as session,
            session.ws_connect(f"ws://{place(page)}/socket") as tab,
        ):
            await take(tab)
            assert "silent for 3 s" in (await heard(tab, "answer", what="control"))["words"]
            await heard(tab, "control", yours=False, held=False)

    asyncio.run(asyncio.wait_for(silent(), 60))
    with OperatorPage(loop.folder, tmp_path) as other:
        others = cookie(other)

        async def second(tab: Socket) -> None:
            while True:
                await tab.send_json({"kind": "control", "take": True})
                while (message := await tab.receive_json())["kind"] != "answer":
                    if message["kind"] == "control" and message["yours"]:
                        return
                assert "Another `srl panel`" in message["words"]
                await asyncio.sleep(0.2)

        async def hung(tab: Socket) -> None:
            await take(tab)
            os.kill(page.pid, signal.SIGSTOP)
            try:
                await asyncio.to_thread(talk, other, second, kept=others)
            finally:
                os.kill(page.pid, signal.SIGCONT)
            await heard(tab, "control", yours=False)

        talk(page, hung, kept=kept)
