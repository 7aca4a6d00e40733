"""What `srl jog` shows: each joint's place and bounds, the state of the run, the keys."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite
from textwrap import wrap
from typing import Any, Final

from rich.console import Console
from rich.table import Table
from rich.text import Text

MOVES: Final = "1-9, 0, up, down choose   hold left/right: move   Space, Esc stop   q end"
_BAR: Final = 15  # columns
_FREE: Final = 1000  # columns, more than any table takes


@dataclass(frozen=True)
class Joint:
    """A joint; NaN where nobody knows.

    Attributes:
        name: as the profile has it.
        unit: of its position: "rad", "m", "1".
        actual: measured position.
        commanded: what the guard lets through: a position, or a velocity.
        lower, upper: the guard's bounds of its position.
        speed: at which it moves.
        load: what the device measures of it: a torque, a force, a current.
    """

    name: str
    unit: str
    actual: float
    commanded: float
    lower: float
    upper: float
    speed: float
    load: float


@dataclass(frozen=True)
class View:
    """All that is shown.

    Attributes:
        title: instance and device.
        velocities: whether velocities are commanded.
        joints: of the device.
        chosen: index of the joint that the keys move.
        load: name and unit of the load: "effort, N m"; "" without one.
        state: the run's state, in words.
        well: whether the joint moves when a key is pressed.
        help: the keys that count now.
        messages: the newest messages, the last one last.
    """

    title: str
    velocities: bool
    joints: Sequence[Joint]
    chosen: int
    load: str
    state: str
    well: bool
    help: str
    messages: Sequence[str] = field(default=())


def lines(view: View, width: int, height: int) -> list[str]:
    """The picture for a terminal of this size."""
    console = Console(
        file=io.StringIO(), width=width, force_terminal=True, color_system="standard", legacy_windows=False
    )
    free = console.options.update(width=_FREE)
    table = _table(view, bool(view.load), True)
    for load, bar in ((bool(view.load), False), (False, False)):
        if console.measure(table, options=free).maximum > width:  # figures that are cut off can be misread
            table = _table(view, load, bar)
    chosen = view.joints[view.chosen]
    console.print(Text(view.title, style="bold"), no_wrap=True, overflow="ellipsis")
    console.print(Text(view.state, style="green" if view.well else "bold red"))
    console.print(Text(view.help))
    console.print()
    console.print(table)
    console.print()
    console.print(Text(f"{chosen.name} moves at {chosen.speed:.3g} {chosen.unit}/s"))
    console.print()
    shown: list[str] = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    room = height - len(shown)
    messages = [line for text in view.messages for line in wrap(text, width)]
    return [*shown, *(messages[-room:] if room > 0 else ())]


def _table(view: View, load: bool, bar: bool) -> Table:
    """The joints' figures; `load` and `bar`: whether these columns are there."""
    table = Table(box=None, pad_edge=False, padding=(0, 1), header_style="dim")
    heads = ["", "joint", "unit", "actual", "commanded" + "/s" * view.velocities, "lower", "upper"]
    for name in heads + [view.load] * load:
        table.add_column(name, justify="left" if name in ("", "joint", "unit") else "right", no_wrap=True)
    if bar:
        table.add_column("lower .. upper", no_wrap=True)
    for i, joint in enumerate(view.joints):
        number = f"{(i + 1) % 10}" if i < 10 else " "
        cells: list[Any] = [f"{'>' if i == view.chosen else ' '} {number}", Text(joint.name), joint.unit]
        digits = 4 if joint.unit == "m" else 3
        cells += [_number(each, digits) for each in (joint.actual, joint.commanded, joint.lower, joint.upper)]
        cells += [_number(joint.load, 2)] * load + [_bar(joint)] * bar
        table.add_row(*cells, style="bold reverse" if i == view.chosen else "")
    return table


def _number(value: float, digits: int) -> str:
    if not isfinite(value):
        return "-"
    text = f"{value:.{digits}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def _bar(joint: Joint) -> str:
    """Where the joint is between its bounds."""
    share = (joint.actual - joint.lower) / (joint.upper - joint.lower) if joint.upper > joint.lower else float("nan")
    if not isfinite(share):
        return ""
    place = min(max(round(share * (_BAR - 1)), 0), _BAR - 1)
    return "|" + "-" * place + "o" + "-" * (_BAR - 1 - place) + "|"
