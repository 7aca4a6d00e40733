"""Text of others on a terminal."""

from __future__ import annotations


def printable(line: str) -> str:
    """The line with what a terminal would obey or hide, such as an escape, as its code."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in line)
