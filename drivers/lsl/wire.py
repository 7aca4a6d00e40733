"""The messages between the driver and its LSL process: datagrams on a Unix socket, little endian.

To the process, once: the order (JSON), `Order`. From it: `R` the stream's description (JSON); `F` failed and `X` lost
(JSON: problem, remedy); `D` samples.
"""

from __future__ import annotations

import json
import struct
from typing import Any, Final, NamedTuple

import numpy as np

from srl.runtime.contracts.signals import Array

_HEAD: Final = struct.Struct("<cQqdHH")
MOST: Final = 60000  # bytes of values in a message


class Order(NamedTuple):
    """What the process is to do.

    Attributes:
        host, port: where to look, as the profile has it.
        exposed: other machines may reach this one.
        here: the sender is on this machine: its clock is ours.
        predicate: of the stream.
    """

    host: str
    port: int
    exposed: bool
    here: bool
    predicate: str


class Words(NamedTuple):
    """A message in JSON, by its kind."""

    kind: bytes
    content: dict[str, Any]


class Data(NamedTuple):
    """Samples, oldest first.

    Attributes:
        number: of the first one since the stream was opened, from 0.
        arrived: ns, CLOCK_MONOTONIC, when the process took the newest.
        offset: s, to be added to the stamps to get CLOCK_MONOTONIC.
        stamps: (k,) s, the sender's.
        values: (k, n), all channels, as sent.
    """

    number: int
    arrived: int
    offset: float
    stamps: Array
    values: Array


def words(kind: bytes, content: dict[str, Any]) -> bytes:
    """Encodes a message in JSON."""
    return kind + json.dumps(content).encode()


def data(item: Data) -> list[bytes]:
    """Encodes samples, in as many messages as they need."""
    k, n = item.values.shape
    each = max(MOST // (8 * (n + 1)), 1)
    return [
        _HEAD.pack(b"D", item.number + at, item.arrived, item.offset, min(each, k - at), n)
        + item.stamps[at : at + each].astype("<f8").tobytes()
        + item.values[at : at + each].astype("<f8").tobytes()
        for at in range(0, k, each)
    ]


def read(message: bytes) -> Words | Data:
    """Decodes a message."""
    if message[:1] != b"D":
        return Words(message[:1], json.loads(message[1:]))
    _, number, arrived, offset, k, n = _HEAD.unpack_from(message)
    both = np.frombuffer(message, "<f8", offset=_HEAD.size)
    return Data(number, arrived, offset, both[:k], both[k:].reshape(k, n))
