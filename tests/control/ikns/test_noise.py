"""The expected noise of c against many noisy fits of the markers."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.null_space_arm import POINTS

from srl.control.ikns.arm_angles import one_arm
from srl.control.ikns.calibration import Calibration, Recording, calibrate
from srl.control.ikns.markers import MarkerFit
from srl.control.ikns.noise import noise_of_c
from srl.control.ikns.thresholds import Thresholds
from srl.runtime.models.body import average

POSTURE = np.deg2rad([25.0, 30.0, 15.0, 80.0, 10.0, 5.0, 0.0])


def calibration() -> Calibration:
    """Of eight points whose joints swing along fixed directions, by 1 rad: only directions and ranges matter here."""
    rng = np.random.default_rng(2)
    along = rng.normal(size=(len(POINTS), 7))
    along /= np.linalg.norm(along, axis=1)[:, None]
    swing = np.linspace(-0.5, 0.5, 40)
    angles = np.concatenate([POSTURE + np.outer(swing, z) for z in along])
    point = np.repeat(np.arange(len(POINTS)), 40)
    times = np.arange(len(angles)) * 0.01 + point * 5.0
    return calibrate(
        Recording(times, angles, POINTS[point], np.zeros(len(angles), np.intp), point), Thresholds(samples=20)
    )


def test_it_is_the_noise_of_fits() -> None:
    body = one_arm(average(1.75), "right")
    joints = [body.names[i] for i in body.chains["right_arm"]]
    found = calibration()
    reported = noise_of_c(body, joints, np.tile(POSTURE, (len(found.sites), 1)), found)
    assert reported.shape == (10, 1)

    q = np.zeros(len(body.names))
    q[list(body.chains["right_arm"])] = POSTURE
    poses = body.forward(q)
    exact = np.array([(poses[m.segment] @ (*m.at, 1.0))[:3] for m in body.markers.values()])
    rng = np.random.default_rng(3)
    # A fit by plain least squares around the posture, of the body's own forward kinematics.
    J = MarkerFit(body).jacobian(q)
    step = 1e-6
    for j in range(len(q)):
        moved = q.copy()
        moved[j] += step
        there = body.forward(moved)
        after = np.array([(there[m.segment] @ (*m.at, 1.0))[:3] for m in body.markers.values()])
        assert J[:, j] == pytest.approx((after - exact).ravel() / step, abs=1e-5)
    noisy = rng.normal(size=(20000, exact.size)) * 1e-3
    fitted = np.linalg.lstsq(J, noisy.T, rcond=None)[0][list(body.chains["right_arm"])]
    spans = (found.upper - found.lower)[:, 0]
    seen = (found.directions[:, 0] @ fitted).std(axis=1) / spans
    assert reported[:, 0] == pytest.approx(seen, rel=0.03)


def test_a_point_without_a_posture_has_none() -> None:
    body = one_arm(average(1.75), "right")
    joints = [body.names[i] for i in body.chains["right_arm"]]
    postures = np.tile(POSTURE, (10, 1))
    postures[4] = np.nan
    reported = noise_of_c(body, joints, postures, calibration())
    assert np.isnan(reported[4, 0])
    assert np.isfinite(np.delete(reported, 4, axis=0)).all()
