"""The whole profile `human-srl` in simulation, with `clear:`: suit, servos, laws, guard."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.blame import BLAME, DT, Gap

from runtime.control.skeleton.body_clearance import BodyClearanceConfig
from runtime.profile import profile
from srl.testing import simulate

CLEAR = """    clear:
      use: body-clearance
      lag: 0.03
      tracking: 0.001
      least: 0.02
      uncertainty: 0.0
      latency: 0.03
      radii: {pelvis: 0.163, thigh: 0.1, forearm: 0.05, hand: 0.035}   # m: men's means, as measured on a wearer
      in: {rotation: suit.rotation, translation: suit.translation}
stop: {arm: hold}
"""


RADII = {"pelvis": 0.163, "thigh": 0.1, "forearm": 0.05, "hand": 0.035}


@pytest.mark.slow
def test_the_arm_goes_to_its_postures_and_never_approaches_what_it_touches() -> None:
    _, text, _ = profile.find("human-srl")
    assert "stop: {arm: hold}\n" in text
    run = simulate(text.replace("stop: {arm: hold}\n", CLEAR), seconds=12)
    applied, margin = run.value("arm.position_command.applied"), run.value("arm.position_command.margin")[:, 0]
    rotation, translation = run.value("suit.rotation"), run.value("suit.translation")
    assert np.ptp(applied[:, 0]) > 0.5, "it moves"
    assert np.isfinite(margin[50:-1]).all()
    assert np.nanmin(margin) < 0, "and is held at times"
    gap = Gap(BodyClearanceConfig(least=0.02, uncertainty=0.0, radii=RADII))
    for k in range(50, len(applied) - 1):
        gap.pose(rotation[k], translation[k])
        before, after = gap(applied[k]), gap(applied[k + 1])
        if after < 0.0:
            assert (before - after) / DT <= BLAME, k
