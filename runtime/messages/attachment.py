"""The attachment of a sample in the format of ROS 2's rmw_zenoh_cpp: its number, time and sender.

33 bytes: sequence number (int64, from 1), source time (int64, Unix ns), the length 16, and 16 bytes that are
the same for all samples of one sender. All little endian. Source: protocol sheet summit-xl-zenoh, section 4.
"""

from __future__ import annotations

import struct

_FORM = struct.Struct("<qqB16s")
SIZE = _FORM.size


def encode(number: int, stamp: int, sender: bytes) -> bytes:
    """Returns the attachment's bytes. number: from 1; stamp: Unix ns; sender: 16 bytes."""
    return _FORM.pack(number, stamp, 16, sender)


def is_one(attachment: bytes) -> bool:
    """Whether bytes are such an attachment."""
    return len(attachment) == SIZE and attachment[16] == 16


def answer(request: bytes, stamp: int) -> bytes:
    """The attachment of a service's reply: number and sender are the request's. `stamp`: Unix ns."""
    return request[:8] + stamp.to_bytes(8, "little", signed=True) + request[16:]


def stamp_of(attachment: bytes) -> int:
    """Returns the source time, Unix ns; -1 if the bytes aren't such an attachment."""
    if not is_one(attachment):
        return -1
    stamp = int.from_bytes(attachment[8:16], "little", signed=True)
    return stamp if stamp > 0 else -1
