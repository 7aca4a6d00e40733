"""The speed of the desired joints that isn't damped (`lead`): what it adds to the torque, and when it adds none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from helpers.joint_impedance import ROBOT, K, Q, law

from srl.control.arm.joint_impedance import JointImpedance
from srl.runtime.models.robots.pinocchio_model import pinocchio_model

DT = 0.002
V = np.array([0.2, -0.1, 0.15, 0.1])  # rad/s
STIFFNESS = np.array(list(K.values()))


def drag(q: Any, v: Any) -> np.ndarray:
    """(n,) N m, that the damper takes at this speed."""
    model = pinocchio_model(ROBOT)
    M = pin.crba(model, model.createData(), q).diagonal()
    found: np.ndarray = 1.4 * np.sqrt(STIFFNESS * M) * v
    return found


def spring(made: JointImpedance) -> np.ndarray:
    """(n,) N m, beside the weight."""
    found: np.ndarray = made.output["torque"] - made.output["gravity"]
    return found


def moving(**options: Any) -> JointImpedance:
    """A law whose arm has followed a steady motion for a while: its torque is what the damper would take."""
    made = law(lead=1.0, **options)
    made.reset()
    for _ in range(200):
        made.input["q"] += DT * V
        made.input["wanted"][:] = made.input["q"]
        made.update(DT)
    assert spring(made) == pytest.approx(drag(made.input["q"], V), abs=2e-3)
    return made


def test_after_a_reset_nothing_of_the_motion_before_is_left() -> None:
    made = moving()
    made.reset()
    assert np.abs(spring(made)).max() < 1e-9
    made.update(DT)
    assert np.abs(spring(made)).max() < 1e-9


def test_where_the_limb_is_found_anew_nothing_of_the_motion_before_is_left() -> None:
    made = moving()
    made.input["q"] += 1.0  # farther than it can have gone
    made.input["wanted"][:] = made.input["q"]
    for known in (False, True):  # without a measured place there is no torque
        for _ in range(300):
            made.update(DT)
            if np.isfinite(spring(made)).all() == known:
                break
    assert made.output["desired"] == pytest.approx(made.input["q"])
    assert np.abs(spring(made)).max() < 1e-9


def test_a_limb_that_is_held_feels_the_spring_at_its_leash_alone() -> None:
    """A hand holds it while the desired joints would go on: they don't move, so they lead nothing."""
    max_following_error = 0.02
    made = law(lead=1.0, max_following_error=max_following_error)
    made.reset()
    made.input["wanted"][:] = Q + np.array([1.0, -1.0, 1.0, -1.0])
    for _ in range(200):
        made.update(DT)
    assert spring(made) == pytest.approx(STIFFNESS * max_following_error * [1, -1, 1, -1], abs=1e-9)


def test_one_joint_that_is_held_does_not_take_the_lead_of_the_others() -> None:
    made = law(lead=1.0, max_following_error=0.02)
    made.reset()
    for _ in range(200):
        made.input["q"][1:] += DT * V[1:]
        made.input["wanted"][1:] = made.input["q"][1:]
        made.input["wanted"][0] = Q[0] + 1.0
        made.update(DT)
    expected = drag(made.input["q"], V)
    expected[0] = STIFFNESS[0] * 0.02
    assert spring(made) == pytest.approx(expected, abs=2e-3)


def test_a_jump_of_what_is_wanted_raises_the_torque_gradually() -> None:
    made = law(lead=1.0, speed=0.5)
    made.reset()
    made.update(DT)
    whole, last = drag(Q, 0.5), spring(made)
    made.input["wanted"][:] = Q + 0.4
    for _ in range(50):
        made.update(DT)
        steps = np.abs(spring(made) - last)
        assert (steps <= 0.1 * whole + STIFFNESS * 0.5 * DT).all()
        last = spring(made)
    assert (last > 0.7 * whole).all(), "and after some hundredths of a second all of it is there"
