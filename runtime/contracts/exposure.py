"""Whether another machine could reach what this process opens on every address: tried, not believed."""

from __future__ import annotations

import re
import socket
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from srl.runtime.contracts.errors import RequestError

TIMEOUT: Final = 0.3  # s for a connection of this machine to itself
ADDRESSES: Final = Path("/proc/net/fib_trie")  # those of all interfaces, in this network namespace


def reachable() -> list[str]:
    """The addresses, other than loopback, at which a listener of this process answers.

    A process in a network namespace of its own has no such address. Where the service manager filters addresses
    (`IPAddressDeny=`), none answers. A firewall isn't seen: the machine's connections to itself don't pass it.
    """
    found = []
    for address in _addresses():
        with socket.socket() as listener, socket.socket() as caller:
            try:
                listener.bind((address, 0))
                listener.listen(1)
                caller.settimeout(TIMEOUT)
                caller.connect(listener.getsockname())
            except OSError:
                continue
        found.append(address)
    return found


def refuse_strangers(remedy: str, tried: Sequence[str] | None = None) -> list[str]:
    """Tries whether other machines could reach what LSL's library opens, and returns the machine's addresses.

    Args:
        remedy: what to do if they could.
        tried: the addresses of the last time; while they are the same, nothing is tried.
    Raises:
        RequestError: other machines could.
    """
    present = _addresses()
    addresses = [] if present == tried else reachable()
    if addresses:
        raise RequestError(
            "the network", f"LSL has no password, and other machines could reach it at {', '.join(addresses)}", remedy
        )
    return present


def _addresses() -> list[str]:
    """This machine's IPv4 addresses but for loopback; liblsl's IPv6 is off where this counts."""
    found = re.findall(r"-- ([0-9.]+)\n\s*/32 host LOCAL", ADDRESSES.read_text())
    return sorted({address for address in found if not address.startswith("127.")})
