"""Checks the way to devices over the network, the host's clock beside theirs, and the bus's own addresses."""

from __future__ import annotations

import ctypes
import errno
import ipaddress
import socket
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

from srl.runtime.service.fitness.can import NETWORK
from srl.runtime.service.fitness.finding import Finding, read

_ROUTES = Path("/proc/net/route")
_UP, _GATEWAY, _REJECT = 0x1, 0x2, 0x200  # flags of a route, linux/route.h
_STA_UNSYNC = 0x40  # linux/timex.h


class _Route(NamedTuple):
    interface: str
    network: ipaddress.IPv4Network
    gateway: ipaddress.IPv4Address
    flags: int


class _Timex(ctypes.Structure):
    """The head of the kernel's struct timex; the rest is room."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", ctypes.c_long),
        ("freq", ctypes.c_long),
        ("maxerror", ctypes.c_long),
        ("esterror", ctypes.c_long),
        ("status", ctypes.c_int),
        ("rest", ctypes.c_byte * 256),
    )


def devices(ports: Mapping[str, str]) -> Iterator[Finding]:
    """The way to each device whose port is an address of the network, and the clock if there is one."""
    far = {name: host for name, port in ports.items() if (host := _host(port)) is not None and not host.is_loopback}
    for name, host in far.items():
        yield _way(name, host)
    interfaces = {route.interface for host in far.values() if (route := _route(host)) is not None}
    for interface in sorted(interfaces):
        yield from _awake(interface)
    if far:
        yield _clock()


def _host(port: str) -> ipaddress.IPv4Address | None:
    """The address in a port; None if it has none, or a name: to ask for it may take long."""
    if "://" not in port:
        return None
    try:
        return ipaddress.IPv4Address(urlsplit(port.removeprefix("spy:")).hostname or "")
    except ValueError:
        return None


def _route(host: ipaddress.IPv4Address) -> _Route | None:
    """The route that the kernel takes: the narrowest network that holds the host."""
    return max(
        (route for route in _routes() if host in route.network), key=lambda route: route.network.prefixlen, default=None
    )


def _routes() -> Iterator[_Route]:
    for line in read(_ROUTES).splitlines()[1:]:
        name, to, gateway, flags, _, _, _, mask, *_ = line.split()
        at, via, bits = (int.from_bytes(bytes.fromhex(word), "little") for word in (to, gateway, mask))
        if int(flags, 16) & _UP and not int(flags, 16) & _REJECT:
            network = ipaddress.IPv4Network((at, bits.bit_count()))
            yield _Route(name, network, ipaddress.IPv4Address(via), int(flags, 16))


def _way(name: str, host: ipaddress.IPv4Address) -> Finding:
    what, route = f"network of {name}", _route(host)
    mine = ipaddress.ip_interface(f"{host + (1 if host.packed[3] < 254 else -1)}/24")
    if route is None:
        return Finding(
            what, "bad", f"no route leads to {host}",
            "Give the interface at the device's cable an address in its network (ip -br link names it)",
            f"sudo ip addr add {mine} dev INTERFACE",
        )  # fmt: skip
    if route.flags & _GATEWAY:
        return Finding(
            what, "doubtful", f"{host} is reached through the router {route.gateway} at {route.interface}",
            f"Put the device on a cable of its own, and give that cable's interface ({route.interface} is the way out) "
            "an address in its network (ip -br link names it)",
            f"sudo ip addr add {mine} dev INTERFACE",
        )  # fmt: skip
    return Finding(what, "good", f"{host} is at {route.interface}")


def _awake(interface: str) -> Iterator[Finding]:
    """Whether an interface may be put to sleep, or is wireless."""
    at, what = NETWORK / interface, f"interface {interface}"
    if (at / "wireless").exists() or (at / "phy80211").exists():
        yield Finding(
            what, "doubtful", f"{interface} is wireless: samples come late and in bursts",
            "Take a cable; without one, keep it awake",
            f"sudo iw dev {interface} set power_save off",
        )  # fmt: skip
    control = at / "device" / "power" / "control"
    # A driver that can't sleep says "auto", too, and is "unsupported" then.
    asleep = read(control.with_name("runtime_status")) not in ("", "unsupported")
    if read(control) == "auto" and asleep:
        yield Finding(
            what, "doubtful", f"{interface} may be put to sleep between packets", "Keep it awake until the next boot",
            f"echo on | sudo tee {control}",
        )  # fmt: skip


def _clock() -> Finding:
    """Whether the system's clock follows a reference: stamps of other computers are compared with it."""
    answer = _Timex()
    if ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.byref(answer)) < 0:
        return Finding("clock of the day", "good", "unknown")
    if answer.status & _STA_UNSYNC:
        return Finding(
            "clock of the day", "doubtful", "it isn't synchronised: recordings of other computers won't fit in time",
            "Needs a time server that this network reaches", "sudo timedatectl set-ntp true",
        )  # fmt: skip
    return Finding("clock of the day", "good", f"synchronised within {answer.maxerror / 1e3:g} ms")


def listens(endpoints: tuple[str, ...]) -> Iterator[Finding]:
    """Whether the bus may listen at each of its endpoints ("tls/0.0.0.0:7447")."""
    for endpoint in endpoints:
        host, _, port = endpoint.partition("/")[2].rpartition(":")
        host, what = host.strip("[]"), f"bus at {endpoint}"
        try:
            family = socket.getaddrinfo(host, int(port), type=socket.SOCK_STREAM)[0][0]
            with socket.socket(family, socket.SOCK_STREAM) as trial:
                trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                trial.bind((host, int(port)))
        except OSError as error:
            remedy = "Give this host the address, or name another one in `bus.listen`"
            command = "ip -br addr"
            if error.errno == errno.EADDRINUSE:
                remedy, command = "End what has it, if it isn't this run", f"sudo ss -ltnp 'sport = :{port}'"
            yield Finding(what, "bad", f"it can't listen there: {error.strerror}", remedy, command)
        else:
            yield Finding(what, "good", "free")
