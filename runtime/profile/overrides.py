"""`--set key.path=value`: which place of a profile's tree it means, and the value there."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any, Final

from ruamel.yaml.error import YAMLError

from srl.runtime.contracts import yaml_text
from srl.runtime.contracts.errors import ProfileError
from srl.runtime.contracts.files import Typed

_DEEP: Final = 64  # parts of a key path


def apply(tree: Any, override: str) -> None:
    """Changes a profile's tree. Raises ProfileError: it isn't `key.path=value`, or there is no such place."""
    path, text = split(override)
    way = steps(tree, path, f"--set {override}")
    node: Any = tree
    for step in way[:-1]:
        node = node[int(step)] if isinstance(node, list) else node.setdefault(step, {})
    node[way[-1]] = _typed(value(text))


def split(override: str) -> tuple[str, str]:
    """Key path and text of an override. Raises ProfileError."""
    path, equals, text = override.partition("=")
    if not equals or not path.strip():
        raise ProfileError(
            f"--set {override}", "expected key.path=value", "For example --set devices.glove.port=/dev/ttyUSB1"
        )
    return path.strip(), text


def value(text: str) -> Any:
    """The plain value of an override's text; what isn't YAML is a text. Not to be changed."""
    try:
        return _read(text)
    except YAMLError:
        return text


def steps(tree: Any, path: str, place: str) -> list[str | int]:
    """The keys and numbers that lead to a key path; the last ones of a mapping need not be there yet.

    Raises:
        ProfileError: it leads into what has no keys; `place` is the error's.
    """
    node, parts, found = tree, path.split("."), list[str | int]()
    if len(parts) > _DEEP:
        raise ProfileError(place, f"the key path has {len(parts)} parts", "Check it against the profile")
    while parts:
        length = 1
        if isinstance(node, list) and re.fullmatch("[0-9]{1,9}", parts[0]) and int(parts[0]) < len(node):
            found.append(int(parts[0]))
            node = node[int(parts[0])]
        elif isinstance(node, dict):
            # A signal's name is one key that contains dots.
            length = next((n for n in range(len(parts), 0, -1) if ".".join(parts[:n]) in node), 1)
            found.append(".".join(parts[:length]))
            node = node.get(found[-1], {})
        else:
            last = len(parts) == 1
            problem = f"'{parts[0]}' has no place there" if last else f"there is no '{parts[0]}' to go into"
            raise ProfileError(place, problem, "Check the key path against the profile")
        parts = parts[length:]
    return found


def plain_values(node: Any) -> Any:
    """What a YAML reader gives, as dicts, lists and scalars of Python's own types; each a copy."""
    if isinstance(node, dict):
        return {str(k): plain_values(v) for k, v in node.items()}
    if isinstance(node, list):
        return [plain_values(v) for v in node]
    if isinstance(node, bool) or node is None:
        return node
    for kind in (int, float, str):
        if isinstance(node, kind):
            return kind(node)
    return str(node)


@lru_cache(maxsize=256)
def _read(text: str) -> Any:
    if "*" in text:
        raise YAMLError("it has an alias")  # of itself, it would never end
    return plain_values(yaml_text.load(text))


def _typed(node: Any) -> Any:
    """A copy in which texts are marked as typed at the command line."""
    if isinstance(node, dict):
        return {key: _typed(inner) for key, inner in node.items()}
    if isinstance(node, list):
        return [_typed(inner) for inner in node]
    return Typed(node) if isinstance(node, str) else node
