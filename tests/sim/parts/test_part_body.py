"""The part `body`: a person of the suit's skeleton, moved by springs; what it stands on, carries, and is pushed by."""

import json
from itertools import pairwise

import mujoco
import numpy as np
import pytest
from helpers.shared import shared
from pydantic import ValidationError

from srl.drivers.noitom.skeleton import Skeleton
from srl.runtime.contracts.errors import RecordingError, WiringError
from srl.sim.parts.body.model import _DE_LEVA, limb, segments
from srl.sim.parts.body.motion import Scripted
from srl.sim.world.cell import Cell, CellConfig

MS = 1_000_000
TURN = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])  # x left, y up, z forward into x forward, y left, z up


def cell(parts=None, floor=False, seed=1, **options) -> Cell:
    made = {"person": {"part": "body"} | options} | (parts or {})
    return Cell(CellConfig.model_validate({"floor": floor, "parts": made}), seed=seed)


def angles(a, b):
    """Degrees between quaternions (..., 4)."""
    return np.degrees(2 * np.arccos(np.clip(np.abs(np.sum(a * b, axis=-1)), 0, 1)))


def run(world, seconds, rate=100):
    """Measured poses (n, 59, 7) and wanted quaternions (n, 59, 4)."""
    person = world.parts["person"]
    poses, wanted = [], []
    for k in range(round(seconds * rate)):
        world.advance(round((k + 1) / rate * 1e9))
        poses.append(person.pose().copy())
        wanted.append(person.wanted(world.time * 1e-9)[1])
    return np.array(poses), np.array(wanted)


# -- the model


def test_a_limb_is_the_sheets_worked_example():
    upper_arm = limb(_DE_LEVA["male"]["upper_arm"], 75.0, np.array([0.3255, 0, 0]))
    assert upper_arm.mass == pytest.approx(2.0325)
    np.testing.assert_allclose(upper_arm.com, [0.187879, 0, 0], atol=1e-6)
    # In the T-pose: longitudinal about x, transverse about y, sagittal about z.
    np.testing.assert_allclose(upper_arm.inertia, [0.005375845, 0.015582499, 0.017491307], rtol=1e-6)


@pytest.mark.parametrize("kind", ["axis-neuron", "axis-studio"])
@pytest.mark.parametrize("sex", ["male", "female"])
@pytest.mark.parametrize("fingers", [False, True])
def test_the_masses_sum_up_and_every_inertia_is_possible(kind, sex, fingers):
    skeleton = Skeleton(kind)
    made = segments(skeleton, skeleton.offsets, 70.0, sex, fingers)
    assert sum(s.mass for s in made.values()) == pytest.approx(70.0, rel=5e-3)
    for segment in made.values():
        a, b, c = np.sort(segment.inertia)
        assert a > 0
        assert c <= a + b + 1e-12
    left = [n for i, n in enumerate(skeleton.names) if i in made and n.startswith("Left")]
    for name in left:
        one, other = (made[skeleton.names.index(n)] for n in (name, "Right" + name.removeprefix("Left")))
        np.testing.assert_allclose(one.com * [-1, 1, 1], other.com, atol=1e-12)
        np.testing.assert_allclose(one.inertia, other.inertia)
    assert cell(skeleton=kind, sex=sex, mass=70.0, fingers=fingers).model.body_mass.sum() == pytest.approx(70, rel=5e-3)


@pytest.mark.parametrize("kind", ["axis-neuron", "axis-studio"])
def test_the_t_pose_is_the_skeletons_turned_into_the_cell(kind):
    quarter = [np.sqrt(0.5), 0, 0, np.sqrt(0.5)]  # facing the cell's y
    world = cell(skeleton=kind, script="t-pose", at={"position": [1.0, 2.0, 0.5], "quaternion": quarter})
    run(world, 0.5)
    skeleton = Skeleton(kind)
    places = np.zeros((59, 3))
    for i, parent in enumerate(skeleton.parents):
        places[i] = skeleton.offsets[i] + (places[parent] if parent >= 0 else 0)
    about_z = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(
        world.truth_arrays["person_position"], places @ (about_z @ TURN).T + [1, 2, 0.5], atol=1e-4
    )


def test_the_drawn_lines_are_its_58_bones():
    signal = cell().truth[0]
    bones = {frozenset(pair) for line in signal.links for pair in pairwise(line)}
    parents = Skeleton("axis-neuron").parents
    assert bones == {frozenset((i, up)) for i, up in enumerate(parents) if up >= 0}
    assert sum(len(line) - 1 for line in signal.links) == 58
    assert (signal.shape, signal.unit, signal.visual, signal.labels[0]) == ((59, 3), "m", "points", "Hips")


