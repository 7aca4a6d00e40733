"""The loop's side of one of its Unix sockets: datagrams with the process and the user that the kernel gives.

The datagrams are described in `srl.runtime.ipc.control_socket`.
"""

from __future__ import annotations

import json
import os
import socket
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from srl.runtime.ipc.control_socket import DATAGRAM

_CREDENTIALS = struct.Struct("3i")  # struct ucred: pid, uid, gid
_ROOM = socket.CMSG_SPACE(_CREDENTIALS.size)  # for no more: descriptors that a sender passes are dropped


@dataclass(frozen=True, slots=True)
class Datagram:
    """One datagram. `sender`: the address for an answer, if it has one; `pid`, `uid`: -1 where the kernel is silent."""

    content: dict[str, Any]
    sender: str | bytes | None
    pid: int
    uid: int


class ControlEnd:
    """A bound socket; see the module's docstring. Nothing here blocks."""

    def __init__(self, path: Path) -> None:
        self._path = path
        path.unlink(missing_ok=True)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        self._socket.bind(str(path))
        os.chmod(path, 0o660)

    def take(self) -> Datagram | None:
        """Returns the next datagram; None if there is none. What is no JSON object has an empty content."""
        try:
            data, ancillary, _, sender = self._socket.recvmsg(DATAGRAM, _ROOM)
        except BlockingIOError:
            return None
        pid = uid = -1
        for level, kind, value in ancillary:
            if level == socket.SOL_SOCKET and kind == socket.SCM_CREDENTIALS and len(value) == _CREDENTIALS.size:
                pid, uid, _ = _CREDENTIALS.unpack(value)
        try:
            content = json.loads(data)
        except (ValueError, RecursionError):
            content = None
        return Datagram(content if isinstance(content, dict) else {}, sender or None, pid, uid)

    def fileno(self) -> int:
        """The descriptor to wait on."""
        return self._socket.fileno()

    def answer(self, sender: str | bytes, content: dict[str, Any]) -> None:
        """Sends an answer. It is no error if the sender has gone: nobody waits for it then."""
        try:
            self._socket.sendto(json.dumps(content).encode(), sender)
        except OSError:
            pass

    def close(self) -> None:
        """Closes and removes the socket."""
        self._socket.close()
        self._path.unlink(missing_ok=True)
