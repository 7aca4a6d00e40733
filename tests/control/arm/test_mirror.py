"""A mirrored arm: its tool is at the other one's image, whatever the plane; what isn't an image is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.arm_urdf import HIP
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from srl.control.arm.mirror import Mirror, MirrorConfig
from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.rotation import from_matrix
from srl.runtime.models.robot_model import RobotModel
from srl.testing import ControllerConformance, bound

OTHER = RobotModel.model_validate({"urdf": KeptFile(Path("hip.urdf"), HIP.encode()), "tip": "tool"}).robot
# The led arm has other names, and its shoulder turns the other way round.
TEXT = HIP.replace('name="yaw"', 'name="turn"').replace('name="elbow"', 'name="bend"')
TEXT = TEXT.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 -1 0"/>', 1)
LED = RobotModel.model_validate({"urdf": KeptFile(Path("led.urdf"), TEXT.encode()), "tip": "tool"}).robot
NAMES = {"turn": "yaw", "bend": "elbow"}
Q = np.array([0.1, -0.2, 0.3, 0.1])
BESIDE = (0.0, 0.4, 0.0, 1.0, 0.0, 0.0, 0.0)


def law(placed: Any = BESIDE, **options: Any) -> Mirror:
    given = {"robot": LED, "other": OTHER, "joints": NAMES, "speed": 2.0} | options
    made = bound(Mirror("mirror", MirrorConfig.model_validate(given)), {"other": placed})
    made.applied["q"][:] = made.input["q"][:] = Q
    return made


def run(made: Mirror, cycles: int, dt: float = 0.01) -> np.ndarray:
    found = []
    for _ in range(cycles):
        made.update(dt)
        made.applied["q"][:] = made.output["q"]
        found.append(made.output["q"].copy())
    return np.array(found)


class TestConformance(ControllerConformance):
    inputs = {"q": Q, "other": [0.4, 0.1, 0.2, 0.3]}  # noqa: RUF012
    start = {"q": Q, "q_velocity": np.zeros(4)}  # noqa: RUF012

    def law(self) -> Mirror:
        return law()


@settings(max_examples=25, deadline=None)
@given(st.tuples(*[st.floats(-1.0, 1.0)] * 3), st.tuples(*[st.floats(-1.4, 1.4)] * 4))
def test_the_tool_is_at_the_other_ones_image(normal: Any, q: Any) -> None:
    n = np.array(normal) + (0.0, 2.0, 0.0)  # noqa: RUF005
    n /= np.linalg.norm(n)
    reflect = np.eye(3) - 2.0 * np.outer(n, n)
    placed = np.eye(4)
    placed[:3, :3] = reflect @ np.diag([1.0, -1.0, 1.0])  # the arm is its own image across its plane y = 0
    placed[:3, 3] = 0.5 * n
    made = law((*placed[:3, 3], *from_matrix(placed[:3, :3])))
    made.reset()
    made.input["other"][:] = q
    run(made, 300)
    tool = (placed @ OTHER.forward(np.array(q)))[:3, 3]
    image = 0.25 * n + reflect @ (tool - 0.25 * n)
    assert LED.forward(made.output["q"])[:3, 3] == pytest.approx(image, abs=1e-9)


def test_it_starts_where_the_limb_is_and_goes_at_its_speed() -> None:
    made = law(speed=0.5)
    made.reset()
    assert made.output["q"].tolist() == Q.tolist()
    made.input["other"][:] = 1.0, 1.0, -1.0, 1.0
    q = run(made, 500)
    assert np.abs(np.diff(q, axis=0, prepend=Q[None])).max() <= 0.005 + 1e-12
    made.param["speed"][()] = 0.0
    made.input["other"][:] = 0.0
    q = run(made, 200)
    assert (q[-1] == q[-2]).all()


def test_an_arm_that_is_lost_is_waited_for_at_rest() -> None:
    made = law()
    made.reset()
    made.input["other"][:] = 1.0, 1.0, -1.0, 1.0
    run(made, 60)
    assert np.abs(made.output["q_velocity"]).max() == pytest.approx(2.0)
    made.input["other"][:] = np.nan
    before = made.output["q_velocity"].copy()
    q = run(made, 49)
    v = np.diff(q, axis=0) / 0.01
    assert np.abs(v[0] - before).max() <= 2.0 / 0.2 * 0.01 * 2 + 1e-9, "no joint stops dead"
    assert np.abs(np.diff(v, axis=0)).max() <= 2.0 / 0.2 * 0.01 + 1e-9
    assert (np.diff(np.abs(v), axis=0) < 1e-9).all()
    assert (q[20:] == q[-1]).all()
    assert not made.lost
    run(made, 2)
    assert made.lost
    made.input["other"][:] = 1.0, 1.0, -1.0, 1.0
    v = np.diff(run(made, 100), axis=0) / 0.01
    assert np.abs(v[0]).max() < 0.1, "it takes up its speed again"
    assert not made.lost


def test_a_reset_without_measured_joints_begins_where_the_limb_is() -> None:
    made = law()
    made.input["q"][:] = made.applied["q"][:] = np.nan
    made.reset()
    made.update(0.01)
    assert not np.isfinite(made.output["q"]).any()
    made.input["q"][:] = Q
    made.update(0.01)
    assert made.output["q"] == pytest.approx(Q, abs=0.02)


def test_limits_of_the_led_arm_hold() -> None:
    made = law()
    made.reset()
    made.input["other"][:] = 9.0
    q = run(made, 500)
    assert (q[-1] <= LED.q_upper).all()
    assert (q[-1] >= LED.q_lower).all()


@pytest.mark.parametrize(
    ("placed", "reason"),
    [
        ((0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), "same place"),
        ((0.4, 0.4, 0.0, 1.0, 0.0, 0.0, 0.0), "axis of shoulder isn't the mirror image of shoulder's: 90 degrees"),
        ((0.0, 0.4, 0.1, 1.0, 0.0, 0.0, 0.0), "isn't the mirror image"),
    ],
)
def test_arms_that_are_no_images_are_refused(placed: Any, reason: str) -> None:
    with pytest.raises(WiringError, match=reason):
        law(placed)


def universal(first: str, second: str, axes: tuple[str, str]) -> Any:
    """Two axes through one point, and a tool."""
    parents = ("base", "mid"), ("mid", "hand")
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for name, axis, (parent, child) in zip((first, second), axes, parents, strict=True)
    )
    links = "".join(f'<link name="{name}"/>' for name in ("base", "mid", "hand"))
    kept = KeptFile(Path("u.urdf"), f'<robot name="u">{links}{joints}</robot>'.encode())
    return RobotModel.model_validate({"urdf": kept}).robot


def test_the_same_axes_in_another_order_are_refused() -> None:
    """At zero a yaw before a pitch is the image of a pitch before a yaw; turned, the two end elsewhere."""
    led, other = universal("yaw", "pitch", ("0 0 1", "0 1 0")), universal("pitch", "yaw", ("0 1 0", "0 0 1"))
    config = MirrorConfig.model_validate({"robot": led, "other": other, "normal": (0.0, 1.0, 0.0)})
    with pytest.raises(WiringError, match="come as yaw, pitch"):
        bound(Mirror("mirror", config), {"other": (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)})


@pytest.mark.parametrize(
    ("joints", "reason"),
    [
        ({"turn": "yaw"}, "no joint 'bend'"),
        ({"turn": "yaw", "bend": "yaw"}, "each joint of one arm needs one"),
        ({**NAMES, "knee": "elbow"}, "no joint 'knee'"),
    ],
)
def test_names_that_do_not_fit_are_refused(joints: dict[str, str], reason: str) -> None:
    with pytest.raises(ValidationError, match=reason):
        law(joints=joints)
