"""The load that is carried and what stands in the way: support, grasp and distances, against geometry by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.person import HEAVY, MS, Trolley, cell, put
from pydantic import ValidationError

from srl.runtime.contracts.errors import WiringError
from srl.sim.parts.robots.softhand import SoftHandPart
from srl.sim.parts.things.box import BoxPart
from srl.sim.parts.things.ft_sensor import FtSensorPart
from srl.sim.parts.things.load import LoadPart, ObstaclesConfig, ObstaclesPart


def carried() -> Any:
    """A trolley, hanging on it a sensor and a hand that points down, over the load's bar."""
    parts: Any = {
        "robot": (Trolley, HEAVY | {"at": {"position": [0, 0, 0.65]}}),
        "sensor": (
            FtSensorPart,
            {"at": {"parent": "robot/body", "position": [0, 0, -0.035], "quaternion": [0, 1, 0, 0]}},
        ),
        "hand": (SoftHandPart, {"at": "sensor/tool"}),
        "load": (LoadPart, {"at": {"position": [0.05, 0, 0.1]}, "gripper": "hand"}),
    }
    return cell(parts, floor=True)


@pytest.mark.slow
def test_a_load_is_picked_up_carried_and_put_down():
    world = carried()
    hand = world.parts["hand"]
    site = world.data.site("load/grasp").xpos
    hollow = world.data.body("hand/palm").xpos + world.data.body("hand/palm").xmat.reshape(3, 3) @ [0.045, 0, 0.085]
    put(world, *(site - hollow), 1.0)
    at = (site - hollow).copy()
    assert world.truth_arrays["load_support"][2] == pytest.approx(98.1, rel=0.01)
    assert world.truth_arrays["load_held"][0] == 0
    hand.command_position(1.8)
    put(world, *at, 2.0)
    assert world.truth_arrays["load_held"][0] == 1
    robot = world.parts["robot"]
    empty = world.truth_arrays["sensor_wrench"][2]
    robot.v[2] = 0.1
    world.advance(world.time + 1000 * MS)
    robot.v[:] = 0
    world.advance(world.time + 500 * MS)
    assert world.truth_arrays["load_pose"][2] == pytest.approx(0.2, abs=0.01)
    assert world.truth_arrays["load_support"] == pytest.approx(np.zeros(3))
    assert world.truth_arrays["sensor_wrench"][2] - empty == pytest.approx(98.1, rel=0.05)  # it hangs upside down
    kept = world.save()
    world.advance(world.time + 200 * MS)
    first = world.save()
    hand.command_position(0.0)
    world.advance(world.time + 2500 * MS)
    assert world.truth_arrays["load_held"][0] == 0
    assert world.truth_arrays["load_pose"][2] == pytest.approx(0.1, abs=0.01)
    world.restore(kept)
    world.advance(world.time + 200 * MS)
    np.testing.assert_array_equal(world.save(), first)
    assert world.truth_arrays["load_held"][0] == 1


def test_a_hand_that_closes_elsewhere_takes_nothing():
    world = carried()
    world.parts["hand"].command_position(1.8)
    put(world, 0.3, 0, 0.2, 2.0)
    assert world.truth_arrays["load_held"][0] == 0


def test_a_gripper_that_isnt_there_is_refused():
    with pytest.raises(WiringError, match="no hand 'claw'"):
        cell({"load": (LoadPart, {"gripper": "claw"})})
    with pytest.raises(WiringError, match=r"sim\.parts\.load\.at: 'load' moves freely"):
        cell({"robot": (Trolley, {}), "load": (LoadPart, {"at": "robot/body"})})


def test_distances_to_obstacles_are_those_of_the_geometry():
    boxes = [
        {"position": [1, 0, 0], "size": [0.2, 0.2, 0.2]},
        {"position": [0, 2, 0], "size": [1, 1, 1], "yaw": np.pi / 4},
    ]
    base = {"at": "robot/body", "size": [0.4, 0.4, 0.1], "mass": 1.0}
    obstacles = (ObstaclesPart, {"boxes": boxes, "watch": ["base/body"]})
    world = cell({"robot": (Trolley, HEAVY), "things": obstacles, "base": (BoxPart, base)}, gravity=(0.0, 0.0, 0.0))
    put(world, 0, 0, 0, 0.05)
    wanted = [0.7, 2 - np.sqrt(0.5) - 0.2]
    np.testing.assert_allclose(world.truth_arrays["things_distance"], wanted, atol=1e-5)
    put(world, 0.5, 0, 0, 0.05)
    assert world.truth_arrays["things_distance"][0] == pytest.approx(0.2, abs=1e-5)
    put(world, -9, 0, 0, 0.05)
    assert world.truth_arrays["things_distance"][0] == 5.0
    for _ in range(2):
        put(world, 0.705, 0, 0, 0.05)
        put(world, 0, 0, 0, 0.5)
    assert world.truth_arrays["things_touches"][0] == 2
    with pytest.raises(ValidationError):
        ObstaclesConfig.model_validate({"boxes": []})
    with pytest.raises(WiringError, match="no body is called 'base'"):
        cell({"things": (ObstaclesPart, {"boxes": boxes, "watch": ["base"]})})
