"""The panel in a real browser: what it says of the run, and what a person can do on it."""

from __future__ import annotations

import copy

import pytest
from helpers.chromium import Chromium
from helpers.operator_seen import Seen
from helpers.wait import until

from srl.runtime.ipc.guidance import GUIDE, OVER, REPORT, GuideEnd
from srl.runtime.ipc.header import LINK_ACTIVE, LINK_CONNECTED, Cause, Latch, State

pytestmark = pytest.mark.slow


def test_what_stopped_it_and_what_to_do_stand_there_and_a_reset_needs_a_second_word(seen: Seen) -> None:
    assert not seen.able("reset")
    seen.loop.state, seen.loop.cause, seen.loop.latches = State.STOPPED, Cause.INTENT_LOSS, Latch.FAULT
    seen.says("why", "Loss of intent")
    seen.says("todo", "vicon gives new data again")
    seen.says("stands", "a fault stopped it")
    assert not seen.able("reset")  # without control
    seen.control()
    until(lambda: seen.able("reset"))
    seen.click("reset")
    seen.says("sure", "the limb may move at once")
    assert not seen.loop.asked
    seen.click("no")
    until(lambda: not seen.text("sure"))
    seen.loop.refuses = "what caused the stop is still there"
    seen.click("reset")
    seen.click("yes")
    seen.says("answer", "reset refused, stopped: what caused the stop is still there")
    seen.loop.refuses = ""
    seen.click("reset")
    seen.click("yes")
    seen.says("answer", "done, active")
    assert [asked["ask"] for asked in seen.loop.asked] == ["reset", "reset"]
    until(lambda: not seen.able("reset"))


def test_a_guided_calibration_is_shown_and_pressed(seen: Seen) -> None:
    shown = {
        "kind": GUIDE, "step": 7, "title": "srl calibrate", "task": "Hold still", "lack": "it moves", "missing": "",
        "things": "poses", "states": ["done", "now", "weak: too short"], "said": ["a line"], "asks": False,
        "bars": [{"name": "still", "share": 0.5, "said": "1 N", "good": False},
                 {"name": "force", "share": None, "said": " 1 2 3", "good": None}],
    }  # fmt: skip
    end = GuideEnd(seen.loop.folder)

    def typed() -> list[tuple[str, int]]:
        found: list[tuple[str, int]] = []
        until(lambda: found.extend(end.heard()) or found)
        return found

    try:
        end.tell(shown)
        until(lambda: end.heard() == [] and "Hold still" in seen.text("guide_task"))
        seen.says("guide_lack", "It moves.")
        seen.says("guide_weak", "3: weak: too short")
        assert not seen.able("guide_on")  # without control
        seen.control()
        until(lambda: seen.able("guide_on"))
        seen.click("guide_skip")
        assert typed() == [("s", 7)]
        assert not seen.able("guide_redo")
        seen.page.value("document.querySelectorAll('#guide_states .chip')[2].click()")
        seen.says("guide_redo", "Do 3 again")
        seen.click("guide_redo")
        assert typed() == [("r 3", 7)]
        seen.page.key("Escape", "Escape", 27)
        seen.says("guide_missing", "nothing counts")
        seen.says("warning", "stopped")  # also where there is nothing to see in space
        end.tell(shown | {"step": 8, "asks": True})
        end.tell({"kind": REPORT, "step": 8, "lines": ["a report"], "refused": [], "picture": "", "choices": []})
        seen.says("guide_lines", "a report")
        seen.says("guide_on", "Write the file")
        seen.click("guide_end")
        until(lambda: seen.text("guide_sure"))
        seen.click("guide_yes")
        assert typed() == [("q", 8)]
        end.tell({"kind": OVER, "ok": False, "words": "No file was written."})
        seen.says("guide_over", "No file was written.")
        assert not seen.text("guide_on")
    finally:
        end.close()
        seen.loop.begin()
    # What has ended stays until the next run begins; then the run's own parameters are there again.
    until(lambda: not seen.text("guide_over"))
    seen.says("fields", "1.25 per m")


def test_a_waiting_run_is_started(seen: Seen) -> None:
    seen.loop.state, seen.loop.latches = State.READY, Latch.START
    seen.control()
    until(lambda: seen.able("start"))
    assert not seen.text("reset")
    seen.click("start")
    seen.click("yes")
    seen.says("answer", "start: done")
    assert [asked["ask"] for asked in seen.loop.asked] == ["start"]


