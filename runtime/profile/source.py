"""Where a profile comes from, and errors that name the place in it."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import Any

from pydantic import ValidationError

from srl.runtime.contracts import code_file, registry
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import ProfileError, nearest
from srl.runtime.contracts.files import Files
from srl.runtime.contracts.validation import CORRECT, refusal


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


def first_error(
    error: ValidationError, source: Source, prefix: str, model: type[BaseModel], given: Any = None
) -> ProfileError:
    """Converts pydantic's first error to a ProfileError. `given`: what was validated."""
    found = refusal(error, given)
    path = ".".join((prefix, *found.keys) if prefix else found.keys)
    remedy = found.remedy or CORRECT
    if found.type == "extra_forbidden":
        remedy = nearest(found.keys[-1], _known_keys(model, list(found.keys[:-1])))
    return ProfileError(source.place(path), found.problem, remedy)


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
