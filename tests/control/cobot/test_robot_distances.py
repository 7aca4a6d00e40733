"""Distances and their gradients against MuJoCo and finite differences; the law keeps them."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
from helpers.control import bound
from helpers.superman import MOUNT, Chain, KairosRig, MocaRig
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from srl.control.cobot.kairos_qp import KairosQp, KairosQpConfig
from srl.control.cobot.moca_qp import MocaQp, MocaQpConfig
from srl.control.cobot.robot_distances import DistancesConfig, RobotDistances
from srl.runtime.contracts import rotation
from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots import ARMS, PANDA, UR16E

ON_DECK = rotation.homogeneous(np.array(MOUNT))
FAST = np.full(10, 10.0)  # so that every pair counts
seeds = st.integers(0, 2**32 - 1)
WALL = {"size": (0.1, 3.0, 3.0), "position": (1.2, 0.0, 1.0)}
POST = {"radius": 0.05, "length": 1.0, "position": (0.9, 0.3, 0.5), "rpy": (0.2, 0.1, 0.0)}


def everything(robot: Any, **options: Any) -> RobotDistances:
    tool = {"end": (0.0, 0.0, 0.15), "radius": 0.06}
    found = {"tool": tool, "obstacles": {"wall": WALL, "post": POST}} | options
    return RobotDistances(robot, ON_DECK, DistancesConfig.model_validate(found))


def anywhere(robot: Any, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    limits = np.maximum(robot.q_lower, -np.pi), np.minimum(robot.q_upper, np.pi)
    return np.concatenate([rng.uniform(-0.4, 0.4, 2), rng.uniform(-3, 3, 1), rng.uniform(*limits)])


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(seeds, st.sampled_from(["panda", "ur16e"]))
def test_gradients_are_those_of_the_distances(seed: int, name: str) -> None:
    """By central differences, where neither side of the pair jumps to another point."""
    robot = ARMS[name]
    of = everything(robot)
    q = anywhere(robot, seed)
    here = of(q, FAST[: len(q)])
    step = 1e-6
    for i in range(len(q)):
        d = np.zeros(len(q))
        d[i] = step
        ahead, back = of(q + d, FAST[: len(q)]).distance, of(q - d, FAST[: len(q)]).distance
        slope = (ahead - back) / (2 * step)
        smooth = (np.abs(ahead + back - 2 * here.distance) < 1e-9) & (here.distance > 1e-3)
        np.testing.assert_allclose(here.gradient[smooth, i], slope[smooth], atol=2e-4)


@pytest.mark.parametrize("name", ["panda", "ur16e"])
def test_distances_are_mujocos(name: str) -> None:
    """The same capsules and box as MuJoCo geoms, placed by the description's own forward kinematics."""
    robot = ARMS[name]
    of = RobotDistances(robot, ON_DECK, DistancesConfig.model_validate({"obstacles": {"wall": WALL}}))
    shapes = [(joint.name, i, s) for i, joint in enumerate(robot.joints) for s in joint.shape]
    body = "".join(
        f'<body name="b{k}" mocap="true"><geom name="g{k}" type="capsule" size="{s.radius}" '
        f'fromto="{" ".join(map(str, (*s.start, *s.end)))}"/></body>'
        for k, (_, _, s) in enumerate(shapes)
    )
    wall = '<geom name="wall" type="box" size="0.05 1.5 1.5" pos="1.2 0 1"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{wall}{body}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    checked = 0
    for seed in range(20):
        q = anywhere(robot, seed)
        near = of(q, FAST[: len(q)])
        x, y, yaw = q[:3]
        c, s = np.cos(yaw), np.sin(yaw)
        place = np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1]]) @ ON_DECK
        frames = []
        for joint, angle in zip(robot.joints, q[3:], strict=True):
            turn = np.eye(4)
            turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
            place = place @ joint.placement @ turn
            frames.append(place)
        for k, (_, i, _) in enumerate(shapes):
            data.mocap_pos[k] = frames[i][:3, 3]
            mujoco.mju_mat2Quat(data.mocap_quat[k], frames[i][:3, :3].ravel())
        mujoco.mj_kinematics(model, data)
        for part in {name for name, _, _ in shapes}:
            pair = f"{part}/wall"
            if pair not in of.pairs:
                continue
            mine = min(d for d, p in zip(near.distance, of.pairs, strict=True) if p == pair)
            geoms = [k for k, (name, _, _) in enumerate(shapes) if name == part]
            theirs = min(mujoco.mj_geomDistance(model, data, k + 1, 0, 5.0, np.zeros(6)) for k in geoms)
            if theirs > 0.0:
                assert mine == pytest.approx(theirs, abs=1e-6)
                checked += 1
    assert checked > 20


