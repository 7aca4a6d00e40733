"""Twelve simulated persons for the user studies: drawn from a seed, listed in assumptions.yaml before any run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from studies.superman.assumptions import assumed
from studies.superman.published import SUBJECTS

SECTION: Final = "persons"
_COLUMNS: Final = (
    "height", "mass", "strength_low", "strength_high", "stiffness", "noise", "drift", "tremor", "sight", "reaction",
    "pace", "care", "follow",
)  # fmt: skip


@dataclass(frozen=True)
class Person:
    """One subject.

    Attributes:
        name: S1 to S12.
        height, mass: m, kg.
        strength_low, strength_high: N of the hand, at the elbow's height with a bent arm, and overhead.
        stiffness: N/m of the hand; its damping is proportional to the square root.
        noise: RMS of the force's noise, as a share of the force.
        drift, tremor: m, RMS along an axis.
        sight, reaction: s.
        pace: m/s, greatest speed of a reach when asked to be quick.
        care: m, greatest visible error of the tool before it goes into a hole.
        follow: m/s along a path that must not be touched.
        seed: of the world, for noise within a trial.
    """

    name: str
    height: float
    mass: float
    strength_low: float
    strength_high: float
    stiffness: float
    noise: float
    drift: float
    tremor: float
    sight: float
    reaction: float
    pace: float
    care: float
    follow: float
    seed: int

    def options(self, *, overhead: bool) -> dict[str, Any]:
        """Returns the options for the cell's part `person`; `overhead` says where the hand works."""
        a = assumed(SECTION)
        return {
            "strength": self.strength_high if overhead else self.strength_low,
            "stiffness": self.stiffness,
            "damping": round(a["damping"] * math.sqrt(self.stiffness / a["stiffness"]["median"]), 2),
            "noise": self.noise,
            "drift": self.drift,
            "tremor": self.tremor,
            "sight": self.sight,
            "reaction": self.reaction,
            "speed": self.pace,
            "arm_load": round(a["arm_load"] * self.mass / a["arm_load_mass"], 2),
            "fatigue": True,
        }


def persons(count: int | None = None) -> list[Person]:
    """Returns the persons listed in the assumptions, the first `count` of them."""
    rows = assumed(SECTION)["list"]
    listed = [
        Person(name=name, seed=i + 1, **dict(zip(_COLUMNS, row, strict=True)))
        for i, (name, row) in enumerate(zip(SUBJECTS, rows, strict=True))
    ]
    return listed[:count]


def drawn() -> list[list[float]]:
    """Draws the rows of the list again, from the seed and the distributions of the assumptions."""
    a = assumed(SECTION)
    rng = np.random.default_rng(a["seed"])

    def spread(what: str, decimals: int) -> float:
        """Draws from a lognormal distribution around a median."""
        return round(float(a[what]["median"] * np.exp(a[what]["spread"] * rng.standard_normal())), decimals)

    def normal(what: str, decimals: int) -> float:
        return round(float(a[what]["mean"] + a[what]["deviation"] * rng.standard_normal()), decimals)

    rows = []
    for k in range(len(SUBJECTS)):
        sex = "man" if k % 2 == 0 else "woman"
        height = normal(f"height_{sex}", 2)
        mass = round(normal("body_mass_index", 2) * height**2, 1)
        strong = float(np.exp(a["strength"]["spread"] * rng.standard_normal()))
        high = a["strength"]["median"] * strong * (1.0 if sex == "man" else a["strength"]["woman"])
        rows.append([
            height, mass, round(high * a["strength"]["low_over_high"], 0), round(high, 0),
            spread("stiffness", 0), spread("noise", 3), spread("drift", 5), spread("tremor", 6),
            normal("sight", 3), normal("reaction", 3), normal("pace", 3), normal("care", 4), normal("follow", 4),
        ])  # fmt: skip
    return rows
