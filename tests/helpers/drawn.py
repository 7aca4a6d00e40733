"""What a file of rerun holds, as a viewer reads it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import rerun as rr


class Drawn:
    """The entities of a file: static components, and the others with the cycle of each of their rows."""

    def __init__(self, file: Path) -> None:
        self.static: dict[tuple[str, str], list[Any]] = {}
        self.moving: dict[tuple[str, str], dict[int, list[Any]]] = {}
        for chunk in rr.chunk.RrdReader(file).stream():
            batch = chunk.to_record_batch()
            for name, column in zip(batch.schema.names, batch.columns, strict=True):
                key = (chunk.entity_path, name)
                if chunk.is_static:
                    self.static[key] = column.to_pylist()[0]
                elif "cycle" in batch.schema.names:
                    cycles = batch.column(batch.schema.names.index("cycle")).to_pylist()
                    rows = zip(cycles, column.to_pylist(), strict=True)
                    self.moving.setdefault(key, {}).update((c, row) for c, row in rows if row is not None)
