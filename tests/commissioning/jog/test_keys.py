"""A terminal's bytes as keys, and keys as presses that end by themselves."""

from __future__ import annotations

import pytest

from srl.commissioning.jog.hold import Hold
from srl.commissioning.jog.keys import TIMEOUT, Keys

RIGHT, LEFT = b"\x1b[C", b"\x1b[D"


@pytest.mark.parametrize(
    ("data", "keys"),
    [
        (b"\x1b[A\x1b[B\x1b[C\x1b[D", ["up", "down", "right", "left"]),
        (b"\x1bOC\x1bOD", ["right", "left"]),
        (b"3 q", ["3", "space", "q"]),
        (b"\x1b[O\x1b[I", ["focus lost", "focus"]),
        (b"\x1b[1;5C\x1b[3~", ["other", "other"]),  # Ctrl-right, Delete: neither moves
        ("ä".encode(), ["other", "other"]),
        (b"\x1bx", ["esc"]),  # Alt-x
        (b"\x1b\x1b[C", ["esc", "right"]),
    ],
)
def test_bytes_are_keys(data: bytes, keys: list[str]) -> None:
    assert Keys().take(data, 0.0) == keys


def test_a_key_in_pieces_is_one_key_and_esc_alone_is_esc() -> None:
    keys = Keys()
    assert keys.take(b"\x1b", 0.0) == []
    assert keys.take(b"[", 0.01) == []
    assert keys.take(b"C", 0.02) == ["right"]
    assert keys.take(b"\x1b", 1.0) == []
    assert keys.take(b"", 1.0 + 2 * TIMEOUT) == ["esc"]
    assert keys.take(b"\x1b[", 2.0) == []
    assert keys.take(b"", 2.0 + 2 * TIMEOUT) == ["esc"]  # what is no key stops


def reported(hold: Hold, now: float) -> tuple[list[float], float]:
    way, press = hold.at(now)
    return way.tolist(), float(press[0])


def test_a_press_is_told_while_it_is_fresh_and_never_again() -> None:
    hold = Hold(("a", "b"), 0.03)
    assert reported(hold, 0.0)[1] == 0.0
    hold.key("right", 1.0)
    assert reported(hold, 1.02) == ([1.0, 0.0], 1.0)
    assert hold.expires(1.02) == 1.03  # a loop that is late doesn't take it
    assert reported(hold, 1.04)[1] == 0.0
    hold.key("left", 2.0)
    assert reported(hold, 2.0) == ([-1.0, 0.0], 2.0)


@pytest.mark.parametrize("key", ["up", "down", "1", "2", "9", "space", "esc", "q", "x", "other"])
def test_every_other_key_brakes(key: str) -> None:
    hold = Hold(("a", "b"), 0.03)
    hold.key("right", 1.0)
    hold.key(key, 1.01)
    way, press = reported(hold, 1.01)
    assert way == [0.0, 0.0]
    assert press == 2.0  # a new one: it takes effect at once


def test_joints_are_chosen_by_number_and_by_turns() -> None:
    hold = Hold([f"j{i}" for i in range(12)], 0.03)
    found = []
    for key in ("3", "down", "up", "up", "0", "1", "up", "down"):
        hold.key(key, 0.0)
        found.append(hold.joint)
    assert found == [2, 3, 2, 1, 9, 0, 11, 0]
    few = Hold(("a", "b"), 0.03)
    few.key("7", 0.0)
    few.key("0", 0.0)
    assert few.joint == 0


def test_a_step_is_one_press_until_the_key_is_let_go() -> None:
    hold = Hold(("a",), 0.03, step=True)
    presses, now = [], 0.0
    for pause in (0.5, *[0.033] * 20, 0.9, 0.033):  # a console's first repeat, the others, let go, again
        hold.key("right", now)
        presses.append(reported(hold, now)[1])
        now += pause
    assert [p for p in dict.fromkeys(presses) if p] == [1.0, 2.0]
