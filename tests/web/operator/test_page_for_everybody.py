"""The panel for everybody: with the keyboard alone, in the dark and in the light, on a phone, and as axe sees it."""

from __future__ import annotations

import time

import pytest
from helpers import axe
from helpers.operator_seen import Seen
from helpers.wait import until

from srl.runtime.ipc.events import EventWriter, Level
from srl.runtime.ipc.header import LINK_ACTIVE, LINK_CONNECTED, Cause, Latch, State

pytestmark = pytest.mark.slow


def stopped(seen: Seen) -> None:
    seen.loop.state, seen.loop.cause, seen.loop.latches = State.STOPPED, Cause.INTENT_LOSS, Latch.FAULT
    seen.loop.link = 0
    seen.says("why", "Loss of intent")


@pytest.mark.parametrize("theme", ["dark", "light"])
@pytest.mark.parametrize("size", [(1280, 800), (390, 844)])
def test_axe_finds_nothing(seen: Seen, theme: str, size: tuple[int, int]) -> None:
    seen.page.ask("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": theme}])
    seen.page.ask(
        "Emulation.setDeviceMetricsOverride", width=size[0], height=size[1], deviceScaleFactor=1, mobile=False
    )
    seen.control()
    until(lambda: seen.text("events") or seen.text("devices"))
    assert axe.faults(seen.page) == []
    seen.page.value(
        "((list) => { list.add('old'); list.toggle = () => {}; })(document.getElementById('desk').classList)"
    )
    assert axe.faults(seen.page) == []  # as it is while no data come
    stopped(seen)
    until(lambda: seen.able("reset"))
    seen.click("reset")
    seen.says("sure", "Reset now")
    assert axe.faults(seen.page) == []
    seen.loop.link = LINK_CONNECTED | LINK_ACTIVE


def test_what_stopped_it_is_on_top_and_covers_nothing(seen: Seen) -> None:
    for width, height in ((1280, 800), (390, 844)):
        seen.page.ask(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False
        )
        stopped(seen)
        seen.says("warning", "stopped")
        banner, main, stop = (
            seen.page.value(f"(b => [b.top, b.bottom])(document.querySelector('{part}').getBoundingClientRect())")
            for part in ("#banner", "main", "#stop")
        )
        for part in ("warning", "why", "todo", "stands"):
            top, bottom = seen.page.value(
                f"(b => [b.top, b.bottom])(document.getElementById('{part}').getBoundingClientRect())"
            )
            assert banner[0] <= top < bottom <= banner[1], part
        assert 0 < banner[0] < banner[1] <= main[0] + 1
        assert main[1] <= stop[0] < stop[1] <= height
        assert main[1] - main[0] > height / 3  # the page is still there
        seen.loop.state, seen.loop.cause, seen.loop.latches = State.ACTIVE, Cause.NONE, Latch(0)
        seen.loop.link = LINK_CONNECTED | LINK_ACTIVE
        until(lambda: not seen.text("why"))


def walked(seen: Seen) -> list[str]:
    """What the Tab key reaches from the picture to the button STOP: the id, or the name."""
    seen.page.value("document.getElementById('space').focus()")
    reached = ["space"]
    while reached[-1] != "stop" and len(reached) < 80:
        seen.page.key("Tab", "Tab", 9)
        reached.append(seen.page.value("(e => e.id || e.getAttribute('aria-label') || e.textContent)"
                                       "(document.activeElement)"))  # fmt: skip
        ring = seen.page.value("(s => s.outlineStyle !== 'none' || s.boxShadow !== 'none')"
                               "(getComputedStyle(document.activeElement))")  # fmt: skip
        assert ring or reached[-1] == "jog", reached  # of its line another test tells
    return reached


def test_the_keyboard_alone_reaches_all_and_shows_where_it_is(seen: Seen) -> None:
    seen.control()
    reached: list[str] = []

    def complete() -> bool:  # where pictures come late, fields are off for a moment
        reached[:] = walked(seen)
        return "parameter_jog.gain" in reached

    until(complete)
    wanted = ["space", "front", "follow", "desk", "control", "jog", "parameter_jog.gain", "list", "curves", "pause"]
    places = [reached.index(name) for name in [*wanted, "stop"]]
    assert places == sorted(places)  # as it is read


def test_the_picture_is_turned_by_keys(seen: Seen) -> None:
    turn = seen.now("turn")
    seen.page.value("document.getElementById('space').focus()")
    seen.page.key("ArrowRight", "ArrowRight", 39)
    until(lambda: seen.now("turn") == pytest.approx(turn + 0.1))
    seen.page.key("Home", "Home", 36)
    until(lambda: seen.now("turn") == pytest.approx(turn))


def test_curves_have_all_names_a_time_axis_and_the_values_at_a_time(seen: Seen) -> None:
    names = seen.page.value("[...document.querySelectorAll('#curves figure')].map((f) => "
                            "[f.querySelector('figcaption').textContent, "
                            "[...f.querySelectorAll('li span')].map((e) => e.textContent)])")  # fmt: skip
    assert [labels for _, labels in names] == [["shoulder", "elbow"], ["period", "cycle"]]
    assert [title for title, _ in names] == ["command (arm), rad", "Loop, ms"]
    outputs = "[...document.querySelectorAll('#curves output')].map((e) => e.textContent)"
    until(lambda: seen.page.value(outputs)[:2] == ["0.1", "0.2"])
    seen.click("pause")
    seen.says("pause", "Paused")
    kept = seen.page.value(outputs)
    seen.passed()
    assert seen.page.value(outputs) == kept
    seen.click("pause")
    until(lambda: seen.page.value(outputs) != kept)


def test_events_have_time_cause_and_remedy_the_newest_first(seen: Seen) -> None:
    writer = EventWriter(seen.loop.folder.events)
    seen.loop.begin()
    at = time.localtime()
    writer.write(time.monotonic_ns(), Level.INFO, 3, "parameter 'jog.gain': 1 -> 2 1/m, changed by 'srl set' (bus)")
    writer.write(time.monotonic_ns(), Level.WARNING, 9, "stopped (intent_loss vicon)")
    seen.says("events", "Stopped: loss of intent")
    lines = seen.text("events_lines").split("\n")
    assert lines[1] == "See that vicon gives new data again, then reset."
    assert lines[2].endswith("Parameter 'jog.gain': 1 -> 2 1/m, changed by 'srl set' (bus)")
    hour, minute, second = map(int, lines[0][:8].split(":"))
    assert 0 <= (hour * 3600 + minute * 60 + second - at.tm_hour * 3600 - at.tm_min * 60 - at.tm_sec) % 86400 < 60
    writer.close()
    seen.loop.folder.events.unlink()
