"""The terminal of `srl jog`: its keys, and a picture that is written only as far as the terminal takes it.

Whoever draws also watches the loop, so nothing here waits: a terminal that takes nothing shows an old picture.
"""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import time
from typing import Any, Final, Self

from srl.commissioning.jog.keys import Keys
from srl.runtime.contracts.errors import HostError, RequestError

_BEGIN: Final = "\x1b[?1049h\x1b[?25l\x1b[?1004h"  # a screen of its own, no cursor, and word of a lost focus
_END: Final = "\x1b[?1004l\x1b[?25h\x1b[?1049l"
_TIMEOUT: Final = 0.5  # s that the last bytes may take


class Terminal:
    """The terminal at standard input.

    Attributes:
        gone: why no more keys will come; "" while they do.
    """

    def __init__(self) -> None:
        """Raises RequestError: there is none. HostError: it can't be opened."""
        # Without an input at all it is None: `<&-` in a shell, a service.
        if sys.stdin is None or sys.stdin.closed or not sys.stdin.isatty():
            remedy = "Run it in a terminal (ssh -t on another machine)"
            raise RequestError("the terminal", "standard input is no terminal, so no key can be read", remedy)
        try:
            path = os.ttyname(sys.stdin.fileno())
            # Opened anew: a mode without waiting, set on the shell's own description, would stay there.
            self._descriptor = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
        except OSError as error:
            raise HostError("the terminal", f"it can't be opened: {error.strerror}", "Use another one") from None
        with contextlib.suppress(OSError):  # it doesn't control this session: then there are no jobs either
            if os.tcgetpgrp(self._descriptor) != os.getpgrp():
                os.close(self._descriptor)
                remedy = "Run it in the foreground, without &"
                raise RequestError("the terminal", "it belongs to another job: the keys would go there", remedy)
        self.gone = ""
        self._keys, self._left = Keys(), b""
        self._before: list[Any] = []

    def __enter__(self) -> Self:
        """Takes the keys one by one. What was typed before counts for nothing."""
        self._before = termios.tcgetattr(self._descriptor)
        mode = termios.tcgetattr(self._descriptor)
        mode[0] &= ~(termios.IXON | termios.ICRNL)  # Ctrl-S must not freeze the picture
        mode[3] &= ~(termios.ICANON | termios.ECHO)
        mode[6][termios.VMIN], mode[6][termios.VTIME] = 1, 0
        termios.tcsetattr(self._descriptor, termios.TCSAFLUSH, mode)
        self._left = _BEGIN.encode()
        self._write()
        return self

    def __exit__(self, *_: object) -> None:
        """Leaves the terminal as it was."""
        self._left += _END.encode()
        end = time.monotonic() + _TIMEOUT
        while self._left and not self.gone and (left := end - time.monotonic()) > 0.0:
            select.select([], [self._descriptor], [], left)
            self._write()
        with contextlib.suppress(termios.error):  # it has gone
            termios.tcsetattr(self._descriptor, termios.TCSANOW, self._before)
        os.close(self._descriptor)

    @property
    def size(self) -> tuple[int, int]:
        """Columns and lines."""
        try:
            size = os.get_terminal_size(self._descriptor)
        except OSError:
            return 80, 24
        return size.columns or 80, size.lines or 24

    def pressed(self) -> list[str]:
        """The keys that came since the last call."""
        data = b""
        try:
            data = os.read(self._descriptor, 4096)
            if not data:
                self.gone = "the terminal has gone"
        except BlockingIOError:
            pass
        except OSError:
            self.gone = "the terminal has gone"
        found = self._keys.take(data, time.monotonic())
        if b"\x04" in data:
            self.gone = "the input has ended"
        elif "focus lost" in found:
            self.gone = "the terminal has lost the focus"
        return found

    def show(self, lines: list[str]) -> None:
        """Draws these lines in place of the ones before, if the terminal has taken those."""
        if not self._left:
            _, rows = self.size
            text = "\r\n".join(f"{line}\x1b[K" for line in lines[:rows])
            self._left = f"\x1b[H{text}\x1b[J".encode(errors="replace")
        self._write()

    def _write(self) -> None:
        try:
            self._left = self._left[os.write(self._descriptor, self._left) :]
        except BlockingIOError:
            pass
        except OSError:
            self.gone = "the terminal has gone"
