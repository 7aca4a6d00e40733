"""The numbers in a datagram of JSON or of Open Sound Control 1.0, and such datagrams. No I/O.

Source: the OSC 1.0 specification (strings end in NUL and are padded to four bytes, big-endian numbers, bundles).
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from itertools import pairwise
from math import isfinite
from typing import Any, Final

LONGEST: Final = 8192  # bytes of a datagram; a longer one could hold the loop up
DEEP: Final = 32  # levels of bundles
MANY: Final = 256  # arguments of a message
_BUNDLE: Final = b"#bundle\0"
_SIZES: Final = {"i": 4, "f": 4, "h": 8, "d": 8, "t": 8, "c": 4, "r": 4, "m": 4, "T": 0, "F": 0, "N": 0, "I": 0}
_NUMBERS: Final = {"i": ">i", "f": ">f", "h": ">q", "d": ">d"}
_FIXED: Final = {"T": 1.0, "F": 0.0}


def of_json(data: bytes, places: list[str]) -> dict[str, float]:
    """The finite numbers at those places that are in a JSON object.

    Raises:
        ValueError: it isn't one.
    """
    text = data.decode("utf-8")
    content = json.loads(text)
    if not isinstance(content, dict):
        raise ValueError("a message is no JSON object")
    found: dict[str, float] = {}
    for place in places:
        value = _at(content, place)
        if isinstance(value, bool | int | float):
            try:
                number = float(value)
            except OverflowError:  # an integer of hundreds of digits
                continue
            if isfinite(number):
                found[place] = number
    return found


def _at(content: Any, place: str) -> Any:
    for word in place.split("."):
        if isinstance(content, dict):
            content = content.get(word)
        elif isinstance(content, list) and word.isdigit() and int(word) < len(content):
            content = content[int(word)]
        else:
            return None
    return content


def of_osc(data: bytes, places: list[str]) -> dict[str, float]:
    """The finite numbers at those places that are in an OSC message or bundle. Raises ValueError: it is neither."""
    found: dict[str, float] = {}
    addresses = {place.partition(" ")[0] for place in places}
    for address, arguments in messages(data):
        if address not in addresses:
            continue
        for number, value in enumerate(arguments, 1):
            names = (f"{address} {number}", *([address] if number == 1 else []))
            if value is not None and isfinite(value):
                found |= {name: value for name in names if name in places}
    return found


def messages(data: bytes, depth: int = 0) -> list[tuple[str, list[float | None]]]:
    """The messages of a packet: address and arguments; None for what is no number. Raises ValueError."""
    if depth > DEEP:
        raise ValueError("bundles nest too deep")
    if not data.startswith(_BUNDLE):
        return [_message(data)]
    found, at = [], len(_BUNDLE) + 8  # the time tag isn't used: few senders set it
    if len(data) < at:
        raise ValueError("a bundle is cut short")
    while at < len(data):
        size = int.from_bytes(data[at : at + 4], "big")
        if size == 0 or at + 4 + size > len(data):
            raise ValueError("a bundle is cut short")
        found += messages(data[at + 4 : at + 4 + size], depth + 1)
        at += 4 + size
    return found


def _message(data: bytes) -> tuple[str, list[float | None]]:
    address, at = _string(data, 0)
    if not address.startswith("/"):
        raise ValueError("a message has no address")
    tags, at = _string(data, at)
    if not tags.startswith(","):
        raise ValueError(f"the message {address} has no types")
    if len(tags) > MANY:
        raise ValueError(f"the message {address[:40]} has more than {MANY} arguments")
    found: list[float | None] = []
    for tag in tags[1:]:
        if tag in "[]":
            continue
        if tag in "sS":
            _, at = _string(data, at)
            found.append(None)
        elif tag == "b":
            at += 4 + (int.from_bytes(data[at : at + 4], "big") + 3) // 4 * 4
            found.append(None)
        elif tag in _SIZES:
            end = at + _SIZES[tag]
            if end > len(data):
                raise ValueError(f"the message {address} is cut short")
            found.append(struct.unpack(_NUMBERS[tag], data[at:end])[0] if tag in _NUMBERS else _FIXED.get(tag))
            at = end
        else:
            raise ValueError(f"the message {address} has an argument of the type '{tag}'")
    if at > len(data):
        raise ValueError(f"the message {address} is cut short")
    return address, found


def _string(data: bytes, at: int) -> tuple[str, int]:
    end = data.find(b"\0", at)
    if end < 0:
        raise ValueError("a text has no end")
    return data[at:end].decode("ascii", "replace"), end // 4 * 4 + 4


def json_message(numbers: Mapping[str, float]) -> bytes:
    """A datagram with numbers at these places; an index makes a list as long as it needs."""
    content: dict[str, Any] = {}
    for place, number in numbers.items():
        node: Any = content
        words = place.split(".")
        for word, after in pairwise(words):
            node = _child(node, word, [] if after.isdigit() else {})
        _child(node, words[-1], number, replace=True)
    return json.dumps(content).encode()


def _child(node: Any, word: str, new: Any, replace: bool = False) -> Any:
    if isinstance(node, list):
        node.extend([None] * (int(word) + 1 - len(node)))
        if replace or node[int(word)] is None:
            node[int(word)] = new
        return node[int(word)]
    if replace or word not in node:
        node[word] = new
    return node[word]


def osc_message(numbers: Mapping[str, float]) -> bytes:
    """A bundle of a message for each address, all arguments as doubles."""
    by_address: dict[str, dict[int, float]] = {}
    for place, number in numbers.items():
        address, _, which = place.partition(" ")
        by_address.setdefault(address, {})[int(which or 1)] = number
    parts = []
    for address, arguments in by_address.items():
        values = [arguments.get(k, 0.0) for k in range(1, max(arguments) + 1)]
        part = _padded(address) + _padded("," + "d" * len(values)) + struct.pack(f">{len(values)}d", *values)
        parts.append(len(part).to_bytes(4, "big") + part)
    return _BUNDLE + (1).to_bytes(8, "big") + b"".join(parts)


def _padded(text: str) -> bytes:
    return text.encode() + b"\0" * (4 - len(text) % 4)
