"""The source of an input device's records: a node of the kernel, or a twin's socket in its place.

A node provides its state by ioctl. A socket can't: its twin first sends one line that describes the device and
its state, and answers each byte `?` with a report of the whole state.
"""

from __future__ import annotations

import array
import contextlib
import errno
import fcntl
import os
import select
import socket
import stat
import time
from abc import ABC, abstractmethod
from pathlib import Path
from typing import NoReturn

from srl.drivers.evdev.records import AxisInfo, Description, Event, Parser
from srl.runtime.contracts.errors import DeviceError, DeviceLostError

NODES = Path("/dev/input")
CHUNK = 24 * 64
CHUNKS = 16  # in one read, so that a flood can't block the loop
_CLOCK_MONOTONIC = 1
_EVIOCGID, _EVIOCGRAB, _EVIOCSCLOCKID = 0x80084502, 0x40044590, 0x400445A0
_EVIOCGNAME, _EVIOCGUNIQ = 0x81004506, 0x81004508
_EVIOCGKEY, _EVIOCGBIT_KEY, _EVIOCGBIT_ABS, _EVIOCGABS = 0x80604518, 0x80604521, 0x80084523, 0x80184540


def open_source(path: str, place: str, grab: bool = False) -> EventSource:
    """Opens one device.

    Args:
        path: a node such as /dev/input/by-id/usb-...-event-joystick, or a twin's socket.
        place: the device's name for errors.
        grab: no other program gets its events (EVIOCGRAB): the desktop must not type what a ring sends.
    Raises:
        DeviceError: no such device, no permission, or not an input device.
    """
    try:
        mode = os.stat(path).st_mode
        if stat.S_ISSOCK(mode):
            return _Socket(path, place)
        fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except FileNotFoundError:
        raise DeviceError(
            place, f"there is no {path}", "Plug it in, or wake it; 'ls -l /dev/input/by-id' lists what is there"
        ) from None
    except PermissionError:
        raise DeviceError(
            place,
            f"no permission to open {path}",
            "Add the user to the group 'input' or ship the udev rule (docs/devices), and log in again",
        ) from None
    except OSError as error:
        raise DeviceError(place, f"{path} can't be opened: {error.strerror}", "Check that it is plugged in") from None
    try:
        return _Node(path, place, fd, grab)
    except OSError:
        os.close(fd)
        raise DeviceError(place, f"{path} isn't an input device", "Name a /dev/input/event*") from None


def discover(folder: Path = NODES) -> list[str]:
    """Returns the existing nodes, by number."""
    found = [path for path in folder.glob("event*") if path.name.removeprefix("event").isdigit()]
    return [str(path) for path in sorted(found, key=lambda path: int(path.name.removeprefix("event")))]


class EventSource(ABC):
    """One open device.

    Attributes:
        path: the path it was opened with.
        description: its own description, with its state when it was opened; None until it is known.
        parser: counts of records.
    """

    def __init__(self, path: str, place: str) -> None:
        self.path, self.place = path, place
        self.description: Description | None = None
        self.parser = Parser()

    def read(self) -> list[list[Event]]:
        """Returns all waiting reports, oldest first; never blocks. Raises DeviceLostError."""
        reports: list[list[Event]] = []
        for _ in range(CHUNKS):
            try:
                data = self._take()
            except BlockingIOError:
                break
            except OSError as error:
                self._lost(error.strerror or str(error))
            if not data:
                self._lost("it was unplugged, or went to sleep")
            reports += self.parser.feed(data)
        if self.parser.lost:
            state = self.refresh()
            if state:
                reports.append(state)
            self.parser.lost = False
        return reports

    def await_description(self, timeout_s: float) -> Description:
        """Waits for a socket's first line. Blocks: for `open` only. Raises DeviceError."""
        deadline = time.monotonic() + timeout_s
        while self.description is None:
            left = deadline - time.monotonic()
            if left <= 0:
                raise DeviceError(self.place, f"{self.path} doesn't describe itself", "Check that it is a twin's")
            select.select([self.fileno()], [], [], left)
            self.read()
        return self.description

    @abstractmethod
    def refresh(self) -> list[Event]:
        """Returns the whole state as one report; empty if a later `read` will return it."""

    @abstractmethod
    def fileno(self) -> int:
        """Returns the file descriptor; -1 once closed."""

    @abstractmethod
    def close(self) -> None:
        """Closes the device. Always succeeds."""

    @abstractmethod
    def _take(self) -> bytes:
        """Reads once; b"" at the end."""

    def _lost(self, why: str) -> NoReturn:
        raise DeviceLostError(self.place, f"{self.path} is gone ({why})", "Plug it in, or wake it")


