"""A calibration guided on the panel: the same procedure as on the terminal, pressed through a page."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import socket
import threading
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.ft_calibration import PROFILE, Turner
from helpers.operated import OperatedLoop
from helpers.operator_page import Socket, heard, take, talk
from helpers.wait import until

from srl.commissioning.calibration import method
from srl.commissioning.calibration.ft import method as ft_method
from srl.commissioning.calibration.ft import report as ft_report
from srl.commissioning.calibration.sources import Rows
from srl.runtime.cli import main
from srl.runtime.ipc.guidance import GUIDE, OVER, REPORT, GuideEnd, GuideReader
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.models import record_file
from srl.runtime.web.operator.client import OperatorPage

PNG = b"\x89PNG as drawn"
Talk = Callable[[Socket], Awaitable[Any]]


class Slow(Turner):
    """One whose steps last as long as those of a quick person."""

    def take(self) -> Rows:
        time.sleep(0.02)
        return super().take()


@pytest.fixture
def calibrated(
    loop: OperatedLoop, page: OperatorPage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[Turner, Talk], int]:
    """`srl calibrate led.yaml ft --panel` whose rows are made up, while somebody acts on the page."""
    (tmp_path / "led.yaml").write_text(PROFILE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(ft_report, "draw", lambda _, png: png.write_bytes(PNG))

    def run(actor: Turner, acts: Talk) -> int:
        async def acting(tab: Socket) -> None:
            await acts(tab)

        actor.folder = loop.folder  # type: ignore[attr-defined]
        monkeypatch.setattr(method, "Live", lambda *_, **__: actor)
        failed: list[BaseException] = []

        def act() -> None:
            try:
                talk(page, acting)
            except BaseException as error:
                failed.append(error)
                raise

        other = threading.Thread(target=act)
        other.start()
        try:
            code = main(["calibrate", "led.yaml", "ft", "--panel"])
        finally:
            other.join()
        assert not failed
        return code

    return run


async def press(tab: Socket, typed: str, step: int) -> None:
    await tab.send_json({"kind": "guide", "typed": typed, "step": step})


class Paced(Turner):
    """Rows come slowly until the test has heard of the step: of what lasts an instant a page may hear nothing."""

    def __init__(self, touched: dict[int, float]) -> None:
        super().__init__(touched=touched)
        self.heard = threading.Event()

    def take(self) -> Rows:
        self.heard.wait(0.2)
        return super().take()


@pytest.mark.slow
def test_a_sensor_is_calibrated_on_the_page(calibrated: Callable[[Turner, Talk], int], tmp_path: Path) -> None:
    actor = Paced(touched={3: 4.0})

    async def acts(tab: Socket) -> None:
        shown = await heard(tab, GUIDE, asks=False)
        assert shown["title"] == "srl calibrate led.yaml ft"
        assert len(shown["states"]) == 8
        actor.heard.set()
        report = await heard(tab, REPORT)
        assert any(reason.startswith("pose 3: ") for reason in report["refused"])
        assert base64.b64decode(report["picture"]) == PNG
        await press(tab, "q", report["step"])
        assert "doesn't have control" in (await heard(tab, "answer", what="guide"))["words"]
        await take(tab)
        await press(tab, "q", report["step"] - 1)
        while "too late" not in " ".join((await heard(tab, GUIDE, asks=True))["said"]):
            pass
        actor.touched = {}
        actor.heard.clear()
        await press(tab, "r 3", report["step"])
        again = await heard(tab, GUIDE, asks=False)
        actor.heard.set()
        assert again["states"][2] == "now"
        assert again["task"].startswith("Turn the sensor: its x axis up")
        report = await heard(tab, REPORT)
        assert report["refused"] == []
        assert any("tool: 0.4" in line for line in report["lines"])
        assert not (tmp_path / "handle.json").exists()
        await press(tab, "", report["step"])
        over = await heard(tab, OVER)
        assert over["ok"]
        assert "handle.json" in over["words"]

    assert calibrated(actor, acts) == 0
    assert record_file.read(ft_method.FtMethod.record_type, tmp_path / "handle.json")
    assert actor.closed


def test_it_is_broken_off_on_the_page(calibrated: Callable[[Turner, Talk], int], tmp_path: Path) -> None:
    async def acts(tab: Socket) -> None:
        await take(tab)
        while (message := await tab.receive_json())["kind"] != OVER or message["ok"]:
            if message["kind"] == GUIDE:
                assert not message["asks"]
                await press(tab, "q", message["step"])
        assert "before it was complete" in message["words"]

    assert calibrated(Slow(), acts) == 2
    assert not (tmp_path / "handle.json").exists()


@pytest.mark.parametrize("more", [["--sim"], ["--recording", "a.rrd"]])
def test_what_nobody_does_needs_no_page(more: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "kairos-man", "ft", "--panel", "-o", str(tmp_path / "a.json"), *more]) == 2
    assert "--panel: " in capsys.readouterr().err


@pytest.mark.parametrize(
    "output", [b"{}\n", b'{"typed": "a\\u0007", "step": 1}\n', b'{"typed": "", "step": true}\n', b"x" * 5000, b"[1]\n"]
)
def test_what_no_panel_says_ends_its_line_and_nothing_else(tmp_path: Path, output: bytes) -> None:
    folder = RunFolder(tmp_path)
    end, good = GuideEnd(folder), GuideReader(folder)
    end.tell({"kind": GUIDE, "asks": False, "task": "Hold still"})
    good.look()
    with socket.socket(socket.AF_UNIX) as bad:
        bad.connect(str(folder.guide_socket))
        bad.sendall(output)
        assert end.heard() == []
        assert good.type("r 3", 7)
        assert end.heard() == [("r 3", 7)]
        bad.settimeout(5.0)
        with contextlib.suppress(ConnectionResetError):
            while bad.recv(4096):
                pass
    assert [message["task"] for message in good.take()] == ["Hold still"]
    end.close()
    assert good.take() == []
    assert not good.there


def test_a_reader_that_takes_nothing_keeps_nobody_waiting(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    end, slow = GuideEnd(folder), GuideReader(folder)
    slow.look()
    end.heard()
    for step in range(3000):
        end.tell({"kind": GUIDE, "asks": False, "step": step, "task": 300 * "x"})
    end.tell({"kind": REPORT, "lines": ["last"]})

    found = []

    def last() -> bool:
        end.heard()
        found.extend(slow.take())
        return bool(found) and found[-1]["kind"] == REPORT

    until(last)
    assert len(found) < 3000  # what was replaced never left
    end.close()


def test_a_calibration_that_dies_is_said_to_have_died(loop: OperatedLoop, page: OperatorPage) -> None:
    async def acts(tab: Socket) -> None:
        with socket.socket(socket.AF_UNIX) as listener:
            listener.bind(str(loop.folder.guide_socket))
            listener.listen()
            end, _ = await asyncio.to_thread(listener.accept)
            end.sendall(json.dumps({"kind": GUIDE, "asks": False, "task": "Hold still"}).encode() + b"\n")
            await heard(tab, GUIDE, task="Hold still")
            end.close()
        while "without a word" not in (await heard(tab, OVER, ok=False))["words"]:  # one before may have ended, too
            pass

    try:
        talk(page, acts)
    finally:
        loop.folder.guide_socket.unlink()
