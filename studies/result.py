"""What a study gives: claims beside the paper's, a table, files."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One statement of a paper, or of ours, and whether it held.

    Attributes:
        id: a slug.
        text: the statement.
        paper: the published figure in words; "" where there is none.
        measured: what was found here; None where the study couldn't measure it.
        unit: of `measured`.
        holds: whether the statement is true of what was measured.
    """

    id: str
    text: str
    paper: str
    measured: float | None
    unit: str
    holds: bool


@dataclass
class Result:
    """A study's outcome. `table`: rows by column; `files`: what was written, by the folder given."""

    study: str
    simulated: bool
    seeds: list[int]
    claims: list[Claim] = field(default_factory=list)
    table: list[dict[str, Any]] = field(default_factory=list)
    files: list[str] = field(default_factory=list)

    def figures(self) -> dict[str, Any]:
        """For `--json`."""
        return asdict(self)
