"""Files that hold what a calibration found about one person: JSON, checked when it is read, written whole or not."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import BaseModel, Field, FiniteFloat, ValidationError

from runtime.contracts.errors import SrlError

NAME = r"^[A-Za-z0-9_.-]{1,64}$"
Name = Annotated[str, Field(pattern=NAME)]
Row = tuple[FiniteFloat, ...]
M = TypeVar("M", bound=BaseModel)


class RecordError(SrlError):
    """A calibration file that can't be read, written or used."""


def read(kind: type[M], path: Path) -> M:
    """Reads a file. Raises RecordError."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise RecordError(str(path), f"it can't be read: {error.strerror}", "Name the file of a calibration") from None
    return parse(kind, content, str(path))


def parse(kind: type[M], content: bytes, place: str) -> M:
    """Makes the record of a file's content; `place` names the file. Raises RecordError."""
    try:
        return kind.model_validate_json(content)
    except ValidationError as error:
        raise refused(place, error, "Calibrate again, or name another file") from None


def write(path: Path, record: BaseModel) -> None:
    """Writes a file whole or not at all, in place of an older one. Raises RecordError."""
    scratch = path.with_name(f".{path.name}.{os.getpid()}.new")
    try:
        with open(scratch, "w", encoding="utf-8") as file:
            file.write(record.model_dump_json(indent=1) + "\n")
            file.flush()
            os.fsync(file.fileno())
        scratch.rename(path)
    except OSError as error:
        raise RecordError(str(path), f"it can't be written: {error.strerror}", "Choose another folder") from None
    finally:
        with contextlib.suppress(OSError):
            scratch.unlink()


def refused(place: str, error: ValidationError, remedy: str) -> RecordError:
    """The error of a record whose values don't fit."""
    first = error.errors()[0]
    at = ".".join(map(str, first["loc"]))
    return RecordError(f"{place}: {at}" if at else place, first["msg"].removeprefix("Value error, "), remedy)
