"""Overrides written into a profile's text: only the values change, and comments and layout stay as they are."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import Any, Final

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import MappingNode, Node, SequenceNode

from srl.runtime.contracts import yaml_text
from srl.runtime.contracts.errors import ProfileError
from srl.runtime.profile import profile
from srl.runtime.profile.overrides import plain_values, split, steps, value
from srl.runtime.profile.source import written

_COMMENT: Final = re.compile(r"([^#\n\"']*?)( {2,})(?=#)")  # and what is before it on the line


def edited(label: str, text: str, overrides: Sequence[str]) -> str:
    """The text of the profile that `text` is with the `--set` options `overrides`; `label` is its name for errors.

    Raises:
        ProfileError: the text or an override is wrong, or the override can't be written there.
    """
    wanted, source = profile.tree(label, text, overrides)
    # A choice brings the places that other overrides name, so its word is written first.
    words = ("choices", *source.chosen)
    first = [override for override in overrides if split(override)[0].split(".")[0] in words]
    changed = _changed(text, first, {})
    changed = _changed(changed, [o for o in overrides if o not in first], profile.tree(label, changed)[1].moved)
    if _tree(label, changed) != wanted:
        # An anchor stands for several places, and the text can't be changed in one of them alone.
        odd = next((o for o in overrides if len(overrides) > 1 and not _fits(label, text, o)), overrides[-1])
        problem = "the profile's text can't be changed there alone"
        raise ProfileError(f"--set {odd}", problem, "Leave it out, and write it into the new file by hand")
    return changed


def _changed(text: str, overrides: Sequence[str], moved: dict[str, str]) -> str:
    for override in overrides:
        path, given = split(override)
        text = set_at(text, written(path, moved), value(given), given)
    return text


def _fits(label: str, text: str, override: str) -> bool:
    try:
        edited(label, text, [override])
    except ProfileError:
        return False
    return True


def _tree(label: str, text: str) -> dict[str, Any] | None:
    """None of a text that was spoilt."""
    try:
        return profile.tree(label, text)[0]
    except ProfileError:
        return None


def set_at(text: str, path: str, new: Any, given: str = "") -> str:
    """A profile's text with another value at a key path of the text, where its mappings go so far.

    Args:
        given: how the value was written, which is kept where it can be.
    """
    node: Node = YAML(typ="rt", pure=True).compose(text)
    way = steps(_shape(node), path, path)
    behind: int | None = None  # the key of the value
    for i, step in enumerate(way):
        if isinstance(node, SequenceNode):
            behind, node = None, node.value[int(step)]
            continue
        entry = next((each for each in node.value if str(each[0].value) == step), None)
        if entry is None:
            for key in reversed(way[i + 1 :]):
                new, given = {str(key): new}, ""
            assert isinstance(node, MappingNode)  # `steps` has looked
            return _with_key(text, node, str(step), as_yaml(new, given))
        behind, node = entry[0].end_mark.index, entry[1]
    start, end = node.start_mark.index, _end(text, node)
    if start == end and behind is not None:  # of `key:` without a value; the node's own mark may be a line farther
        start = end = text.index(":", behind) + 1
        return _put(text, start, end, " " + as_yaml(new, given))
    return _put(text, start, end, as_yaml(new, given))


def _shape(node: Node) -> Any:
    """The keys and lists of a node, without values."""
    if isinstance(node, MappingNode):
        return {str(key.value): _shape(inner) for key, inner in node.value}
    return [_shape(inner) for inner in node.value] if isinstance(node, SequenceNode) else None


def content(text: str) -> dict[str, Any]:
    """The keys and values of a profile's text, as they stand there: no choice is made."""
    found: dict[str, Any] = plain_values(yaml_text.load(text, "rt"))
    return found


def as_yaml(new: Any, given: str = "") -> str:
    """A value on one line, which may stand in a block as in braces; plain or as it was `given`, if it can."""
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


def _with_key(text: str, node: MappingNode, key: str, words: str) -> str:
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
        room = len(comment[2]) + (end - start) - len(words)
        return text[:start] + words + comment[1] + " " * max(room, 2) + text[comment.end() :]
    return text[:start] + words + text[end:]


def _end(text: str, node: Node) -> int:
    """Where the text of a node ends: without the lines after a block, which may be comments of what follows."""
    if isinstance(node, MappingNode | SequenceNode) and not node.flow_style:
        last = node.value[-1]
        return _end(text, last[1] if isinstance(last, tuple) else last)
    start, end = int(node.start_mark.index), int(node.end_mark.index)
    return start + len(text[start:end].rstrip())
