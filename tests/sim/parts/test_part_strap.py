"""The cell's parts `strap` and `imu`: springs that give way by what they say, and what a sensor on them feels."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from srl.sim.parts.body.strap import STIFFNESS, StrapPart
from srl.sim.parts.things.imu import ImuPart
from srl.sim.world.cell import Cell, CellConfig

G = 9.81
LOAD, LEVER = 2.0, 0.2  # kg, m


def cell(load: float = LOAD, lever: float = LEVER, **options: Any) -> Cell:
    """A strap in the world with a weight in front of it, and a sensor on its plate."""
    parts = {
        "strap": {"part": "strap", "at": {"position": [0, 0, 1]}, "mass": 0.01} | options,
        "weight": {
            "part": "dynamixel-chain",
            "at": {"parent": "strap/plate", "position": [lever, 0, 0]},
            "axes": {"one": {"model": "MX-28", "link": [0, 0, 0], "mass": load}},
        },
        "imu": {"part": "imu", "at": {"parent": "strap/plate", "rpy": [0.3, 0.0, 0.0]}},
    }
    return Cell(CellConfig.model_validate({"parts": parts}), seed=1)


def settled(world: Cell, seconds: float = 4.0) -> tuple[np.ndarray, np.ndarray]:
    world.advance(round(seconds * 1e9))
    return world.truth_arrays["strap_shift"].copy(), world.truth_arrays["strap_tilt"].copy()


@pytest.mark.slow
@pytest.mark.parametrize("firmness", ["soft", "medium", "hard"])
def test_a_weight_makes_it_give_way_by_its_stiffness(firmness):
    world = cell(firmness=firmness)
    masses = world.model.body_mass
    total = float(masses.sum())
    moment = G * float((masses * world.data.xipos[:, 0]).sum())
    shift, tilt = settled(world)
    along, about = STIFFNESS[firmness]
    np.testing.assert_allclose(shift, [0, 0, -total * G / along], atol=1e-4 + 0.02 * total * G / along)
    # The lever grows shorter as it tilts.
    assert tilt[1] == pytest.approx(moment * np.cos(tilt[1]) / about, rel=0.02)
    assert abs(tilt[0]) < 0.02 * tilt[1]


@pytest.mark.slow
def test_own_stiffnesses_replace_those_of_the_firmness():
    stiff = settled(cell(firmness="soft", rotation=3000.0, translation=1e5))
    assert np.linalg.norm(stiff[0]) < 3e-4
    assert np.linalg.norm(stiff[1]) < 2e-3


def test_a_rigid_one_is_a_weld():
    world = cell(firmness="rigid")
    shift, tilt = settled(world, 1.0)
    np.testing.assert_allclose([shift, tilt], 0, atol=1e-12)
    assert world.model.nv == 1


@pytest.mark.slow
def test_a_load_that_lets_go_swings_and_comes_to_rest():
    world = cell(firmness="soft")
    rest = settled(world)[1]
    world.data.qvel[3:6] = [0.0, 1.0, 0.0]
    before = world.data.time
    seen = []
    for _ in range(300):
        world.advance(world.time + 10_000_000)
        seen.append(world.truth_arrays["strap_tilt"][1])
    assert world.data.time > before
    assert np.ptp(seen[:50]) > 0.05
    assert np.ptp(seen[-50:]) < 1e-3
    assert seen[-1] == pytest.approx(rest[1], abs=1e-3)


@pytest.mark.slow
def test_where_a_rigid_one_would_be_goes_with_the_body_that_wears_it():
    parts = {
        "wearer": {"part": "body", "script": "walk"},
        "strap": {"part": "strap", "at": {"parent": "wearer/Spine", "position": [0, 0, 0.1]}},
    }
    world = Cell(CellConfig.model_validate({"parts": parts}), seed=1)
    world.advance(3_000_000_000)
    strap = world.part(StrapPart, "strap")
    spine, pose = world.data.body("wearer/Spine"), strap.rigid()
    w, x, y, z = spine.xquat
    np.testing.assert_allclose(pose[:3], spine.xpos + Rotation.from_quat([x, y, z, w]).apply([0, 0, 0.1]), atol=1e-9)
    shift, tilt = world.truth_arrays["strap_shift"], world.truth_arrays["strap_tilt"]
    plate = world.data.body("strap/plate")
    turn = Rotation.from_quat(pose[[4, 5, 6, 3]])
    np.testing.assert_allclose(pose[:3] + turn.apply(shift), plate.xpos, atol=1e-9)
    w, x, y, z = plate.xquat
    assert ((turn * Rotation.from_rotvec(tilt)).inv() * Rotation.from_quat([x, y, z, w])).magnitude() < 1e-9


@pytest.mark.slow
def test_a_sensor_on_it_turns_with_it_and_feels_what_holds_it():
    world = cell()
    tilt = settled(world)[1]
    imu = world.part(ImuPart, "imu")
    w, x, y, z, *force = imu.measured()
    found = Rotation.from_quat([x, y, z, w])
    assert ((Rotation.from_rotvec(tilt) * Rotation.from_rotvec([0.3, 0, 0])).inv() * found).magnitude() < 1e-6
    np.testing.assert_allclose(found.apply(force), [0, 0, G], atol=0.02)
    np.testing.assert_allclose(world.truth_arrays["imu_orientation"], [w, x, y, z])


def test_a_saved_world_goes_on_bit_for_bit():
    world = cell()
    world.advance(300_000_000)
    state = world.save()
    world.advance(600_000_000)
    first = [settled(world, 0.7), world.part(ImuPart, "imu").measured()]
    world.restore(state)
    world.advance(600_000_000)
    second = [settled(world, 0.7), world.part(ImuPart, "imu").measured()]
    np.testing.assert_array_equal(np.concatenate([*first[0], first[1]]), np.concatenate([*second[0], second[1]]))


@pytest.mark.slow
def test_a_strap_that_slips_rests_elsewhere_by_what_is_said():
    slip = {"at": 1.0, "lasts": 0.3, "shift": [0.0, 0.01, -0.05], "tilt": [0.0, 0.2, 0.1]}
    world = cell(load=0.01, lever=0.0, slip=slip, rotation=500.0, translation=1e4)
    before = settled(world, 1.0)
    assert np.abs(before[0]).max() < 1e-4
    after = settled(world, 3.0)
    np.testing.assert_allclose(after[0], slip["shift"], atol=5e-4)
    np.testing.assert_allclose(after[1], slip["tilt"], atol=2e-3)


def test_a_rigid_strap_cannot_slip():
    with pytest.raises(ValidationError, match="a rigid strap can't slip"):
        StrapPart.Config.model_validate({"firmness": "rigid", "slip": {"at": 1.0}})
