"""A user's own profile, begun as one that comes with the runtime: its text, and the files that go beside it."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from srl.runtime import __version__
from srl.runtime.contracts.errors import ProfileError, RequestError, nearest
from srl.runtime.profile import library, profile
from srl.runtime.profile.edit import content, edited, set_at
from srl.runtime.profile.overrides import split


@dataclass(frozen=True)
class FilledTemplate:
    """A profile to be written.

    Attributes:
        text: YAML, with the comments of the one that it began as.
        beside: the files that its options name and that belong beside it: content by name. Other branches of its
            choices count, too, as their word may be chosen later.
    """

    text: str
    beside: dict[str, bytes]


def begin(template: str, name: str, overrides: Sequence[str]) -> FilledTemplate:
    """Makes a profile of a shipped one.

    Args:
        template: the shipped profile's name.
        name: the new one's; the files beside it get it, too, as a person's calibration belongs to one profile.
        overrides: as for `srl run`, with `--set`.
    Raises:
        ProfileError: there is no such template, or an override is wrong.
        RequestError: the name is none, or is taken by a shipped profile; or an override gives another.
    """
    check_name(name)
    for override in overrides:
        if split(override)[0] == "name":
            problem = f"the new profile's name is said already: {name}"
            raise RequestError(f"--set {override}", problem, "Leave it out; the first word after `srl new` is the name")
    if template not in library.shipped():
        raise _no_template(template)
    label, text, folder = profile.find(template)
    tree = edited(label, text, overrides)
    beside = {}
    for path, file in _named(content(tree), folder):
        renamed = file.replace(template, name)
        beside[renamed] = (folder / file).read_bytes()
        tree = set_at(tree, path, renamed)
    tree = set_at(tree, "name", name)
    return FilledTemplate(f"# Begun as {template} of srl {__version__}.\n{tree}", beside)


def _no_template(given: str) -> ProfileError:
    stem = given.removesuffix(".yaml").removesuffix(".yml")
    own = next((file for file in (given, f"{stem}.yaml") if os.path.isfile(file)), None)
    if own is not None:
        problem = "only a profile that comes with srl can be begun as"
        return ProfileError(given, problem, f"Copy {own}, and change its `name`")
    return ProfileError(given, "no profile that comes with srl has this name", nearest(stem, library.shipped()))


def check_name(name: str) -> None:
    """Raises RequestError if no profile can have this name, or a shipped one has it."""
    if not re.fullmatch(profile.SLUG, name):
        proposed = re.sub(r"[^a-z0-9_]+", "-", re.sub(r"\.ya?ml$", "", name.lower())).strip("-_0123456789") or "my-limb"
        problem = f"'{name}' is no name: lower-case letters, digits, - and _ only, beginning with a letter"
        raise RequestError("NAME", problem, f"For example {proposed}; -o says where the file goes")
    if name in library.shipped():
        problem = f"'{name}' is a profile that comes with srl, and `srl run {name}` would run that one"
        raise RequestError("NAME", problem, f"Choose another one, such as my-{name}")


def _named(node: Any, folder: Path, path: str = "") -> Iterator[tuple[str, str]]:
    """Key path and name of each file that lies beside the template."""
    if isinstance(node, str):
        if node and not node.startswith("/") and (folder / node).is_file():
            yield path, node
        return
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, inner in items:
        yield from _named(inner, folder, f"{path}.{key}" if path else str(key))
