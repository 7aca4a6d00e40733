"""Overrides written into a profile's text: only the values change, and comments and layout stay as they are."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import Any, Final

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import MappingNode, Node, SequenceNode

from runtime.contracts.errors import ProfileError
from runtime.profile import profile
from runtime.profile.overrides import plain_values, split, steps, value
from runtime.profile.source import written

_COMMENT: Final = re.compile(r" {2,}(?=#)")


def edited(label: str, text: str, overrides: Sequence[str]) -> str:
    """The text of the profile that `text` is with the `--set` options `overrides`; `label` is its name for errors.

    Raises:
        ProfileError: the text or an override is wrong, or the override can't be written there.
    """
    wanted, source = profile.tree(label, text, overrides)
    # A choice brings the places that other overrides name, so its word is written first.
    words = ("choices", *source.chosen)
    for override in sorted(overrides, key=lambda o: split(o)[0].split(".")[0] not in words):
        path, given = split(override)
        if path.split(".")[0] not in words:
            path = _written(label, text, path)
        changed = set_at(text, path, value(given), given)
        try:
            got = profile.tree(label, changed)[0]
        except ProfileError:
            got = None
        if got != profile.tree(label, text, [override])[0]:  # an anchor, which stands for several places, would be
            problem = "the profile's text can't be changed there alone"
            raise ProfileError(f"--set {override}", problem, "Leave it out, and write it into the new file by hand")
        text = changed
    if profile.tree(label, text)[0] != wanted:
        raise ProfileError(f"--set {overrides[0]}", "with the others it can't be written", "Give one after the other")
    return text


def set_at(text: str, path: str, new: Any, given: str = "") -> str:
    """A profile's text with another value at a key path of the text, where its mappings go so far.

    Args:
        given: how the value was written, which is kept where it can be.
    """
    node: Node = YAML(typ="rt", pure=True).compose(text)
    way = steps(content(text), path, path)
    for i, step in enumerate(way):
        if isinstance(node, SequenceNode):
            node = node.value[int(step)]
            continue
        below = next((inner for key, inner in node.value if str(key.value) == step), None)
        if below is None:
            for key in reversed(way[i + 1 :]):
                new, given = {str(key): new}, ""
            return _with_key(text, node, str(step), as_yaml(new, given))
        node = below
    start, end = node.start_mark.index, _end(text, node)
    space = " " * (start == end)  # of `key:` without a value
    return _put(text, start, end, space + as_yaml(new, given))


def content(text: str) -> dict[str, Any]:
    """The keys and values of a profile's text, as they stand there: no choice is made."""
    found: dict[str, Any] = plain_values(YAML(typ="rt", pure=True).load(text))
    return found


def as_yaml(new: Any, given: str = "") -> str:
    """A value on one line, so that it may stand in a block as in braces; as plain text or as it was `given`, if it can."""
    for words in (new if isinstance(new, str) else "", given.strip()):
        if words and "\n" not in words and _means(words, new):
            return words
    if isinstance(new, dict):
        return f"{{{', '.join(f'{as_yaml(key)}: {as_yaml(inner)}' for key, inner in new.items())}}}"
    if isinstance(new, list):
        return f"[{', '.join(map(as_yaml, new))}]"
    return json.dumps(new, ensure_ascii=False)


def _means(words: str, new: Any) -> bool:
    try:
        return all(value(whole) == {"k": new} for whole in (f"{{k: {words}}}", f"k: {words}"))
    except YAMLError:
        return False


def _written(label: str, text: str, path: str) -> str:
    """The key path in the text of a key path in the merged profile."""
    return written(path, profile.tree(label, text)[1].moved)


def _with_key(text: str, node: Node, key: str, words: str) -> str:
    """The text with one more key at the end of a mapping."""
    entry = f"{as_yaml(key)}: {words}"
    if node.flow_style:
        end = _end(text, node.value[-1][1]) if node.value else node.end_mark.index - 1
        return _put(text, end, end, f"{', ' * bool(node.value)}{entry}")
    end = text.find("\n", _end(text, node))  # behind the comment of the last line
    end = len(text) if end < 0 else end
    return f"{text[:end]}\n{' ' * node.value[0][0].start_mark.column}{entry}{text[end:]}"


def _put(text: str, start: int, end: int, words: str) -> str:
    """The text with other words from `start` to `end`; a comment behind them stays in its column, if it can."""
    if comment := _COMMENT.match(text, end):
        room = len(comment[0]) + (end - start) - len(words)
        return text[:start] + words + " " * max(room, 2) + text[comment.end() :]
    return text[:start] + words + text[end:]


def _end(text: str, node: Node) -> int:
    """Where the text of a node ends: without the lines after a block, which may be comments of what follows."""
    if isinstance(node, MappingNode | SequenceNode) and not node.flow_style:
        last = node.value[-1]
        return _end(text, last[1] if isinstance(last, tuple) else last)
    start, end = int(node.start_mark.index), int(node.end_mark.index)
    return start + len(text[start:end].rstrip())
