"""The launch file: the supervisor writes it to start its loop process; the loop and people read it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path


@dataclass
class Launch:
    """The settings of one run.

    Attributes:
        label, text, overrides: the profile as it was found.
        sim: devices to simulate; empty for all, None for none.
        fast: True to run simulated time as fast as possible.
        cycles: number of cycles after which the run ends; None: no such end.
        automatic: True to go from READY to motion without a request.
        crashed: True if the previous run ended in a crash: this run then starts in STOPPED.
        recorded: True if a recorder reads the rows: an unpaced simulation then waits for it.
    """

    label: str
    text: str
    overrides: list[str] = field(default_factory=list)
    sim: list[str] | None = None
    fast: bool = False
    cycles: int | None = None
    automatic: bool = True
    crashed: bool = False
    recorded: bool = False

    def save(self, path: Path) -> None:
        """Writes the launch file as JSON."""
        path.write_text(json.dumps(asdict(self)))

    @classmethod
    def load(cls, path: Path) -> Launch:
        """Reads what `save` wrote."""
        return cls(**json.loads(path.read_text()))
