"""A library that brings threads and open sockets, in a process of its own: the driver's end, which never waits."""

from __future__ import annotations

import contextlib
import select
import socket
import subprocess
import sys
import time
from typing import NoReturn

from srl.runtime.contracts.errors import DeviceError


class ProcessEndedError(Exception):
    """The process is gone."""


class HelperProcess:
    """`python -m MODULE DESCRIPTOR`, with whole messages over a socket (Unix, SEQPACKET).

    The process must end when the socket closes: with this object, or with this program.
    """

    def __init__(self, place: str, module: str, what: str) -> None:
        """
        Args:
            place: the device, for errors.
            module: what runs in the process.
            what: its name for people, as "zenoh process".
        """
        self.place, self.what = place, what
        self._module = module
        self._end: socket.socket | None = None
        self._process: subprocess.Popen[bytes] | None = None

    def ensure(self) -> None:
        """Starts it unless it runs. Blocks for a moment. Raises DeviceError: the host has no room for it."""
        if self._end is not None and self._process is not None and self._process.poll() is None:
            return
        self.let_go()
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.setblocking(False)
        with theirs:
            try:
                self._process = subprocess.Popen(
                    [sys.executable, "-m", self._module, str(theirs.fileno())],
                    pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL, start_new_session=True,
                )  # fmt: skip
            except OSError as error:
                ours.close()
                raise DeviceError(
                    self.place, f"its {self.what} can't be started: {error.strerror}", "Look at the host's limits"
                ) from None
        self._end = ours

    def fileno(self) -> int | None:
        """The socket's descriptor, None without a process."""
        return None if self._end is None else self._end.fileno()

    def pid(self) -> int | None:
        """The process id, None without a process."""
        return None if self._process is None else self._process.pid

    def give(self, message: bytes) -> bool:
        """Sends a message without blocking. Returns False if there is no room. Raises ProcessEndedError."""
        if self._end is None:
            raise ProcessEndedError
        try:
            self._end.send(message)
        except BlockingIOError:
            return False
        except OSError:
            self.let_go()
            raise ProcessEndedError from None
        return True

    def tell(self, message: bytes) -> None:
        """Sends a message; blocks up to 1 s. Raises ProcessEndedError, and DeviceError for a process that hangs."""
        deadline = time.monotonic() + 1.0
        while not self.give(message):
            if time.monotonic() > deadline:
                self.end_hanging()
            time.sleep(0.001)

    def take(self) -> bytes | None:
        """The next message that has arrived; None if there is none. Raises ProcessEndedError."""
        if self._end is None:
            raise ProcessEndedError
        try:
            message = self._end.recv(1 << 17)
        except BlockingIOError:
            return None
        except OSError:
            message = b""
        if not message:
            self.let_go()
            raise ProcessEndedError
        return message

    def wait(self, timeout: float) -> None:
        """Blocks until a message is there, `timeout` s at most."""
        if self._end is not None:
            select.select([self._end], [], [], max(timeout, 0))

    def let_go(self) -> None:
        """Closes the socket, which makes the process end; reaps the process if it has ended."""
        end, self._end = self._end, None
        if end is not None:
            end.close()
        if self._process is not None:
            self._process.poll()
            self._process = None

    def kill(self) -> None:
        """Ends the process at once, without its help."""
        process = self._process
        self.let_go()
        if process is not None:
            process.kill()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(1.0)

    def end_hanging(self) -> NoReturn:
        """Kills it. Raises DeviceError: it can't end in an orderly way, and the next attempt needs one that works."""
        self.kill()
        raise DeviceError(self.place, f"its {self.what} hangs", "It was ended, and is started again")
