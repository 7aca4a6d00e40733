"""The upper body: against MuJoCo, its sides against each other, its ranges and what is refused."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from pydantic import ValidationError

from srl.runtime.models.body import Body, average
from srl.runtime.models.models import BodyModel

MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])
BODY = BodyModel(stature=1.82, lengths={"upper_arm": 0.30, "right_forearm": 0.27}).body


def postures(body: Body, count: int = 20) -> np.ndarray:
    """(count, n) within the ranges; the torso's places within 1 m."""
    low, high = np.clip(body.ranges, -1.0, 1.0).T
    finite = np.isfinite(body.ranges).all(axis=1)
    low, high = np.where(finite, body.ranges[:, 0], low), np.where(finite, body.ranges[:, 1], high)
    return np.random.default_rng(1).uniform(low, high, (count, len(body.joints)))


def mujoco_poses(body: Body, q: np.ndarray) -> Mapping[str, np.ndarray]:
    """The same chain, written as MJCF."""
    inside: dict[int, str] = {}
    for i in reversed(range(len(body.joints))):
        joint = body.joints[i]
        children = "".join(inside[k] for k, j in enumerate(body.joints) if j.parent == i)
        kind = "slide" if joint.slides else "hinge"
        place, axis = (" ".join(map(repr, v)) for v in (joint.place, joint.axis))
        inside[i] = (
            f'<body name="{joint.name}" pos="{place}"><joint type="{kind}" axis="{axis}"/>'
            f'<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>{children}</body>'
        )
    model: Any = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{inside[0]}</worldbody></mujoco>")
    data: Any = mujoco.MjData(model)
    order = [int(model.jnt_qposadr[model.body(joint.name).jntadr[0]]) for joint in body.joints]
    data.qpos[order] = q
    mujoco.mj_kinematics(model, data)
    poses = {}
    for segment, i in body.segments.items():
        row = model.body(body.joints[i].name).id
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = data.xmat[row].reshape(3, 3), data.xpos[row]
        poses[segment] = pose
    return poses


def test_it_has_24_degrees_of_freedom_in_chains_with_names() -> None:
    assert len(BODY.joints) == len(set(BODY.names)) == 24
    assert {chain: len(joints) for chain, joints in BODY.chains.items()} == {
        "torso": 6, "left_clavicle": 2, "left_arm": 7, "right_clavicle": 2, "right_arm": 7,
    }  # fmt: skip
    right = average(1.75, ["right"])
    assert len(right.joints) == 15
    assert set(right.segments) == {"torso", "right_clavicle", "right_upper_arm", "right_forearm", "right_hand"}


def test_pinocchios_model_and_the_chain_multiplied_out_are_what_mujoco_finds() -> None:
    model = BODY.model()
    data = model.createData()
    assert tuple(model.names[1:]) == BODY.names
    np.testing.assert_array_equal(model.lowerPositionLimit, BODY.ranges[:, 0])
    np.testing.assert_array_equal(model.upperPositionLimit, BODY.ranges[:, 1])
    for q in postures(BODY):
        expected, ours = mujoco_poses(BODY, q), BODY.forward(q)
        pin.framesForwardKinematics(model, data, q)
        for segment, pose in expected.items():
            np.testing.assert_allclose(ours[segment], pose, atol=1e-12)
            np.testing.assert_allclose(data.oMf[model.getFrameId(segment)].homogeneous, pose, atol=1e-12)


def test_the_left_mirrors_the_right() -> None:
    body = average(1.7)
    for q in postures(body):
        values = dict(zip(body.names, q, strict=True))
        other = {"left": "right", "right": "left"}
        mirrored = {
            name: values.get(f"{other.get(name.partition('_')[0])}_{name.partition('_')[2]}", 0.0)
            for name in body.names
        }
        for name in ("torso_y", "torso_yaw", "torso_side"):
            mirrored[name] = -values[name]
        for name in ("torso_x", "torso_z", "torso_lean"):
            mirrored[name] = values[name]
        here, there = body.forward(q), body.forward([mirrored[name] for name in body.names])
        for side in ("left", "right"):
            for part in ("clavicle", "upper_arm", "forearm", "hand"):
                ours, theirs = here[f"{side}_{part}"], there[f"{other[side]}_{part}"]
                np.testing.assert_allclose(MIRROR @ ours @ MIRROR, theirs, atol=1e-12)
    for name in ("SHO", "UPA", "ELB", "FRM", "WRA", "WRB", "FIN"):
        left, right = body.markers[f"L{name}"], body.markers[f"R{name}"]
        np.testing.assert_allclose(np.array(left.at) * (1, -1, 1), right.at)
        assert left.segment.replace("left", "right") == right.segment


