"""A made-up run of a body, and its picture in a browser."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from helpers.body_run import body_layout, body_rows
from helpers.chromium import Page
from helpers.panel import MadeUpLoop
from helpers.wait import until
from srl.runtime.web.operator.client import OperatorPage as PageProcess

ROWS = body_rows(body_layout(), 400)


class BodyLoop(MadeUpLoop):
    """A made-up loop whose rows are those of a body.

    Attributes:
        at: the row of ROWS that is written, again and again.
    """

    def __init__(self, path: Path) -> None:
        self.at = 0
        super().__init__(path)

    def begin(self) -> None:
        self.layout = body_layout()
        super().begin()

    def step(self, at: float | None = None) -> None:
        self.cycle += 1
        row, names = ROWS[self.at].copy(), self.layout.int_names
        now = time.monotonic_ns()
        for i, word in enumerate(("now", "deadline", "wake", "read", "control", "guard", "write")):
            row[names.index(word)] = now + 10_000 * i
        row[names.index("cycle")], row[names.index("state")] = self.cycle, self.state
        row[names.index("suit.stamp")], row[names.index("suit.link")] = now - 8_000_000, self.link
        self.ring.append(row)


class Seen:
    """A loop that runs, its page's process, and the page in the browser."""

    def __init__(self, loop: MadeUpLoop, process: PageProcess, page: Page) -> None:
        self.loop, self.process, self.page = loop, process, page

    def now(self, key: str) -> Any:
        """What the newest frame shows."""
        return self.page.value(f"globalThis.pictureNow && pictureNow.{key}")

    def until(self, key: str, value: object) -> None:
        """Waits for a frame that shows it."""
        until(lambda: self.now(key) == value, what=lambda: f"{key} is {value}: {self.now(key)}")

    def text(self, part: str) -> str:
        """What a part of the page says; nothing if it isn't shown."""
        return str(self.page.value(f"document.getElementById('{part}').checkVisibility() ? "
                                   f"document.getElementById('{part}').innerText : ''"))  # fmt: skip

    def things(self) -> dict[str, np.ndarray]:
        """The numbers that are drawn, by signal; NaN for null."""
        return {name: np.array(values, float) for name, values, _ in self.now("things")}

    def colors(self) -> set[tuple[int, ...]]:
        """The colours in the picture."""
        script = """(() => { const c = document.getElementById("space"), seen = new Set();
            const d = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
            for (let i = 0; i < d.length; i += 4) seen.add(d[i] * 65536 + d[i + 1] * 256 + d[i + 2]);
            return [...seen]; })()"""
        return {((n >> 16) & 255, (n >> 8) & 255, n & 255) for n in self.page.value(script)}

    def picture(self, folder: Path) -> np.ndarray:
        """(height, width, 3) of the canvas, as it is seen."""
        self.page.picture(folder / "seen.png")
        whole = np.asarray(Image.open(folder / "seen.png").convert("RGB")).astype(int)
        x, y, width, height = self.page.value(
            "(b => [b.x, b.y, b.width, b.height].map(Math.round))"
            "(document.getElementById('space').getBoundingClientRect())"
        )
        return whole[y : y + height, x : x + width]
