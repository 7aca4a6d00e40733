"""A guided calibration on the panel: what it shows is passed on to the pages, and what is pressed there back to it."""

from __future__ import annotations

from typing import Any, Final

from srl.runtime.ipc.guidance import GUIDE, OVER, REPORT, GuideReader, is_typed
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.web.panel.peer import BadMessageError, number

GONE: Final = "guide_gone"  # there is none now
LOOK: Final = 0.5  # s between looks whether one has come
_SILENT: Final = "It has ended without a word. Look at its terminal"


class Guiding:
    """Follows the calibration of a run folder, if there is one.

    Attributes:
        newest: what a page that comes now is told.
    """

    def __init__(self, run_folder: RunFolder) -> None:
        self._reader = GuideReader(run_folder)
        self.newest: dict[str, dict[str, Any]] = {}
        self._due = 0.0

    def look(self, now: float) -> list[dict[str, Any]]:
        """What the pages are told now. `now`: CLOCK_MONOTONIC s."""
        if now >= self._due:
            self._due = now + LOOK
            self._reader.look()
        was = self._reader.there
        found = self._reader.take()
        for message in found:
            self._keep(message)
        if was and not self._reader.there and OVER not in self.newest:
            found.append({"kind": OVER, "ok": False, "words": _SILENT})
            self._keep(found[-1])
        return found

    def _keep(self, message: dict[str, Any]) -> None:
        if message["kind"] == GUIDE:
            self.newest.pop(OVER, None)
            if not message["asks"]:
                self.newest.pop(REPORT, None)
        self.newest[message["kind"]] = message

    def forget(self) -> list[dict[str, Any]]:
        """Another run has begun: the calibration that has ended isn't its. What the pages are told."""
        found = self._reader.take()  # it may have ended a moment ago
        for message in found:
            self._keep(message)
        if self._reader.there or not self.newest:
            return found
        self.newest.clear()
        return [{"kind": GONE}]

    def press(self, message: dict[str, Any]) -> str:
        """Passes on what was pressed for a step. Returns why it can't be; "" if it left. Raises BadMessageError."""
        typed, step = message.get("typed"), number(message, "step")
        if not is_typed(typed) or step != int(step):
            raise BadMessageError("nobody can have typed that")
        return "" if self._reader.type(str(typed), int(step)) else "no calibration is there any more"

    def close(self) -> None:
        """Lets go of the calibration."""
        self._reader.close()