# -- motion


@pytest.mark.slow
@pytest.mark.parametrize("script", ["still", "walk", "reach"])
def test_it_follows_its_script_closely_but_not_exactly(script):
    poses, wanted = run(cell(script=script), 5.0)
    off = angles(poses[:, :21, 3:], wanted[:, :21])
    assert 1e-5 < np.sqrt((off**2).mean()) < 1.0
    assert off.max() < 4.0


@pytest.mark.slow
def test_a_walk_goes_in_a_circle_with_feet_that_take_turns():
    world = cell(script="walk")
    heights = []
    for k in range(1000):
        world.advance((k + 1) * 10 * MS)
        heights.append(world.truth_arrays["person_position"][[3, 6], 2].copy())
    left, right = np.array(heights)[300:].T
    assert np.corrcoef(left, right)[0, 1] < 0
    assert min(np.ptp(left), np.ptp(right)) > 0.05
    hips = world.truth_arrays["person_position"][0]
    assert np.linalg.norm(hips[:2] - [0, 1.2]) == pytest.approx(1.2, abs=0.05)
    assert np.linalg.norm(hips[:2]) > 0.3


def test_scripts_depend_on_seed_and_time_alone():
    skeleton = Skeleton("axis-neuron")
    for script in ("still", "walk", "reach"):
        one, two, other = (Scripted(script, skeleton, 1.0, seed, "person") for seed in (3, 3, 4))
        times = np.random.default_rng(0).uniform(0, 30, 20)
        forward = [one.at(t)[1] for t in times]
        backward = [two.at(t)[1] for t in times[::-1]][::-1]
        np.testing.assert_array_equal(forward, backward)
        assert any((other.at(t)[1] != q).any() for t, q in zip(times, forward, strict=True))
        steps = [angles(one.at(t)[1], one.at(t + 1e-4)[1]).max() for t in np.linspace(0, 12, 600)]
        assert max(steps) < 0.1  # degrees in 0.1 ms: it never jumps


def test_a_run_goes_on_bit_for_bit_from_a_saved_state():
    world = cell(script="reach")
    world.advance(501 * MS)  # between two of its reference poses
    state = world.save()
    world.advance(900 * MS)
    first = world.save()
    world.restore(state)
    world.advance(900 * MS)
    np.testing.assert_array_equal(world.save(), first)


@pytest.mark.slow
def test_the_bandwidth_is_what_it_says():
    """How well joints follow decides how far they are off."""
    off = []
    for bandwidth in (3.0, 6.0, 12.0):
        poses, wanted = run(cell(script="reach", bandwidth=bandwidth), 4.0)
        off.append(np.sqrt((angles(poses[:, :21, 3:], wanted[:, :21]) ** 2).mean()))
    assert off[0] > 2 * off[1] > 4 * off[2]


# -- recordings

WITHIN = {"fullbody_walk_yxz": (2.0, 0.02), "fullbody_xyz": (1.0, 0.005), "left_arm_fingers_yxz": (0.6, 0.001)}


@pytest.mark.parametrize("name", WITHIN)
def test_it_follows_recordings_of_real_people(name):
    world = cell(recording=str(shared(f"data/axis_neuron_bvh/{name}.bvh")), fingers=True)
    person = world.parts["person"]
    poses, wanted = run(world, min(person.duration, 5.0))
    degrees, metres = WITHIN[name]
    assert np.sqrt((angles(poses[:, :, 3:], wanted) ** 2).mean()) < degrees
    hips = [person.wanted((k + 1) * 0.01)[0] for k in range(len(poses))]
    assert np.sqrt(((poses[:, 0, :3] - hips) ** 2).sum(axis=1).mean()) < metres


def test_a_recordings_bones_and_poses_are_where_an_independent_reader_puts_them():
    """The arm kit's file doesn't stretch its bones, so a rigid chain must meet the reference exactly."""
    frames = json.loads(shared("data/axis_neuron_bvh/reference_fk.json").read_text())["left_arm_fingers_yxz.bvh"]
    world = cell(recording=str(shared("data/axis_neuron_bvh/left_arm_fingers_yxz.bvh")), fingers=True)
    person = world.parts["person"]
    for frame, places in frames.items():
        hips, rotations = person.wanted(int(frame) * 0.008)
        world.data.qpos[person._hips] = np.concatenate(person._to_world(hips, rotations[0]))
        world.data.qpos[person._balls] = rotations[1:]
        mujoco.mj_kinematics(world.model, world.data)
        for joint, place in places.items():
            if not joint.endswith("_End"):
                found = world.data.body(f"person/{joint}").xpos
                np.testing.assert_allclose(found, TURN @ np.array(place) / 100, atol=2e-6, err_msg=joint)


