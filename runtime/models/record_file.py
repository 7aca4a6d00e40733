"""Files that hold what a calibration found about one person: JSON, checked when it is read, written whole or not.

A file ends with a hash of the rest. A number that was changed afterwards could be plausible and wrong, so it is
refused; who changes a file on purpose takes the hash out. A file without one is taken as it is.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import Field, FiniteFloat, ValidationError

from srl.runtime.contracts import whole_file
from srl.runtime.contracts.checksummed import HASH, ChangedError, checksummed, opened
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import SrlError
from srl.runtime.contracts.validation import refusal

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
        plain = opened(content)
    except ChangedError as error:
        remedy = f'Calibrate again; if you changed it on purpose, take "{HASH}" out'
        raise RecordError(place, str(error), remedy) from None
    except (ValueError, RecursionError) as error:
        problem = f"it is no JSON: {error}" if isinstance(error, ValueError) else "it is nested too deeply"
        raise RecordError(place, problem, "Calibrate again, or name another file") from None
    try:
        return kind.model_validate_json(json.dumps(plain))
    except ValidationError as error:
        raise refused(place, error, "Calibrate again, or name another file") from None


def write(path: Path, record: BaseModel) -> None:
    """Writes a file whole or not at all, in place of an older one. Raises RecordError."""
    plain = json.loads(record.model_dump_json())
    text = json.dumps(checksummed(plain), indent=1, ensure_ascii=False) + "\n"
    whole_file.write(path, text.encode(), RecordError)


def refused(place: str, error: ValidationError, remedy: str) -> RecordError:
    """The error of a record whose values don't fit."""
    first = refusal(error)
    return RecordError(first.at(place), first.problem, first.remedy_or(remedy))
