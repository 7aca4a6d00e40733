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
from helpers.run import Running, alive, call, ended, environment, srl
from helpers.wait import until

from runtime.cli.panel import SECONDS, TRIALS, demo_curve
from runtime.ipc.words import Cause, Latch, State
from runtime.panel.trial import Trial

SIGNAL = "glove.position[index_mpj]"


def test_the_demonstrations_curves_can_be_shown_and_begin_flat() -> None:
    for number in range(1, TRIALS + 1):
        trial = Trial(demo_curve(number), SECONDS)
        assert np.ptp(trial.target(np.linspace(0.0, 1.4, 50))) == 0.0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--signal", "x"], "no instance"), (["--signal", "x", "--span", "1", "1"], "--span"),
        (["--signal", "x", "--span", "nan", "1"], "--span"), (["--signal", "x", "--port", "70000"], "--port"),
        (["--signal", "x", "--out", "here"], "--demo"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_said(tmp_path: Path, options: list[str], words: str) -> None:
    assert words in call(tmp_path, "panel", *options, code=2).stderr


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with Running(tmp_path_factory.mktemp("r"), "sixth-finger", "--sim", "--confirm") as running:
        running.started()
        running.until(lambda: running.word("state") == State.ACTIVE, "motion")
        yield running


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
    times, glove = run.layout.word(rows, "control") / 1e6, run.layout.value(rows, "glove.position")
    index = run.layout.fields["glove.position"].labels.index("index_mpj")
    for t, y in values:
        at = int(np.argmin(np.abs(times - t)))
        assert times[at] == pytest.approx(t, abs=1e-3)
        assert y == pytest.approx((glove[at, index] + 1) / 4)
    assert len({t for t, _ in values}) > 20
    run.until(lambda: run.word("state") == State.STOPPED, "the stop")
    assert run.word("cause") == Cause.REQUEST
    assert run.word("latches") & Latch.PERSON


async def _values_then_stop(address: str, count: int) -> list[tuple[float, float]]:
    place = f"{urlsplit(address).scheme}://{urlsplit(address).netloc}"
    headers = {"Origin": place}
    jar = aiohttp.CookieJar(unsafe=True)  # for an address without a name
    found = []
    async with aiohttp.ClientSession(headers=headers, cookie_jar=jar) as session:
        async with session.get(address) as answer:
            assert answer.status == 200
            assert "Participant" in await answer.text()
        async with session.ws_connect(f"{place}/socket") as socket:
            while len(found) < count:
                message: dict[str, Any] = await socket.receive_json()
                if message["kind"] == "value" and message["condition"] == "live":
                    found.append((message["t"], message["y"]))
        async with session.post(f"{place}/stop") as stopped:
            assert (await stopped.json())["ok"]
    return found
