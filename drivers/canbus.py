"""CAN links to devices through python-can, named by URL. They never block.
can://INTERFACE/CHANNEL?KEY=VALUE...    any interface of python-can, with its own options:
can://socketcan/can0                    (bit rate set by `ip link`)
can://slcan//dev/ttyACM0?bitrate=1000000
can://udp_multicast/239.74.163.2        several programs of one host or network, for tests
"""

from __future__ import annotations

import contextlib
import logging
import socket
import struct
import time
from collections import deque
from urllib.parse import parse_qsl, urlsplit

import can
from can.interfaces.udp_multicast.utils import pack_message

from srl.runtime.contracts.errors import DeviceError, DeviceLostError

MOST = 256  # frames in one read, so that a flood can't block the loop
PAUSE = 50_000_000  # ns between two reads, after which frames without a time of the kernel may have waited so long
_TIMED = ("socketcan", "udp_multicast", "virtual")  # their frames have the time of arrival, of the system's clock
_BUS_OFF = 0x40  # in a Linux error frame's identifier
_STRUCT = struct.Struct("=IB3x8s")  # Linux' can_frame: identifier with its flags, length, data
_EXTENDED = 0x8000_0000


def frame_bits(size: int, extended: bool = False) -> int:
    """Returns the bits that a data frame of `size` bytes takes of the bus, at worst: stuffed, with its pause.

    From the start to the checksum a bit may be stuffed after every four; the checksum's end to the pause never is.
    """
    stuffed = (54 if extended else 34) + 8 * size
    return stuffed + (stuffed - 1) // 4 + 10 + 3


def shared_bus(url: str) -> str:
    """Returns what two URLs of the same bus have in common: they may differ in options, but for a multicast's port."""
    bus, _, options = url.partition("?")
    port = dict(parse_qsl(options)).get("port") if bus.startswith("can://udp_multicast/") else None
    return f"{bus}?port={port}" if port is not None else bus


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
    return CanLink(url, place, bus, parts.netloc)


class CanLink:
    """One open bus.

    Attributes:
        url: the URL it was opened with.
        place: the device's name for errors.
        interface: python-can's name of the interface.
    """

    def __init__(self, url: str, place: str, bus: can.BusABC | None, interface: str) -> None:
        self.url, self.place, self.interface = url, place, interface
        self._bus = bus
        self._writer: socket.socket | None = None
        self._read_at = self._waited = 0  # ns: the last read, and the pause before it
        # A multicast bus returns one's own frames; nothing may take them for another's.
        self._own: deque[tuple[int, bytes]] | None = deque(maxlen=MOST) if interface == "udp_multicast" else None

    def read(self) -> list[can.Message]:
        """Returns all frames of others that have arrived, oldest first; never blocks. Error frames are left out.

        Raises:
            DeviceLostError: the bus is gone or closed, or the controller has gone bus-off.
        """
        found: list[can.Message] = []
        before, self._read_at = self._read_at, int(time.monotonic() * 1e9)
        self._waited = self._read_at - before if 0 < before < self._read_at - PAUSE else 0
        for _ in range(MOST):
            try:
                message = self._open_bus().recv(timeout=0)
            except (can.CanError, OSError, ValueError) as error:
                if found:
                    break
                self._lost(error)
            if message is None:
                break
            if message.is_error_frame:
                if message.arbitration_id & _BUS_OFF and self.interface in ("socketcan", "virtual"):
                    raise self._off()
            elif not self._is_own(message):
                found.append(message)
        return found

    def _is_own(self, message: can.Message) -> bool:
        own, key = self._own, (message.arbitration_id, bytes(message.data))
        if not own or key not in own:
            return False
        while own.popleft() != key:
            pass
        return True

    def _off(self) -> DeviceLostError:
        return DeviceLostError(
            self.place,
            f"the CAN controller of {self.url} is bus-off: too many of its frames failed",
            "Check the bit rate, the wires and the terminators (120 ohm at both ends), then take the interface down "
            "and up: 'ip link set IFACE down' and 'up', or set 'restart-ms 100' with it",
        )

    def stamp(self, message: can.Message, now: int) -> int:
        """Returns when a frame of the last `read` arrived, ns on the loop's clock, which is at `now`.

        After a pause of the loop frames wait in a queue that is full of old ones. An interface that doesn't say when
        they came (slcan) leaves open when they did within that pause: then they count as if they came at its beginning.
        """
        if self.interface in _TIMED and message.timestamp > 0:
            return max(now - max(int((time.time() - message.timestamp) * 1e9), 0), 0)
        return max(now - self._waited, 0)

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
        if self._own is not None:
            self._own.append((message.arbitration_id, bytes(message.data)))
        return True

    def stop_fileno(self) -> int | None:
        """Returns the descriptor to which another process writes what `stop_frame` gives, one write a frame.

        None where the interface has no such descriptor: then only the devices' own watchdogs stop them.
        """
        bus = self._bus
        if bus is None or self.interface not in ("socketcan", "slcan", "udp_multicast"):
            return None
        if self.interface == "udp_multicast":
            if self._writer is None:
                self._writer = _connected(bus)
            return self._writer.fileno()
        try:
            descriptor = bus.fileno()
        except (NotImplementedError, OSError):
            return None
        return descriptor if descriptor >= 0 else None

    def stop_frame(self, message: can.Message) -> bytes:
        """Returns a frame as the bytes that `stop_fileno` takes. Empty where there is none.

        On a serial line it begins with the end of a frame that was cut short; a socket takes frames whole.
        """
        data, extended = bytes(message.data), message.is_extended_id
        if self.interface == "socketcan":
            return _STRUCT.pack(message.arbitration_id | extended * _EXTENDED, len(data), data)
        if self.interface == "slcan":
            head = f"T{message.arbitration_id:08X}" if extended else f"t{message.arbitration_id:03X}"
            return f"\r{head}{len(data)}{data.hex().upper()}\r".encode()
        if self.interface == "udp_multicast":
            return bytes(pack_message(message))
        return b""

    def close(self) -> None:
        """Closes the link. Always succeeds."""
        bus, self._bus = self._bus, None
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.close()
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


def _connected(bus: can.BusABC) -> socket.socket:
    """A socket that sends to a multicast bus by plain writes, which the bus' own can't: it isn't connected."""
    multicast = bus._multicast
    six = multicast.ip_version == 6
    writer = socket.socket(socket.AF_INET6 if six else socket.AF_INET, socket.SOCK_DGRAM)
    level = socket.IPPROTO_IPV6 if six else socket.IPPROTO_IP
    writer.setsockopt(level, socket.IPV6_MULTICAST_HOPS if six else socket.IP_MULTICAST_TTL, multicast.hop_limit)
    writer.setblocking(False)
    writer.connect((multicast.group, multicast.port))
    return writer
