"""What `srl jog` shows: each joint's place and bounds, the state of the run, the keys."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any, Final

from rich.console import Console
from rich.table import Table
from rich.text import Text

MOVES: Final = "1-9, 0, up, down choose   hold left/right: move   Space, Esc stop   q end"
_BAR: Final = 15  # columns


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
        said: the newest messages, the last one last.
    """

    title: str
    velocities: bool
    joints: Sequence[Joint]
    chosen: int
    load: str
    state: str
    well: bool
    help: str
    said: Sequence[str] = field(default=())


def lines(view: View, width: int, height: int) -> list[str]:
    """The picture for a terminal of this size."""
    table = Table(box=None, pad_edge=False, padding=(0, 1), header_style="dim")
    bounded = any(isfinite(j.lower) and isfinite(j.upper) and isfinite(j.actual) for j in view.joints)
    heads = ["", "joint", "unit", "actual", "commanded" + "/s" * view.velocities, "lower", "upper", "speed/s"]
    for name in heads + [view.load] * bool(view.load):
        table.add_column(name, justify="left" if name in ("", "joint", "unit") else "right", no_wrap=True)
    wide = bounded and width >= 100
    if wide:
        table.add_column("lower .. upper", no_wrap=True)
    for i, joint in enumerate(view.joints):
        number = f"{(i + 1) % 10}" if i < 10 else " "
        cells: list[Any] = [f"{'>' if i == view.chosen else ' '} {number}", Text(joint.name), joint.unit]
        figures = [joint.actual, joint.commanded, joint.lower, joint.upper]
        cells += [_number(value) for value in figures] + [f"{joint.speed:.3g}"]
        cells += [_number(joint.load, 2)] * bool(view.load) + [_bar(joint)] * wide
        table.add_row(*cells, style="bold reverse" if i == view.chosen else "")
    console = Console(
        file=io.StringIO(), width=width, force_terminal=True, color_system="standard", legacy_windows=False
    )
    console.print(Text(view.title, style="bold"), no_wrap=True, overflow="ellipsis")
    console.print(Text(view.state, style="green" if view.well else "bold red"))
    console.print()
    console.print(table)
    console.print()
    console.print(Text(view.help, style="dim"))
    shown = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    room = height - len(shown) - 1
    for text in list(view.said)[-room:] if room > 0 else ():
        shown.append(text[:width])
    return list(map(str, shown))


def _number(value: float, digits: int = 4) -> str:
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
