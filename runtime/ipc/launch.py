"""The launch file: what the supervisor starts its loop process with, for the loop and for people to read."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path


@dataclass
class Launch:
    """One run.

    Attributes:
        label, text, overrides: the profile as it was found.
        sim: devices to simulate, empty for all, None for none.
        fast: simulated time as fast as it goes.
        cycles: end after so many; None: run on.
        automatic: go from READY to motion without being asked.
        crashed: the run before ended in a crash: begin in the stop.
        recorded: a recorder reads the rows; unpaced simulation waits for it.
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
        """Writes it as JSON."""
        path.write_text(json.dumps(asdict(self)))

    @classmethod
    def load(cls, path: Path) -> Launch:
        """Reads what `save` wrote."""
        return cls(**json.loads(path.read_text()))
