"""A study's results: claims compared with the paper's, a table, files."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One statement of a paper, or of ours, and whether it held.

    Attributes:
        id: a slug.
        text: the statement.
        paper: the published figure in words; "" if there is none.
        measured: the value found here; None if the study couldn't measure it.
        unit: of `measured`.
        holds: whether the measurement confirms the statement.
    """

    id: str
    text: str
    paper: str
    measured: float | None
    unit: str
    holds: bool


@dataclass
class Result:
    """A study's outcome.

    Attributes:
        table: rows by column.
        files: the written files, relative to the given folder.
        page: Markdown for a page, which `srl study NAME --write PAGE` puts there; "" if it has none.
    """

    study: str
    simulated: bool
    seeds: list[int]
    claims: list[Claim] = field(default_factory=list)
    table: list[dict[str, Any]] = field(default_factory=list)
    files: list[str] = field(default_factory=list)
    page: str = ""

    def metrics(self) -> dict[str, Any]:
        """Returns the result for `--json`."""
        return asdict(self)
