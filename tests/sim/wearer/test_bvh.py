"""BVH: the reader against an independent one's forward kinematics, the hand against the skeleton's."""

import json

import numpy as np
import pytest
from helpers.shared import shared
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.models.human_hand import FINGERS, JOINTS
from srl.runtime.models.skeleton import bvh
from srl.sim.wearer import load_wearer
from srl.sim.wearer.bvh_hand import _knuckle, hand_angles

FILES = ("left_arm_fingers_yxz.bvh", "fullbody_walk_yxz.bvh", "fullbody_xyz.bvh")
LEFT = "data/axis_neuron_bvh/left_arm_fingers_yxz.bvh"


@pytest.mark.parametrize("name", FILES)
def test_forward_kinematics_are_the_references(name):
    file = bvh.read(shared(f"data/axis_neuron_bvh/{name}"))
    reference = json.loads(shared("data/axis_neuron_bvh/reference_fk.json").read_text())[name]
    positions = file.world_positions()
    assert len(file.joints) == 72
    for frame, nodes in reference.items():
        for node, expected in nodes.items():
            np.testing.assert_allclose(positions[int(frame), file.index(node)], expected, atol=2e-4)


def test_the_models_fingers_close_when_the_recorded_hand_closes():
    path = shared(LEFT)
    file = bvh.read(path)
    positions = file.world_positions()
    angles = hand_angles(file, "Left")
    for number, (finger, bone) in enumerate(zip(FINGERS, ("Thumb", "Index", "Middle", "Ring", "Pinky"), strict=True)):
        if finger == "thumb":
            continue
        tip = positions[:, file.index(f"LeftHand{bone}3_End")]
        reach = np.linalg.norm(tip - positions[:, file.index(f"LeftHand{bone}1")], axis=1)
        bend = angles[:, 4 * number + 1 : 4 * number + 4]
        # The distance from knuckle to tip that the outer joints' angles give with the skeleton's lengths.
        a, b, c = (-_offset(file, name) for name in (f"{bone}2", f"{bone}3", f"{bone}3_End"))
        x = a + b * np.cos(bend[:, 1]) + c * np.cos(bend[:, 1] + bend[:, 2])
        y = b * np.sin(bend[:, 1]) + c * np.sin(bend[:, 1] + bend[:, 2])
        np.testing.assert_allclose(np.hypot(x, y), reach, atol=0.02)  # cm
        # And the finger's first bone dips below the hand's plane as far as flexion says.
        dip = _dip(file, positions, bone)
        np.testing.assert_allclose(np.sin(bend[:, 0]), dip, atol=0.02)
    played = load_wearer(path)
    closed = int(np.argmax(angles[:, [5, 9, 13, 17]].sum(1)))
    q = played.target(closed * file.frame_time)
    assert q[JOINTS.index("middle_pip_flexion")] > 1.0


def _offset(file, name):
    return -float(np.linalg.norm(file.joints[file.index(f"LeftHand{name}")].offset))


def _dip(file, positions, bone):
    """How far (sine) a finger's first bone points to the palm's side, from world positions alone."""
    R = np.eye(3)
    chain, index = [], file.index("LeftHand")
    while index >= 0:
        chain.append(index)
        index = file.joints[index].parent
    for index in reversed(chain):
        R = R @ file.rotation(index)
    first = positions[:, file.index(f"LeftHand{bone}2")] - positions[:, file.index(f"LeftHand{bone}1")]
    first /= np.linalg.norm(first, axis=1)[:, None]
    return -np.einsum("nij,nj->ni", R.transpose(0, 2, 1), first)[:, 1]


@given(st.floats(-0.5, 0.5), st.floats(-1.1, 1.1), st.floats(-1, 1))
def test_knuckle_angles_come_back_whatever_the_twist(a, f, twist):
    R = Rotation.from_euler("ZXY", [a, -f, twist])
    abduction, flexion = _knuckle(R.apply([0.0, 1.0, 0.0])[None])
    assert abduction[0] == pytest.approx(a, abs=1e-9)
    assert flexion[0] == pytest.approx(f, abs=1e-9)


@given(st.floats(-0.3, 0.3), st.floats(-1.0, 2.4))
def test_flexion_goes_on_past_a_right_angle(a, f):
    d = Rotation.from_euler("ZX", [a, -f]).apply([0.0, 1.0, 0.0])[None]
    abduction, flexion = _knuckle(d)
    assert abs(abduction[0]) <= abs(a) + 1e-9
    assert flexion[0] == pytest.approx(f, abs=0.06)