class _Node(EventSource):
    """A node of the kernel."""

    def __init__(self, path: str, place: str, fd: int, grab: bool) -> None:
        super().__init__(path, place)
        self._fd = fd
        self.description = self._describe()
        fcntl.ioctl(fd, _EVIOCSCLOCKID, array.array("i", [_CLOCK_MONOTONIC]))
        if grab:
            try:
                fcntl.ioctl(fd, _EVIOCGRAB, 1)
            except OSError as error:
                if error.errno == errno.EBUSY:
                    os.close(fd)
                    self._fd = -1
                    raise DeviceError(
                        place, f"{path} is held by another program", "End it, or set 'grab: false'"
                    ) from None
                raise

    def refresh(self) -> list[Event]:
        now = time.monotonic_ns()
        try:
            return [Event(now, *change) for change in self._describe().state()]
        except OSError as error:
            self._lost(error.strerror or str(error))

    def fileno(self) -> int:
        return self._fd

    def close(self) -> None:
        fd, self._fd = self._fd, -1
        if fd >= 0:
            with contextlib.suppress(OSError):
                os.close(fd)

    def _take(self) -> bytes:
        return os.read(self._fd, CHUNK)

    def _describe(self) -> Description:
        ids = array.array("H", [0] * 4)
        fcntl.ioctl(self._fd, _EVIOCGID, ids)
        keys, axes = self._bits(_EVIOCGBIT_KEY, 96), self._bits(_EVIOCGBIT_ABS, 8)
        pressed = self._bits(_EVIOCGKEY, 96)
        found: dict[int, AxisInfo] = {}
        for code in axes:
            info = array.array("i", [0] * 6)
            fcntl.ioctl(self._fd, _EVIOCGABS + code, info)
            found[code] = AxisInfo(*info)
        return Description(
            self._text(_EVIOCGNAME), self._text(_EVIOCGUNIQ), ids[1], ids[2], ids[3],
            frozenset(keys), frozenset(pressed), found,
        )  # fmt: skip

    def _bits(self, request: int, size: int) -> list[int]:
        bits = bytearray(size)
        try:
            fcntl.ioctl(self._fd, request, bits)
        except OSError as error:
            if error.errno != errno.EINVAL:  # the device has no events of this type
                raise
        return [8 * i + bit for i, byte in enumerate(bits) for bit in range(8) if byte >> bit & 1]

    def _text(self, request: int) -> str:
        text = bytearray(256)
        try:
            fcntl.ioctl(self._fd, request, text)
        except OSError as error:
            if error.errno != errno.ENOENT:  # it has none
                raise
        return text.split(b"\0")[0].decode("utf-8", "replace")


class _Socket(EventSource):
    """A twin's socket."""

    def __init__(self, path: str, place: str) -> None:
        super().__init__(path, place)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
        try:
            self._socket.connect(path)
        except OSError as error:
            self._socket.close()
            raise DeviceError(place, f"nobody serves {path}: {error.strerror}", "Start the twin") from None
        self._head = b""

    def refresh(self) -> list[Event]:
        with contextlib.suppress(OSError):
            self._socket.send(b"?")
        return []

    def fileno(self) -> int:
        return self._socket.fileno()

    def close(self) -> None:
        self._socket.close()

    def _take(self) -> bytes:
        data = self._socket.recv(CHUNK)
        if self.description is not None or not data:
            return data
        head, end, rest = (self._head + data).partition(b"\n")
        if not end:
            self._head = head[-65536:]
            raise BlockingIOError
        try:
            self.description = Description.from_line(head)
        except ValueError:
            raise OSError(errno.EPROTO, "it isn't an input device's twin") from None
        if not rest:
            raise BlockingIOError
        return rest
