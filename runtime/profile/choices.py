"""Alternatives of a profile: `choices:` lists them, and one word at the top level picks one.

A branch is a piece of a profile. The chosen one is merged into the profile before anything else looks at it; the others
are left out, so their devices are neither opened nor simulated.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Annotated, Any

from pydantic import Field

from srl.runtime.contracts.errors import ProfileError, nearest
from srl.runtime.profile.source import Source, written

SECTIONS = (
    "devices", "setpoints", "controllers", "guard", "frames", "models", "sim", "stop", "faults", "emergency", "reset",
    "record",
)  # fmt: skip
JOINED = ("controllers", "emergency", "reset.inputs", "record.plots")  # lists that grow by a branch's
_WORD = re.compile(r"^[a-z][a-z0-9_-]*$")

Branch = Annotated[dict[str, Any], Field(json_schema_extra={"propertyNames": {"enum": list(SECTIONS)}})]
Choices = dict[str, dict[str, Branch]]


@dataclass(frozen=True)
class Merged:
    """A profile with its choices made.

    Attributes:
        tree: the profile's keys and values, without `choices` and the words.
        words: the chosen word of each choice.
        moved: where the content of a key path is written, for what stands elsewhere in the file.
    """

    tree: dict[str, Any]
    words: dict[str, str] = field(default_factory=dict)
    moved: dict[str, str] = field(default_factory=dict)


def merge(tree: dict[str, Any], source: Source, keys: Collection[str]) -> Merged:
    """Puts the chosen branches into a profile's tree.

    Args:
        tree: the whole file; it isn't changed.
        source: for the errors' places.
        keys: the profile's own keys, which no choice may be called.
    Raises:
        ProfileError: no word or an unknown one, a malformed branch, or a key that two of them give differently.
    """
    merged = Merged({key: value for key, value in tree.items() if key != "choices"})
    choices = _mapping(tree.get("choices", {}), "choices", source)
    for name, branches in choices.items():
        _named(name, f"choices.{name}", source)
        if name in keys:
            problem = f"a choice can't be called '{name}', which is a key of every profile"
            raise ProfileError(source.place(f"choices.{name}"), problem, "Rename the choice")
        _check(branches, f"choices.{name}", source)
        word = merged.tree.pop(name, None)
        known = ", ".join(branches)
        if word is None:
            problem = f"nothing says which '{name}' to take"
            raise ProfileError(source.place(f"choices.{name}"), problem, f"Write {name}: and one of {known}")
        if not isinstance(word, str) or word not in branches:
            problem = f"'{word}' isn't one of the choices of '{name}'"
            raise ProfileError(source.place(name), problem, nearest(str(word), branches))
        merged.words[name] = word
    for name in reversed(merged.words):  # a list's items of the first choice come first
        word = merged.words[name]
        joined = _joined(merged.tree, choices[name][word], "", f"choices.{name}.{word}", merged.moved, source)
        merged.tree.update(joined)
    return merged


def _check(branches: Any, path: str, source: Source) -> None:
    if not _mapping(branches, path, source):
        raise ProfileError(source.place(path), "there is nothing to choose from", "Add a branch")
    for word, branch in branches.items():
        _named(word, f"{path}.{word}", source)
        for section, content in _mapping(branch, f"{path}.{word}", source).items():
            here = f"{path}.{word}.{section}"
            if section not in SECTIONS:
                raise ProfileError(
                    source.place(here), f"a branch can't have the key '{section}'", nearest(section, SECTIONS)
                )
            if section in JOINED and not isinstance(content, list):
                raise ProfileError(source.place(here), "this must be a list", "Write its items with a - before each")


def _mapping(value: Any, path: str, source: Source) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ProfileError(source.place(path), f"this must be a mapping, not {value!r}", "Write keys with values")
    return value


def _named(word: str, path: str, source: Source) -> None:
    if not _WORD.match(word):
        problem = f"'{word}' isn't a valid name: a-z, 0-9, - and _ only, beginning with a letter"
        raise ProfileError(source.place(path), problem, "Rename it")


def _joined(
    base: dict[str, Any], more: dict[str, Any], at: str, path: str, moved: dict[str, str], source: Source
) -> dict[str, Any]:
    """A copy of `base` with `more` in it; `base` belongs at `at`, and `more` is written at `path`."""
    both = dict(base)
    for key, value in more.items():
        here, there = f"{at}.{key}" if at else key, f"{path}.{key}"
        old = both.get(key)
        if key not in both:
            both[key] = value
            moved[here] = there
        elif isinstance(old, dict) and isinstance(value, dict):
            both[key] = _joined(old, value, here, there, moved, source)
        elif here in JOINED and isinstance(old, list) and isinstance(value, list):
            n = len(value)
            shifted = {f"{here}.{n + i}": written(f"{here}.{i}", moved) for i in range(len(old))}
            both[key] = value + old
            moved |= shifted | {f"{here}.{i}": f"{there}.{i}" for i in range(n)}
        elif old != value or type(old) is not type(value):
            first = source.place(written(here, moved))
            raise ProfileError(
                source.place(there), f"'{here}' is given twice, with different contents; first by {first}",
                "Keep it in one place: the profile for every choice, or each branch for itself",
            )  # fmt: skip
    return both
