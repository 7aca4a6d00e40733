"""A worn arm and a wearer who reaches about without looking: the human-SRL study's trial for tests.

The arm is that of `human-srl` on the model's standard base: nearer to the body, so that more happens.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from srl.control.skeleton.envelope import PARTS
from srl.control.skeleton.kinematics import Kinematics
from srl.control.skeleton.options import EnvelopeOptions
from srl.runtime.models.skeleton.arms import BASE
from srl.runtime.profile import profile
from srl.studies.human_srl.contacts import BLAME, shapes
from srl.studies.human_srl.gap import Gap
from srl.studies.human_srl.reach_trial import Attack, Run
from srl.studies.human_srl.reaching import AVERAGE, Reaching
from srl.studies.human_srl.setting import Setting
from srl.studies.human_srl.wearers import wearers

__all__ = ["BLAME", "DT", "HIGH", "LAG", "LOW", "A", "Attack", "Gap", "Outcome", "V", "Wearer", "trial", "truth"]

SETTING = Setting(profile.find("human-srl")[1], base=BASE)
DT, LAG, LOW, HIGH, V, A = (
    SETTING.dt, SETTING.lag, SETTING.lower, SETTING.upper, SETTING.velocity, SETTING.acceleration
)  # fmt: skip


class Wearer(Reaching):
    """The average person, of the options' body."""

    def __init__(self, config: EnvelopeOptions, rng: np.random.Generator, quick: float) -> None:
        super().__init__(config.figure.human, rng, replace(AVERAGE, pace=quick))


@dataclass
class Outcome:
    """What became of trials.

    Attributes:
        contacts: m/s, by which the arm closed the gap when each contact began.
        goals: reached.
    """

    contacts: list[float] = field(default_factory=list)
    goals: int = 0

    @property
    def blamed(self) -> int:
        return sum(speed > BLAME for speed in self.contacts)


def trial(seed: int, attack: Attack, seconds: float = 8.0) -> Outcome:
    """One wearer of the study's, one arm."""
    who = wearers()[seed]
    run = Run(SETTING, replace(who, pace=who.pace * attack.pace), attack, seed)
    run.run(seconds)
    reached = sum(time is not None for time in run.goals.times)
    return Outcome([contact.speed for contact in run.contacts.found], reached)


def truth(config: EnvelopeOptions) -> tuple[Kinematics, dict[tuple[int, int], str]]:
    """MuJoCo's model with the envelope's capsules, which fit the T-pose, and the geoms that belong to a pair."""
    envelope, figure = config.envelope, config.figure
    radii = dict(zip(PARTS, envelope.radii.tolist(), strict=True))
    kinematics = Kinematics(figure, lambda spec: shapes(spec, figure, config.arm, radii, envelope.link_radius))
    model, nodes = kinematics.model, figure.arms.names(config.arm)
    pairs = {
        (model.geom(f"arm/{nodes[pair.link]}").id, model.geom(f"body/{envelope.segments[pair.segment]}").id): pair.name
        for pair in envelope.pairs
    }
    return kinematics, pairs
