"""A flood of damaged bytes for protocol parsers."""

from __future__ import annotations

import random
import sys
from collections.abc import Callable, Iterator


def mutations(good: bytes, seed: int, total: int) -> Iterator[bytes]:
    """About `total` bytes made from good ones: cut, flipped, inserted, repeated, split at random places."""
    rng = random.Random(seed)
    sent = 0
    while sent < total:
        data = bytearray(good)
        for _ in range(rng.choice((0, 1, 1, 2, 3, 8))):
            if not data:
                break
            at = rng.randrange(len(data))
            kind = rng.randrange(6)
            if kind == 0:
                data[at] ^= 1 << rng.randrange(8)
            elif kind == 1:
                del data[at : at + rng.randrange(1, 40)]
            elif kind == 2:
                data[at:at] = rng.randbytes(rng.randrange(1, 40))
            elif kind == 3:
                data[at] = rng.choice((0, 255, 127, 128))
            elif kind == 4:
                data[at:at] = data[at : at + rng.randrange(1, 64)]
            else:
                data = bytearray(rng.randbytes(rng.randrange(1, 200)))
        sent += len(data)
        while data:
            cut = rng.randrange(1, len(data) + 1)
            yield bytes(data[:cut])
            del data[:cut]


def fuzz(feed: Callable[[bytes], object], good: bytes, total: int = 1_000_000, seed: int = 0) -> int:
    """Feeds a parser `total` mutated bytes; any exception is the test's failure.

    Returns:
        Bytes fed.
    """
    fed = 0
    for chunk in mutations(good, seed, total):
        try:
            feed(chunk)
        except Exception as error:
            raise AssertionError(f"after {fed} bytes, at {chunk[:80].hex(' ')}: {error!r}") from error
        fed += len(chunk)
    return fed


def size_of(thing: object, depth: int = 4) -> int:
    """Bytes an object and what it holds take: to show that a parser's memory stays bounded."""
    size = sys.getsizeof(thing)
    if depth == 0:
        return size
    if isinstance(thing, dict):
        return size + sum(size_of(k, depth - 1) + size_of(v, depth - 1) for k, v in thing.items())
    if isinstance(thing, list | tuple | set | frozenset):
        return size + sum(size_of(item, depth - 1) for item in thing)
    inner = getattr(thing, "__dict__", None) or {
        name: getattr(thing, name) for name in getattr(type(thing), "__slots__", ()) if hasattr(thing, name)
    }
    return size + (size_of(dict(inner), depth - 1) if inner else 0)
