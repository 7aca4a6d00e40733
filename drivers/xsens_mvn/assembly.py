"""Puts the datagrams of one sample together, in whatever order they come (sheet xsens_mvn, 7). No I/O."""

from __future__ import annotations

from typing import NamedTuple

from srl.drivers.xsens_mvn.protocol import Datagram

MOST = 8  # samples of a type that are waited for at a time; a datagram is rarely late by more


class Sample(NamedTuple):
    """A complete message: its items, and where in time it stands."""

    kind: int
    number: int
    time: int
    items: int
    payload: bytes


class Assembly:
    """Of one character. Attributes: `incomplete`, samples of which a datagram never came."""

    def __init__(self) -> None:
        self.incomplete = 0
        self._parts: dict[tuple[int, int], dict[int, Datagram]] = {}

    def take(self, datagram: Datagram) -> Sample | None:
        """Takes a datagram; returns the sample that it completes."""
        key = (datagram.kind, datagram.sample)
        parts = self._parts.setdefault(key, {})
        parts[datagram.part] = datagram
        end = next((index for index, part in parts.items() if part.last), None)
        if end is None or any(index not in parts for index in range(end + 1)):
            self._forget(datagram.kind)
            return None
        del self._parts[key]
        whole = [parts[index] for index in range(end + 1)]
        payload = b"".join(part.payload for part in whole)
        return Sample(datagram.kind, datagram.sample, datagram.time, sum(part.items for part in whole), payload)

    def restart(self) -> None:
        """Forgets what is incomplete."""
        self._parts = {}

    def _forget(self, kind: int) -> None:
        """Of too many incomplete samples of a type, the one that came first is given up."""
        waiting = [key for key in self._parts if key[0] == kind]
        if len(waiting) > MOST:
            del self._parts[waiting[0]]
            self.incomplete += 1