def test_a_question_is_withdrawn_when_the_state_changes(seen: Seen) -> None:
    seen.control()
    seen.loop.state = State.STOPPED
    until(lambda: seen.able("reset"))
    seen.click("reset")
    seen.says("sure", "Reset now")
    seen.loop.state = State.ACTIVE
    until(lambda: not seen.text("sure"))


def test_a_question_is_withdrawn_when_something_else_stops_it_too(seen: Seen) -> None:
    seen.control()
    seen.loop.latches, seen.loop.cause, seen.loop.state = Latch.PERSON, Cause.REQUEST, State.STOPPED  # in this order
    until(lambda: seen.able("reset"))
    seen.click("reset")
    seen.says("sure", "Reset now")
    seen.passed()
    assert seen.text("sure")
    seen.loop.latches |= Latch.EMERGENCY
    until(lambda: not seen.text("sure"))
    seen.says("answer", "has changed")
    assert not seen.loop.asked


def test_a_lost_device_has_words_and_a_remedy(seen: Seen) -> None:
    seen.says("devices", "well, takes commands")
    seen.loop.link = 0
    seen.says("devices", "lost")
    seen.says("devices", "Look at cable and power")
    seen.loop.link = LINK_CONNECTED | LINK_ACTIVE
    seen.says("devices", "well")


@pytest.mark.parametrize("where", ["document.body", "document.querySelector('#fields input')"])
def test_escape_stops_from_anywhere_also_without_control(seen: Seen, where: str) -> None:
    if "input" in where:
        seen.control()
        until(lambda: seen.page.value(f"!{where}.disabled"))
    seen.page.value(f"{where}.focus()")
    seen.page.key("Escape", "Escape", 27)
    until(lambda: seen.loop.stops == 1)


def test_another_tab_takes_the_control_and_says_so(seen: Seen, browser: Chromium) -> None:
    seen.control()
    other = browser.open(seen.page.value("location.href"))
    button = "document.getElementById('control')"
    until(lambda: "another tab" in str(other.value(f"{button}.innerText")) and not other.value(f"{button}.disabled"))
    other.value(f"{button}.click()")
    until(lambda: seen.now("control") is False)
    assert "another tab" in seen.text("control")
    other.close()
    seen.says("control", "Take control")


def test_names_from_elsewhere_are_text(seen: Seen) -> None:
    meta = copy.deepcopy(seen.loop.layout.meta)
    seen.loop.layout.meta |= {"name": "<img src=x onerror=alert(1)>"}
    seen.loop.layout.meta["parameters"][0]["text"] = "<b id=evil>bold</b>"
    seen.loop.begin()
    seen.says("name", "<img")
    seen.says("fields", "<b id=evil>")
    assert seen.page.value(
        "document.getElementById('evil') === null && !document.querySelector('img:not(#guide_picture)')"
    )
    seen.loop.layout.meta = meta
    seen.loop.begin()
    seen.says("name", "made-up")


def test_recordings_that_are_not_there_are_said(seen: Seen) -> None:
    seen.click("list")
    seen.says("shelf_words", "No recordings of made-up")


@pytest.mark.parametrize("width", [1600, 1000, 420])
def test_stop_is_in_sight_at_every_width_and_nothing_is_cut_off(seen: Seen, width: int) -> None:
    seen.page.ask(
        "Emulation.setDeviceMetricsOverride", width=width, height=700, deviceScaleFactor=1, mobile=False,
    )  # fmt: skip
    seen.loop.state, seen.loop.cause = State.STOPPED, Cause.REQUEST
    seen.says("warning", "stopped")
    for down in (0, 10_000):
        box = seen.page.value(f"(() => {{ document.querySelector('main').scrollTo(0, {down}); "
                              "const b = document.getElementById('stop').getBoundingClientRect(); "
                              "return [b.left, b.top, b.right, b.bottom]; })()")  # fmt: skip
        assert 0 <= box[0] < box[2] <= width
        assert 0 <= box[1] < box[3] <= 700
        warning = seen.page.value("(b => [b.top, b.bottom])"
                                  "(document.getElementById('warning').getBoundingClientRect())")  # fmt: skip
        assert 0 <= warning[0] < warning[1] <= box[1]  # it covers no button
    assert seen.page.value("document.documentElement.scrollWidth") <= width
    assert seen.page.value("(d => d.scrollWidth <= d.clientWidth)(document.getElementById('desk'))")
