"""Which of two arms is meant: never a guess, since the other one's distances say nothing of it."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from runtime.contracts.errors import SrlError, WiringError
from runtime.control.models import ArmsModel
from runtime.control.skeleton.body_clearance import BodyClearanceConfig
from runtime.control.skeleton.collision import CollisionConfig
from runtime.control.skeleton.retreat import RetreatConfig
from runtime.control.strap.law import StrapBaseConfig
from runtime.profile import profile, wiring

TWO = ArmsModel(sides=("right", "left"))
CLEAR = (
    "{{use: body-clearance, lag: 0.06, tracking: 0.006, least: 0.02, uncertainty: 0.05{side},"
    " in: {{rotation: suit.rotation, translation: suit.translation}}}}"
)
OTHER = {
    BodyClearanceConfig: {"least": 0.02, "uncertainty": 0.0},
    StrapBaseConfig: {"axes": {f"J{i}": {"lower": -1, "upper": 1} for i in range(1, 8)}},
}


@pytest.mark.parametrize("options", [BodyClearanceConfig, CollisionConfig, RetreatConfig, StrapBaseConfig])
def test_of_two_arms_one_must_be_named_and_of_one_it_is_that_one(options):
    other = OTHER.get(options, {})
    with pytest.raises(ValidationError, match="two arms"):
        options(arms=TWO, **other)
    left = options(arms=ArmsModel(sides=("left",)), **other)
    assert left.arms.arms.side(left.side) == "left"
    options(arms=TWO, side="left", **other)
    with pytest.raises(ValidationError, match="no right one"):
        options(arms=ArmsModel(sides=("left",)), side="right", **other)


def build(right: str, left: str) -> wiring.Graph:
    both = {"right": right, "left": left}
    return wiring.build(
        *profile.load(
            "human-srl-two",
            [
                f"guard.{arm}.position_command.clear={CLEAR.format(side=side and f', side: {side}')}"
                for arm, side in both.items()
            ],
        )
    )


def test_in_a_profile_each_arm_has_a_clearance_of_its_own():
    limbs = [each.clearance.limb for each in build("right", "left").clearances.values()]
    assert [limb[1] for limb in limbs] == ["right", "left"]  # type: ignore[index]
    with pytest.raises(WiringError, match=r"left\.position_command.*one and the same limb"):
        build("right", "right")
    with pytest.raises(SrlError, match="two arms"):
        build("right", "")
