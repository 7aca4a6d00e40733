"""Byte links to devices, named by URL. They never block and never queue several commands.

    /dev/ttyUSB0, a pty's path    a serial port: 8N1, no flow control, exclusively locked
    tcp://HOST:PORT               a TCP connection without Nagle's delay, lost after 2 s without an answer
    tcp-listen://HOST:PORT        the same for a device that connects to us; HOST is this host's address, or 0.0.0.0
    spy:FILE:URL                  the link URL, with a readable log of both directions in FILE
    loop://                       an echo: what is written is read back
    loop://NAME                   the first and the second opener of NAME get the two ends of one link

A dead link holds one command at most: `write` refuses the next. The kernel can't always tell: TCP counts bytes
as sent once the peer's kernel has them, and a pty reports no unsent bytes at all. A peer that is reachable but
no longer reads therefore absorbs commands up to the size of its own buffer (a pty's: 20 KB) before `write`
refuses. Only an answer in the device's own protocol shows this sooner.
"""

from __future__ import annotations

from srl.drivers.transport.base import Transport
from srl.drivers.transport.listening import await_caller
from srl.drivers.transport.serial_port import open_serial
from srl.drivers.transport.spy import Spy
from srl.drivers.transport.stream import connected, open_loop, open_tcp
from srl.runtime.contracts.errors import DeviceError

__all__ = ["Transport", "open_transport"]


def open_transport(url: str, *, place: str, baudrate: int = 115200) -> Transport:
    """Opens a link; may block up to 3 s.

    Args:
        url: see the module's docstring.
        place: the device's name, used in every error, e.g. "glove".
        baudrate: bit/s, for serial ports.
    Raises:
        DeviceError: no such port, no permission, in use, refused, or not a valid link.
    """
    if url.startswith("spy:"):
        file, _, inner = url.removeprefix("spy:").partition(":")
        if not file or not inner:
            raise DeviceError(place, f"'{url}' isn't spy:FILE:URL", "E.g. spy:glove.log:/dev/ttyUSB0")
        return Spy(open_transport(inner, place=place, baudrate=baudrate), url, file, place)
    if url.startswith("tcp://"):
        return open_tcp(url, place)
    if url.startswith("tcp-listen://"):
        return connected(url, place, await_caller(url, place))
    if url.startswith("loop://"):
        return open_loop(url, place)
    if "://" in url:
        raise DeviceError(
            place,
            f"no link is called '{url}'",
            "Known: a path, tcp://HOST:PORT, tcp-listen://HOST:PORT, spy:FILE:URL, loop://",
        )
    return open_serial(url, place, baudrate)
