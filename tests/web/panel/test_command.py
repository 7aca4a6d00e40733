"""`srl panel` beside a real run of a simulated limb."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import aiohttp
import numpy as np
import psutil
import pytest
from helpers.panel import shown
from helpers.run import Running, alive, call, ended, environment, refused, srl
from helpers.wait import until

from srl.runtime.cli.panel import SECONDS, TRIALS, demo_curve
from srl.runtime.ipc.header import Cause, Latch, State
from srl.runtime.web.panel.trial import Trial

SIGNAL = "glove.position[index_mpj]"


def test_the_demonstrations_curves_can_be_shown_and_begin_flat() -> None:
    for number in range(1, TRIALS + 1):
        trial = Trial(demo_curve(number), SECONDS)
        assert np.ptp(trial.target(np.linspace(0.0, 1.4, 50))) == 0.0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--signal", "x"], "no instance"), (["--signal", "x", "--span", "1", "1"], "--span"),
        (["--signal", "x", "--span", "nan", "1"], "--span"), (["--signal", "x", "--web-port", "70000"], "--web-port"),
        (["--signal", "x", "--out", "here"], "--demo"), ([], "no instance"), (["--web-port", "-1"], "--web-port"),
        (["--demo"], "Add --signal"), (["--span", "0", "1"], "Add --signal"), (["--held", "x"], "Add --signal"),
        (["--signal", "x", "--recordings", "."], "--recordings"), (["--again"], "no instance"),
        (["--again", "--signal", "x"], "--signal"), (["--again", "--web-port", "5000"], "--web-port"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: list[str], words: str
) -> None:
    monkeypatch.setenv("SRL_RUNTIME_DIR", str(tmp_path))
    assert words in refused("panel", *options)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with Running(tmp_path_factory.mktemp("r"), "sixth-finger", "--sim", "--confirm") as running:
        running.started()
        running.until(lambda: running.header("state") == State.ACTIVE, "motion")
        yield running


@pytest.mark.slow
def test_without_a_signal_the_page_is_the_panel_with_the_live_picture(run: Running) -> None:
    with ended(srl("panel"), env=environment(run.folder)) as panel:
        assert panel.stdout is not None
        panel.stdout.readline()
        address = panel.stdout.readline().strip()
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\?token=[\w-]{32}", address)
        (page,) = psutil.Process(panel.pid).children()
        ears = [c for c in page.net_connections("inet") if c.status == psutil.CONN_LISTEN]
        assert [c.laddr.ip for c in ears] == ["127.0.0.1"]
        said = call(run.folder, "panel", "--again").stdout.splitlines()
        assert said[1] == "the panel:"
        assert said[2].strip() != address
        address = said[2].strip()  # the one before is worth nothing now
        scene, frames = asyncio.run(asyncio.wait_for(_scene_and_frames(address, 30), 60))
    names = [thing["name"] for thing in scene["things"]]
    assert {"hand.skeleton", "mapping.sphere"} <= set(names)
    assert "position (finger), simulated" in [plot["title"] for plot in scene["plots"]]
    rows = run.reader.take()
    cycles, tips = run.layout.header(rows, "cycle"), run.layout.value(rows, "hand.skeleton")
    assert all(frame["condition"] == "live" for frame in frames)
    assert len({frame["cycle"] for frame in frames}) > 20
    for frame in frames:
        if frame["cycle"] in cycles:  # in whatever frame, the tips are as far apart as the row has them
            own = tips[np.searchsorted(cycles, frame["cycle"])]
            shown = np.array(frame["things"][names.index("hand.skeleton")]).reshape(-1, 3)
            assert np.linalg.norm(shown - shown[0], axis=1) == pytest.approx(
                np.linalg.norm(own - own[0], axis=1), abs=3e-4
            )


@pytest.mark.slow
def test_without_a_page_there_is_no_new_address(run: Running) -> None:
    assert "srl panel sixth-finger" in call(run.folder, "panel", "--again", code=2).stderr


@pytest.mark.slow
def test_the_page_shows_the_loops_values_and_stops_it(run: Running) -> None:
    command = srl("panel", "--signal", SIGNAL, "--span", "-1", "3")
    with ended(command, env=environment(run.folder)) as panel:
        assert panel.stdout is not None
        panel.stdout.readline()
        address = panel.stdout.readline().strip()
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\?token=[\w-]{32}", address)
        (page,) = psutil.Process(panel.pid).children()
        values = asyncio.run(asyncio.wait_for(_values_then_stop(address, 40), 60))
        panel.kill()  # the command has no chance to tidy up
        until(lambda: not alive(page.pid))
    rows = run.reader.take()
    times, glove = run.layout.header(rows, "control") / 1e6, run.layout.value(rows, "glove.position")
    index = run.layout.fields["glove.position"].labels.index("index_mpj")
    for t, y in values:
        at = int(np.argmin(np.abs(times - t)))
        assert times[at] == pytest.approx(t, abs=1e-3)
        assert y == pytest.approx((glove[at, index] + 1) / 4)
    assert len({t for t, _ in values}) > 20
    run.until(lambda: run.header("state") == State.STOPPED, "the stop")
    assert run.header("cause") == Cause.REQUEST
    assert run.header("latches") & Latch.PERSON


async def _scene_and_frames(address: str, count: int) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    place = f"{urlsplit(address).scheme}://{urlsplit(address).netloc}"
    jar = aiohttp.CookieJar(unsafe=True)  # for an address without a name
    async with aiohttp.ClientSession(headers={"Origin": place}, cookie_jar=jar) as session:
        async with session.get(f"{place}/") as answer:
            assert answer.status == 403  # without the token
        async with session.get(address) as answer:
            page = await answer.text()
            assert "Live picture" in page
        async with session.ws_connect(f"{place}/socket", headers=shown(page)) as socket:
            scene = await socket.receive_json()
            assert scene["kind"] == "scene"
            frames: list[dict[str, Any]] = []
            while len(frames) < count:
                message = await socket.receive_json()
                frames += [message] if message["kind"] == "frame" else []
            return scene, frames


async def _values_then_stop(address: str, count: int) -> list[tuple[float, float]]:
    place = f"{urlsplit(address).scheme}://{urlsplit(address).netloc}"
    headers = {"Origin": place}
    jar = aiohttp.CookieJar(unsafe=True)  # for an address without a name
    found = []
    async with aiohttp.ClientSession(headers=headers, cookie_jar=jar) as session:
        async with session.get(address) as answer:
            assert answer.status == 200
            page = await answer.text()
            assert "Participant" in page
        async with session.ws_connect(f"{place}/socket", headers=shown(page)) as socket:
            while len(found) < count:
                message: dict[str, Any] = await socket.receive_json()
                if message["kind"] == "value" and message["condition"] == "live":
                    found.append((message["t"], message["y"]))
        async with session.post(f"{place}/stop", headers=shown(page)) as stopped:
            assert (await stopped.json())["ok"]
    return found
