"""The mobile base of the cell."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from helpers.sim import MS

from srl.runtime.models.robots import SUMMIT_XL
from srl.sim.parts.robots.arm import ArmPart
from srl.sim.parts.robots.summit_xl import SummitXlPart
from srl.sim.world.cell import Cell, CellConfig


def cell(**parts: dict[str, Any]) -> Cell:
    return Cell(CellConfig.model_validate({"parts": parts}), 1)


def base(world: Cell) -> SummitXlPart:
    return cast(SummitXlPart, world.parts["base"])


def run(world: Cell, seconds: float) -> None:
    for _ in range(round(seconds * 100)):
        world.advance(world.time + 10 * MS)


@pytest.mark.parametrize("twist", [(0.5, 0, 0), (0, 0.4, 0), (0, 0, 0.6), (-0.3, 0.2, -0.5)])
def test_it_follows_its_twist(twist: tuple[float, float, float]) -> None:
    world = cell(base={"part": "summit-xl", "slip": 0.0})
    part = base(world)
    part.command(*twist)
    run(world, 2.0)
    np.testing.assert_allclose(part.twist(), twist, atol=2e-3)
    np.testing.assert_allclose(part.wheels(), SUMMIT_XL.wheels(*twist), atol=1e-6)
    np.testing.assert_allclose(part.odometry()[1], twist, atol=1e-6)
    part.command(0, 0, 0)
    run(world, 2.0)
    np.testing.assert_allclose(part.twist(), 0.0, atol=1e-6)
    still = part.pose()
    run(world, 1.0)
    np.testing.assert_allclose(part.pose(), still, atol=1e-9)


def test_the_twist_is_in_its_own_frame() -> None:
    world = cell(base={"part": "summit-xl", "slip": 0.0})
    part = base(world)
    part.command(0, 0, 0.5)
    run(world, np.pi)  # 90 degrees, but for the lag
    part.command(0, 0, 0)
    run(world, 1.0)
    before = part.pose()
    assert before[2] == pytest.approx(np.pi / 2, abs=0.05)
    part.command(0.5, 0, 0)
    run(world, 2.0)
    way = part.pose() - before
    np.testing.assert_allclose(way[:2] / np.hypot(*way[:2]), [np.cos(before[2]), np.sin(before[2])], atol=1e-3)


def test_a_step_is_answered_late_and_gradually() -> None:
    world = cell(base={"part": "summit-xl", "latency": 0.02, "acceleration": 3.0})
    part = base(world)
    part.command(1.0, 0, 0)
    world.advance(20 * MS)
    assert part.twist()[0] == 0.0
    world.advance(120 * MS)
    assert 0.15 < part.twist()[0] < 0.31  # at most 3 m/s^2 for 0.1 s
    world.advance(1000 * MS)
    assert part.twist()[0] == pytest.approx(0.97, abs=0.01)  # 3 % are lost in slip


def test_a_stream_of_commands_is_only_delayed() -> None:
    world = cell(base={"part": "summit-xl", "latency": 0.1, "slip": 0.0})
    part = base(world)
    for _ in range(1000):
        part.command(0.9, 0, 0)
        part.command(0.5, 0, 0)  # of two at once the later counts
        world.advance(world.time + MS)
    assert part.twist()[0] == pytest.approx(0.5, abs=0.01)


def test_odometry_does_not_see_slip() -> None:
    world = cell(base={"part": "summit-xl", "slip": 0.04})
    part = base(world)
    part.command(0.5, 0.0, 0.1)
    run(world, 10.0)
    pose, _ = part.odometry()
    assert part.pose()[2] == pytest.approx(0.96 * pose[2], rel=2e-3)
    assert 0.1 < np.linalg.norm(pose[:2] - part.pose()[:2]) < 0.5


def test_wheels_have_a_greatest_speed() -> None:
    world = cell(base={"part": "summit-xl", "slip": 0.0})
    part = base(world)
    part.command(3.0, 3.0, 0.0)
    run(world, 5.0)
    assert np.abs(part.wheels()).max() == pytest.approx(SUMMIT_XL.wheel_speed)
    np.testing.assert_allclose(part.twist(), [1.5, 1.5, 0.0], atol=0.01)


def test_friction_limits_what_the_wheels_can_do() -> None:
    world = cell(base={"part": "summit-xl", "slip": 0.0, "acceleration": 50.0, "friction": 0.1, "time_constant": 0.01})
    part = base(world)
    part.command(2.0, 0, 0)
    run(world, 0.5)
    # Four rollers at 45 degrees carry mu m g / sqrt(2) along x.
    assert part.twist()[0] == pytest.approx(0.1 * 9.81 / 2**0.5 * 0.48, rel=0.05)


def test_it_resists_a_push_but_not_any_push() -> None:
    world = cell(base={"part": "summit-xl"})
    part = base(world)
    body = world.model.body("base/base").id
    world.data.xfrc_applied[body, 0] = 100.0
    run(world, 1.0)
    assert abs(part.pose()[0]) < 0.01
    world.data.xfrc_applied[body, 0] = 2000.0  # more than friction carries
    run(world, 1.0)
    assert part.pose()[0] > 1.0


def test_an_arm_on_the_deck_rides_along() -> None:
    arm = {"part": "panda", "at": {"parent": "base/deck", "position": (0.2, 0, 0.02)}}
    world = cell(base={"part": "summit-xl", "at": {"position": (1.0, 2.0, 0.0)}, "slip": 0.0}, arm=arm)
    part, robot = base(world), cast(ArmPart, world.parts["arm"])
    np.testing.assert_allclose(world.data.body("arm/base").xpos, [1.2, 2.0, 0.529], atol=1e-9)
    robot.command("position", robot.home)
    part.command(0.5, 0, 0.3)
    run(world, 2.0)
    np.testing.assert_allclose(robot.position, robot.home, atol=0.02)
    np.testing.assert_allclose(robot.flange()[1], robot.robot.forward(robot.position)[:3, 3], atol=1e-9)
    x, y, yaw = part.pose()
    expected = [1.0 + x + 0.2 * np.cos(yaw), 2.0 + y + 0.2 * np.sin(yaw), 0.529]
    np.testing.assert_allclose(world.data.body("arm/base").xpos, expected, atol=1e-9)


def test_it_stops_at_a_wall() -> None:
    wall = {"part": "box", "size": (0.2, 2.0, 1.0), "at": {"position": (1.0, 0, 0.5)}}
    ball = {
        "part": "box",
        "shape": "sphere",
        "size": (0.2,),
        "mass": 2.0,
        "free": True,
        "at": {"position": (0.6, 0, 0.1)},
    }
    world = Cell(
        CellConfig.model_validate(
            {"floor": True, "parts": {"base": {"part": "summit-xl"}, "ball": ball, "wall": wall}}
        ),
        1,
    )
    part = base(world)
    part.command(0.5, 0, 0)
    run(world, 4.0)
    assert world.truth_arrays["ball_contact_force"] is not None
    assert part.pose()[0] < 0.55


def test_saved_world_goes_on_bit_for_bit() -> None:
    worlds = [cell(base={"part": "summit-xl"}) for _ in range(2)]
    base(worlds[0]).command(0.3, 0.1, 0.2)
    run(worlds[0], 0.5)
    base(worlds[0]).command(0.0, 0.1, -0.2)
    worlds[1].restore(worlds[0].save())
    for world in worlds:
        run(world, 0.5)
    assert np.array_equal(worlds[0].save(), worlds[1].save())
