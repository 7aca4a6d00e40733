"""From where a person's datagrams come: two programs that send the same character are two persons, never mixed."""

from __future__ import annotations

from typing import Final

Address = tuple[str, int]
TIMEOUT: Final = 500_000_000  # ns without a datagram of a type, after which MVN may go on from another port


class Sources:
    """Of one character. The first who sends a type of message is its source; others are left out.

    MVN that restarts its streamer may send from another port: after a silence that is taken up, from the same computer.

    Attributes:
        host: the computer whose datagrams were taken first; it stays for the run.
        left_out: datagrams of others.
    """

    def __init__(self) -> None:
        self.host: str | None = None
        self.left_out = 0
        self._sources: dict[int, tuple[Address, int]] = {}
        self._others: set[Address] = set()

    def begin(self) -> None:
        """The port is opened anew: from which ports it sends is open again, not from which computer."""
        self._sources = {}
        self._others = set()

    def takes(self, kind: int, address: Address, now: int) -> bool:
        """Whether a datagram of this type, from (host, port), is the person's; `now` in ns."""
        known = self._sources.get(kind)
        if self.host is None:
            self.host = address[0]
        same = address[0] == self.host and (known is None or address == known[0] or now - known[1] > TIMEOUT)
        if not same:
            self.left_out += 1
            self._others.add(address)
            return False
        self._sources[kind] = address, now
        return True

    @property
    def warning(self) -> str:
        """Who else sends this character, in words; "" for nobody."""
        if not self._others:
            return ""
        used = next((f"{host} port {port}" for (host, port), _ in self._sources.values()), self.host)
        others = ", ".join(f"{host} port {port}" for host, port in sorted(self._others)[:3])
        return f"{others} sends this character, too, and is left out: {used} was the first"
