"""A guided calibration on the page of `srl panel`, in place of the terminal's picture and keys."""

from __future__ import annotations

import base64
import math
import tempfile
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, Self

from srl.commissioning.calibration.guided import Step, View
from srl.commissioning.calibration.screen import Report, Screen
from srl.runtime.contracts.errors import HostError, SrlError
from srl.runtime.ipc.guidance import GUIDE, OVER, REPORT, GuideEnd
from srl.runtime.ipc.run_folder import RunFolder

_KEPT: Final = 6  # lines that the page shows
_PERIOD: Final = 0.1  # s between two pictures of a step
_LOOK: Final = 0.05  # s between two looks at what was pressed, at the end
NO_JOINT: Final = -1
_LATE: Final = "what was pressed came too late: it was for the step before"
_NO_FILE: Final = "No file was written."


class PanelScreen(Screen):
    """Shows views on the page, and gives what is pressed there. What is said goes to the terminal, too.

    Attributes:
        joint: which of the run's joints the page's held keys move now; `NO_JOINT`: none; None: nothing ever moves.
    """

    def __init__(self, title: str, say: Callable[[str], None]) -> None:
        """
        Args:
            title: what is calibrated, and of whom.
            say: takes a line of text, for the terminal.
        """
        self._title, self._say = title, say
        self._folder: RunFolder | None = None
        self._end: GuideEnd | None = None
        self._messages: deque[str] = deque(maxlen=_KEPT)
        self._typed: deque[str] = deque()
        self._number, self._due = 0, 0.0
        self._step: Step | None = None
        self._shown: dict[str, Any] = {}
        self._written = ""
        self.joint: int | None = None

    def begin(self, run_folder: RunFolder) -> None:
        self._folder = run_folder
        self._say(f"guided on the page of `srl panel {run_folder.path.name}`; Ctrl-C ends")

    def __enter__(self) -> Self:
        """Raises HostError: the page can't be reached."""
        assert self._folder is not None
        try:
            self._end = GuideEnd(self._folder)
        except OSError as error:
            raise HostError(
                str(self._folder.guide_socket), f"the panel's socket can't be made: {error.strerror}",
                "Set SRL_RUNTIME_DIR to a shorter folder of yours, or calibrate without --panel",
            ) from None  # fmt: skip
        return self

    def __exit__(self, *raised: object) -> None:
        """Tells the page what came of it."""
        if self._end is None:
            return
        _, error, _ = raised
        words = str(error) if isinstance(error, SrlError) else _NO_FILE
        well = bool(self._written) and error is None
        self._end.tell({"kind": OVER, "ok": well, "words": self._written if well else words})
        self._end.close()
        self._end = None

    def show(self, view: View) -> None:
        self._listen()
        now, new = time.monotonic(), view.step != self._step
        if not new and now < self._due:
            return
        self._due, self._step = now + _PERIOD, view.step
        self._number += new
        self._shown = {
            "task": view.task, "lack": view.lack, "missing": view.missing, "things": view.things,
            "states": list(view.states), "asks": False, "joint": self.joint,
            "bars": [{"name": b.name, "share": _share(b.share), "said": b.text, "good": b.good} for b in view.bars],
        }  # fmt: skip
        self._tell()

    def say(self, text: str) -> None:
        self._say(text)
        self._messages.append(text)
        self._tell()

    def command(self) -> str:
        self._listen()
        return self._typed.popleft() if self._typed else "none"

    def report(self, report: Report) -> None:
        for line in (*report.lines, *(f"refused: {reason}" for reason in report.refused)):
            self._say(line)  # the page shows them as the report
        self._typed.clear()
        self._number, self._step = self._number + 1, None
        self._shown |= {
            "asks": True, "joint": None if self.joint is None else NO_JOINT, "missing": "", "lack": "", "bars": [],
            "task": "It can't be used as it is" if report.refused else "Done. Look at the report, then write the file",
        }  # fmt: skip
        self._tell()
        self.changed(report)

    def changed(self, report: Report) -> None:
        if self._end is None:
            return
        self._end.tell({
            "kind": REPORT, "step": self._number, "lines": list(report.lines), "refused": list(report.refused),
            "picture": _png(report.draw), "choices": [list(choice) for choice in report.choices],
        })  # fmt: skip

    def ask(self, question: str, wait: Callable[[], None]) -> str:
        """Waits until somebody answers on the page: nobody else can."""
        while (typed := self.command()) == "none":
            wait()
            time.sleep(_LOOK)
        return typed

    def written(self, words: str) -> None:
        self._written = f"Written: {words}"

    def _listen(self) -> None:
        for typed, step in self._end.heard() if self._end is not None else ():
            if step == self._number:
                self._typed.append(typed)
            else:
                self.say(_LATE)

    def _tell(self) -> None:
        if self._end is not None and self._shown:
            frame = {"kind": GUIDE, "title": self._title, "step": self._number, "said": list(self._messages)}
            self._end.tell(frame | self._shown)


def _share(share: float | None) -> float | None:
    return None if share is None or not math.isfinite(share) else min(max(share, 0.0), 1.0)


def _png(draw: Callable[[Path], None] | None) -> str:
    """A picture as base64; "" where there is none, or it can't be drawn now: the words are the report then."""
    if draw is None:
        return ""
    with tempfile.TemporaryDirectory(prefix="srl-") as folder:
        png = Path(folder) / "report.png"
        try:
            draw(png)
            return base64.b64encode(png.read_bytes()).decode()
        except (OSError, SrlError):
            return ""
