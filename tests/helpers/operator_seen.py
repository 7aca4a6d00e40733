"""The operator's panel in a browser, as a person sees it and acts on it."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from helpers.chromium import Page
from helpers.operated import OperatedLoop
from helpers.wait import TIMEOUT, until
from srl.runtime.web.operator.client import OperatorPage


class Seen:
    """A loop that runs, and its panel in the browser."""

    def __init__(self, loop: OperatedLoop, process: OperatorPage, page: Page) -> None:
        self.loop, self.process, self.page = loop, process, page
        self._anew: tuple[tuple[str, dict[str, object]], ...] = ()  # lets go what is down, and presses it again

    def now(self, key: str) -> Any:
        """What the newest frame shows."""
        return self.page.value(f"globalThis.pictureNow && pictureNow.{key}")

    def text(self, part: str) -> str:
        """What a part of the page says; nothing if it isn't shown."""
        return str(self.page.value(f"document.getElementById('{part}').checkVisibility() ? "
                                   f"document.getElementById('{part}').innerText : ''"))  # fmt: skip

    def says(self, part: str, words: str) -> None:
        """Waits until a part of the page says it."""
        until(lambda: words in self.text(part), what=lambda: f"{part} says '{words}': {self.text(part)}")

    def click(self, part: str) -> None:
        self.page.value(f"document.getElementById('{part}').click()")

    def able(self, part: str) -> bool:
        return bool(self.page.value(f"!document.getElementById('{part}').disabled"))

    def control(self) -> None:
        """Takes the control; again where it ended at once, which a host under load makes it do."""
        button = "document.getElementById('control')"  # off for a moment when pictures come late
        for timeout in (3.0, 3.0, TIMEOUT):
            until(lambda: self.page.value(f"!{button}.disabled && ({button}.click(), true)"))
            with suppress(AssertionError):
                until(lambda: self.now("control"), timeout=timeout)
                return
        raise AssertionError("the page doesn't get the control")

    def key(self, kind: str, **key: object) -> None:
        """A key goes down (`rawKeyDown`) or up (`keyUp`)."""
        self._act("Input.dispatchKeyEvent", kind, {"rawKeyDown": key, "keyUp": key})

    def mouse(self, kind: str, **place: object) -> None:
        """The first button of a mouse goes down (`mousePressed`) or up (`mouseReleased`) at a place of `higher`."""
        events = {"mousePressed": {"buttons": 1}, "mouseReleased": {"buttons": 0}}
        self._act("Input.dispatchMouseEvent", kind, {k: {"button": "left"} | v | place for k, v in events.items()})

    def _act(self, method: str, kind: str, events: dict[str, dict[str, object]]) -> None:
        """`events`: what each of down and up says."""
        self.page.ask(method, type=kind, **events[kind])
        down, up = ((method, {"type": each} | event) for each, event in events.items())
        self._anew = (up, down) if kind == down[1]["type"] else ()

    def higher(self, joint: int) -> dict[str, Any]:
        """A mouse on the button that moves a joint to higher values."""
        button = f"document.querySelectorAll('.joint')[{joint}].children[2]"
        x, y = self.page.value(f"(() => {{ {button}.scrollIntoView(); const b = {button}.getBoundingClientRect();"
                               " return [b.x + b.width / 2, b.y + b.height / 2]; })()")  # fmt: skip
        return {"x": x, "y": y, "clickCount": 1}

    def passed(self, frames: int = 25) -> None:
        """Waits until the page was drawn so often again."""
        seen = self.now("frames")
        until(lambda: self.now("frames") > seen + frames)

    def held(self) -> None:
        """Waits until what is held makes presses.

        The page lets go what is held where pictures came late, and its control ends where it was silent for long: a
        host under load does both. It is pressed anew then, as a person does.
        """
        before = len(self.loop.presses)

        def made() -> bool:
            if self._anew and not self.now("jogging"):
                if not self.now("control"):
                    self.control()
                for method, event in self._anew:
                    self.page.ask(method, **event)
            return sum(p["way"] == 1 for _, p in self.loop.presses[before:]) > 5

        until(made)

    def let_go(self) -> None:
        """Waits until nothing is held, and checks that no press follows."""
        until(lambda: self.now("jogging") == 0)
        # What is on its way arrives before a picture that is made afterwards is answered.
        frames = self.now("frames")
        until(lambda: self.now("frames") > frames + 10)
        before = len(self.loop.presses)
        until(lambda: self.now("frames") > frames + 25)
        assert [p for _, p in self.loop.presses[before:] if p["way"]] == []
