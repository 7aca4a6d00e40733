"""The whole profile `human-srl` in simulation, as it is shipped: suit, servos, laws, guard."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.blame import BLAME, DT, Gap

from srl.control.skeleton.body_clearance import BodyClearanceConfig
from srl.runtime.models.models import ArmsModel
from srl.runtime.profile import profile
from srl.testing import simulate

NEAR = np.array([0.08, 0.08, 0.08, 0.08, 0.005, 0.08, 0.08])
POSTURES = np.array(
    [[0.0] * 7, [-0.8727, -0.8727, -0.5236, 0.0, 0.0, 0.0, 0.8727], [-0.6, -0.3, 0.4, -0.9, 0.08, -0.5, 0.2]]
)


@pytest.mark.exhaustive
@pytest.mark.slow
def test_the_arm_goes_to_its_postures_and_never_approaches_what_it_touches() -> None:
    _, text, _ = profile.find("human-srl")
    run = simulate(text, seconds=26)
    applied, margin = run.value("arm.position_command.applied"), run.value("arm.position_command.margin")[:, 0]
    rotation, translation = run.value("suit.rotation"), run.value("suit.translation")
    assert np.ptp(applied[:, 0]) > 0.5, "it moves"
    assert np.isfinite(margin[50:-1]).mean() > 0.99, "what passes a joint's limit is not judged"
    assert np.nanmin(margin) < 0, "and is held at times"
    position = run.value("arm.position")
    for posture in POSTURES:
        assert (np.abs(position - posture) <= NEAR).all(axis=1).any(), posture
    assert (np.abs(position[-600:] - POSTURES[0]) <= NEAR).all(axis=1).any(), "and is back"
    gap = Gap(BodyClearanceConfig(least=0.02, uncertainty=0.0, arms=ArmsModel(base=(-0.15, 0.05, 0.35))))
    for k in range(50, len(applied) - 1):
        gap.pose(rotation[k], translation[k])
        before, after = gap(applied[k]), gap(applied[k + 1])
        if after < 0.0:
            assert (before - after) / DT <= BLAME, k
