"""Rows as rerun's columns, for people: each signal is an entity of float64, the loop's words of int64.

Every column has the timelines `cycle` and `time` (Unix time: the loop's clock plus the offset measured at start-up).
In recordings of format 1 the columns held every row, and `row` (the ring's sequence number) linked a row's columns.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import CYCLE, DEVICE
from srl.runtime.ipc.layout import Layout, Words

ROW = "row"
DRAWN = 10.0  # Hz of the loop's clock at which a file's columns show the rows; the rows themselves are in its blocks


@dataclass(frozen=True)
class Column:
    """The place of a component's numbers in a row: `size` words from `start`."""

    descriptor: rr.ComponentDescriptor
    start: int
    size: int
    kind: type[np.int64] | type[np.float64]


class ArrowBatch:
    """An Arrow array in the form that rerun's columns take."""

    def __init__(self, array: pa.Array) -> None:
        self._array = array

    def as_arrow_array(self) -> pa.Array:
        """Returns the array."""
        return self._array


class Columns:
    """The entities and components of a layout.

    Attributes:
        entities: columns by entity path. Together they hold every word of a row exactly once.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self._wall = int(layout.meta.get("wall", 0))
        self._bin = -1
        self.entities: dict[str, list[Column]] = {}
        words = [("/loop/cycle", "srl.Cycle", word) for word in CYCLE._fields]
        words += [(f"/loop/devices/{d}", "srl.Device", word) for d in layout.devices for word in DEVICE._fields]
        for start, (path, archetype, word) in enumerate(words):
            descriptor = rr.ComponentDescriptor(word).with_builtin_archetype(archetype)
            self.entities.setdefault(path, []).append(Column(descriptor, start, 1, np.int64))
        for field in layout.fields.values():
            if field.size:
                column = Column(rr.Scalars.descriptor_scalars(), layout.ints + field.offset, field.size, np.float64)
                self.entities.setdefault(entity(field.name), []).append(column)

    def times(self, rows: Words) -> list[rr.TimeColumn]:
        """The timelines for people, `cycle` and `time`, of rows (k, width)."""
        stamps = self.layout.header(rows, "now") + self._wall
        return [
            rr.TimeColumn("cycle", sequence=self.layout.header(rows, "cycle")),
            rr.TimeColumn("time", timestamp=stamps.astype("datetime64[ns]")),
        ]

    def send(self, recording: rr.RecordingStream, rows: Words) -> None:
        """Sends rows (k, width) as they are."""
        self._send(recording, rows, lambda values: values)

    def draw(self, recording: rr.RecordingStream, rows: Words) -> None:
        """Sends one row of each 1/DRAWN s of rows (k, width), with the precision of float32: that compresses.

        The rows must follow those of the last call.
        """
        bins = np.floor_divide(self.layout.header(rows, "now"), int(1e9 / DRAWN))
        new = bins != np.append(self._bin, bins[:-1])
        self._bin = int(bins[-1])
        if new.any():
            self._send(recording, rows[new], rounded)

    def _send(self, recording: rr.RecordingStream, rows: Words, shown: Callable[[Array], Array]) -> None:
        indexes = self.times(rows)
        for path, columns in self.entities.items():
            components = []
            for column in columns:
                block = np.ascontiguousarray(rows[:, column.start : column.start + column.size])
                offsets = np.arange(0, block.size + 1, column.size, dtype=np.int32)
                values: NDArray[Any] = block.view(column.kind).ravel()
                if column.kind is np.float64:
                    values = shown(values)
                components.append(rr.ComponentColumn(column.descriptor, ArrowBatch(pa.array(values)), offsets=offsets))
            rr.send_columns(path, indexes, components, recording=recording, strict=True)


class Assembler:
    """Assembles the columns of format 1 into rows again. A row is complete once all its columns are there."""

    def __init__(self, columns: Columns) -> None:
        self._width = columns.layout.width
        self._columns = {
            (path, column.descriptor.component): (number, column)
            for number, (path, column) in enumerate((p, c) for p, cs in columns.entities.items() for c in cs)
        }
        # Words that an earlier version didn't write; they stay 0.
        written = set(columns.layout.recorded_names)
        names = columns.layout.int_names
        self._absent = np.array(
            [column.start < len(names) and names[column.start] not in written for _, column in self._columns.values()]
        )
        self._pending: list[tuple[int, Column, Words, Words]] = []
        self.bytes = 0

    def add(self, path: str, batch: pa.RecordBatch) -> None:
        """Takes a chunk of the entity at `path`.

        Raises:
            RecordingError: a column doesn't fit the layout.
        """
        names = batch.schema.names
        if ROW not in names:
            return
        sequence = np.asarray(batch.column(names.index(ROW))).astype(np.int64, copy=False)
        for name, array in zip(names, batch.columns, strict=True):
            if (path, name) not in self._columns:
                continue
            number, column = self._columns[path, name]
            values = array.flatten()
            if len(values) != len(sequence) * column.size or values.type != pa.from_numpy_dtype(column.kind):
                raise RecordingError(path, "the column doesn't fit the recording's layout", "The file is damaged")
            block = values.to_numpy(zero_copy_only=True).view(np.int64).reshape(len(sequence), column.size)
            self._pending.append((number, column, sequence, block))
            self.bytes += block.nbytes

    def take(self) -> tuple[Words, Words]:
        """Returns the sequence numbers (k,) and rows (k, width) that are complete, in order. Keeps the rest."""
        if not self._pending:
            return np.empty(0, np.int64), np.empty((0, self._width), np.int64)
        sequence = np.unique(np.concatenate([s for _, _, s, _ in self._pending]))
        rows = np.zeros((len(sequence), self._width), np.int64)
        have: NDArray[np.bool_] = np.tile(self._absent, (len(sequence), 1))
        for number, column, numbers, block in self._pending:
            at = np.searchsorted(sequence, numbers)
            rows[at, column.start : column.start + column.size] = block
            have[at, number] = True
        whole: NDArray[np.bool_] = np.asarray(have.all(axis=1))
        rest = []
        if not whole.all():
            for number, column, numbers, block in self._pending:
                keep = ~whole[np.searchsorted(sequence, numbers)]
                if keep.any():
                    rest.append((number, column, numbers[keep], block[keep]))
        self._pending = rest
        self.bytes = sum(block.nbytes for *_, block in rest)
        return sequence[whole], rows[whole]


def rounded(values: Array) -> Array:
    """Values with the precision of float32; what is beyond its range is infinite."""
    with np.errstate(over="ignore", invalid="ignore"):
        return values.astype(np.float32).astype(np.float64)


def entity(name: str) -> str:
    """The entity path of a signal: `finger.position.applied` -> `/finger/position/applied`."""
    path: str = rr.new_entity_path(name.split("."))
    return path if path.startswith("/") else f"/{path}"
