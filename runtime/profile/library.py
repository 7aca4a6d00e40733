"""The profiles that come with the runtime: their names, texts and lines for `srl list`, without reading them whole."""

from __future__ import annotations

import re
from importlib import resources
from importlib.resources.abc import Traversable

_SUMMARY = re.compile(r"^summary:[ \t]+(\S.*?)[ \t]*\n(?![ \t])", re.MULTILINE)
_PLAIN = re.compile(r"(?!.*(: | #))[A-Za-z].*[ ].*")  # a YAML scalar that is just its text


def files() -> dict[str, Traversable]:
    """The profiles' files by name."""
    return {
        p.name.removesuffix(".yaml"): p for p in resources.files("srl.profiles").iterdir() if p.name.endswith(".yaml")
    }


def shipped() -> list[str]:
    """Names of the profiles that come with the runtime."""
    return sorted(files())


def summary(name: str) -> str | None:
    """The summary of a profile that comes with the runtime; None if it isn't plain text on one line."""
    found = _SUMMARY.findall(files()[name].read_text(encoding="utf-8"))
    return found[0] if len(found) == 1 and _PLAIN.fullmatch(found[0]) else None
