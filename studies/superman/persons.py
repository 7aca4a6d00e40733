"""Fifty simulated persons for the SUPER-MAN studies: drawn from a seed, listed in persons.csv before any run.

The distributions and their sources are in persons.yaml. Nobody was drawn again because of a result.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.rotation import Quaternion, conjugate, exp, normalised, product
from srl.sim.parts.person.practice import practised
from srl.studies.toolkit import subjects

COUNT: Final = 50
LIST: Final = Path(__file__).with_suffix(".csv")
_SOURCES: Final = Path(__file__).with_suffix(".yaml")


@dataclass(frozen=True)
class Person:
    """One subject. Sources: persons.yaml.

    Attributes:
        name: P01 to P50; odd numbers are men.
        height, mass: m, kg.
        strength_low, strength_high: N of the hand, at the elbow's height with a bent arm, and overhead.
        stiffness: N/m of the hand; its damping is proportional to the square root.
        noise: RMS of the force's noise, as a share of the force.
        drift, tremor: m, RMS along an axis.
        sight, reaction: s.
        knowledge: share of a robot's mass and damping that is known before practice.
        steering: s, of the steering law.
        reward: J, of arriving.
        bias_x, bias_y: m in the world, by which the person aims beside.
        tilt_x, tilt_y: rad about the world's axes, by which what seems upright is tilted.
        care: m, greatest visible error of the tool before it goes into a hole.
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
    knowledge: float
    steering: float
    reward: float
    bias_x: float
    bias_y: float
    tilt_x: float
    tilt_y: float
    care: float

    @property
    def number(self) -> int:
        """From 1; the seed of the person's trials."""
        return int(self.name[1:])

    @property
    def tilt(self) -> Quaternion:
        """Rotation in the world from upright to what seems upright."""
        return exp(self.tilt_x, self.tilt_y, 0.0)

    def tilt_at(self, upright: Quaternion) -> Quaternion:
        """The tilt, in the axes of an upright flange (w x y z), of a tool that the person turned upright by sight."""
        q = normalised(upright)
        return product(product(conjugate(q), self.tilt), q)

    def options(self, *, overhead: bool = False) -> dict[str, Any]:
        """Returns the options for the cell's part `person`; `overhead` says where the hand works."""
        a = assumed()
        return {
            "strength": self.strength_high if overhead else self.strength_low,
            "stiffness": self.stiffness,
            "damping": round(a["damping"] * math.sqrt(self.stiffness / a["stiffness"]["median"]), 2),
            "noise": self.noise,
            "noise_floor": a["noise_floor"],
            "drift": self.drift,
            "tremor": self.tremor,
            "sight": self.sight,
            "reaction": self.reaction,
            "knowledge": round(practised(self.knowledge, a["practice"]), 4),
            "steering": self.steering,
            "reward": self.reward,
            "arm_mass": round(a["arm_mass"] * self.mass, 3),
            "aim_bias": [self.bias_x, self.bias_y, 0.0],
            "aim_tilt": [self.tilt_x, self.tilt_y, 0.0],
            "push_rise": a["push_rise"],
            "push_most": a["push_most"],
            "arm_load": round(a["arm_load"] * self.mass / a["arm_load_mass"], 2),
            "fatigue": True,
        }


@cache
def assumed() -> Mapping[str, Any]:
    """The distributions and constants of persons.yaml, by name."""
    return subjects.assumed(_SOURCES)


def persons(count: int = COUNT) -> list[Person]:
    """Returns the first `count` of the list."""
    return subjects.listed(LIST, Person, count)


def drawn() -> list[Person]:
    """Draws the list again."""
    a = assumed()
    rng = np.random.default_rng(a["seed"])

    def draw(what: str, decimals: int) -> float:
        return round(subjects.quantity(a[what], rng.standard_normal()), decimals)

    found = []
    for number in range(1, COUNT + 1):
        man = number % 2 == 1
        height = draw("height_man" if man else "height_woman", 2)
        mass = round(draw("body_mass_index", 2) * height**2, 1)
        high = draw("strength", 1) * (1.0 if man else a["strength_woman"])
        found.append(
            Person(
                f"P{number:02}", height, mass, round(high * a["strength_low"], 0), round(high, 0),
                draw("stiffness", 0), draw("noise", 3), draw("drift", 5), draw("tremor", 6), draw("sight", 3),
                draw("reaction", 3), draw("knowledge", 3), draw("steering", 4), draw("reward", 0),
                draw("bias", 4), draw("bias", 4), draw("tilt", 4), draw("tilt", 4), draw("care", 4),
            )
        )  # fmt: skip
    return found


def main() -> None:
    """Writes the list: `python -m srl.studies.superman.persons`."""
    subjects.write(LIST, drawn())


if __name__ == "__main__":
    main()
