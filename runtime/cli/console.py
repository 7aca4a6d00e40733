"""Messages for people, to a terminal, a pipe or the journal, which never block the sender.

A terminal stopped with Ctrl-S, or a pipe that nobody reads, would block a write. The supervisor must not wait, so
a message that can't be written at once is dropped. Under systemd (JOURNAL_STREAM) a message goes to the journal
with structured fields.
"""

from __future__ import annotations

import io
import os
import select
import socket
from typing import TextIO

from srl.runtime.contracts.printable import printable
from srl.runtime.ipc.events import Level

JOURNAL = "/run/systemd/journal/socket"
_WORDS = {Level.INFO: "", Level.WARNING: "warning: ", Level.ERROR: "error: "}


class Console:
    """The output for a command's messages, apart from its result.

    Attributes:
        terminal: True for a terminal, where a status line may be rewritten in place.
        dropped: number of messages that could not be written.
        fields: fields of every journal entry: the instance and its state.
    """

    def __init__(self, stream: TextIO, journal: str = JOURNAL) -> None:
        """`journal` is the socket for entries, used if JOURNAL_STREAM shows that systemd is present."""
        try:
            self._descriptor: int | None = stream.fileno()
        except io.UnsupportedOperation:  # a stream in memory, in the place of a caller's standard error
            self._descriptor = None
        self.terminal = stream.isatty()
        self.dropped = 0
        self.fields: dict[str, str] = {}
        self._journal: socket.socket | None = None
        self._address = journal
        if os.environ.get("JOURNAL_STREAM"):
            self._journal = socket.socket(
                socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC
            )

    def say(self, text: str, level: Level = Level.WARNING) -> None:
        """Writes a message as a line of its own, or as its lines. A terminal obeys nothing in it."""
        text = "\n".join(map(printable, text.split("\n")))
        if self._journal is not None and self._enter(text, level):
            return
        self.write(f"srl: {_WORDS[level]}{text}\n")

    def write(self, text: str) -> None:
        """Writes a text as it is, at once or not at all."""
        data = text.encode(errors="replace")[: select.PIPE_BUF]  # as much as a ready pipe takes without blocking
        try:
            if self._descriptor is not None and select.select([], [self._descriptor], [], 0)[1]:
                os.write(self._descriptor, data)
                return
        except OSError:
            pass  # the reader has gone
        self.dropped += 1

    def _enter(self, text: str, level: Level) -> bool:
        """Sends an entry by journald's native protocol. Returns False if this fails."""
        assert self._journal is not None
        fields = {
            "MESSAGE": text.replace("\n", " | "),
            "PRIORITY": str(int(level)),
            "SYSLOG_IDENTIFIER": "srl",
        } | self.fields
        entry = "".join(f"{name}={value}\n" for name, value in fields.items())
        try:
            self._journal.sendto(entry.encode(errors="replace"), self._address)
        except OSError:
            return False
        return True
