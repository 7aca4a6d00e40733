"""Presses on the operator's panel, in place of a terminal's keys."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final, Self

from srl.commissioning.jog.hold import FINE, Hold
from srl.runtime.ipc.presses import FRESH
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.loop.control_end import ControlEnd, Datagram

_MOST: Final = 16  # datagrams taken at once: a flood must not keep the run's own process busy


class Presses:
    """Stands where `Terminal` stands: it hands presses to `hold` and shows nothing.

    Attributes:
        gone: "", as it never goes by itself. Without presses the joint brakes.
        size: columns and lines of what isn't shown.
    """

    gone = ""
    size = (80, 24)

    def __init__(self, run_folder: RunFolder, joints: int, hold: Hold) -> None:
        self._folder, self._joints, self._hold = run_folder, joints, hold
        self._end: ControlEnd | None = None
        self._resets: list[Datagram] = []

    def __enter__(self) -> Self:
        self._end = ControlEnd(self._folder.press_socket)
        return self

    def __exit__(self, *_: object) -> None:
        if self._end is not None:
            self._end.close()

    def pressed(self) -> list[str]:
        """Hands what came to `hold`. Returns no keys."""
        for _ in range(_MOST):
            datagram = self._end.take() if self._end is not None else None
            if datagram is None:
                break
            if datagram.content.get("ask") == "reset":
                self._resets.append(datagram)
                continue
            joint, way, expires, fine = (datagram.content.get(key) for key in ("joint", "way", "expires", "fine"))
            # The types first: True is no joint, and 1.0 no index.
            if type(joint) is int and type(way) is int and type(expires) is int and fine in (None, False, True):
                now = time.monotonic()
                rest = expires / 1e9 - now
                if 0 <= joint < self._joints and way in (-1, 0, 1) and 0.0 < rest <= FRESH:
                    self._hold.press(joint, float(way) * (FINE if fine else 1.0), now + rest, now)
        return []

    def resets(self, asked: Callable[[int], dict[str, Any] | None]) -> None:
        """Answers the resets that came with what `asked` says; it is given their `expires`, CLOCK_MONOTONIC ns."""
        came, self._resets = self._resets, []
        for datagram in came:
            expires = datagram.content.get("expires")
            answer = asked(expires) if type(expires) is int else None
            if answer is not None and datagram.sender is not None and self._end is not None:
                self._end.answer(datagram.sender, answer)

    def show(self, lines: list[str]) -> None:
        """The panel shows the run."""
