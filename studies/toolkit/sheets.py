"""Reads tables of plain text (CSV with a header line), as written by a spreadsheet."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from srl.runtime.contracts.files import read_regular
from srl.studies.toolkit.errors import StudyError

MOST = 1 << 26  # bytes of a sheet


@dataclass(frozen=True)
class Line:
    """A line of a sheet.

    Attributes:
        place: file and line, for errors.
        cells: text by column.
    """

    place: str
    cells: dict[str, str]

    def number(self, column: str) -> float:
        """Returns a cell's number; raises StudyError if it isn't a finite number."""
        text = self.cells.get(column, "")
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            problem = f"{column}: expected a number, got '{text}'" if text else f"{column} is empty"
            raise StudyError(self.place, problem, "Fill it in, with a point for the decimals")
        return value


def cells_of(reader: Iterator[list[str]], path: Path) -> Iterator[list[str]]:
    """The lines of a reader. Raises StudyError where a line is none of a table."""
    try:
        yield from reader
    except csv.Error as error:
        raise StudyError(str(path), f"it is no table: {error}", "Save the sheet as CSV, UTF-8") from None


def read(path: Path, required: Sequence[str]) -> list[Line]:
    """Returns the lines of a sheet; column names are stripped and in lower case.

    Raises:
        StudyError: it can't be read, a column is missing or there twice, a line has more cells than the header,
            or there are no lines.
    """
    try:
        text = read_regular(path, MOST).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it isn't UTF-8 text"
        raise StudyError(str(path), f"it can't be read: {why}", "Save the sheet as CSV, UTF-8") from None
    # If the comma is the decimal sign, spreadsheets separate cells by semicolons.
    head = text.split("\n", 1)[0]
    reader = csv.reader(text.splitlines(), delimiter=";" if head.count(";") > head.count(",") else ",")
    columns = [name.strip().lower() for name in next(reader, [])]
    if missing := [name for name in required if name not in columns]:
        problem = f"no column {', '.join(missing)}"
        raise StudyError(f"{path}: line 1", problem, f"Columns found: {', '.join(columns) or 'none'}")
    if twice := {name for name in columns if name and columns.count(name) > 1}:
        raise StudyError(f"{path}: line 1", f"column {min(twice)} is there twice", "Rename or remove one")
    lines = []
    for cells in cells_of(reader, path):
        place = f"{path}: line {reader.line_num}"
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) > len(columns):
            raise StudyError(place, f"{len(cells)} cells under {len(columns)} columns", "Write decimals with a point")
        lines.append(Line(place, {name: cell.strip() for name, cell in zip(columns, cells, strict=False) if name}))
    if not lines:
        raise StudyError(str(path), "there are no lines below the header", "Write one line for each trial")
    return lines
