"""YAML that somebody else wrote, read in bounded time; whatever is wrong with it is a YAMLError."""

from __future__ import annotations

import re
from typing import Any, Final

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

MOST: Final = 1 << 18  # characters; the longest profile that comes with srl has 11,000
ITEMS: Final = 20_000  # lines, commas and opening brackets: the reader takes 50 us for each
DEEP: Final = 64  # levels; the reader calls itself for each
_WIDE: Final = 4 * DEEP  # columns of indentation


def load(text: str, typ: str = "safe") -> Any:
    """The values of a text. `typ`: as ruamel's, "safe" or "rt".

    Raises:
        YAMLError: it isn't YAML, it is too long or too deep, or a scalar in it is none of its tag.
    """
    check(text)
    try:
        return YAML(typ=typ, pure=True).load(text)
    except YAMLError:
        raise
    except (ValueError, KeyError, OverflowError, RecursionError, TypeError, AttributeError) as error:
        raise YAMLError(f"a value in it can't be read: {' '.join(str(error).split())[:200]}") from None


def check(text: str) -> None:
    """Raises YAMLError for a text that would take its reader minutes, or all memory."""
    if len(text) > MOST:
        raise YAMLError(f"it has {len(text)} characters, at most {MOST} are read")
    if sum(map(text.count, "\n,[{")) > ITEMS:
        raise YAMLError(f"it has more than {ITEMS} lines and elements")
    depth = 0
    for mark in re.findall(rf"[\[\]{{}}]|^ {{{_WIDE}}}|(?:[-?] ){{{DEEP}}}", text, re.MULTILINE):
        depth += 1 if mark in "[{" else -1 if mark in "]}" else DEEP + 1
        if depth > DEEP:
            raise YAMLError(f"it is nested deeper than {DEEP} levels")
        depth = max(depth, 0)
