"""The file that a calibration writes."""

from __future__ import annotations

import os
from itertools import chain, count
from pathlib import Path

from pydantic import BaseModel

from runtime.control.shared import record_file
from runtime.control.shared.record_file import RecordError


def write_record(path: Path, record: BaseModel, replacing: bool) -> None:
    """Writes a record, whole or not at all; each that was there is kept: FILE.old, FILE.old.2, ...

    Raises RecordError.
    """
    check_target(path, type(record), replacing)
    names = (f"{path.name}.old{number}" for number in chain([""], (f".{n}" for n in count(2))))
    older = next(free for name in names if not os.path.lexists(free := path.with_name(name)))
    try:
        before = path.read_bytes() if path.exists() else None
        if before is not None:
            older.write_bytes(before)
    except OSError as error:
        raise RecordError(str(older), f"it can't be written: {error.strerror}", "Choose another folder") from None
    record_file.write(path, record)


def check_target(path: Path, kind: type[BaseModel], replacing: bool) -> None:
    """Checks, before anybody begins, that a record of this kind can be written there. Raises RecordError."""
    if path.is_dir():
        raise RecordError(str(path), "it is a folder", f"Name a file in it: -o {path}/p07.json")
    if path.exists() and replacing:
        record_file.read(kind, path)  # what is no calibration isn't replaced
    if path.exists() and not replacing:
        raise RecordError(
            str(path), "a calibration is there already", "Add --yes to replace it (it is kept as .old), or -o FILE"
        )
    if not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise RecordError(str(path.parent), "the folder can't be written", "Make it, or choose another with -o")
