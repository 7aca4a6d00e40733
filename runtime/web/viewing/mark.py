"""How far a page has been served."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Mark:
    """Numbers of the next messages: of the rows, and of the states and events. -1: the head comes first."""

    rows: int = -1
    events: int = -1
