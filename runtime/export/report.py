"""What came of an export: the files, and what their format couldn't hold."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import ModuleType

from srl.runtime.contracts import extras
from srl.runtime.contracts.errors import HostError, RecordingError


@dataclass
class Report:
    """What came of an export.

    Attributes:
        files: those that were written.
        content: what is in them, for a person.
        left_out: what the recording has and they don't, a line each.
    """

    files: list[Path]
    content: str
    left_out: list[str] = field(default_factory=list)


def needed(name: str, option: str) -> ModuleType:
    """A library that comes with an extra. Raises HostError: it isn't installed."""
    try:
        return import_module(name)
    except ImportError:
        raise HostError(option, f"this needs the package '{name.partition('.')[0]}'", extras.remedy(name)) from None


@contextmanager
def whole_file(target: Path) -> Iterator[Path]:
    """A path to write to; the file gets its name once it is whole.

    Raises:
        RecordingError: it can't be written.
    """
    part = target.with_name(f".part-{target.name}")  # ezc3d adds the ending where it isn't there
    try:
        yield part
        part.replace(target)
    except OSError as error:
        problem = f"the file can't be written: {error.strerror or error}"
        raise RecordingError(str(target), problem, "Choose another place, or make room") from None
    finally:
        part.unlink(missing_ok=True)


def listed(names: Iterable[str], most: int = 8) -> str:
    """Names for a person, not too many."""
    found = list(names)
    more = f" and {len(found) - most} more" if len(found) > most else ""
    return ", ".join(found[:most]) + more
