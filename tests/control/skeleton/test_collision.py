"""The law `collision` against MuJoCo's own distances, and its envelope."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
from helpers.blame import HIGH, LOW, Wearer, truth

from srl.control.skeleton.body_clearance import BodyClearanceConfig
from srl.control.skeleton.collision import Collision, CollisionConfig
from srl.runtime.contracts.errors import OptionError
from srl.runtime.models.models import ArmsModel
from srl.runtime.testing.controller_rules import recovers_from_nan
from srl.testing import bound

DT = 0.01


def law(**options: Any) -> tuple[Collision, Wearer]:
    config = CollisionConfig(**options)
    made = bound(Collision("collision", config))
    wearer = Wearer(BodyClearanceConfig(least=0.02, uncertainty=0.0), np.random.default_rng(3), 1.0)
    made.input["translation"][:] = wearer.translation
    made.input["rotation"][:] = wearer.rotation(0.0)
    made.input["arm"][:] = 0.0
    made.reset()
    return made, wearer


def posture(k: int) -> Any:
    q = (LOW + HIGH) / 2 + 0.4 * (HIGH - LOW) * np.sin(0.004 * k * np.arange(1, 8))
    q[4] = 0.0  # MuJoCo's capsules have fixed lengths
    return q


def test_distances_and_nearest_points_are_mujoco_s():
    made, wearer = law()
    kinematics, pairs = truth(made.config)
    by_name = {name: two for two, name in pairs.items()}
    labels = made.outputs[0].labels
    assert sorted(labels) == sorted(by_name)
    for k in range(0, 400, 40):
        made.input["rotation"][:], made.input["arm"][:] = wearer.rotation(k * DT), posture(k)
        made.update(DT)
        kinematics.nodes(made.input["rotation"], wearer.translation, {"right": posture(k)})
        fromto = np.zeros(6)
        for i, name in enumerate(labels):
            arm, body = by_name[name]
            true = mujoco.mj_geomDistance(kinematics.model, kinematics.data, body, arm, 10.0, fromto)
            assert made.output["distance"][i] == pytest.approx(true, abs=1e-6)
            found = made.output["points"][i]
            if true > 0:
                assert np.linalg.norm(found[1] - found[0]) == pytest.approx(true, abs=1e-6)
            crossing = np.linalg.norm(found.ravel() - fromto) < 1e-4
            parallel = name.startswith("RJ") and not crossing  # where axes are parallel points aren't unique
            assert crossing or parallel
    assert made.output["least"][0] == made.output["distance"].min()
    assert made.metrics()["pair"] in labels


def test_nothing_stays_of_a_pose_that_was_nan():
    made, _ = law(picture=False)
    recovers_from_nan(made, {name: values.copy() for name, values in made.input.items()}, {})
    assert np.isfinite(made.metrics()["least_m"])


def test_the_approach_is_the_rate_at_which_the_gap_closes():
    made, wearer = law()
    errors, before = [], None
    for k in range(400):
        if k % 2 == 0:
            made.input["rotation"][:] = wearer.rotation(k * DT)
        made.input["arm"][:] = posture(k)
        made.update(DT)
        if k % 2 == 0:
            now = made.output["distance"].copy(), made.output["approach"].copy()
            if before is not None and k > 20:
                errors.append((before[0] - now[0]) / (2 * DT) - (before[1] + now[1]) / 2)
            before = now
    rate = np.abs(np.array(errors))
    assert np.median(rate) < 0.01
    assert np.percentile(rate, 95) < 0.15, "a body's mean speed over 0.05 s lags behind by half of that"


def test_what_is_left_out_is_said_with_the_reason_and_names_must_be_known():
    arms = ArmsModel(sides=("right", "left"))
    left = CollisionConfig(arms=arms, side="left", leave_out=[("LJ3-LJ4", "left_thigh")]).envelope
    assert len(left.pairs) + sum(map(len, left.left_out.values())) == len(left.links) * len(left.segments)
    text = "\n".join(left.remarks())
    assert "the profile leaves it out: LJ3-LJ4/left_thigh" in text
    assert "can't approach: LBase-LJ1/pelvis" in text
    assert "chest circumference" in text
    thick = CollisionConfig(radii={"forearm": 0.1, "left_hand": 0.2}).envelope
    radii = dict(zip(thick.segments, thick.radii, strict=True))
    assert (radii["left_forearm"], radii["right_forearm"], radii["left_hand"]) == (0.1, 0.1, 0.2)
    assert radii["right_hand"] < 0.1
    for wrong, match in (
        ({"radii": {"tail": 0.1}}, "no segment 'tail'"),
        ({"leave_out": [("RJ3-RJ4", "tail")]}, "nothing is called 'tail'"),
        ({"leave_out": [("RJ3-RJ9", "head")]}, "nothing is called 'RJ3-RJ9'"),
        ({"side": "left"}, "no left one"),
    ):
        with pytest.raises((OptionError, ValueError), match=match):
            CollisionConfig(**wrong)
