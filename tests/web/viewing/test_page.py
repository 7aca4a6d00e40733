"""rerun's viewer in a real browser: it shows the run, and says when its picture isn't of now."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.chromium import Chromium, Page
from helpers.operator_page import get
from helpers.viewed import WALL, ViewedLoop, ViewerProcess
from helpers.wait import until

from srl.runtime.ipc.header import State

pytestmark = pytest.mark.slow

LATE = 1000.0  # ms, as the page's
SLOW = 120.0  # s: a machine without a graphics card takes long for the first pictures


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with Chromium(tmp_path_factory.mktemp("chromium")) as made:
        yield made


def opened(browser: Chromium, viewer: ViewerProcess) -> Page:
    """A small page: rerun's pictures are computed on the processor here."""
    page = browser.open("about:blank?")
    page.ask("Emulation.setDeviceMetricsOverride", width=480, height=300, deviceScaleFactor=1, mobile=False)
    return page.go(viewer.address)


def now(page: Page) -> dict[str, Any]:
    """What the page says of itself, and whether its warning is seen: as far as the browser's compositor has it."""
    found = page.value("""globalThis.viewerNow && {...viewerNow,
        seen: ["old", "words"].map((id) => Number(getComputedStyle(document.getElementById(id)).opacity)),
        output: document.getElementById("words").textContent}""")
    return dict(found or {"words": "", "ms": None, "time": None})


def test_the_viewer_shows_the_run_and_says_when_it_is_old(tmp_path: Path, browser: Chromium) -> None:
    loop = ViewedLoop(tmp_path / "run")
    with loop.running():
        until(lambda: loop.cycle > 2)
        with ViewerProcess(loop.folder.path) as viewer:
            page = opened(browser, viewer)
            assert page.value("location.href").endswith("/")  # the token is spent, and isn't in the address
            until(lambda: now(page)["time"], timeout=SLOW, what=lambda: str(now(page)), pause=0.2)
            # The picture is of a row of the run, and moves on. Its age is what the page says, and old isn't live.
            first = now(page)
            assert min(abs(first["time"] - WALL / 1e6 - t) for t in loop.times) < 0.01
            until(
                lambda: now(page)["time"] > first["time"] + 2000, timeout=SLOW, what=lambda: str(now(page)), pause=0.2
            )
            for _ in range(10):
                seen = now(page)
                assert bool(seen["words"]) == (seen["ms"] is None or seen["ms"] > LATE), seen
                assert not seen["words"] or seen["seen"] == [1, 1], seen
            loop.state = State.STOPPED
            until(lambda: "The limb is stopped" in now(page)["note"], timeout=SLOW, pause=0.2)
            loop.state = State.ACTIVE
            assert get(viewer, "/").status == 403  # to nobody else
            page.close()


def test_a_loop_that_hangs_and_an_ended_run_are_said(tmp_path: Path, browser: Chromium) -> None:
    loop = ViewedLoop(tmp_path / "run")
    loop.step()
    with ViewerProcess(loop.folder.path) as viewer:
        page = opened(browser, viewer)
        until(lambda: "gives no data" in now(page)["words"], timeout=SLOW, what=lambda: str(now(page)), pause=0.2)
        assert now(page)["seen"] == [1, 1]
        loop.ring.finish()
        until(lambda: "The run has ended" in now(page)["words"], timeout=SLOW, what=lambda: str(now(page)), pause=0.2)
        assert viewer.process.wait(30) == 0
        assert now(page)["seen"] == [1, 1]
        page.close()
