"""A part of the study: some claims with their table and files."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

from srl.studies.result import Claim

NAME: Final = "human-srl"


@dataclass
class Part:
    """What a part of the study found.

    Attributes:
        claims: what holds and what doesn't.
        table: rows by column; the first column, "part", says which part it is.
        files: written ones, relative to the study's folder.
    """

    claims: list[Claim] = field(default_factory=list)
    table: list[dict[str, Any]] = field(default_factory=list)
    files: list[str] = field(default_factory=list)
