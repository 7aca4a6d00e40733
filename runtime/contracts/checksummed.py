"""JSON objects that end with a hash of the rest.

A number that was changed afterwards could be plausible and wrong, so it is refused; who changes a file on purpose takes
the hash out. An object without one is taken as it is.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any, Final

HASH: Final = "sha256"


class ChangedError(ValueError):
    """The object was changed after it was sealed."""


def checksummed(plain: Mapping[str, Any]) -> dict[str, Any]:
    """The object with its hash at the end."""
    return {**plain, HASH: _hash(plain)}


def opened(content: bytes | str) -> Any:
    """What JSON holds, without the hash. Raises ChangedError; ValueError, RecursionError: it is no JSON."""
    plain = json.loads(content, object_pairs_hook=_once)
    if isinstance(plain, dict) and plain.pop(HASH, None) not in (None, _hash(plain)):
        raise ChangedError("it was changed after it was written")
    return plain


def _hash(plain: Any) -> str:
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object of a file. Raises ValueError: it has a key twice, of which a reader would take the last."""
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise ValueError(f"'{key}' is there twice")
        found[key] = value
    return found
