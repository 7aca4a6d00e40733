"""A part of a profile as a profile of its own: what is left of its frames, and its text, with places in the whole."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from ruamel.yaml import YAML

from srl.runtime.contracts.files import Files, Typed
from srl.runtime.profile import profile
from srl.runtime.profile.profile import ControllerEntry, Profile
from srl.runtime.profile.source import Source, written


def frames_left(
    checked: Profile, plain: Mapping[str, Any], devices: set[str], laws: list[ControllerEntry], sim: bool
) -> dict[str, Any]:
    """The frames that are still there without the devices and laws that were left out."""
    parts = checked.sim.options.get("parts") if sim and checked.sim is not None else None
    gone = checked.devices.keys() - devices - (parts.keys() if isinstance(parts, dict) else set())
    made = {target for e in laws for w in e.outputs.values() for target in w.signals}
    owners = devices | {e.called for e in laws}
    left = dict(checked.frames)
    while True:
        lost = [
            name
            for name, frame in left.items()
            if (frame.pose is not None and frame.pose not in made and frame.pose.partition(".")[0] not in owners)
            or (frame.parent is not None and frame.parent in checked.frames and frame.parent not in left)
            or (frame.parent is not None and frame.parent not in left and frame.parent.partition("/")[0] in gone)
        ]
        if not lost:
            return {name: plain[name] for name in plain if name in left}
        for name in lost:
            del left[name]


def parsed(plain: dict[str, Any], source: Source, kept: list[int]) -> tuple[Profile, Source]:
    """The cut profile, with errors at their places in the whole one.

    What was typed is typed again: a path among it begins where srl runs. `kept`: the places of its laws in the whole.
    """
    stream = io.StringIO()
    YAML().dump(_written(plain), stream)
    moved = {path: at for path, at in source.moved.items() if not path.startswith("controllers.")}
    moved |= {f"controllers.{new}": written(f"controllers.{old}", source.moved) for new, old in enumerate(kept)}
    typed = tuple(_typed(plain))
    files = Files(source.files.folder, run_code=source.files.run_code)
    made, own = profile.parse(source.label, stream.getvalue(), typed, files)
    return made, replace(own, lines=source.lines, moved=moved)


def _typed(value: Any, path: str = "") -> Iterator[str]:
    """What was typed with `--set`, once more, each text by itself."""
    if isinstance(value, Typed):
        yield f"{path}={json.dumps(value, ensure_ascii=False)}"
    elif isinstance(value, dict | list):
        for key, each in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _typed(each, f"{path}.{key}" if path else str(key))


def _written(value: Any) -> Any:
    """The same as YAML can write it: texts that were typed with `--set` are plain ones."""
    if isinstance(value, dict):
        return {key: _written(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_written(each) for each in value]
    return str(value) if isinstance(value, Typed) else value