def test_only_what_the_build_joins_is_left_out() -> None:
    assert everything(PANDA).left_out == ("joint5/joint7", "joint5/tool", "joint6/tool")
    assert "base/shoulder_pan" in everything(UR16E).left_out
    home = np.concatenate([np.zeros(3), UR16E.home])
    ours = RobotDistances(UR16E, ON_DECK, DistancesConfig())
    ours(home, np.zeros(9))
    assert ours.least > 0.03, ours.nearest


@pytest.mark.parametrize(
    "wrong",
    [
        {"obstacles": {"wall": {}}},
        {"obstacles": {"wall": {"size": (1, 1, 1), "radius": 1}}},
        {"obstacles": {"wall": {"size": (1, 1, 1), "length": 1}}},
        {"least": 0.0},
        {"wall": WALL},
    ],
)
def test_wrong_options_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        DistancesConfig.model_validate(wrong)


def test_an_obstacle_is_no_part_of_the_robot() -> None:
    with pytest.raises(OptionError, match="another name"):
        everything(UR16E, obstacles={"elbow": WALL})


START = (-0.280, -0.174, 1.072)
"""m, about where the tool is at home."""


def kept_off(
    aim: Array, obstacles: dict[str, Any], seconds: float, *, locomotion: bool = False
) -> tuple[KairosQp, Array]:
    """The tool is wished to `aim` (3,) m from its start, world axes; returns the law and the tool's places (k, 3)."""
    limits = {"distances": {"obstacles": obstacles, "tool": {"end": (0.0, 0.0, 0.15), "radius": 0.06}}}
    law = bound(KairosQp("kairos", KairosQpConfig(gain=(2.0,) * 6, limits=limits)), mount=MOUNT)
    law.applied = {"base_twist": np.zeros(3), "velocity": np.zeros(6)}
    rig = KairosRig()
    rig.chain = Chain(law, "ur16e")
    law.bind(law.input, law.output, law.applied, law.param, {"mount": np.array(MOUNT)})
    rig.chain.locked = True
    rig.chain.reset(rig.q, rig.qd, rig.base, rig.twist)
    law.input["desired_pose"][:] = law.input["pose"]
    law.input["desired_pose"][:3] += aim
    if locomotion:
        rig.chain.press("P")
        rig.step()
        rig.chain.press()
    ways = []
    for _ in range(int(seconds / rig.dt)):
        rig.step()
        ways.append(law.input["pose"][:3].copy())
    return law, np.array(ways)


@pytest.mark.slow
@pytest.mark.parametrize("aim", [(0.0, 0.0, -2.0), (0.8, 0.0, -0.6)])
def test_the_ground_and_the_robot_itself_are_not_run_into(aim: tuple[float, float, float]) -> None:
    law, _ = kept_off(np.array(aim), {}, 3.0)
    found = law.metrics()
    assert found["least_distance_m"] > 0.03 - 2e-3, found  # type: ignore[operator]
    assert found["solver_failures"] == 0


