"""Claims about the share of persons who confirm something."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from srl.studies.result import Claim
from srl.studies.toolkit.statistics import proportion


@dataclass(frozen=True)
class Share:
    """k of n persons, and the exact 95 % interval of the probability behind them; None and 0 to 1 without any."""

    k: int
    n: int
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.k} of {self.n} ({100 * self.low:.0f} to {100 * self.high:.0f} %)"

    def claim(self, name: str, text: str, paper: str) -> Claim:
        """Returns a claim that holds if the whole interval is above a half: it is so of most people."""
        measured = self.k / self.n if self.n else None
        return Claim(
            id=name, text=f"{text}: {self}", paper=paper, measured=measured, unit="of the persons",
            holds=self.n > 0 and self.low > 0.5,
        )  # fmt: skip


def share(confirmed: Sequence[bool]) -> Share:
    """Counts."""
    k, n = sum(map(bool, confirmed)), len(confirmed)
    low, high = proportion(k, n) if n else (0.0, 1.0)
    return Share(k, n, low, high)
