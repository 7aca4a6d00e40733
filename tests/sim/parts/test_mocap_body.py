"""The part `mocap-body`: it moves as it is told, as physics, and comes back to every bit."""

import mujoco
import numpy as np
import pytest
from helpers.shared import shared
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from srl.runtime.contracts.errors import RecordingError, WiringError
from srl.sim.parts.body.mocap_motion import MotionConfig, make_motion, read
from srl.sim.world.cell import Cell, CellConfig

MS = 1_000_000


def cell(**parts) -> Cell:
    made = {name: {"part": "mocap-body"} | options for name, options in parts.items()}
    return Cell(CellConfig.model_validate({"parts": made}), seed=1)


def follow(world: Cell, seconds: float, name="wand"):
    """Truth and target poses, 100 a second."""
    rows, targets = [], []
    for _ in range(round(seconds * 100)):
        world.advance(world.time + 10 * MS)
        rows.append(world.truth_arrays[f"{name}_pose"].copy())
        targets.append(world.parts[name].target(world.time * 1e-9))
    return np.array(rows), np.array(targets)


def test_still_stays_where_it_was_put_against_gravity():
    world = cell(wand={"at": {"position": [0.4, -0.2, 1.1], "quaternion": [2.0, 0.0, 0.0, 2.0]}})
    rows, _ = follow(world, 1.0)
    half = np.sqrt(0.5)
    np.testing.assert_allclose(rows, np.tile([0.4, -0.2, 1.1, half, 0, 0, half], (100, 1)), atol=1e-6)
    np.testing.assert_allclose(world.truth_arrays["wand_markers"][1], [0.4, -0.14, 1.1], atol=1e-6)  # M2


@pytest.mark.parametrize("kind", ["circle", "sine"])
def test_it_follows_its_motion_closely_but_not_exactly(kind):
    world = cell(wand={"at": {"position": [0.0, 0.0, 1.0]}, "motion": {"kind": kind}})
    rows, targets = follow(world, 5.0)
    off = np.linalg.norm(rows[:, :3] - targets[:, :3], axis=1)
    assert 1e-5 < off[100:].mean() < off.max() < 0.03  # it has mass, and the weld gives
    turned = Rotation.from_quat(rows[:, [4, 5, 6, 3]]).inv() * Rotation.from_quat(targets[:, [4, 5, 6, 3]])
    assert turned.magnitude().max() < 0.1
    assert np.ptp(rows[:, :3], axis=0).max() > 0.15
    if kind == "sine":
        assert (np.ptp(np.delete(rows, 3, axis=1), axis=0) > 0.05).all()


def test_the_circle_is_one():
    motion = make_motion(MotionConfig(kind="circle", radius=0.2, period=3.0))
    points = np.array([motion.at(t)[:3] for t in np.linspace(0, 3, 50)])
    np.testing.assert_allclose(np.linalg.norm(points - [-0.2, 0, 0], axis=1), 0.2)
    np.testing.assert_allclose(points[[0, -1]], 0.0, atol=1e-12)


def test_a_thing_in_its_way_holds_it_back():
    world = Cell(
        CellConfig.model_validate(
            {
                "floor": True,
                "parts": {
                    "wand": {
                        "part": "mocap-body",
                        "at": {"position": [0, 0, 0.05]},
                        "motion": {
                            "kind": "sine",
                            "amplitude": {"x": 0, "y": 0, "z": 0.15, "rx": 0, "ry": 0, "rz": 0},
                            "period": 1.3,
                        },
                    }
                },
            }
        ),
        seed=1,
    )
    rows, targets = follow(world, 2.0)
    assert targets[:, 2].min() < -0.05
    assert rows[:, 2].min() > -0.02


def test_a_saved_world_goes_on_bit_for_bit():
    other = {"at": {"position": [1, 0, 0]}, "motion": {"kind": "circle"}}
    parts = {"wand": {"motion": {"kind": "sine"}}, "other": other}
    world = cell(**parts)
    follow(world, 0.5)
    state = world.save()
    first, _ = follow(world, 0.5)
    again = cell(**parts)
    again.restore(state)
    second, _ = follow(again, 0.5)
    np.testing.assert_array_equal(first, second)


