"""What decides a trial's row besides its task: versions, and the program's own text."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from srl.runtime.contracts import compiled, provenance
from srl.studies.tasks.task import GROUP

OURS: Final = tuple(
    f"srl.{name}" for name in ("runtime", "control", "commissioning", "drivers", "sim", "studies", "profiles")
)
_SUFFIXES: Final = (".py", ".yaml")
# Recorded, but not part of a key: kernels and what computes the laws differ in last bits only, and between machines
# that work for one study.
_RECORDED: Final = ("blas", "backend")


def environment(trial: str) -> dict[str, str]:
    """Returns versions, the BLAS kernel, what computes the laws, the trial's function, and the program's hash, by name.

    It is read once a process: what is imported later must be what was there at the start.

    Args:
        trial: the registered name; one that isn't registered has the function "missing".
    """
    return dict(_environment(trial))


def decisive(found: Mapping[str, str]) -> dict[str, str]:
    """Returns the part of an environment that must be equal wherever a study's trials run."""
    return {name: value for name, value in found.items() if name not in _RECORDED}


def differences(ours: Mapping[str, str], theirs: Mapping[str, str]) -> list[str]:
    """Returns what differs, in words; [] if nothing does that decides a row."""
    return [
        f"{name}: {_short(theirs.get(name))} there, {_short(ours.get(name))} here"
        for name in sorted(decisive(ours).keys() | decisive(theirs).keys())
        if ours.get(name) != theirs.get(name)
    ]


def _short(value: str | None) -> str:
    return "nothing" if value is None else value if len(value) < 48 else value[:12]


@cache
def _environment(trial: str) -> dict[str, str]:
    value = next((point.value for point in entry_points(group=f"srl.{GROUP}") if point.name == trial), "missing")
    tops = [*OURS, *({value.partition(":")[0].partition(".")[0]} - {"srl", "missing"})]
    found = {"blas": provenance.blas(), "backend": compiled.available(), "function": value, "program": program(tops)}
    return provenance.versions() | found


def program(tops: list[str]) -> str:
    """Returns the hash of the text of packages or modules: an edited line makes another program."""
    digest = hashlib.sha256()
    for top in tops:
        spec = find_spec(top)
        if spec is None:
            continue
        roots = [Path(place) for place in spec.submodule_search_locations or ()]
        files = [(file.relative_to(root), file) for root in roots for file in root.rglob("*")]
        if not roots and spec.origin:
            files = [(Path(Path(spec.origin).name), Path(spec.origin))]
        for name, file in sorted(files):
            if file.suffix in _SUFFIXES and file.is_file():
                digest.update(f"{top}/{name}\0".encode() + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()
