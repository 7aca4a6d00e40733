"""The page in a real browser: what it draws is what the loop's rows say, and what is wrong is seen."""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.chromium import Chromium, Page
from helpers.panel import SIGNAL, MadeUpLoop
from helpers.wait import until

from srl.runtime.contracts.errors import HostError
from srl.runtime.ipc.header import LINK_CONNECTED, LINK_STALE, State
from srl.runtime.web.panel.screen import Screen
from srl.runtime.web.panel.trial import ScreenTrial, Trial

pytestmark = pytest.mark.slow

TRIAL = Trial((0.3, 0.3, 0.9, 0.1), duration=1.5, settle=0.6, title="Profile T1", number=3, of=9)
LONG = Trial((0.3, 0.3), duration=600.0, settle=0.2)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with Chromium(tmp_path_factory.mktemp("chromium")) as made:
        yield made


@pytest.fixture
def loop(tmp_path: Path) -> MadeUpLoop:
    return MadeUpLoop(tmp_path / "run")


class Seen:
    """A loop that runs, its screen, and the page in the browser."""

    def __init__(self, loop: MadeUpLoop, screen: Screen, page: Page) -> None:
        self.loop, self.screen, self.page = loop, screen, page

    def now(self, key: str) -> Any:
        """What the newest frame shows."""
        return self.page.value(f"globalThis.screenNow && screenNow.{key}")

    def until(self, key: str, value: object) -> None:
        """Waits for a frame that shows it."""
        until(lambda: self.now(key) == value, what=lambda: f"{key} is {value}: {self.now(key)}")

    def text(self, part: str) -> str:
        """What a part of the page says; nothing if it isn't shown."""
        return str(self.page.value(f"document.getElementById('{part}').checkVisibility() ? "
                                   f"document.getElementById('{part}').innerText : ''"))  # fmt: skip

    def colour(self) -> list[int]:
        """The colour in the pointer's middle, (red, green, blue, alpha)."""
        script = """(() => { const c = document.getElementById("live"), s = c.width / innerWidth, n = screenNow;
            return [...c.getContext("2d").getImageData(Math.round(n.x * s), Math.round(n.y * s), 1, 1).data]; })()"""
        return list(self.page.value(script))

    def trial(self, trial: Trial) -> tuple[threading.Thread, list[ScreenTrial]]:
        """A trial whose card is shown."""
        found: list[ScreenTrial] = []

        def run() -> None:
            with contextlib.suppress(HostError):  # the test is over, and the screen with it
                found.append(self.screen.run_trial(trial))

        thread = threading.Thread(target=run)
        thread.start()
        self.until("phase", "waiting")
        return thread, found

    def begin(self) -> None:
        """The participant presses space."""
        self.until("condition", "live")
        self.page.key(" ", "Space", 32)
        self.until("phase", "running")


@pytest.fixture
def seen(loop: MadeUpLoop, browser: Chromium) -> Iterator[Seen]:
    with loop.running(), Screen(loop.folder, SIGNAL) as screen:
        page = browser.open(screen.address)
        made = Seen(loop, screen, page)
        made.until("condition", "live")
        yield made
        page.close()


def test_the_pointer_is_where_the_value_is(seen: Seen) -> None:
    zero, one = None, None
    for value in (0.0, 0.25, 0.6, 1.0):
        seen.loop.value = value
        seen.until("value", value)
        y = seen.now("y")
        zero, one = (y if value == 0.0 else zero), y
        assert seen.colour()[:3] == [255, 77, 79]
    heights = seen.page.value("innerHeight")
    assert 0 < one < zero < heights
    seen.loop.value = 0.5
    seen.until("value", 0.5)
    assert seen.now("y") == pytest.approx((zero + one) / 2, abs=1.0)


def test_a_trial_from_the_card_to_its_frames(seen: Seen) -> None:
    seen.loop.value = 0.3
    thread, found = seen.trial(TRIAL)
    assert seen.text("headline") == "Trial 3 of 9"
    assert seen.text("key") == "Press space to begin"
    assert seen.text("title") == "Profile T1"
    seen.begin()
    assert seen.text("card") == ""
    until(lambda: seen.now("share") > 0)
    thread.join(60)
    (done,) = found
    assert done.aborted == ""
    t, value, age = done.frames.T
    assert (np.diff(t) > 0).all()
    assert t[0] < 0 < t[-1] <= TRIAL.duration  # the settling's frames are kept, too
    assert (value[t > 0] == 0.3).all()
    # The clocks agree: to half of the best ping until then, which on a busy machine was longer than the best of all.
    assert (age[np.isfinite(age)] > -0.05).all()
    assert 0 < done.round_trip < 1
    seen.until("phase", "idle")


def test_the_pointer_moves_on_at_a_constant_speed(seen: Seen) -> None:
    seen.trial(LONG)
    seen.begin()
    until(lambda: seen.now("share") > 0)
    frames: list[list[float]] = []
    until(
        lambda: len({t for t, _ in frames}) > 20, lambda: frames.append(seen.page.value("[screenNow.now, screenNow.x]"))
    )
    t, x = np.array(frames).T
    slope = np.polyfit(t - t[0], x, 1)
    assert np.abs(np.polyval(slope, t - t[0]) - x).max() < 1e-2  # pixels; the clocks' offset may get better meanwhile
    width = seen.page.value("innerWidth")
    assert slope[0] * 1e3 * LONG.duration == pytest.approx(0.87 * width, rel=0.01)


