"""CAN links to devices through python-can, named by URL. They never block.
can://INTERFACE/CHANNEL?KEY=VALUE...    any interface of python-can, with its own options:
can://socketcan/can0                    (bit rate set by `ip link`)
can://slcan//dev/ttyACM0?bitrate=1000000
can://udp_multicast/239.74.163.2        several programs of one host or network, for tests
"""

from __future__ import annotations

import contextlib
import logging
import time
from urllib.parse import parse_qsl, urlsplit

import can

from runtime.contracts.errors import DeviceError, DeviceLostError

MOST = 256  # frames in one read, so that a flood can't block the loop


def open_can(url: str, *, place: str, filters: list[dict[str, int]] | None = None) -> CanLink:
    """Opens a CAN bus.

    Args:
        url: see the module's docstring.
        place: the device's name, used in every error.
        filters: python-can's filters, {"can_id": ..., "can_mask": ...}; None accepts every frame.
    Raises:
        DeviceError: the URL isn't valid, the interface or channel doesn't exist, or permission is missing.
    """
    try:
        parts = urlsplit(url)
    except ValueError:
        parts = urlsplit("")
    channel = parts.path.removeprefix("/")
    if parts.scheme != "can" or not parts.netloc or not channel:
        raise DeviceError(place, f"'{url}' isn't can://INTERFACE/CHANNEL", "E.g. can://socketcan/can0")
    if parts.netloc not in can.VALID_INTERFACES:
        known = ", ".join(sorted(can.VALID_INTERFACES))
        raise DeviceError(place, f"python-can has no interface '{parts.netloc}'", f"Known: {known}")
    options: dict[str, object] = {key: int(v) if v.isdigit() else v for key, v in parse_qsl(parts.query)}
    logging.getLogger("can").setLevel(logging.ERROR)  # its warnings on closing aren't useful
    try:
        bus = can.Bus(interface=parts.netloc, channel=channel, can_filters=filters, **options)
    except ImportError as error:
        raise DeviceError(
            place, f"python-can's interface '{parts.netloc}' lacks a package: {error}", "Install it with pip"
        ) from None
    except Exception as error:  # interfaces raise any exception type: without their library even a NameError
        up = " and up ('ip link set {channel} up type can bitrate 1000000')" if parts.netloc == "socketcan" else ""
        raise DeviceError(
            place,
            f"the CAN bus {url} can't be opened: {error}",
            f"Check that it is there{up.format(channel=channel)}, its options, and what the interface needs",
        ) from None
    port = getattr(bus, "serialPortOrig", None)
    if port is not None:
        port.flush = lambda: None  # slcan's `send` would wait here until the last byte has left
    return CanLink(url, place, bus)


class CanLink:
    """One open bus.

    Attributes:
        url: the URL it was opened with.
        place: the device's name for errors.
    """

    def __init__(self, url: str, place: str, bus: can.BusABC) -> None:
        self.url, self.place = url, place
        self._bus: can.BusABC | None = bus

    def read(self) -> list[can.Message]:
        """Returns all frames that have arrived, oldest first; never blocks. Error frames are left out.

        Raises:
            DeviceLostError: the bus is gone, or closed.
        """
        found: list[can.Message] = []
        for _ in range(MOST):
            try:
                message = self._open_bus().recv(timeout=0)
            except (can.CanError, OSError, ValueError) as error:
                if found:
                    break
                self._lost(error)
            if message is None:
                break
            if not message.is_error_frame:
                found.append(message)
        return found

    def read_wait(self, timeout_s: float) -> list[can.Message]:
        """Like `read`, but waits up to `timeout_s` for the first. Blocks: for `open` only."""
        deadline = time.monotonic() + timeout_s
        while not (found := self.read()) and time.monotonic() < deadline:
            time.sleep(0.001)
        return found

    def write(self, message: can.Message) -> bool:
        """Sends one frame; never blocks.

        Returns:
            False if the bus had no room (no node acknowledges, or its queue is full); nothing is kept for later.
        Raises:
            DeviceLostError: the bus is gone.
        """
        try:
            self._open_bus().send(message, timeout=0)
        except can.CanOperationError:
            return False
        except (can.CanError, OSError, ValueError) as error:
            self._lost(error)
        return True

    def fileno(self) -> int:
        """Returns the file descriptor; -1 if the interface has none or the link is closed."""
        try:
            return self._open_bus().fileno()
        except (NotImplementedError, DeviceLostError):
            return -1

    def close(self) -> None:
        """Closes the link. Always succeeds."""
        bus, self._bus = self._bus, None
        if bus is not None:
            with contextlib.suppress(Exception):  # interfaces raise any exception type when their device is gone
                bus.shutdown()

    def _open_bus(self) -> can.BusABC:
        if self._bus is None:
            raise DeviceLostError(self.place, f"the CAN bus {self.url} is closed", "Open it first")
        return self._bus

    def _lost(self, error: Exception) -> None:
        if isinstance(error, DeviceLostError):
            raise error
        raise DeviceLostError(self.place, f"the CAN bus {self.url} is gone ({error})", "Check its cable and its power")
