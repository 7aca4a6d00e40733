"""Fifty simulated wearers for the human-SRL study: drawn from a seed, listed in wearers.csv before any run.

The distributions and their sources are in wearers.yaml. Nobody was drawn again because of a result.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from math import sqrt
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.studies.toolkit import subjects

COUNT: Final = 50
LIST: Final = Path(__file__).with_suffix(".csv")
_SOURCES: Final = Path(__file__).with_suffix(".yaml")


@dataclass(frozen=True)
class Wearer:
    """One person. Units and sources: wearers.yaml.

    Attributes:
        name: W01 to W50; odd numbers are men.
        scale: size, of the paper's body.
        trunk, limbs, ends: girths, as shares of the envelope's.
        pace: factor on the speed.
        lean, bend, twist, stride, apart: degrees, of the posture.
    """

    name: str
    scale: float
    trunk: float
    limbs: float
    ends: float
    pace: float
    lean: float
    bend: float
    twist: float
    stride: float
    apart: float

    @property
    def number(self) -> int:
        """From 1."""
        return int(self.name[1:])


@cache
def assumed() -> Mapping[str, Any]:
    """The distributions and constants of wearers.yaml, by name."""
    return subjects.assumed(_SOURCES)


def wearers(count: int = COUNT) -> list[Wearer]:
    """Returns the first `count` of the list."""
    return subjects.listed(LIST, Wearer, count)


def drawn() -> list[Wearer]:
    """Draws the list again."""
    a = assumed()
    rng = np.random.default_rng(a["seed"])

    def normal(what: str, standard: float) -> float:
        return round(subjects.quantity(a[what], standard), 4)

    found = []
    for number in range(1, COUNT + 1):
        sex = "man" if number % 2 else "woman"
        scale = round(normal(f"stature_{sex}", rng.standard_normal()) / a["figure"], 4)
        build, limbs, ends = rng.standard_normal(3)  # the stout are stout all over, more or less
        girths = [build]
        for own, together in ((limbs, a["limbs_with_trunk"]), (ends, a["ends_with_trunk"])):
            girths.append(together * build + sqrt(1.0 - together**2) * own)
        shares = [normal(f"{part}_{sex}", z) for part, z in zip(("trunk", "limbs", "ends"), girths, strict=True)]
        rest = [normal(field.name, rng.standard_normal()) for field in fields(Wearer)[5:]]
        found.append(Wearer(f"W{number:02}", scale, *shares, *rest))
    return found


def main() -> None:
    """Writes the list: `python -m srl.studies.human_srl.wearers`."""
    subjects.write(LIST, drawn())


if __name__ == "__main__":
    main()
