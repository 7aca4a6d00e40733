"""Joints that are jogged on the panel in a real browser: what begins a motion, and all that ends it."""

from __future__ import annotations

import pytest
from helpers.operator_seen import Seen
from helpers.wait import until

from srl.runtime.ipc.header import State

pytestmark = pytest.mark.slow

RIGHT = {"key": "ArrowRight", "code": "ArrowRight", "windowsVirtualKeyCode": 39}


def jog(seen: Seen) -> None:
    """Takes control, and gives the jog's area the focus."""
    seen.control()
    seen.page.value("document.getElementById('jog').focus()")
    seen.says("jog_words", "Hold")


def test_a_joint_moves_while_a_key_is_held(seen: Seen) -> None:
    seen.page.value("document.getElementById('jog').focus()")
    seen.key("rawKeyDown", **RIGHT)
    seen.key("keyUp", **RIGHT)
    assert not seen.loop.presses  # without control
    jog(seen)

    def reported() -> bool:
        """Whether the loop is told that the key was let go; a page that was too slow had ended the press before."""
        seen.key("rawKeyDown", **RIGHT)
        seen.held()
        seen.key("keyUp", **RIGHT)
        seen.let_go()
        return seen.loop.presses[-1][1]["way"] == 0

    until(reported)
    assert {p["joint"] for _, p in seen.loop.presses} == {0}
    seen.page.key("2", "Digit2", 50)
    seen.key("rawKeyDown", **RIGHT)
    seen.held()
    assert seen.loop.presses[-1][1]["joint"] == 1
    seen.page.key("x", "KeyX", 88)  # any other key brakes
    seen.let_go()
    seen.key("keyUp", **RIGHT)


@pytest.mark.parametrize(
    "end",
    [
        "dispatchEvent(new Event('blur'))",
        "document.dispatchEvent(new Event('visibilitychange'))",
        "document.getElementById('control').click()",
        "document.getElementById('list').focus()",
    ],
)
def test_a_held_joint_is_let_go_with_the_focus_the_page_or_the_control(seen: Seen, end: str) -> None:
    jog(seen)
    seen.key("rawKeyDown", **RIGHT)
    seen.held()
    seen.page.value(end)
    seen.let_go()
    seen.key("rawKeyDown", **RIGHT, autoRepeat=True)  # the key is still down: it must be pressed anew
    seen.let_go()
    seen.key("keyUp", **RIGHT)


def test_the_arrows_jog_only_where_the_jog_has_the_focus(seen: Seen) -> None:
    seen.control()
    seen.says("jog_words", "Hold")
    for place in ("control", "list"):
        seen.page.value(f"document.getElementById('{place}').focus()")
        seen.key("rawKeyDown", **RIGHT)
        seen.passed()
        seen.key("keyUp", **RIGHT)
    assert not seen.loop.presses
    place = seen.higher(0)
    seen.mouse("mousePressed", **place)
    seen.held()
    seen.page.value("document.getElementById('list').focus()")
    seen.page.key("x", "KeyX", 88)  # it brakes wherever the focus is
    seen.let_go()
    seen.mouse("mouseReleased", **place)


def test_a_button_is_held_with_the_mouse(seen: Seen) -> None:
    jog(seen)
    place = seen.higher(1)
    seen.mouse("mousePressed", **place)
    seen.held()
    assert seen.loop.presses[-1][1]["joint"] == 1
    seen.mouse("mouseReleased", **place)
    seen.let_go()


def test_the_end_of_a_key_counts_also_when_it_means_another_by_then(seen: Seen) -> None:
    jog(seen)
    # With Shift the keypad's 6 is an arrow. Shift is let go first, and then it is a 6.
    arrow, six = RIGHT | {"code": "Numpad6"}, {"key": "6", "code": "Numpad6", "windowsVirtualKeyCode": 102}
    for end in ({"type": "rawKeyDown", "autoRepeat": True}, {"type": "keyUp"}):
        seen.key("rawKeyDown", **arrow)
        seen.held()
        seen.page.ask("Input.dispatchKeyEvent", **end, **six)
        seen.let_go()
        seen.key("keyUp", **six)


def test_the_first_mouse_button_lets_go_while_another_is_held(seen: Seen) -> None:
    jog(seen)
    place = seen.higher(0)
    seen.mouse("mousePressed", **place)
    seen.held()
    middle = place | {"button": "middle"}
    seen.page.ask("Input.dispatchMouseEvent", type="mousePressed", buttons=5, **middle)
    seen.mouse("mouseReleased", **place, buttons=4)
    seen.let_go()
    seen.page.ask("Input.dispatchMouseEvent", type="mouseReleased", buttons=0, **middle)
    # The end of a click that another window has taken: the mouse comes back without a button.
    seen.mouse("mousePressed", **place)
    seen.held()
    seen.page.value("dispatchEvent(new PointerEvent('pointermove', {buttons: 0}))")
    seen.let_go()
    seen.mouse("mouseReleased", **place)


def test_a_stop_lets_go_and_a_held_key_begins_nothing_after_it(seen: Seen) -> None:
    jog(seen)
    seen.key("rawKeyDown", **RIGHT)
    seen.held()
    seen.page.key("Escape", "Escape", 27)
    until(lambda: seen.loop.stops == 1)
    seen.let_go()
    seen.loop.state = State.ACTIVE
    seen.let_go()
