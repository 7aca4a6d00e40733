"""The simulated hand against the fact sheet's fingertips and a table of its own, which other code computed."""

import mujoco
import numpy as np
import pytest
from helpers.shared import shared
from helpers.sim import world
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation

from srl.runtime.models.human_hand import FINGERS, JOINTS, RANGES
from srl.runtime.models.models import HandModel

# The hand a second time, on purpose: positions of the fingers' first joints, m; then for each joint the length along x,
# and quarter turns about x to the next joint's axis.
BASES = {
    "thumb": (-0.037, 0.045, 0.0),
    "index": (-0.024, 0.073, 0.0),
    "middle": (-0.008, 0.073, 0.0),
    "ring": (0.008, 0.073, 0.0),
    "little": (0.024, 0.073, 0.0),
}
LINKS = {
    "thumb": ((0.0, -1), (0.025, 0), (0.015, 1), (0.010, 0)),
    "index": ((0.0, -1), (0.037, 0), (0.030, 0), (0.015, 0)),
    "middle": ((0.0, -1), (0.040, 0), (0.035, 0), (0.017, 0)),
    "ring": ((0.0, -1), (0.037, 0), (0.030, 0), (0.015, 0)),
    "little": ((0.0, -1), (0.027, 0), (0.025, 0), (0.010, 0)),
}


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("scale", [1.0, 0.8, 1.2])
def test_fingertips_are_where_a_second_table_has_them(side, scale):
    hand, rng = HandModel(side=side, length=scale * 0.189), np.random.default_rng(4)
    model = world(models={"hand": hand}).model
    for _ in range(10):
        q = RANGES[:, 0] + rng.uniform(size=20) * np.ptp(RANGES, axis=1)
        data = sites(model, hand=q)
        for finger, angles in zip(FINGERS, q.reshape(5, 4), strict=True):
            tip, turn = np.array(BASES[finger]), Rotation.from_euler("z", 90, degrees=True)
            for angle, (length, quarters) in zip(angles, LINKS[finger], strict=True):
                turn = turn * Rotation.from_euler("z", angle)
                tip = tip + turn.apply([length, 0.0, 0.0])
                turn = turn * Rotation.from_euler("x", 90 * quarters, degrees=True)
            expected = scale * tip * [1.0 if side == "right" else -1.0, 1.0, 1.0]
            np.testing.assert_allclose(data.site(f"hand/{finger}").xpos, expected, atol=1e-12)


@pytest.fixture(scope="module")
def facts():
    return YAML(typ="safe").load(shared("facts/human_hand.yaml"))


@pytest.fixture(scope="module")
def model():
    return world().model


def sites(model, hand=(0.0,) * 20, finger=(0.0,) * 4):
    data = mujoco.MjData(model)
    for names, values in ((JOINTS, hand), (("abduction", "flexion_1", "flexion_2", "flexion_3"), finger)):
        prefix = "hand" if names is JOINTS else "finger"
        for name, value in zip(names, values, strict=True):
            data.joint(f"{prefix}/{name}").qpos[0] = value
    mujoco.mj_kinematics(model, data)
    return data


@pytest.mark.parametrize("pose", ["zero", "flex30", "santello_mean", "abd10", "fist"])
def test_fingertips_are_where_the_sheet_has_them(facts, model, pose):
    reference = facts["reference"][pose]
    data = sites(model, hand=np.deg2rad(reference["q_deg"]))
    for finger in FINGERS:
        expected = np.array(reference["tips_mm"][finger]) / 1000
        np.testing.assert_allclose(data.site(f"hand/{finger}").xpos, expected, atol=1e-6)


@pytest.mark.parametrize("pose", ["zero", "flex30", "flex60", "abd20", "mix"])
def test_the_sixth_fingers_tip_is_where_the_sheet_has_it(facts, model, pose):
    reference = facts["sixth_finger"]["reference"][pose]
    data = sites(model, finger=np.deg2rad(reference["q_deg"]))
    np.testing.assert_allclose(data.site("finger/tip").xpos, np.array(reference["tip_mm"]) / 1000, atol=1e-6)


def test_ranges_and_masses_are_the_sheets(facts, model):
    ranges = np.deg2rad([row for finger in FINGERS for row in facts["joint_ranges_deg"]["recommended_20dof"][finger]])
    np.testing.assert_allclose(RANGES, ranges)
    np.testing.assert_allclose([model.joint(f"hand/{joint}").range for joint in JOINTS], ranges)
    finger = [model.body(i) for i in range(model.nbody) if model.body(i).name.startswith("finger/")]
    assert sum(body.mass[0] for body in finger) == pytest.approx(
        facts["sixth_finger"]["mass_g_estimate"]["total"] / 1e3
    )


def test_actuators_and_joints_are_in_the_documented_order(model):
    joints = [model.joint(i).name for i in range(model.njnt)]
    assert joints == [model.actuator(i).name for i in range(model.nu)]
    assert joints[:20] == [f"hand/{joint}" for joint in JOINTS]
    assert [model.site(i).name for i in range(model.nsite)] == [
        *(f"hand/{finger}" for finger in FINGERS),
        "finger/tip",
    ]
