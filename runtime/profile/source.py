"""Where a profile comes from, and errors that name the place in it."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import Any

from pydantic import ValidationError

from srl.runtime.contracts import code_file, registry
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import OptionError, ProfileError, nearest
from srl.runtime.contracts.files import Files


@dataclass(frozen=True)
class Source:
    """The origin of a profile, for errors and for the recording.

    Attributes:
        label: the file's name as the user gave it.
        text: the file's text.
        overrides: the `--set` options, in order.
        lines: line number (from 1) of each key path.
        files: the files that its options name.
        chosen: the word of each of the profile's choices.
        moved: where a key path of the profile is written, for what a choice put there.
    """

    label: str
    text: str
    overrides: tuple[str, ...] = ()
    lines: dict[str, int] = field(default_factory=dict)
    files: Files = field(default_factory=Files)
    chosen: dict[str, str] = field(default_factory=dict)
    moved: dict[str, str] = field(default_factory=dict)

    def place(self, path: str) -> str:
        """A key path as it appears in errors: "sixth-finger.yaml line 12: devices.glove.port"."""
        given = {override.split("=", 1)[0].strip() for override in self.overrides}
        if path in given:
            return f"--set {path}"
        path = written(path, self.moved)
        if path in given:
            return f"--set {path}"
        at = path
        while at and at not in self.lines:
            at = at.rpartition(".")[0]
        line = f" line {self.lines[at]}" if at in self.lines else ""
        return f"{self.label}{line}: {path}" if path else f"{self.label}{line}"

    def load(self, group: str, name: str, path: str) -> Any:
        """The class that an entry names: a registered one, or `FILE.py:CLASS`.

        Args:
            group: as in `registry.load`.
            name: as the profile writes it.
            path: its key path.
        Raises:
            ProfileError, HostError: there is none, or it can't be imported.
        """
        if group in ("controllers", "drivers", "fakes") and code_file.is_file(name):
            return code_file.load(group, name, self.files, self.place(path))
        return registry.load(group, name, self.place(path))

    @property
    def sha256(self) -> str:
        """Hash of the text and the overrides."""
        return hashlib.sha256("\n--set ".join((self.text, *self.overrides)).encode()).hexdigest()


def written(path: str, moved: dict[str, str]) -> str:
    """The key path in the file of a key path in the merged profile."""
    at, rest = path, ""
    while at:
        if at in moved:
            return moved[at] + rest
        at, dot, last = at.rpartition(".")
        rest = f"{dot}{last}{rest}"
    return path


_OWN = ("function-", "literal", "is-instance", "tagged-", "str-enum")  # what pydantic adds to a key path
_CHOICES = ("enum", "literal_error")


def first_error(error: ValidationError, source: Source, prefix: str, model: type[BaseModel]) -> ProfileError:
    """Converts pydantic's first error to a ProfileError."""
    # A misspelt key causes two errors: the unknown key says more than the missing one.
    item = min(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
    location = _location(item["loc"])
    path = ".".join([prefix, *location] if prefix else location)
    words = [e["ctx"]["expected"] for e in error.errors() if e["type"] in _CHOICES and _location(e["loc"]) == location]
    others = error.error_count() - max(len(words), 1)
    more = f" ({others} more after this one)" if others else ""
    if item["type"] == "extra_forbidden":
        known = _known_keys(model, location[:-1])
        return ProfileError(
            source.place(path), f"the key '{location[-1]}' isn't known here{more}", nearest(location[-1], known)
        )
    if item["type"] == "missing":
        return ProfileError(source.place(path), f"the key '{location[-1]}' is missing{more}", "Add it")
    cause = item.get("ctx", {}).get("error")
    if isinstance(cause, OptionError):
        return ProfileError(source.place(path), f"{cause.problem}{more}", cause.remedy)
    message = item["msg"].removeprefix("Value error, ")
    if len(words) > 1:
        message = f"input should be {' or '.join(words)}"
    value = item.get("input")
    huge = isinstance(value, int) and value.bit_length() > 1000  # Python doesn't write such a number
    plain = isinstance(value, str | int | float | bool) or value is None
    shown = f", not {repr(value)[:200]}" if plain and not huge else ""
    return ProfileError(source.place(path), f"{message[0].lower()}{message[1:]}{shown}{more}", "Correct the value")


def _location(loc: tuple[int | str, ...]) -> list[str]:
    return [str(part) for part in loc if not str(part).startswith(_OWN)]


def _known_keys(model: type[BaseModel], location: list[str]) -> list[str]:
    """The keys a model allows at a location, as they are written in YAML."""
    current: Any = model
    for part in location:
        fields = getattr(current, "model_fields", {})
        named = {(f.alias or n): f for n, f in fields.items()}
        if part in named:
            current = _model_in(named[part].annotation)
        elif not fields:
            break
    return [f.alias or n for n, f in getattr(current, "model_fields", {}).items()]


def _model_in(annotation: Any) -> Any:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for inner in getattr(annotation, "__args__", ()):
        found = _model_in(inner)
        if found is not None:
            return found
    return None
