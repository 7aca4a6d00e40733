"""A log of a link's bytes, for debugging."""

from __future__ import annotations

import time

from srl.drivers.transport.base import Transport
from srl.runtime.contracts.errors import DeviceError


class Spy(Transport):
    """Wraps another link and logs its bytes: seconds since opening, direction, hex, text.

    For debugging only, not for normal operation: the loop writes the log and can block on the disk.
    """

    def __init__(self, inner: Transport, url: str, file: str, place: str) -> None:
        super().__init__(url, place)
        self._inner = inner
        self._start = time.monotonic()
        try:
            self._log = open(file, "w", buffering=1, encoding="ascii")  # noqa: SIM115
        except OSError as error:
            inner.close()
            raise DeviceError(
                place, f"the log {file} can't be written: {error.strerror}", "Name another file"
            ) from error

    def fileno(self) -> int:
        return self._inner.fileno()

    def _read_fileno(self) -> int:
        return self._inner._read_fileno()

    def _take(self, most: int) -> bytes:
        data = self._inner._take(most)
        self._note("<", data)
        return data

    def _give(self, data: bytes) -> int:
        taken = self._inner._give(data)
        self._note(">", data[:taken])
        return taken

    def _queued(self) -> int:
        return self._inner._queued()

    def _shut(self) -> None:
        try:
            self._log.close()  # fails if the disk is full
        finally:
            self._inner._shut()

    def _note(self, direction: str, data: bytes) -> None:
        seconds = time.monotonic() - self._start
        for at in range(0, len(data), 16):
            row = data[at : at + 16]
            text = "".join(chr(byte) if 32 <= byte < 127 else "." for byte in row)
            self._log.write(f"{seconds:12.6f} {direction} {row.hex(' '):<47}  {text}\n")
