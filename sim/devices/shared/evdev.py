"""Twins of input devices: the kernel's records on a Unix socket, with a text line that replaces the ioctls.

Without a kernel that provides input devices, a twin can't come closer. The records and their meaning are the
kernel's; the description and the reading of the whole state use another path (drivers/evdev/source.py).
"""

from __future__ import annotations

import contextlib
import shutil
import socket
import tempfile
from abc import abstractmethod
from pathlib import Path

from srl.drivers.evdev.records import EV_SYN, RECORD, SYN_DROPPED, Description, encode
from srl.runtime.contracts.errors import HostError
from srl.runtime.contracts.world import Fake, Twin
from srl.sim.devices.shared.windows import Windows, inside


class EventTwin(Twin):
    """A device that sends the changes since its last report to one client.

    Attributes:
        muted: it sends nothing; the kernel would not notice.
    """

    def __init__(self, fake: Fake) -> None:
        super().__init__(fake)
        self.muted = False
        self.reports = self.drops = self.connects = 0
        self._windows: Windows = getattr(fake.options, "loss", ())
        self._in_window = False
        self._folder: Path | None = None
        self._listener: socket.socket | None = None
        self._client: socket.socket | None = None
        self._sent: list[tuple[int, int, int]] = []
        self._overflow = False

    @abstractmethod
    def describe(self) -> Description:
        """The device with its present state."""

    def present(self) -> bool:
        """Whether its device node exists now."""
        return True

    def open(self) -> None:
        if self._folder is None:
            self._folder = Path(tempfile.mkdtemp(prefix="srl-input-"))
        path = self._folder / "event0"
        self.close_node()
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
        try:
            listener.bind(str(path))
            listener.listen(1)
        except OSError as error:
            listener.close()
            raise HostError(
                str(path), f"a twin can't listen there: {error.strerror}", "Set TMPDIR to a short path"
            ) from None
        self._listener = listener
        self.address = str(path)

    def close_node(self) -> None:
        """Unplugs the device: the client sees the end of the stream, the path is removed. `open` plugs it in again."""
        for end in (self._client, self._listener):
            if end is not None:
                end.close()
        self._client = self._listener = None
        if self._folder is not None:
            with contextlib.suppress(OSError):
                (self._folder / "event0").unlink()

    def close(self) -> None:
        self.close_node()
        self.address = ""
        folder, self._folder = self._folder, None
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)

    def service(self, now: int) -> None:
        gone = inside(self._windows, self.fake.world.time) or not self.present()
        if gone != self._in_window:
            self._in_window = gone
            self.close_node() if gone else self.open()
        if gone or self._listener is None:
            return
        self._accept()
        if self._client is None or self.muted:
            return
        state = self.describe().state()
        changed = [change for change in state if change not in self._sent]
        if self._overflow:
            if not self._send(RECORD.pack(0, 0, EV_SYN, SYN_DROPPED, 0) + encode(now, [])):
                return
            self._overflow = False
        if self._asked():
            changed = state
        if changed:
            self._overflow = not self._send(encode(now, changed))
            self.drops += self._overflow
            self.reports += not self._overflow
            self._sent = state

    def metrics(self) -> dict[str, object]:
        """Number of clients so far, of reports sent and of overflows."""
        return {"connects": self.connects, "reports": self.reports, "drops": self.drops}

    def _accept(self) -> None:
        assert self._listener is not None
        with contextlib.suppress(BlockingIOError):
            client, _ = self._listener.accept()
            if self._client is not None:
                self._client.close()
            client.setblocking(False)
            # A kernel's event buffer is small, too: it holds 64 packets and more.
            client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 64 * RECORD.size)
            self._client = client
            self.connects += 1
            described = self.describe()
            self._sent, self._overflow = described.state(), False
            with contextlib.suppress(OSError):
                client.send(described.to_line())

    def _asked(self) -> bool:
        assert self._client is not None
        try:
            data = self._client.recv(4096)
        except BlockingIOError:
            return False
        except OSError:
            data = b""
        if not data:
            self._client.close()
            self._client = None
        return b"?" in data

    def _send(self, data: bytes) -> bool:
        if self._client is None:
            return False
        try:
            return self._client.send(data) == len(data)
        except BlockingIOError:
            return False
        except OSError:
            self._client.close()
            self._client = None
            return False