@pytest.mark.parametrize("side", ["left", "right"])
def test_positive_angles_mean_what_they_are_called(side: str) -> None:
    body = average(1.75)
    outward = 1.0 if side == "left" else -1.0

    def hand(**angles: float) -> np.ndarray:
        """The grip (3,) in the chest's frame."""
        q = [angles.get(name.removeprefix(f"{side}_"), 0.0) if side in name else 0.0 for name in body.names]
        pose = body.forward(q)[f"{side}_hand"]
        return pose[:3, 3] + pose[:3, :3] @ body.grip(side)  # type: ignore[arg-type]

    rest = hand()
    assert (hand(shoulder_abduction=0.1) - rest)[1] * outward > 0.05
    assert (hand(shoulder_flexion=0.1) - rest)[0] > 0.05
    assert (hand(elbow_flexion=0.1) - rest)[0] > 0.02
    bent = hand(elbow_flexion=1.5)
    assert (hand(elbow_flexion=1.5, shoulder_rotation=0.1) - bent)[1] * outward < -0.02  # to the body
    assert (hand(wrist_flexion=0.1) - rest)[1] * outward < -0.005  # the palm faces the body
    assert (hand(wrist_deviation=0.1) - rest)[0] < -0.005  # the little finger is at the back
    assert (hand(clavicle_protraction=0.1) - rest)[0] > 0.01
    assert (hand(clavicle_elevation=0.1) - rest)[2] > 0.01
    turned = body.forward([1.0 if name == f"{side}_forearm_pronation" else 0.0 for name in body.names])
    assert (turned[f"{side}_hand"][:3, 0])[1] * outward < -0.5  # the thumb turns to the body


def test_ranges_hold_rest_and_enclose_the_arm_models() -> None:
    ranges = dict(zip(BODY.names, np.rad2deg(BODY.ranges).tolist(), strict=True))
    assert all(low <= 0.0 <= high for low, high in ranges.values())
    for name, (low, high) in {
        "elbow_flexion": (0, 130), "forearm_pronation": (-90, 90),
        "wrist_flexion": (-70, 70), "wrist_deviation": (-10, 25),
    }.items():  # fmt: skip
        for side in ("left", "right"):
            ours = ranges[f"{side}_{name}"]
            assert ours[0] <= low + 1e-9
            assert ours[1] >= high - 1e-9


def test_lengths_are_the_statures_unless_they_are_measured() -> None:
    plain = BodyModel(stature=1.75).body
    assert plain.sizes["upper_arm"]["left"] == pytest.approx(0.3255)
    assert plain.sizes["forearm"]["right"] == pytest.approx(0.2555)
    assert (BODY.sizes["upper_arm"]["left"], BODY.sizes["upper_arm"]["right"]) == (0.30, 0.30)
    assert BODY.sizes["forearm"]["right"] == 0.27
    assert BODY.sizes["forearm"]["left"] == pytest.approx(0.146 * 1.82)
    # A marker near a joint stays near it.
    low = 0.27 - 0.146 * 1.82
    assert BODY.markers["RWRA"].at[2] == pytest.approx(BODY.markers["LWRA"].at[2] - low)
    moved = BodyModel(shoulder={"left": (-0.06, 0.15, 0.02)}).body
    offset = np.subtract(plain.markers["LSHO"].at, plain.shoulder["left"])
    np.testing.assert_allclose(np.subtract(moved.markers["LSHO"].at, (-0.06, 0.15, 0.02)), offset)


def test_markers_can_be_placed_and_taken_away() -> None:
    body = BodyModel(
        sides=("right",), markers={"RUPA": None, "EPIM": {"segment": "right_upper_arm", "at": (0, 0, 0.1)}}
    ).body
    assert "RUPA" not in body.markers
    assert body.markers["EPIM"].at == (0.0, 0.0, 0.1)
    assert "LFIN" not in body.markers


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"stature": 175}, "less than 2.3"),
        ({"lengths": {"uper_arm": 0.3}}, "Did you mean 'upper_arm'"),
        ({"lengths": {"forearm": 270}}, "lengths are in m"),
        ({"sides": ("right",), "lengths": {"left_forearm": 0.27}}, "no length 'left_forearm'"),
        ({"sides": ("right", "right")}, "each side once"),
        ({"sides": ("right",), "shoulder": {"left": (0, 0.1, 0)}}, "no left arm"),
        ({"markers": {"X": {"segment": "right_arm", "at": (0, 0, 0)}}}, "no segment 'right_arm'"),
        ({"markers": {"X": {"segment": "torso", "at": (0, 0, np.inf)}}}, "finite"),
    ],
)
def test_wrong_bodies_are_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        BodyModel(**options)
