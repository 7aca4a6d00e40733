"""What a guided calibration shows on the terminal, and the keys that it takes."""

from __future__ import annotations

import os
import select
import sys
import termios
import time
import tty
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

from rich.console import Console, Group
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from srl.commissioning.calibration.guided import Step, View
from srl.runtime.ipc.run_folder import RunFolder

_PERIOD: Final = 0.1  # s between two pictures
_BAR: Final = 30
_STYLES: Final = {"done": "green", "now": "bold cyan", "weak": "yellow", "waiting": "dim", "left out": "dim"}
KEYS: Final = "Enter go on   s leave it out   r N Enter redo number N   q quit"


@dataclass(frozen=True)
class Report:
    """The quality report at the end.

    Attributes:
        lines: as text.
        refused: why no file can be written; none if one can.
        draw: draws its picture into a file, and raises RecordError; None: there is none.
        choices: what else may be typed now, each with its words.
    """

    lines: Sequence[str]
    refused: Sequence[str]
    draw: Callable[[Path], None] | None
    choices: Sequence[tuple[str, str]] = ()


class Screen(ABC):
    """Shows views and gives the keys pressed."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Leaves the terminal as it was."""

    @abstractmethod
    def show(self, view: View) -> None:
        """Shows the newest view; may be called as often as one likes."""

    @abstractmethod
    def say(self, text: str) -> None:
        """Shows a line that stays."""

    def command(self) -> str:
        """The next command that was typed: "", "s", "r 3", "q", ... without a wait; "none" if there is none."""
        return "none"

    def begin(self, run_folder: RunFolder) -> None:
        """The run is there, whose instance has this folder; called before it is entered, if there is one."""

    def report(self, report: Report) -> None:
        """Shows the quality report."""
        for line in report.lines:
            self.say(line)
        for reason in report.refused:
            self.say(f"refused: {reason}")

    def changed(self, report: Report) -> None:
        """What was typed has changed the report."""

    def ask(self, question: str, wait: Callable[[], None]) -> str:
        """Waits for an answer, and calls `wait` meanwhile; "" where nobody can give one."""
        return ""

    def written(self, words: str) -> None:
        """The file is written; `words` say where."""


class Plain(Screen):
    """One line for each step, for what isn't a terminal."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._last: Step | None = None

    def show(self, view: View) -> None:
        if view.step != self._last:
            self._last = view.step
            self._say(view.task)

    def say(self, text: str) -> None:
        self._say(text)


class Terminal(Screen):
    """A live picture."""

    def __init__(self, title: str, console: Console | None = None) -> None:
        self._title = title
        self._live = Live(
            console=console or Console(stderr=True), auto_refresh=False, transient=True, redirect_stdout=False
        )
        self._next = 0.0
        self._typed = ""
        # Without an input at all it is None: `<&-` in a shell, a service.
        self._keys = sys.stdin is not None and not sys.stdin.closed and sys.stdin.isatty()
        self._before: list[Any] = []

    def __enter__(self) -> Self:
        if self._keys:
            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()
        if self._keys:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    def show(self, view: View) -> None:
        now = time.monotonic()
        if now >= self._next:
            self._next = now + _PERIOD
            self._live.update(picture(self._title, view, self._typed), refresh=True)

    def say(self, text: str) -> None:
        self._live.console.print(text, highlight=False, markup=False)

    def command(self) -> str:
        while self._keys and select.select([sys.stdin], [], [], 0)[0]:
            key = os.read(sys.stdin.fileno(), 1).decode(errors="replace")
            if not key:
                self._keys = False
                return "none"
            if key in "\r\n":
                typed, self._typed = self._typed.strip(), ""
                return typed
            if key in "\x7f\b":
                self._typed = self._typed[:-1]
            elif not self._typed and key in "sq":
                return key
            elif key.isprintable():
                self._typed += key
        return "none"

    def ask(self, question: str, wait: Callable[[], None]) -> str:
        if not self._keys:
            return ""
        self.say(question)
        while (typed := self.command()) == "none":
            if not self._keys:
                return ""
            self._live.update(Text(f"> {self._typed}"), refresh=True)
            select.select([sys.stdin], [], [], 0.05)
            wait()
        return typed


def picture(title: str, view: View, typed: str = "") -> Panel:
    """The live picture of a view."""
    rows: list[Any] = [Text(view.task, style="bold white on blue", justify="center"), Text()]
    table = Table.grid(padding=(0, 2))
    for each in view.bars:
        colours: dict[str, Any] = {}
        if each.good is not None:
            colour = "green" if each.good else "red"
            colours = {"complete_style": colour, "finished_style": colour}
        drawn: Any = ""
        if each.share is not None:
            drawn = ProgressBar(total=1.0, completed=min(each.share, 1.0), width=_BAR, **colours)
        table.add_row(each.name, drawn, each.text)
    rows.append(table)
    if view.missing:
        rows.append(Text(view.missing, style="red"))
    if view.lack:
        rows.append(Text(view.lack, style="yellow"))
    if view.states:
        listed = Text(f"{view.things} ")
        for i, state in enumerate(view.states):
            short = state.partition(":")[0]
            sign = {"done": "✓", "weak": "!", "now": "▶", "left out": "–"}.get(short, "·")
            listed.append(f" {i + 1}{sign}", style=_STYLES.get(short, ""))
        rows += [Text(), listed]
        rows += [
            Text(f"  {view.things.removesuffix('s')} {i + 1} {s}", style="yellow")
            for i, s in enumerate(view.states)
            if s.startswith("weak")
        ]
    rows += [Text(), Text(f"> {typed}" if typed else KEYS, style="dim")]
    return Panel(Group(*rows), title=Text(title), title_align="left")
