"""A held hand's arm in closed form: against the body's own chain, and what the swivel angle is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.runtime.contracts.signals import Array
from srl.runtime.models.body import Body, Side, average
from srl.sim.parts.body.arm_posture import ArmPosture

BODY = average(1.75)
ARMS = {side: ArmPosture(BODY, side) for side in BODY.sides}
SIDES: tuple[Side, ...] = ("left", "right")


def forward(body: Body, arm: ArmPosture, q: Array) -> dict[str, Array]:
    full = np.zeros(len(body.joints))
    full[arm.joints] = q
    return body.forward(full)


def place(arm: ArmPosture, side: Side, ahead: float, inwards: float, up: float) -> Array:
    return arm.shoulder + np.array([ahead, inwards * (-1.0 if side == "left" else 1.0), up])


@settings(deadline=None, max_examples=60)
@given(
    side=st.sampled_from(SIDES),
    ahead=st.floats(0.3, 0.45),
    inwards=st.floats(-0.15, 0.2),
    up=st.floats(-0.3, 0.1),
    swivel=st.floats(-0.3, 1.6),
    clavicle=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.2, 0.4)),
)
def test_the_chain_puts_the_hand_where_it_is_held(
    side: Side, ahead: float, inwards: float, up: float, swivel: float, clavicle: tuple[float, float]
) -> None:
    arm = ARMS[side]
    hold = arm.natural(place(arm, side, ahead, inwards, up), 0.6)
    q = arm.solve(hold, swivel, clavicle)
    poses = forward(BODY, arm, q)
    hand = poses[f"{side}_hand"]
    assert hand[:3, :3] @ BODY.grip(side) + hand[:3, 3] == pytest.approx(hold.place, abs=1e-9)
    assert hand[:3, :3] == pytest.approx(hold.axes, abs=1e-9)
    assert arm.place(q) == pytest.approx(hold.place, abs=1e-9)
    assert q[:2] == pytest.approx(clavicle)
    # The elbow: turned by the swivel angle about the line from shoulder to wrist, outwards, from where it hangs.
    shoulder, elbow, wrist = (poses[f"{side}_{s}"][:3, 3] for s in ("upper_arm", "forearm", "hand"))
    axis = (wrist - shoulder) / np.linalg.norm(wrist - shoulder)
    off = (elbow - shoulder) - axis * (axis @ (elbow - shoulder))
    down = np.array([0.0, 0.0, -1.0]) + axis * axis[2]
    out = np.cross(axis, down) * (1.0 if side == "left" else -1.0)
    assert np.arctan2(off @ out, off @ down) == pytest.approx(swivel, abs=1e-9)


@pytest.mark.parametrize("side", SIDES)
def test_a_natural_hand_has_a_nearly_straight_wrist_and_a_range_of_swivel(side: Side) -> None:
    arm = ARMS[side]
    hold = arm.natural(place(arm, side, 0.33, 0.03, -0.12), 0.6, pronation=0.2)
    assert arm.solve(hold, 0.6)[6:] == pytest.approx([0.2, 0.0, 0.0], abs=0.08)
    assert all(arm.fits(arm.solve(hold, swivel), 0.0) for swivel in np.linspace(0.0, 1.6, 30))
    assert not arm.fits(arm.solve(hold, -1.3), 0.0)


def test_left_and_right_are_mirror_images() -> None:
    left, right = ARMS["left"], ARMS["right"]
    one = left.natural(place(left, "left", 0.3, 0.05, -0.1), 0.5)
    other = right.natural(place(right, "right", 0.3, 0.05, -0.1), 0.5)
    assert left.solve(one, 0.9, (0.1, 0.2)) == pytest.approx(right.solve(other, 0.9, (0.1, 0.2)))


def test_the_jacobian_is_the_derivative() -> None:
    arm = ARMS["right"]
    q = arm.solve(arm.natural(place(arm, "right", 0.33, 0.03, -0.12), 0.6), 0.9, (0.1, 0.2))
    J = arm.jacobian(q)
    numeric = np.column_stack([(arm.place(q + e) - arm.place(q - e)) / 2e-6 for e in 1e-6 * np.eye(9)])
    assert J[:3] == pytest.approx(numeric, abs=1e-7)
    turn = lambda x: forward(BODY, arm, x)["right_hand"][:3, :3]  # noqa: E731
    for j, e in enumerate(1e-6 * np.eye(9)):
        W = (turn(q + e) - turn(q - e)) / 2e-6 @ turn(q).T
        assert J[3:, j] == pytest.approx([W[2, 1], W[0, 2], W[1, 0]], abs=1e-7)


def test_out_of_reach_the_hand_stays_on_its_line() -> None:
    arm = ARMS["right"]
    far = arm.natural(arm.shoulder + np.array([2.0, 0.0, 0.0]), 0.6)
    assert not arm.reaches(far)
    found = arm.place(arm.solve(far, 0.6))
    assert np.isfinite(found).all()
    assert np.linalg.norm(found - arm.shoulder) < arm.reach
