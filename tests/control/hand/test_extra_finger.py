"""The extra finger's description and equation (5)."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from helpers.control import HOME, WORN
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydantic import ValidationError

from srl.control.hand.extra_finger import ExtraFinger, FingerKinematics
from srl.runtime.contracts.rotation import homogeneous
from srl.runtime.contracts.signals import Array
from srl.runtime.models.models import FingerModel

REST = np.zeros(3)


class Finger:
    """FingerKinematics in arrays, at the posture of the last `tip`."""

    def __init__(self, **options: object) -> None:
        model = FingerModel(**options)
        self.lower, self.upper = np.array(model.lower), np.array(model.upper)
        self.middle = 0.5 * (self.lower + self.upper)
        self.kinematics = FingerKinematics(model, homogeneous(WORN), 0.01)

    def tip(self, q: Array) -> Array:
        return np.array(self.kinematics.chain.forward(q.tolist()))

    def jacobian(self) -> Array:
        return np.array(self.kinematics.chain.jacobian()).T

    def follow(self, q: Array, dp: Array, v: Array, pull: float) -> tuple[Array, Array]:
        dq, rate = self.kinematics.follow(q.tolist(), tuple(dp), tuple(v), pull)
        return np.array(dq), np.array(rate)


def test_small_steps_reach_and_leave_the_tip_to_the_null_space() -> None:
    kinematics, dp = Finger(), np.array([2e-6, -1e-6, 3e-6])
    start = kinematics.tip(HOME)
    dq, rate = kinematics.follow(HOME, dp, 7.0 * dp, 0.0)
    np.testing.assert_allclose(kinematics.tip(HOME + dq) - start, dp, atol=1e-9)
    np.testing.assert_allclose(rate, 7.0 * dq, rtol=1e-9)
    kinematics.tip(HOME)
    dq, _ = kinematics.follow(HOME, REST, REST, 1e-4)
    assert np.linalg.norm(dq) > 1e-6
    assert np.linalg.norm(kinematics.tip(HOME + dq) - start) < 1e-3 * np.linalg.norm(dq)
    assert np.dot(dq, kinematics.middle - HOME) > 0.0


@given(arrays(float, 4, elements=st.floats(-1, 1)), arrays(float, 3, elements=st.floats(-1, 1)))
def test_any_posture_and_target_stay_bounded_and_within_limits(where: Array, target: Array) -> None:
    """Singular postures (straight, folded) and targets out of reach among them."""
    kinematics = Finger()
    q = kinematics.middle + where * (kinematics.upper - kinematics.lower) / 2
    for _ in range(30):
        ahead = target - kinematics.tip(q)
        ahead *= 0.03 / max(np.linalg.norm(ahead), 0.03)
        dq, rate = kinematics.follow(q, ahead, ahead, 0.01)
        assert np.linalg.norm(dq) <= 1.5
        assert np.all(np.isfinite(rate))
        q = q + dq
        assert np.all((q >= kinematics.lower - 1e-12) & (q <= kinematics.upper + 1e-12))


def test_out_of_reach_it_stretches_toward_the_target_and_rests() -> None:
    kinematics, q, target = Finger(), HOME.copy(), np.array([0.0, 0.2, -0.4])
    for _ in range(400):
        ahead = target - kinematics.tip(q)
        dq, _ = kinematics.follow(q, ahead * 0.03 / np.linalg.norm(ahead), REST, 0.0)
        q = q + dq
    assert np.abs(dq).max() < 1e-6
    shoulder = np.array([0.0, -0.02, -0.045])
    best = np.linalg.norm(target - shoulder) - 3 * 0.042
    assert np.linalg.norm(target - kinematics.tip(q)) < best + 0.002


def test_when_a_joint_is_at_its_limit_the_others_take_over() -> None:
    kinematics = Finger(upper=(pi / 3, np.deg2rad(40.0), pi / 2, pi / 2))
    start = kinematics.tip(HOME)
    for dp in ([0.0, 1e-4, 1e-4], [0.0, 1e-4, -1e-4], [0.0, -1e-4, 1e-4], [0.0, -1e-4, -1e-4]):
        q = HOME
        for _ in range(60):
            q = q + kinematics.follow(q, start + dp - kinematics.tip(q), REST, 0.0)[0]
            assert q[1] <= kinematics.upper[1] + 1e-15
        np.testing.assert_allclose(kinematics.tip(q) - start, dp, atol=1e-7)


def test_a_joint_at_its_limit_has_no_rate_beyond() -> None:
    kinematics = Finger()
    q = np.array([0.0, 0.3, 0.3, pi / 2])
    kinematics.tip(q)
    J = kinematics.jacobian()
    outward = J @ np.array([0.0, 0.0, 0.0, 1e-3])
    dq, rate = kinematics.follow(q, outward, outward, 0.0)
    assert dq[3] <= 0.0
    assert rate[3] <= 0.0 or dq[3] < 0.0


@pytest.mark.parametrize("n", [1, 2, 3, 5, 7])
def test_any_number_of_joints(n: int) -> None:
    kinematics = Finger(rows=((0.5, 0.03),) * n, lower=(-1.5,) * n, upper=(1.5,) * n)
    q = np.full(n, 0.3)
    start = kinematics.tip(q)
    reachable = kinematics.jacobian() @ np.full(n, 1e-5)
    for _ in range(50):
        dq, _ = kinematics.follow(q, start + reachable - kinematics.tip(q), REST, 0.0)
        q = q + dq
    np.testing.assert_allclose(kinematics.tip(q) - start, reachable, atol=3e-7)


@pytest.mark.parametrize(
    "options",
    [
        {"model": {"kind": "finger"}},
        {"model": "other"},
        {"lower": (-1.0,) * 4},
        {"base": np.eye(4).tolist()},
        {"reach": 1.0},
    ],
)
def test_wrong_descriptions_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        ExtraFinger(**options)