@pytest.mark.parametrize(
    ("change", "condition", "words"),
    [
        ({"link": LINK_CONNECTED | LINK_STALE}, "held", "vicon"),
        ({"value": math.nan}, "held", "no value"),
        ({"state": State.STOPPED}, "stopped", "stopped"),
    ],
)
def test_a_value_that_does_not_follow_is_seen(seen: Seen, change: dict[str, Any], condition: str, words: str) -> None:
    assert seen.text("warning") == ""
    before = {name: getattr(seen.loop, name) for name in change}
    vars(seen.loop).update(change)
    seen.until("condition", condition)
    assert words in seen.text("warning")
    if seen.now("value") is not None:
        assert seen.colour()[3] == 0  # hollow
    vars(seen.loop).update(before)
    seen.until("condition", "live")
    assert seen.text("warning") == ""
    assert seen.colour()[:3] == [255, 77, 79]


def test_a_loop_that_hangs_is_seen_and_so_is_the_next_one(loop: MadeUpLoop, browser: Chromium) -> None:
    with Screen(loop.folder, SIGNAL) as screen:
        with loop.running():
            seen = Seen(loop, screen, browser.open(screen.address))
            seen.until("condition", "live")
        seen.until("condition", "silent")
        assert "no data" in seen.text("warning")
        assert seen.colour()[3] == 0
        loop.ring.finish()
        seen.until("condition", "ended")
        loop.begin()
        with loop.running():
            seen.until("condition", "live")
            assert seen.text("warning") == ""
        seen.page.close()


def test_a_dead_server_is_seen(seen: Seen) -> None:
    os.kill(seen.screen.pid, signal.SIGKILL)
    seen.until("condition", "lost")
    assert "lost" in seen.text("warning")
    seen.page.key("Escape", "Escape", 27)
    until(lambda: "hardware stop" in seen.text("warning"))


def test_a_server_that_hangs_is_seen_and_so_is_that_it_goes_on(seen: Seen) -> None:
    os.kill(seen.screen.pid, signal.SIGSTOP)
    try:
        seen.until("condition", "silent")
        assert "late" in seen.text("warning")
        assert seen.colour()[3] == 0
        seen.page.key("Escape", "Escape", 27)
        until(lambda: "hardware stop" in seen.text("warning"))
    finally:
        os.kill(seen.screen.pid, signal.SIGCONT)
    until(lambda: seen.loop.stops == 1)  # the stop arrives all the same


def test_escape_and_the_button_stop_the_limb(seen: Seen) -> None:
    thread, found = seen.trial(LONG)
    seen.begin()
    seen.page.key("Escape", "Escape", 27)
    thread.join(30)
    assert found[0].aborted == "stopped on the screen"
    until(lambda: seen.loop.stops == 1)
    seen.until("condition", "stopped")
    until(lambda: "stopped" in seen.text("warning"))  # the words of the button's own answer may come first
    seen.page.value("document.getElementById('stop').click()")
    until(lambda: seen.loop.stops == 2)


def test_a_reload_breaks_the_trial_off_and_finds_the_next_one_waiting(seen: Seen) -> None:
    thread, found = seen.trial(LONG)
    seen.begin()
    seen.page.reload()
    thread.join(30)
    assert found[0].aborted in ("the page was closed", "the page was hidden")  # both happen
    thread, found = seen.trial(TRIAL)
    seen.page.reload()
    seen.until("phase", "waiting")
    until(lambda: seen.now("participant"))
    assert seen.text("headline") == "Trial 3 of 9"
    seen.begin()
    thread.join(60)
    assert found[0].aborted == ""


def test_space_begins_nothing_while_the_pointer_does_not_follow(seen: Seen) -> None:
    seen.trial(LONG)
    seen.loop.link = 0
    seen.until("condition", "held")
    seen.page.key(" ", "Space", 32)
    until(lambda: "follows you" in seen.text("text"))
    assert seen.now("phase") == "waiting"


def test_a_break_comes_before_the_trial(seen: Seen) -> None:
    seen.trial(Trial((0.5, 0.5), rest=2.0))
    until(lambda: seen.text("headline") == "A short break")
    until(lambda: seen.text("key") == "Press space to begin")


def test_nothing_comes_from_elsewhere_and_nothing_is_blocked(seen: Seen) -> None:
    entries = json.loads(seen.page.value("JSON.stringify(performance.getEntriesByType('resource').map(e => e.name))"))
    origin = seen.page.value("location.origin")
    assert {e.removeprefix(origin) for e in entries if e.startswith(origin)} >= {"/screen.js", "/screen.css"}
    assert all(e.startswith(origin) for e in entries)
    blocked = "fetch('http://127.0.0.1:9/').then(() => 'let', e => 'blocked')"
    assert seen.page.value(blocked) == "blocked"
    assert seen.page.value("location.href") == f"{origin}/"
    assert seen.page.value("document.querySelector('meta[name=key]')") is None
    assert seen.page.value("document.cookie") == ""