def skeleton(side, rotations, order="ZXY", frames=2):
    """A minimal hand whose finger bones turn by the given rotations (bone -> Rotation); other bones stay."""
    sign = 1 if side == "Left" else -1
    lines, values, orders = ["HIERARCHY", "ROOT Hand", "{", "OFFSET 0 0 0", "CHANNELS 0"], [], []
    for bone in ("Thumb", "Index", "Middle", "Ring", "Pinky"):
        for k in (1, 2, 3):
            channels = " ".join(f"{axis}rotation" for axis in order)
            lines += [f"JOINT {side}Hand{bone}{k}", "{", f"OFFSET {sign * 3} 0 0", f"CHANNELS 3 {channels}"]
            turn = rotations.get(f"{bone}{k}", Rotation.identity())
            values += turn.as_euler(order, degrees=True).tolist()
            orders.append(order)
        lines += ["End Site", "{", f"OFFSET {sign * 2} 0 0", "}", "}", "}", "}"]
    lines += ["}", "MOTION", f"Frames: {frames}", "Frame Time: 0.01"]
    zero = " ".join(["0"] * len(values))
    return "\n".join([*lines, zero, *[" ".join(repr(v) for v in values)] * (frames - 1)]) + "\n"


@pytest.mark.parametrize("order", ["YXZ", "XYZ", "ZXY"])
def test_left_and_right_hands_read_alike_in_any_rotation_order(tmp_path, order):
    flex, spread = 0.8, 0.2
    for side, sign in (("Left", 1), ("Right", -1)):
        # Flexion: the distal axis (left +X, right -X) toward -Y. Toward the thumb: toward +Z.
        about_z, about_y = -sign * flex, -sign * spread
        turns = {
            "Index1": Rotation.from_euler("YZ", [about_y, about_z]),
            "Index2": Rotation.from_euler("Z", about_z),
            "Thumb3": Rotation.from_euler("Y", sign * 0.5),  # across the palm
        }
        path = tmp_path / "hand.bvh"
        path.write_text(skeleton(side, turns, order))
        q = hand_angles(bvh.read(path), side)[1]
        expected = np.zeros(20)
        expected[[4, 5, 6, 3]] = spread, flex, flex, 0.5
        np.testing.assert_allclose(q, expected, atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("HIERARCHY", "HIERACHY", "line 1.*HIERARCHY"),
        ("CHANNELS 3 Zrotation", "CHANNELS 4 Zrotation", "CHANNELS"),
        ("Zrotation", "Wrotation", "channel 'Wrotation'"),
        ("OFFSET 3 0 0", "OFFSET 3 0", r"line 8.*Expected 3"),
        ("Frames: 2", "Frames: 3", "3 frames are said, and 2 lines follow"),
        ("Frames: 2", "Frames: many", "Frames"),
        ("Frame Time: 0.01", "Frame Time: 0", "frame time"),
        ("MOTION", "", "MOTION"),
    ],
)
def test_a_broken_file_is_refused_with_its_line(tmp_path, old, new, words):
    path = tmp_path / "hand.bvh"
    path.write_text(skeleton("Left", {"Index1": Rotation.from_euler("Z", -1)}).replace(old, new, 1))
    with pytest.raises(RecordingError, match=f"hand.bvh, line \\d+.*{words}|hand.bvh, {words}"):
        bvh.read(path)


def test_a_number_that_is_none_is_refused_with_its_line(tmp_path):
    lines = skeleton("Left", {"Index1": Rotation.from_euler("Z", -1)}).splitlines()
    path = tmp_path / "hand.bvh"
    for word in ("nan", "x"):
        path.write_text("\n".join([*lines[:-1], lines[-1].replace("0.0", word, 1)]))
        with pytest.raises(RecordingError, match=f"line {len(lines)}"):
            bvh.read(path)


def test_hands_without_fingers_or_without_motion_are_refused(tmp_path):
    path = tmp_path / "hand.bvh"
    path.write_text(skeleton("Left", {}).replace("LeftHandRing", "LeftHandFourth"))
    with pytest.raises(RecordingError, match="no finger bones"):
        load_wearer(path)
    with pytest.raises(RecordingError, match="no finger moves"):
        load_wearer(shared("data/axis_neuron_bvh/fullbody_xyz.bvh"))
