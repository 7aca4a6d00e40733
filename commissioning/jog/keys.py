"""The bytes that a terminal sends, as names of keys."""

from __future__ import annotations

import re
from typing import Final

TIMEOUT: Final = 0.03  # s after which the rest of a key's bytes won't come: it was Esc itself
_SEQUENCES: Final = {
    "[A": "up", "[B": "down", "[C": "right", "[D": "left",
    "OA": "up", "OB": "down", "OC": "right", "OD": "left",
    "[I": "focus", "[O": "focus lost",
}  # fmt: skip
_NAMED: Final = {" ": "space", "\r": "enter", "\n": "enter", "\x7f": "backspace", "\b": "backspace"}
_WHOLE: Final = re.compile(rb"\x1b(\[[0-?]*[ -/]*[@-~]|O[@-~])")
_BEGUN: Final = re.compile(rb"\x1b(\[[0-?]*[ -/]*|O)?\Z")


class Keys:
    """Decodes a terminal's bytes.

    Esc begins the bytes of other keys, too. It counts as Esc if they don't follow within `TIMEOUT`, and if what
    follows is no key: a stop too many does no harm.
    """

    def __init__(self) -> None:
        self._rest = b""
        self._since = 0.0

    def take(self, data: bytes, now: float) -> list[str]:
        """Returns the keys in the bytes that came: "up", "left", "esc", "space", "enter", "backspace",
        "focus lost", "1", "q", or "other".

        Args:
            data: what came since the last call; may be empty.
            now: s.
        """
        if data:
            self._since = now
        rest, found = self._rest + data, list[str]()
        while rest:
            if rest[:1] != b"\x1b":
                letter = chr(rest[0])
                found.append(_NAMED.get(letter, letter if "!" <= letter <= "~" else "other"))
                rest = rest[1:]
            elif key := _WHOLE.match(rest):
                found.append(_SEQUENCES.get(key.group(1).decode(), "other"))
                rest = rest[key.end() :]
            elif _BEGUN.match(rest) and now - self._since < TIMEOUT:
                break
            else:
                found.append("esc")
                rest = rest[1:] if rest[1:2] == b"\x1b" else b""
        self._rest = rest
        return found
