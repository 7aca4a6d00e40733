"""MOCA's damping: the ratio of each mode, by its poles and by swings in MuJoCo, without and with the rotors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.superman import ON_DECK, MocaRig, task_inertia
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import eigh
from scipy.optimize import curve_fit
from scipy.spatial.transform import Rotation

from srl.control.cobot.moca_impedance import ModalDamping
from srl.runtime.contracts.signals import Array

FREE = {"part": "panda", "friction": 0.0, **ON_DECK}
seeds = st.integers(0, 2**32 - 1)


@settings(max_examples=100, deadline=None)
@given(seeds, st.floats(0.1, 1.5))
def test_the_damping_ratio_is_that_of_every_mode(seed: int, ratio: float) -> None:
    """The poles of Lambda x_dd + D x_d + K x = 0, which know nothing of modes."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(6, 6)) * [1, 1, 1, 3, 3, 3]
    mobility, K = A.T @ A + 0.1 * np.eye(6), np.exp(rng.uniform(3, 8, 6))
    D = ModalDamping(tuple(K.tolist()), ratio)(np.tril(mobility))
    np.testing.assert_allclose(D, D.T, rtol=1e-9, atol=1e-9 * np.abs(D).max())
    poles = np.linalg.eigvals(np.block([[np.zeros((6, 6)), np.eye(6)], [-mobility * K, -mobility @ D]]))
    if ratio < 0.95:
        np.testing.assert_allclose(-poles.real / np.abs(poles), ratio, rtol=1e-5)
    elif ratio > 1.05:
        assert np.abs(poles.imag).max() < 1e-5 * np.abs(poles).max()


def test_a_mode_that_has_all_but_no_mobility_has_bounded_damping() -> None:
    D = ModalDamping((500.0,) * 6, 0.7)(np.diag([0.1, 0.1, 1e-12, 0.1, 0.0, 0.1]))
    np.testing.assert_allclose(D[2, 2], 2 * 0.7 * 500 / 1.0)
    assert np.isfinite(D).all()


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"unit_mass": True, "rotors": "none"}], ids=["ours", "as published"])
def test_a_push_dies_out_two_milliseconds_late(options: dict[str, Any]) -> None:
    """The rotors' inertia keeps the light wrist from ringing, without friction, too."""
    rig = MocaRig({"arm": FREE}, delay=2, **options)
    rig.push[:] = [20, 10, -15, 1, 1, 1]
    rig.step(500)
    rig.push[:] = 0
    rig.step(2000)
    assert np.abs(rig.arm.velocity).max() < 0.05


def swing(mode: int, **options: Any) -> tuple[float, float, float, float]:
    """Deflects one mode of (Lambda, K_d) in MuJoCo, lets go; frequency of theory and found, ratio, the fit's rest."""
    rig = MocaRig({"arm": FREE}, **options)
    rig.step(20)
    given = rig.chain.law.input
    inertia = task_inertia(rig.arm.position, given["jacobian"], rotors=True)
    squares, V = eigh(np.diag([500.0, 500, 500, 30, 30, 30]), inertia)
    w, shape = float(np.sqrt(squares[mode])), V[:, mode]
    away = shape * min(0.002 / np.abs(shape[:3]).max(), 0.01 / np.abs(shape[3:]).max())
    rig.chain.locked, start, goal = True, given["pose"].copy(), given["desired_pose"]
    goal[:3] = start[:3] + away[:3]
    goal[3:] = (Rotation.from_rotvec(away[3:]) * Rotation.from_quat(start[[4, 5, 6, 3]])).as_quat()[[3, 0, 1, 2]]
    given["desired_twist"][:] = 0.0
    error = np.empty(round(min(4 / w, 0.6) * 1000))
    for k in range(len(error)):
        rig.step()
        turn = Rotation.from_quat(goal[[4, 5, 6, 3]]) * Rotation.from_quat(given["pose"][[4, 5, 6, 3]]).inv()
        error[k] = shape @ inertia @ np.concatenate([goal[:3] - given["pose"][:3], turn.as_rotvec()])
    t = 1e-3 * np.arange(len(error))

    def free(t: Array, size: float, w: float, xi: float) -> Array:
        fast = w * np.sqrt(1 - xi * xi)
        return np.asarray(size * np.exp(-xi * w * t) * (np.cos(fast * t) + xi * w / fast * np.sin(fast * t)))

    error /= error[0]
    found, _ = curve_fit(free, t, error, [1.0, w, 0.7], bounds=([0.5, 0.1, 0.01], [1.5, 200.0, 0.999]))
    return w, found[1], found[2], float(np.sqrt(np.mean((free(t, *found) - error) ** 2)))


@pytest.mark.slow
@pytest.mark.parametrize(("rotors", "of_ratio", "of_inertia"), [("damping", 0.03, 0.06), ("all", 0.01, 0.03)])
def test_each_mode_swings_in_simulation_as_theory_says(rotors: str, of_ratio: float, of_inertia: float) -> None:
    for mode in range(6):
        w, found, ratio, rest = swing(mode, rotors=rotors)
        print(f"{rotors} {mode}: ratio {ratio:.3f} of 0.7, rendered inertia {(w / found) ** 2:.3f} of theory's")
        assert rest < 0.01
        assert ratio == pytest.approx(0.7, rel=of_ratio)
        assert (w / found) ** 2 == pytest.approx(1.0, rel=of_inertia)


@pytest.mark.slow
def test_damping_that_does_not_count_the_rotors_lets_the_wrist_swing() -> None:
    assert min(swing(mode, rotors="none")[2] for mode in (3, 4)) < 0.3


@pytest.mark.slow
def test_a_mass_with_rotors_in_equation_4_costs_speed_in_locomotion() -> None:
    """The published weights are for the robot's own mass matrix, which has none. Metres in 2 s of 15 N."""
    way = {}
    for rotors in ("damping", "all"):
        rig = MocaRig(rotors=rotors)
        rig.chain.press("P")
        rig.step()
        rig.chain.press()
        rig.step(700)
        rig.chain.press("A")
        for _ in range(2000):
            rig.chain.wrench[1] = 15.0
            rig.step()
            rig.chain.press()
        way[rotors] = np.linalg.norm(rig.base.pose()[:2])
    assert way["all"] < 0.75 * way["damping"]
