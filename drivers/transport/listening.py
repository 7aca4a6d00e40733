"""A link to a device that connects to this host: the device is the TCP client, this host listens."""

from __future__ import annotations

import errno
import select
import socket
from urllib.parse import urlsplit

from srl.drivers.timeout import remaining
from srl.runtime.contracts.errors import DeviceError

AWAIT = 10.0  # s that `open` waits for the device; such devices try again every few seconds


def await_caller(url: str, place: str) -> socket.socket:
    """Listens at `tcp-listen://HOST:PORT` until one device has connected; blocks up to 10 s.

    The first caller is taken. After that nobody listens: the kernel refuses a second device.

    Args:
        url: HOST is an address of this host; 0.0.0.0 means all of them.
        place: the device's name for errors.
    Raises:
        DeviceError: the URL isn't valid, the address isn't ours, the port is taken, or no device connected.
    """
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not host or not port or parts.path or parts.query:
        raise DeviceError(place, f"'{url}' isn't tcp-listen://HOST:PORT", "E.g. tcp-listen://0.0.0.0:49500")
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC) as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((host, port))
            listener.listen(1)
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                raise DeviceError(
                    place, f"port {port} is taken by another program", f"'ss -tlpn sport = {port}' shows which; end it"
                ) from None
            raise DeviceError(
                place, f"this host can't listen at {host}:{port}: {error.strerror}", "Use 0.0.0.0, or an address it has"
            ) from None
        for left in remaining(AWAIT):
            if select.select([listener], [], [], left)[0]:
                try:
                    caller, _ = listener.accept()
                except OSError:  # the caller has hung up already
                    continue
                return caller
    raise DeviceError(
        place,
        f"no device dialled in at {host}:{port} within {AWAIT:g} s",
        "Check its Wi-Fi, the address and port it was given for this host, and this host's firewall",
    )
