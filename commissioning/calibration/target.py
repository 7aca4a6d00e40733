"""The file that a calibration writes."""

from __future__ import annotations

from pathlib import Path

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.ipc import older
from srl.runtime.models import record_file
from srl.runtime.models.record_file import RecordError


def write_record(path: Path, record: BaseModel, replacing: bool) -> None:
    """Writes a record, whole or not at all; each that was there is kept: FILE.old, FILE.old.2, ...

    Raises RecordError.
    """
    check_target(path, type(record), replacing)
    older.keep(path, RecordError)
    record_file.write(path, record)


def check_target(path: Path, kind: type[BaseModel], replacing: bool) -> None:
    """Checks, before anybody begins, that a record of this kind can be written there. Raises RecordError."""
    older.check(path, "a calibration", replacing, f"{path}/p07.json", RecordError)
    if path.exists():
        record_file.read(kind, path)  # what is no calibration isn't replaced
