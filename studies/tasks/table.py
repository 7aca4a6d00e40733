"""The rows of a study as one Parquet file, which any tool for tables reads."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from srl.studies.tasks.task import Row
from srl.studies.toolkit.errors import StudyError

FILE: Final = "rows.parquet"
_EXACT: Final = 2**53  # integers beyond aren't all floats


def write(path: Path, rows: Sequence[Row]) -> None:
    """Writes the rows in their order, whole or not at all, in place of an older file.

    The columns are those of `srl.studies.tasks.task.COLUMNS`, then the trials' own. What a row doesn't have is null;
    NaN stays NaN.

    Raises:
        StudyError: a column has texts and numbers, or the file can't be written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns: dict[str, list[Any]] = {}
    for i, row in enumerate(rows):
        for name, value in (_fixed(row) | row.values).items():
            columns.setdefault(name, [None] * len(rows))[i] = value
    arrays = {name: pa.array(values, getattr(pa, _type(name, values))()) for name, values in columns.items()}
    scratch = path.with_name(f".{path.name}.new")
    try:
        with open(scratch, "wb") as file:
            pq.write_table(pa.table(arrays), file)
            file.flush()
            os.fsync(file.fileno())
        scratch.replace(path)
        folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError as error:
        scratch.unlink(missing_ok=True)
        problem = f"it can't be written: {error.strerror}; the journal beside it has every row"
        raise StudyError(str(path), problem, "Make room, then give the same command again") from None


def read(path: Path) -> list[dict[str, Any]]:
    """Returns the rows of a file that `write` made, each by column. Raises StudyError."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        rows: list[dict[str, Any]] = pq.read_table(path).to_pylist()
    except (OSError, pa.ArrowException) as error:
        raise StudyError(str(path), f"it can't be read: {error}", "Run the study again: its journal is kept") from None
    return rows


def _fixed(row: Row) -> dict[str, Any]:
    return {
        "key": row.key, "study": row.task.study, "trial": row.task.trial, "profile": row.task.profile,
        "profile_sha256": row.profile_sha256, "parameters": json.dumps(row.task.parameters), "seed": row.task.seed,
        "state": row.state, "error": row.error, "seconds": row.seconds, "worker": row.worker,
        "environment": json.dumps(row.environment),
    }  # fmt: skip


def _type(name: str, values: list[Any]) -> str:
    """The column's type, as pyarrow calls it."""
    kinds = {type(value) for value in values if value is not None}
    if kinds == {int, float}:
        if all(abs(v) <= _EXACT for v in values if type(v) is int):
            return "float64"
        raise StudyError(f"column {name}", "some of its integers don't fit between floats", "Let trials give one kind")
    if len(kinds) > 1:
        words = " and ".join(sorted(kind.__name__ for kind in kinds))
        raise StudyError(f"column {name}", f"trials gave {words}", "Let every trial give the same kind of value")
    return {bool: "bool_", int: "int64", float: "float64", str: "string"}[kinds.pop()] if kinds else "null"
