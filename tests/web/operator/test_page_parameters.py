"""Parameters on the panel: typed, or changed by steps; a large jump is asked about; what stands there is sent."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from typing import Any

import pytest
from helpers.operator_seen import Seen
from helpers.wait import until

pytestmark = pytest.mark.slow

FIELD = "document.querySelector('#fields input')"
SENT = """(() => { globalThis.sent = []; const send = WebSocket.prototype.send;
    WebSocket.prototype.send = function (m) { sent.push(JSON.parse(m)); return send.call(this, m); }; })()"""
ENTER = {"key": "Enter", "code": "Enter", "windowsVirtualKeyCode": 13, "text": "\r"}


@pytest.fixture
def bounded(seen: Seen) -> Seen:
    """A page with control, whose messages are kept. The parameter is at 1.25 of 0.5 to 2 per m."""
    seen.control()
    seen.page.value(SENT)
    until(lambda: seen.page.value(f"!{FIELD}.disabled"))
    return seen


@pytest.fixture
def free(seen: Seen) -> Iterator[Seen]:
    """The same without bounds."""
    meta = copy.deepcopy(seen.loop.layout.meta)
    seen.loop.layout.meta["parameters"][0] |= {"lower": float("-inf"), "upper": float("inf")}
    seen.loop.begin()
    until(lambda: seen.page.value("document.querySelectorAll('#fields .parameter button').length") == 3)
    seen.control()
    seen.page.value(SENT)
    until(lambda: seen.page.value(f"!{FIELD}.disabled"))
    yield seen
    seen.loop.layout.meta = meta
    seen.loop.begin()
    until(lambda: seen.page.value("document.querySelectorAll('#fields .parameter button').length") == 5)


def typed(seen: Seen, words: str) -> None:
    """Into the field, without Enter."""
    seen.page.value(f"{FIELD}.focus(), {FIELD}.select()")
    seen.page.ask("Input.insertText", text=words) if words else seen.page.key("Backspace", "Backspace", 8)


def enter(seen: Seen) -> None:
    seen.page.ask("Input.dispatchKeyEvent", type="keyDown", **ENTER)
    seen.page.ask("Input.dispatchKeyEvent", type="keyUp", **ENTER)


def sets(seen: Seen) -> Any:
    return seen.page.value("sent.filter((m) => m.kind === 'set').map((m) => m.value)")


def test_bounds_and_the_loops_value_are_shown_and_without_control_nothing_can_be_changed(seen: Seen) -> None:
    seen.says("fields", "1.25 per m")
    seen.says("fields", "0.5 to 2 per m")
    assert seen.page.value("[...document.querySelectorAll('#fields .row > *')].slice(0, 4).every((e) => e.disabled)")
    assert seen.page.value("document.querySelector('#fields input[type=range]')") is None  # nothing jumps at a click


def test_a_number_is_sent_by_enter_and_what_the_loop_refuses_goes_back(bounded: Seen) -> None:
    typed(bounded, "1.3")
    bounded.says("fields", "not set yet")
    assert sets(bounded) == []
    enter(bounded)
    assert sets(bounded) == [1.3]
    bounded.says("answer", "has no bus")
    until(lambda: bounded.page.value(f"Number({FIELD}.value)") == 1.25)


def test_steps_go_by_buttons_and_by_keys(bounded: Seen) -> None:
    bounded.page.value("document.querySelector('#fields [aria-label=\"jog.gain one step up\"]').click()")
    until(lambda: sets(bounded) == [1.3])  # a fiftieth of the way, as a round number
    bounded.says("answer", "has no bus")
    bounded.page.value(f"{FIELD}.focus()")
    bounded.page.key("ArrowDown", "ArrowDown", 40)
    until(lambda: sets(bounded) == [1.3, 1.2])


def test_what_was_typed_and_not_set_is_gone_once_the_field_is_left(bounded: Seen) -> None:
    typed(bounded, "1.4")
    bounded.page.value(f"{FIELD}.blur()")
    until(lambda: bounded.page.value(f"{FIELD}.value") == "1.25")
    assert sets(bounded) == []


def test_a_large_jump_is_asked_about(bounded: Seen) -> None:
    typed(bounded, "1.9")
    enter(bounded)
    bounded.says("fields", "1.25 per m → 1.9 per m is a large jump")
    assert sets(bounded) == []
    assert bounded.page.value("document.activeElement.textContent") == "Change it"  # the keyboard goes on there
    enter(bounded)
    until(lambda: sets(bounded) == [1.9])
    until(lambda: "large jump" not in bounded.text("fields"))
    bounded.says("answer", "has no bus")
    typed(bounded, "0.5")
    enter(bounded)
    bounded.says("fields", "large jump")
    bounded.page.value("document.querySelector('#fields .sure .row').lastChild.click()")
    until(lambda: "large jump" not in bounded.text("fields"))
    assert sets(bounded) == [1.9]


def test_the_enter_that_asked_doesnt_answer_while_it_is_held(bounded: Seen) -> None:
    typed(bounded, "1.9")
    bounded.page.ask("Input.dispatchKeyEvent", type="keyDown", **ENTER)
    bounded.says("fields", "large jump")
    for _ in range(3):
        bounded.page.ask("Input.dispatchKeyEvent", type="keyDown", autoRepeat=True, **ENTER)
    bounded.page.ask("Input.dispatchKeyEvent", type="keyUp", **ENTER)
    assert sets(bounded) == []
    enter(bounded)
    until(lambda: sets(bounded) == [1.9])


@pytest.mark.parametrize("words", ["1,000", "0x1", "1.3.1", "13a"])
def test_what_is_no_number_is_not_sent(bounded: Seen, words: str) -> None:
    typed(bounded, words)
    enter(bounded)
    bounded.says("fields", "no number")
    assert sets(bounded) == []


def test_a_question_goes_with_the_control(bounded: Seen) -> None:
    typed(bounded, "1.9")
    enter(bounded)
    bounded.says("fields", "large jump")
    bounded.click("control")
    until(lambda: "large jump" not in bounded.text("fields"))


def test_what_is_out_of_bounds_is_refused_and_not_moved_to_a_bound(bounded: Seen) -> None:
    typed(bounded, "7")
    enter(bounded)
    bounded.says("answer", "7 is out of bounds (0.5 to 2)")
    assert sets(bounded) == [7]


@pytest.mark.parametrize("words", ["", "-", "1,5e", "e", "Infinity"])
def test_what_is_no_number_is_not_sent_as_one(free: Seen, words: str) -> None:
    typed(free, words)
    enter(free)
    free.page.value(f"{FIELD}.blur()")
    until(lambda: free.page.value(f"Number({FIELD}.value)") == 1.25)  # what the loop has is back
    assert sets(free) == []


def test_a_number_is_sent_as_it_was_typed(free: Seen) -> None:
    typed(free, "1.30004321")
    enter(free)
    assert sets(free) == [1.30004321]
    free.says("answer", "has no bus")
    typed(free, "0.0004321")
    enter(free)
    free.says("fields", "large jump")  # without bounds: more than twice as much, or less than half
    enter(free)
    until(lambda: sets(free) == [1.30004321, 0.0004321])


@pytest.mark.parametrize("bounds", [(0.0, 0.005), (0.0, 4e-6), (0.5, 2.0), (0.0, 3e5), (-3.0, 3.0)])
def test_steps_are_round_and_end_at_the_bounds(seen: Seen, bounds: tuple[float, float]) -> None:
    lower, upper = bounds
    given = {"name": "g", "lower": lower, "upper": upper, "default": lower, "unit": "1", "text": "t"}
    found = seen.page.value(
        "import('/parameter.js').then(({ Parameter }) => { const sent = [], p = new Parameter("
        f"{json.dumps(given)}, (v) => sent.push(v)); p.frame({lower}, true, 0); "
        "for (let i = 0; i < 120; i++) p.by(1); p.by(1); return [p.step, sent]; })"
    )
    step, sent = found
    assert (upper - lower) / 50 <= step <= (upper - lower) / 20
    assert sent[0] == pytest.approx(lower + step, rel=1e-9)
    assert max(sent) == sent[-1] == upper