@pytest.mark.slow
def test_an_obstacle_is_approached_and_not_touched() -> None:
    """A wall 0.15 m before the hand, and a wish that lies behind it."""
    x, y, z = START
    wall = {"wall": {"size": (0.1, 3.0, 4.0), "position": (x - 0.4, y, z)}}
    law, way = kept_off(np.array([-1.0, 0.0, 0.0]), wall, 2.5)
    found = law.metrics()
    assert 0.03 - 2e-3 < found["least_distance_m"] < 0.04  # type: ignore[operator]
    assert str(found["nearest"]).endswith("/wall")
    assert found["solver_failures"] == 0
    assert way[-1, 0] < x - 0.1  # it came as near as it may


@pytest.mark.slow
def test_a_gap_that_is_too_small_from_the_start_opens_slowly() -> None:
    """The wall is where the hand is, as after odometry has drifted. Before, the tool leapt away at 1 m/s by itself."""
    x, y, z = START
    wall = {"wall": {"size": (0.1, 3.0, 4.0), "position": (x - 0.01, y, z)}}
    law, way = kept_off(np.zeros(3), wall, 0.6)
    speed = np.linalg.norm(np.diff(way, axis=0), axis=1) * 500
    assert str(law.metrics()["nearest"]).endswith("/wall")
    assert speed.max() < 0.15
    assert law.metrics()["solver_failures"] == 0


@pytest.mark.parametrize(("beside", "deep"), [(0.0, False), (0.15, True)])
def test_what_overlaps_deeply_stops_the_limb(beside: float, deep: bool) -> None:
    """The hand, 6 cm thick, stands so far in a wall beyond half of its own size."""
    x, y, z = START
    wall = {"wall": {"size": (0.4, 3.0, 4.0), "position": (x - 0.2 + beside, y, z)}}
    law, _ = kept_off(np.zeros(3), wall, 0.002)
    assert law.contact is deep


@pytest.mark.slow
def test_the_base_keeps_off_an_obstacle_too() -> None:
    """In locomotion the base follows the tool; a low step stands behind it."""
    step = {"step": {"size": (0.1, 3.0, 0.3), "position": (-0.55, 0.0, 0.15)}}
    law, _ = kept_off(np.array([-1.0, 0.0, 0.0]), step, 3.0, locomotion=True)
    found = law.metrics()
    assert 0.03 - 2e-3 < found["least_distance_m"] < 0.06  # type: ignore[operator]
    assert found["nearest"] == "base/step"


@pytest.mark.exhaustive
@pytest.mark.slow
def test_moca_keeps_off_a_wall_in_simulation() -> None:
    """Pulled by 15 N towards a wall that isn't there in the physics; the closed form goes on into it."""
    least = []
    wall = {"wall": {"size": (0.1, 4.0, 4.0), "position": (1.0, 0.0, 1.0)}}
    for distances in ({"obstacles": wall}, None):
        rig = MocaRig(parts={})
        law = bound(MocaQp("moca", MocaQpConfig(limits={"distances": distances})), mount=MOUNT)
        rig.chain = Chain(law, "panda")
        places = {t.name: np.array(MOUNT) for t in law.transforms}
        law.bind(law.input, law.output, law.applied, law.param, places)
        rig.chain.reset(*rig._measured())
        seen = RobotDistances(PANDA, ON_DECK, DistancesConfig.model_validate({"obstacles": wall}))
        rig.chain.press("A")
        for k in range(2000):
            w, x, y, z = rig.chain.tool.output["pose"][3:].tolist()
            rig.chain.wrench[:3] = rotation.turned(rotation.conjugate((w, x, y, z)), (15.0, 0.0, 0.0))
            rig.step()
            rig.chain.press()
            if k % 20 == 0:
                seen(np.concatenate([rig.base.pose(), rig.arm.position]), np.zeros(10))
        least.append(seen.least)
        assert law.metrics()["solver_failures"] == 0
    assert least[0] > 0.02
    assert least[1] < 0.0