def test_the_last_pose_is_held_or_the_recording_goes_back():
    path = str(shared("data/axis_neuron_bvh/fullbody_walk_yxz.bvh"))
    person = cell(recording=path).parts["person"]
    end = person.wanted(person.duration)
    np.testing.assert_array_equal(person.wanted(person.duration + 5.0)[1], end[1])
    back = cell(recording=path, loop=True).parts["person"]
    np.testing.assert_allclose(back.wanted(back.duration + 0.3)[1], back.wanted(back.duration - 0.3)[1], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(back.wanted(1.2345)[1], axis=1), 1.0)


def test_fingers_stay_as_they_are_at_the_start_unless_they_are_to_move():
    path = str(shared("data/axis_neuron_bvh/left_arm_fingers_yxz.bvh"))
    finger = Skeleton("axis-neuron").names.index("LeftHandIndex2")
    rigid, _ = run(cell(recording=path), 3.0, rate=20)
    assert angles(rigid[:, finger, 3:], rigid[0, finger, 3:]).max() == 0.0
    assert angles(rigid[0, finger, 3:], np.array([1.0, 0, 0, 0])) > 1
    moving, _ = run(cell(recording=path, fingers=True), 3.0, rate=20)
    assert angles(moving[:, finger, 3:], moving[0, finger, 3:]).max() > 5


# -- what it carries, and what pushes it

LOAD = {
    "part": "box",
    "at": {"parent": "person/Spine", "position": [0, 0, -0.25]},
    "size": [0.1, 0.1, 0.1],
    "mass": 5.0,
}


def test_a_load_on_its_back_pulls_it_over_a_little():
    world = cell({"load": LOAD}, script="t-pose")
    poses, wanted = run(world, 2.0)
    leaning = angles(poses[-1, 7, 3:], wanted[-1, 7])
    assert 0.01 < leaning < 3.0
    assert world.truth_arrays["load_pose"][0] == pytest.approx(-0.25, abs=0.02)


def pushed(**options):
    wall = {"part": "box", "size": [0.05, 2.0, 0.4], "at": {"position": [0.25, 0.0, 1.3]}, "mass": 1.0}
    world = cell({"wall": wall}, script="reach", **options)
    poses, wanted = run(world, 5.0)
    return angles(poses[:, :21, 3:], wanted[:, :21]).max(), np.abs(poses[:, :, :3]).max()


@pytest.mark.slow
def test_a_wall_holds_a_reaching_arm_back_only_where_contact_is_asked_for():
    assert pushed()[0] < 5.0
    off, farthest = pushed(contact=True)
    assert off > 10.0
    assert farthest < 5.0


# -- what it refuses


def test_it_cant_be_mounted_on_something():
    with pytest.raises(WiringError, match=r"sim\.parts\.person\.at: 'person' moves freely"):
        cell({"box": {"part": "box", "size": [1, 1, 1]}}, at="box/body")


def test_a_recording_of_something_else_is_refused(tmp_path):
    path = shared("data/axis_neuron_bvh/fullbody_walk_yxz.bvh")
    with pytest.raises(RecordingError, match=r"no joint 'Neck1'"):
        cell(recording=str(path), skeleton="axis-studio")
    channels = "CHANNELS 3 Xrotation Yrotation Zrotation"
    hips = f"HIERARCHY\nROOT Hips\n{{\nOFFSET 0 0 0\n{channels}\nEnd Site\n{{\nOFFSET 0 1 0\n}}\n}}\n"
    other = tmp_path / "other.bvh"
    other.write_text(hips + "MOTION\nFrames: 2\nFrame Time: 0.01\n0 0 0\n0 0 0\n")
    with pytest.raises(RecordingError, match=r"58 missing"):
        cell(recording=str(other))
    twice = tmp_path / "twice.bvh"
    twice.write_text(path.read_text().replace("Zrotation", "Xrotation", 1))
    with pytest.raises(RecordingError, match="each once"):
        cell(recording=str(twice))
    with pytest.raises(RecordingError, match="can't be read"):
        cell(recording=str(tmp_path / "none.bvh"))


def test_options_are_checked():
    with pytest.raises(ValidationError):
        cell(bandwidth=100.0)
    with pytest.raises(ValidationError):
        cell(script="dance")
