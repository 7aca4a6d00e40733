"""Fifty simulated wearers for the IKNS studies: drawn from a seed, listed in wearers.csv before any run.

The distributions and their sources are in wearers.yaml. Nobody was drawn again because of a result.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.runtime.models.body import FRACTIONS
from srl.runtime.models.models import BodyModel
from srl.studies.toolkit import subjects

COUNT: Final = 50
LIST: Final = Path(__file__).with_suffix(".csv")
_SOURCES: Final = Path(__file__).with_suffix(".yaml")
_LENGTHS: Final = ("upper_arm", "forearm", "palm", "hand")


@dataclass(frozen=True)
class Wearer:
    """One subject. Units and sources: wearers.yaml; options of the part `upper-body` have their names there.

    Attributes:
        name: W01 to W50; odd numbers are men.
        stature, upper_arm, forearm, palm, hand: m.
        lag, delay, crossover, correction, learning: of tracking, by arm and by gamepad alike.
        force_noise: of the finger on a gamepad's trigger, share of its force.
    """

    name: str
    stature: float
    upper_arm: float
    forearm: float
    palm: float
    hand: float
    lag: float
    delay: float
    crossover: float
    correction: float
    learning: float
    noise: float
    direction_error: float
    wander: float
    wander_turn: float
    feedback: float
    feel: float
    sway: float
    effort: float
    pace: float
    reaction: float
    force_noise: float

    @property
    def number(self) -> int:
        """From 1."""
        return int(self.name[1:])

    def tracking(self, model: str, gain_error: float) -> dict[str, Any]:
        """Returns the options `tracking` of the part `upper-body`. `model`: preview or pursuit."""
        given = {name: getattr(self, name) for name in ("lag", "delay", "crossover", "correction", "learning")}
        return {"model": model, **given, "gain_error": gain_error}

    def overrides(self, model: str, gain_error: float) -> dict[str, Any]:
        """Returns what this wearer changes in a profile with one part `wearer`, by key path.

        The law's body is the one that was measured with a tape; the wearer's own differs, and has its markers
        somewhat beside the landmarks.
        """
        own = ("noise", "direction_error", "wander", "wander_turn", "feedback", "feel", "sway", "effort", "pace",
               "reaction")  # fmt: skip
        part = "sim.parts.wearer"
        a = assumed()
        rng = np.random.default_rng([a["seed"], self.number])
        lengths = {name: getattr(self, name) for name in _LENGTHS}
        body: dict[str, Any] = {"kind": "body", "stature": self.stature, "sides": ["right"]}
        taped = {name: round(value + a["tape"] * float(rng.normal()), 4) for name, value in lengths.items()}
        landmarks = BodyModel.model_validate(body | {"lengths": lengths}).body.markers
        markers = {
            label: {"segment": m.segment, "at": np.round(np.add(m.at, a["placement"] * rng.normal(size=3)), 4).tolist()}
            for label, m in landmarks.items()
        }
        return {
            "models.body": body | {"lengths": taped},
            "models.wearer": body | {"lengths": lengths, "markers": markers},
            f"{part}.model": "wearer",
            f"{part}.tracking": self.tracking(model, gain_error),
            **{f"{part}.{name}": getattr(self, name) for name in own},
        }


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

    def draw(what: str) -> float:
        return subjects.quantity(a[what], rng.standard_normal())

    found = []
    for number in range(1, COUNT + 1):
        stature = round(draw("stature_man" if number % 2 else "stature_woman"), 3)
        hand = draw("proportion_hand")  # palm and fingers go together
        shares = (draw("proportion_upper_arm"), draw("proportion_forearm"), hand, hand)
        lengths = {n: round(FRACTIONS[n] * stature * s, 4) for n, s in zip(_LENGTHS, shares, strict=True)}
        rest = {f.name: round(draw(f.name), 5) for f in fields(Wearer) if f.name not in ("name", "stature", *_LENGTHS)}
        found.append(Wearer(f"W{number:02}", stature, **lengths, **rest))
    return found


def main() -> None:
    """Writes the list: `python -m srl.studies.ikns.wearers`."""
    subjects.write(LIST, drawn())


if __name__ == "__main__":
    main()
