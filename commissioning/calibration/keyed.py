"""The terminal of a calibration that moves something: the keys of `srl jog` move the joint, the others guide."""

from __future__ import annotations

import io
from collections import deque
from collections.abc import Callable
from textwrap import wrap
from typing import Final

from rich.console import Console
from rich.text import Text

from srl.commissioning.calibration.guided import View
from srl.commissioning.calibration.screen import Screen, picture
from srl.commissioning.jog.screen import View as Joints
from srl.runtime.ipc.header import State

KEYS: Final = "left, right held: move it   , . finely   Space, Esc: STOP   any other key brakes"


class Keyed(Screen):
    """Draws on the terminal of a `srl.commissioning.jog.session.Session`, as its face, and takes the keys that guide.

    A space is a stop, so "do joint 3 again" is typed `r3` Enter.
    """

    def __init__(self, title: str) -> None:
        self._title = title
        self._view: View | None = None
        self._question = self._typed = ""
        self._commands: deque[str] = deque()
        self.messages: list[str] = []  # all that was said: the terminal's screen is gone afterwards

    def show(self, view: View) -> None:
        self._view = view

    def say(self, text: str) -> None:
        self.messages.append(text)

    def command(self) -> str:
        return self._commands.popleft() if self._commands else "none"

    def ask(self, question: str, wait: Callable[[], None]) -> str:
        self._question = question
        try:
            while (typed := self.command()) == "none":
                wait()
        finally:
            self._question = ""
        return typed

    def key(self, key: str, state: State) -> bool:
        """See `srl.commissioning.jog.session.Face`. What a jog does with `s` and `r` where it doesn't move stays."""
        if not self._typed and (key, state) in (("s", State.READY), ("r", State.STOPPED)):
            return False
        if key == "enter":
            typed, self._typed = self._typed, ""
            self._commands.append(f"r {typed[1:]}" if typed else "")
        elif key == "backspace":
            self._typed = self._typed[:-1]
        elif key in ("s", "q") and not self._typed:
            self._commands.append(key)
        elif key == "r" and not self._typed:
            self._typed = key
        elif key.isdecimal() and self._typed:
            self._typed += key
        else:
            return key.isdecimal()
        return True

    def lines(self, view: Joints, width: int, height: int) -> list[str]:
        """See `srl.commissioning.jog.session.Face`."""
        console = Console(
            file=io.StringIO(), width=width, force_terminal=True, color_system="standard", legacy_windows=False
        )
        console.print(Text(view.state, style="green" if view.well else "bold red"))
        console.print(Text(KEYS if view.well else view.help))
        if self._question:
            console.print(Text(f"{self._question}\n> {self._typed}", style="bold white on blue"))
        elif self._view is not None:
            console.print(picture(self._title, self._view, self._typed))
        shown: list[str] = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
        room = height - len(shown)
        output = [line for text in self.messages[-40:] for line in wrap(text, width)]
        return [*shown, *(output[-room:] if room > 0 else ())]
