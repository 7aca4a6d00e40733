"""What richer deformations and psi cost or gain: the figures of docs/object-mapping.md."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.control import FIST, HOME, RELAXED, finger_tip, hand_tips
from scipy.spatial.transform import Rotation

from srl.control.hand.sphere import MinimumSphere
from srl.control.hand.virtual_object import Deformation, Psi, VirtualObject
from srl.runtime.contracts.signals import Array

ROBOT = finger_tip(HOME)[None]
CLOSING = [hand_tips(RELAXED + u * (FIST - RELAXED)) for u in np.linspace(0.0, 1.0, 101)]
ALL, PARTIAL = [0, 1, 2, 3, 4], [2, 3, 4]


@pytest.mark.parametrize(
    ("chosen", "deformation", "undamped", "damped"),
    [
        (ALL, Deformation.ISOTROPIC, (1.05, 2.3), (1.05, 2.3)),
        (ALL, Deformation.SCALING, (0.60, 0.80), (0.60, 0.80)),
        (ALL, Deformation.NON_ISOTROPIC, (6.3, 18), (1.5, 2.7)),
        (ALL, Deformation.SHEAR, (13, 33), (1.4, 4.1)),
        (PARTIAL, Deformation.ISOTROPIC, (8.4, 17), (1.7, 2.5)),
        (PARTIAL, Deformation.SCALING, (0.98, 1.5), (0.98, 1.5)),
        (PARTIAL, Deformation.NON_ISOTROPIC, (80, 5700), (1.7, 3.9)),
        (PARTIAL, Deformation.SHEAR, (7.1, 18), (2.1, 4.0)),
    ],
)
def test_noise_gain_of_a_closing_hand(
    chosen: list[int], deformation: Deformation, undamped: tuple[float, float], damped: tuple[float, float]
) -> None:
    model = VirtualObject(deformation, Psi.NONE, 4.0)
    gains = np.array([model.noise_gain(tips[chosen], ROBOT) for tips in CLOSING])
    assert (np.median(gains[:, 0]), gains[:, 0].max()) == pytest.approx(damped, rel=0.05)
    assert (np.median(gains[:, 1]), gains[:, 1].max()) == pytest.approx(undamped, rel=0.05)


def test_three_points_leave_a_shear_open() -> None:
    """Any three points lie in a plane, and what is off it may shear without moving them."""
    for deformation, nullity in ((Deformation.ISOTROPIC, 0), (Deformation.SHEAR, 3)):
        model = VirtualObject(deformation, Psi.NONE, np.inf)
        for tips in CLOSING[::10]:
            three = tips[[0, 1, 4]]
            _, eigenvalues, _, _ = model._decompose(three - three.mean(axis=0), ROBOT - three.mean(axis=0))
            assert int(np.sum(eigenvalues < 1e-9 * eigenvalues[-1])) == nullity


def carried(points: Array, psi: Psi, axis: Array, turn: bool) -> float:
    """Error, m, of a tip that follows two points through 20 degrees about the wrist, or through 20 mm."""
    model, p_h, p_a, true = VirtualObject(Deformation.RIGID, psi, np.inf), points, ROBOT, ROBOT
    step = Rotation.from_rotvec(np.deg2rad(1.0) * axis).as_matrix() if turn else np.eye(3)
    shift = np.zeros(3) if turn else 0.001 * axis
    for _ in range(20):
        after = p_h @ step.T + shift
        p_a = model.move(p_h, after, p_a, np.array(MinimumSphere().around(np.concatenate([p_h, p_a]).tolist())))
        p_h, true = after, true @ step.T + shift
    return float(np.linalg.norm(p_a - true))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pair", "none", "minimum", "shifted"),
    [([0, 1], 13.5, 21.4, 8.6), ([2, 3], 15.4, 14.2, 11.0), ([1, 4], 14.6, 9.7, 10.0)],
    ids=["thumb and index", "middle and ring", "index and little"],
)
def test_psi_of_two_points(pair: list[int], none: float, minimum: float, shifted: float) -> None:
    """The minimum norm follows turns of the hand better or worse, by the points; shifts always worse."""
    points, n = CLOSING[0][pair], 50
    z, turns = (2.0 * np.arange(n) + 1.0) / n - 1.0, np.pi * (1.0 + np.sqrt(5.0)) * np.arange(n)  # evenly on a sphere
    axes = np.column_stack([np.sqrt(1.0 - z**2) * np.cos(turns), np.sqrt(1.0 - z**2) * np.sin(turns), z])

    def rms(psi: Psi, turn: bool) -> float:
        return 1e3 * float(np.sqrt(np.mean([carried(points, psi, axis, turn) ** 2 for axis in axes])))

    assert rms(Psi.NONE, turn=True) == pytest.approx(none, rel=0.05)
    assert rms(Psi.MINIMUM_NORM, turn=True) == pytest.approx(minimum, rel=0.05)
    assert rms(Psi.NONE, turn=False) == pytest.approx(0.0, abs=1e-9)
    assert rms(Psi.MINIMUM_NORM, turn=False) == pytest.approx(shifted, rel=0.05)
