"""The way of a guided calibration to the operator's panel and back: a socket in the run folder.

Both ends send JSON, an object a line. The calibration says:

- {"kind": "guide", "asks": bool, ...}: what the person is shown now, and whether it is the question at the end. One
  that a slow reader hasn't taken is replaced by the next.
- {"kind": "guide_report", ...}: the quality report, with its picture as base64 of a PNG.
- {"kind": "guide_over", "ok": bool, "words": str}: it has ended; `words`: the file, or why there is none.

The panel says {"typed": what would be typed on the terminal, "step": the number of what was shown}. It counts for that
step only: what was pressed for another one does nothing.
"""

from __future__ import annotations

import contextlib
import json
import select
import socket
import time
from typing import Any, Final

from srl.runtime.ipc.run_folder import RunFolder

GUIDE: Final = "guide"
REPORT: Final = "guide_report"
OVER: Final = "guide_over"
LONGEST: Final = 512  # bytes of a line from the panel
TYPED: Final = 64  # characters of it
_HELD: Final = 4 << 20  # bytes that a reader may be behind; then it is let go
_READERS: Final = 8
_LAST: Final = 1.0  # s that the last words may take to leave


class GuideEnd:
    """The calibration's end. Nothing here waits, but `close`."""

    def __init__(self, run_folder: RunFolder) -> None:
        """Raises OSError: the socket can't be made."""
        self._path = run_folder.guide_socket
        self._path.unlink(missing_ok=True)  # of one that was killed
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK)
        self._listener.bind(str(self._path))
        self._path.chmod(0o600)
        self._listener.listen(_READERS)
        self._readers: dict[socket.socket, _Reader] = {}
        self._newest: dict[str, bytes] = {}

    def tell(self, message: dict[str, Any]) -> None:
        """Says a message to every reader, and to those that come later."""
        line = json.dumps(message).encode() + b"\n"
        kind = message["kind"]
        if kind == GUIDE and not message["asks"]:
            self._newest.pop(REPORT, None)  # it was of the steps before
        self._newest[kind] = line
        for reader in self._readers.values():
            if kind != GUIDE or not reader.out:
                reader.out += line
        self._send()

    def heard(self) -> list[tuple[str, int]]:
        """What was typed since the last call, each with the number of its step."""
        with contextlib.suppress(OSError):
            while len(self._readers) < _READERS:
                made, _ = self._listener.accept()
                made.setblocking(False)
                self._readers[made] = _Reader(out=bytearray(b"".join(self._newest.values())))
        found: list[tuple[str, int]] = []
        for end, reader in list(self._readers.items()):
            try:
                found += reader.take(end.recv(4096))
            except BlockingIOError:
                pass
            except (OSError, ValueError):  # it has gone, or says what no panel says
                self._drop(end)
        self._send()
        return found

    def close(self) -> None:
        """Lets the last words leave, and ends it."""
        until = time.monotonic() + _LAST
        while any(reader.out for reader in self._readers.values()) and time.monotonic() < until:
            select.select([], [end for end, reader in self._readers.items() if reader.out], [], 0.1)
            self._send()
        for end in list(self._readers):
            self._drop(end)
        self._listener.close()
        self._path.unlink(missing_ok=True)

    def _send(self) -> None:
        for end, reader in list(self._readers.items()):
            try:
                while reader.out:
                    del reader.out[: end.send(reader.out)]
            except BlockingIOError:
                if len(reader.out) > _HELD:
                    self._drop(end)
            except OSError:
                self._drop(end)

    def _drop(self, end: socket.socket) -> None:
        self._readers.pop(end, None)
        end.close()


class _Reader:
    """A panel at the other end: what it hasn't taken yet, and the beginning of what it says."""

    def __init__(self, out: bytearray) -> None:
        self.out = out
        self._started = b""

    def take(self, data: bytes) -> list[tuple[str, int]]:
        """Raises ValueError: it is no panel. ConnectionError: it has gone."""
        if not data:
            raise ConnectionError
        *lines, self._started = (self._started + data).split(b"\n")
        if len(self._started) > LONGEST:
            raise ValueError
        return [self._typed(line) for line in lines]

    @staticmethod
    def _typed(line: bytes) -> tuple[str, int]:
        content = json.loads(line[:LONGEST])
        typed, step = (content.get(key) for key in ("typed", "step")) if isinstance(content, dict) else (None, None)
        if not is_typed(typed) or type(step) is not int:
            raise ValueError
        return str(typed), step


class GuideReader:
    """The panel's end. Nothing here waits.

    Attributes:
        there: whether a calibration is at the other end.
    """

    def __init__(self, run_folder: RunFolder) -> None:
        self._path = run_folder.guide_socket
        self._end: socket.socket | None = None
        self._started = b""

    @property
    def there(self) -> bool:
        return self._end is not None

    def look(self) -> None:
        """Connects, if a calibration has come."""
        if self._end is not None or not self._path.exists():
            return
        end = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK)
        try:
            end.connect(str(self._path))
        except OSError:  # of one that was killed, or it is busy
            end.close()
        else:
            self._end, self._started = end, b""

    def take(self) -> list[dict[str, Any]]:
        """The messages since the last call."""
        if self._end is None:
            return []
        try:
            while data := self._end.recv(1 << 16):
                self._started += data
            self.close()
        except BlockingIOError:
            pass
        except OSError:
            self.close()
        *lines, self._started = self._started.split(b"\n")
        return [json.loads(line) for line in lines]

    def type(self, typed: str, step: int) -> bool:
        """Sends what was typed for a step. Returns whether it left."""
        if self._end is None:
            return False
        line = json.dumps({"typed": typed, "step": step}).encode() + b"\n"
        try:
            return self._end.send(line) == len(line)
        except OSError:
            return False

    def close(self) -> None:
        """Lets go of it."""
        if self._end is not None:
            self._end.close()
            self._end = None


def is_typed(value: object) -> bool:
    """Whether it is something that a person may have typed."""
    return isinstance(value, str) and len(value) <= TYPED and (value.isprintable() or not value)