def test_all_names_are_its_own():
    world = cell(wand={})
    for kind in (
        mujoco.mjtObj.mjOBJ_BODY,
        mujoco.mjtObj.mjOBJ_SITE,
        mujoco.mjtObj.mjOBJ_JOINT,
        mujoco.mjtObj.mjOBJ_GEOM,
    ):
        count = {
            mujoco.mjtObj.mjOBJ_BODY: world.model.nbody,
            mujoco.mjtObj.mjOBJ_SITE: world.model.nsite,
            mujoco.mjtObj.mjOBJ_JOINT: world.model.njnt,
            mujoco.mjtObj.mjOBJ_GEOM: world.model.ngeom,
        }[kind]
        names = [mujoco.mj_id2name(world.model, kind, i) for i in range(count)]
        assert all(name == "world" or name.startswith("wand/") for name in names)


def test_it_can_t_be_mounted():
    with pytest.raises(WiringError, match=r"sim\.parts\.b\.at: 'b' moves freely"):
        cell(a={}, b={"at": "a/body"})


# -- recordings


def written(tmp_path, text):
    path = tmp_path / "motion.csv"
    path.write_text(text)
    return path


def test_a_recording_is_played_forth_and_back_from_the_base(tmp_path):
    path = written(tmp_path, "time,x,y,z,qw,qx,qy,qz\n0,1,0,0,1,0,0,0\n1,1.2,0,0,1,0,0,0\n2,1.5,0,0,0.8,0,0,0.6\n")
    motion = make_motion(MotionConfig(kind="recording", file=path))
    np.testing.assert_allclose(motion.at(0.0), [0, 0, 0, 1, 0, 0, 0])
    np.testing.assert_allclose(motion.at(1.0), [0.2, 0, 0, 1, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(motion.at(2.0), [0.5, 0, 0, 0.8, 0, 0, 0.6], atol=1e-12)
    np.testing.assert_allclose(motion.at(3.0), motion.at(1.0))
    np.testing.assert_allclose(motion.at(4.25), motion.at(0.25))
    for t in np.linspace(0, 4, 41):
        assert np.linalg.norm(motion.at(t)[3:]) == pytest.approx(1.0)


def test_both_signs_of_a_quaternion_are_one_orientation(tmp_path):
    path = written(tmp_path, "x,y,z,q0,q1,q2,q3\n0,0,0,0,0,0,1\n0,0,0,0,0,0,-1\n0,0,0,0,0,0.1,-0.995\n")
    motion = make_motion(MotionConfig(kind="recording", file=path, rate=10))
    for t in np.linspace(0, 0.1, 11):
        np.testing.assert_allclose(motion.at(t)[3:], [1, 0, 0, 0], atol=1e-9)


def test_a_recorded_hand_is_followed():
    path = shared("data/handover_mocap_wrench/giver_RHand_pose_saved.csv")
    time, poses = read(path, 120.0)
    assert time[-1] == pytest.approx(800 / 120)
    world = cell(wand={"motion": {"kind": "recording", "file": str(path), "rate": 120}})
    rows, _ = follow(world, 6.0)
    recorded = poses[(np.arange(1, 601) * 1.2).astype(int), :3] - poses[0, :3]
    # Half a metre in half a second, through a weld of 20 ms.
    assert np.linalg.norm(rows[:, :3] - recorded, axis=1).max() < 0.06
    np.testing.assert_allclose(np.ptp(rows[:, :3], axis=0), np.ptp(recorded, axis=0), atol=0.02)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y,z\n1,2,3\n1,2,3\n", "its columns are x, y, z"),
        ("x,y,z,qw,qx,qy,qz\n0,0,0,1,0,0,0\n", "needs two at least"),
        ("x,y,z,qw,qx,qy,qz\n0,0,0,1,0,0,0\n0,0,0,nan,0,0,0\n", "line 3, column 'qw'"),
        ("x,y,z,qw,qx,qy,qz\n0,0,0,1,0,0,0\n0,0,0,3,0,0,0\n", "line 3.*no unit quaternion"),
        ("x,y,z,qw,qx,qy,qz\n0,0,0,1,0,0,no\n", "no table of numbers|isn't a table"),
        ("time,x,y,z,qw,qx,qy,qz\n1,0,0,0,1,0,0,0\n0,0,0,0,1,0,0,0\n", "doesn't come after"),
        ("", "its columns are"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*no data")
def test_a_recording_that_can_t_be_played_says_where(tmp_path, text, message):
    with pytest.raises(RecordingError, match=message):
        read(written(tmp_path, text), 100.0)


def test_a_recording_that_isn_t_there(tmp_path):
    with pytest.raises(RecordingError, match="can't be read"):
        read(tmp_path / "none.csv", 100.0)
    with pytest.raises(ValidationError, match="needs 'file'"):
        MotionConfig(kind="recording")
