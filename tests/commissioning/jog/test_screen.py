"""What is on the screen can be read: no figure is cut off, and each message is whole."""

from __future__ import annotations

import re
from dataclasses import replace
from math import nan

import pytest

from srl.commissioning.jog.screen import MOVES, Joint, View, lines

JOINTS = [
    Joint("shoulder_lift", "rad", -1.5708, 0.25, -6.2832, 6.2832, 0.1, -32.567),
    Joint("slide", "m", 0.01234, 0.0, 0.0, 0.1, 0.02, 1.0),
    Joint("servo", "rad", nan, 0.7, nan, nan, 0.1, nan),
]
VIEW = View("srl jog my-limb: arm", False, JOINTS, 0, "effort N m", "active", True, MOVES, ("ready", "active"))


def text(view: View, width: int = 110, height: int = 30) -> str:
    return re.sub(r"\x1b\[[0-9;]*m", "", "\n".join(lines(view, width, height)))


def test_each_joint_is_there_with_its_figures() -> None:
    shown = text(VIEW)
    for words in ("my-limb: arm", "shoulder_lift", "-1.571", "0.250", "-6.283", "6.283", "-32.57", "0.0123", "0.1000"):
        assert words in shown
    assert "shoulder_lift moves at 0.1 rad/s" in shown
    assert "slide moves at 0.02 m/s" in text(replace(VIEW, chosen=1))
    assert re.search(r"3 +servo +rad +- +0.700 +- +- +- *$", shown, re.MULTILINE)
    assert "nan" not in shown


@pytest.mark.parametrize("width", [60, 72, 80, 100, 200])
def test_no_figure_is_cut_off(width: int) -> None:
    shown = text(VIEW, width)
    assert "…" not in shown
    assert all(len(line) <= width for line in shown.splitlines())
    assert ("N m" in shown) == (width >= 72)


def test_a_long_message_is_whole_and_the_newest_ones_are_shown() -> None:
    long = "put the limb near its home, clear of people and things, then start it " * 2
    shown = text(replace(VIEW, messages=("former", long, "new")), width=60, height=14)
    assert "things, then start it" in shown.replace("\n", " ")
    assert shown.splitlines()[-1] == "new"
    assert "former" not in shown
    assert text(replace(VIEW, messages=(long,)), height=3).startswith("srl jog")
