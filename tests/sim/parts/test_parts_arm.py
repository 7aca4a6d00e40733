"""Arms of the cell: compensation, servos, brakes, and what they measure."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pinocchio as pin
import pytest
from helpers.sim import MS
from pydantic import ValidationError

from srl.runtime.contracts.errors import WiringError
from srl.runtime.models.robots import PANDA
from srl.runtime.models.robots.pinocchio_model import FLANGE, pinocchio_model
from srl.sim.parts.robots.arm import ArmPart
from srl.sim.world.cell import Cell, CellConfig

KINDS = ("panda", "ur16e")


def cell(seed: int = 1, **parts: dict[str, Any]) -> Cell:
    return Cell(CellConfig.model_validate({"parts": parts}), seed)


def arm(world: Cell, name: str = "arm") -> ArmPart:
    return cast(ArmPart, world.parts[name])


def run(world: Cell, seconds: float) -> None:
    """In periods of 1 ms, as a loop at 1 kHz does."""
    for _ in range(round(seconds * 1000)):
        world.advance(world.time + MS)


@pytest.mark.parametrize("kind", KINDS)
def test_gravity_compensation_holds_it_anywhere(kind: str) -> None:
    world = cell(arm={"part": kind})
    part = arm(world)
    rng = np.random.default_rng(3)
    for _ in range(5):
        world.data.qpos[:] = q = rng.uniform(0.8 * part.robot.q_lower, 0.8 * part.robot.q_upper)
        if kind == "panda":
            world.data.qpos[3] = q[3] = -1.5  # its range isn't about zero
        world.data.qvel[:] = 0.0
        part.command("torque", np.zeros(part.n))
        run(world, 0.3)
        np.testing.assert_allclose(part.position, q, atol=1e-9)
        np.testing.assert_allclose(part.effort, part.gravity(), atol=1e-9)


@pytest.mark.parametrize("friction", [0.0, 1.0])
def test_torque_moves_it_as_its_equations_say(friction: float) -> None:
    """With the rotors, and with and without the friction that was published."""
    world = cell(arm={"part": "panda", "friction": friction})
    part = arm(world)
    tau = np.array([4.0, -6.0, 2.0, 4.0, 1.0, -0.8, 0.5])
    part.command("torque", tau)
    model, law = pinocchio_model(PANDA, rotors=True), PANDA.sliding_friction
    assert law is not None
    data = model.createData()
    q, dq = part.position, part.velocity
    for _ in range(200):
        # Semi-implicit steps of the textbook's equation; the drives compensate gravity, not Coriolis forces.
        gravity = pin.computeGeneralizedGravity(model, data, q).copy()
        ddq = pin.aba(model, data, q, dq, tau + gravity - friction * law.torque(dq))
        dq = dq + 0.001 * ddq
        q = q + 0.001 * dq
        world.advance(world.time + MS)
    assert np.abs(q - PANDA.home).max() > 0.05
    np.testing.assert_allclose(part.position, q, atol=5e-4)


def test_an_untold_load_sags_and_a_told_one_does_not() -> None:
    load = {
        "part": "box",
        "at": {"parent": "arm/flange", "position": (0, 0, 0.05)},
        "size": (0.06, 0.06, 0.06),
        "mass": 2.0,
    }
    moved, felt, holding = [], [], []
    for reported in ({}, {"declared_payload": {"mass": 2.0, "com": (0, 0, 0.05)}}):
        world = cell(arm={"part": "panda", **reported}, load=load)
        part = arm(world)
        holding.append(part.gravity())
        felt.append(part.external_effort)
        part.command("torque", np.zeros(7))
        run(world, 0.2)
        moved.append(np.abs(part.position - PANDA.home).max())
    assert moved[0] > 0.05
    assert moved[1] < 1e-9
    # What it isn't told of counts as external; what it is told of is held.
    np.testing.assert_allclose(felt[0], holding[0] - holding[1], atol=1e-9)
    np.testing.assert_allclose(felt[1], 0.0, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_velocity_loop(kind: str) -> None:
    world = cell(arm={"part": kind})
    part = arm(world)
    target = np.linspace(-0.3, 0.4, part.n)
    part.command("velocity", target)
    run(world, 0.3)
    np.testing.assert_allclose(part.velocity, target, atol=5e-3)
    part.command("velocity", np.zeros(part.n))
    run(world, 0.3)
    held = part.position
    run(world, 0.5)
    np.testing.assert_allclose(part.position, held, atol=1e-3)


def test_a_commanded_step_of_velocity_is_not_echoed() -> None:
    world = cell(arm={"part": "ur16e"})
    part = arm(world)
    part.command("velocity", np.full(6, 2.0))
    world.advance(world.time + MS)
    assert np.all(part.velocity < 1.0)
    assert np.all(np.abs(part.effort) <= part.robot.tau_max + 1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_position_servo_goes_there_and_yields_as_a_spring(kind: str) -> None:
    world = cell(arm={"part": kind})
    part = arm(world)
    goal = part.home + 0.1
    part.command("position", goal)
    run(world, 1.5)
    np.testing.assert_allclose(part.position, goal, atol=1e-3)
    world.data.xfrc_applied[world.model.body("arm/flange").id, 2] = -30.0
    run(world, 1.5)
    sag = part.external_effort / part.robot.stiffness
    assert np.abs(sag).max() > 1e-4
    np.testing.assert_allclose(part.position, goal + sag, atol=0.1 * np.abs(sag).max())


def test_position_with_rates_follows_a_moving_target_closely() -> None:
    lag = []
    for forward in (False, True):
        world = cell(arm={"part": "panda"})
        part = arm(world)
        for k in range(1, 501):
            t = k * 0.001
            rate = np.full(7, 0.3) * min(1.0, t / 0.1)
            target = part.home + 0.3 * (t * t / 0.2 if t < 0.1 else t - 0.05)
            part.command("position", target, rate if forward else None)
            world.advance(world.time + MS)
        lag.append(np.abs(part.position - target).max())
    assert lag[1] < 0.002
    assert lag[0] > 3 * lag[1]


def test_brakes_stop_and_hold_even_an_untold_load() -> None:
    load = {
        "part": "box",
        "at": {"parent": "arm/flange", "position": (0, 0, 0.05)},
        "size": (0.06, 0.06, 0.06),
        "mass": 2.0,
    }
    world = cell(arm={"part": "panda"}, load=load)
    part = arm(world)
    part.command("velocity", np.full(7, 0.2))
    run(world, 0.2)
    part.command("brake")
    run(world, 0.5)
    held = part.position
    run(world, 1.0)
    np.testing.assert_allclose(part.position, held, atol=1e-4)
    np.testing.assert_allclose(part.velocity, 0.0, atol=1e-3)


def test_a_drive_saturates_at_its_limit() -> None:
    world = cell(arm={"part": "panda"})
    part = arm(world)
    part.command("torque", np.full(7, 500.0))
    world.advance(world.time + MS)
    np.testing.assert_allclose(part.effort, PANDA.tau_max)
    world = cell(
        arm={"part": "panda"}, wall={"part": "box", "size": (0.2, 0.6, 2.0), "at": {"position": (0.5, 0, 0.6)}}
    )
    part = arm(world)
    part.command("velocity", np.array([0, 0.3, 0, 0.3, 0, 0, 0.0]))
    run(world, 2.0)
    assert np.all(np.abs(part.effort) <= PANDA.tau_max + 1e-9)
    # Held up, the velocity loop's spring isn't wound up for ever: it comes back at once.
    part.command("velocity", np.array([0, -0.3, 0, -0.3, 0, 0, 0.0]))
    run(world, 0.3)
    assert part.velocity[1] < -0.25


def test_external_effort_is_what_a_force_at_the_flange_causes() -> None:
    world = cell(arm={"part": "panda"})
    part = arm(world)
    part.command("position", part.home)
    force, flange = np.array([5.0, -7.0, 9.0]), world.model.body("arm/flange").id
    world.data.xfrc_applied[flange, :3] = force
    run(world, 1.0)
    model = pinocchio_model(PANDA)
    jacobian = pin.computeFrameJacobian(
        model, model.createData(), part.position, model.getFrameId(FLANGE), pin.LOCAL_WORLD_ALIGNED
    )
    expected = jacobian[:3].T @ force
    np.testing.assert_allclose(part.external_effort, expected, atol=1e-6)
    np.testing.assert_allclose(part.effort, part.gravity() - expected, atol=1e-3)
    np.testing.assert_allclose(part.jacobian(), jacobian, atol=1e-9)


def test_a_contact_is_felt_as_external_effort() -> None:
    table = {"part": "box", "size": (0.6, 0.6, 0.1), "at": {"position": (0.4, 0, 0.47)}}
    world = cell(arm={"part": "panda"}, table=table)
    part = arm(world)
    assert np.all(part.external_effort == 0.0)
    part.command("position", part.home + 0.25 * np.eye(7)[1])
    run(world, 3.0)
    assert np.abs(part.velocity).max() < 1e-2
    # At rest the table carries what the drives give beyond gravity.
    np.testing.assert_allclose(part.external_effort, part.gravity() - part.effort, atol=0.05)
    assert part.external_effort[1] < -1.0


def test_flange_wrench_is_what_the_load_exerts() -> None:
    load = {
        "part": "box",
        "at": {"parent": "arm/flange", "position": (0.03, 0, 0.05)},
        "size": (0.06, 0.06, 0.06),
        "mass": 2.0,
    }
    world = cell(arm={"part": "ur16e"}, load=load)
    part = arm(world)
    run(world, 1.0)
    turn, _ = part.flange()
    weight = turn.T @ np.array([0.0, 0.0, -2.0 * 9.81])
    expected = np.concatenate([weight, np.cross([0.03, 0, 0.05], weight)])
    np.testing.assert_allclose(part.flange_wrench(), expected, atol=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_kinematics_are_of_this_instant(kind: str) -> None:
    world = cell(arm={"part": kind, "at": {"position": (1.0, 2.0, 3.0), "quaternion": (0.5, 0.5, 0.5, 0.5)}})
    part = arm(world)
    part.command("velocity", np.full(part.n, 0.5))
    run(world, 0.3)
    place = part.robot.forward(part.position)
    turn, origin = part.flange()
    np.testing.assert_allclose(turn, place[:3, :3], atol=1e-9)
    np.testing.assert_allclose(origin, place[:3, 3], atol=1e-9)
    before = part.flange()[1]
    twist = part.flange_twist()
    run(world, 0.001)
    np.testing.assert_allclose((part.flange()[1] - before) / 0.001, twist[:3], atol=5e-3)
    # The arm hangs from a wall: gravity is another one in its base frame.
    model = pinocchio_model(part.robot, gravity=tuple(np.array([0.0, -9.81, 0.0])))
    turned = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]]).T @ np.array([0, 0, -9.81])
    model.gravity.linear = turned
    np.testing.assert_allclose(
        part.gravity(), pin.computeGeneralizedGravity(model, model.createData(), part.position), atol=1e-9
    )


def test_mass_matrix_knows_the_rotors_and_the_load() -> None:
    world = cell(arm={"part": "ur16e"})
    part = arm(world)
    model = pinocchio_model(part.robot, rotors=True)
    upper = np.triu(pin.crba(model, model.createData(), part.position))
    np.testing.assert_allclose(part.mass_matrix(), upper + np.triu(upper, 1).T, atol=1e-9)
    load = {"part": "box", "at": "arm/flange", "size": (0.1, 0.1, 0.1), "mass": 5.0}
    assert arm(cell(arm={"part": "ur16e"}, load=load)).mass_matrix()[1, 1] > part.mass_matrix()[1, 1] + 1.0


def test_saved_world_goes_on_bit_for_bit() -> None:
    load = {"part": "box", "at": "arm/flange", "size": (0.1, 0.1, 0.1), "mass": 1.0}
    worlds = [cell(arm={"part": "panda", "friction": 0.2}, load=load) for _ in range(2)]
    first, second = (arm(world) for world in worlds)
    first.tell_payload(0.5, (0, 0, 0.02))
    first.command("velocity", np.full(7, 0.2))
    run(worlds[0], 0.2)
    state = worlds[0].save()
    worlds[1].restore(state)
    assert np.array_equal(first.effort, second.effort)
    assert np.array_equal(first.external_effort, second.external_effort)
    assert np.array_equal(first.flange_wrench(), second.flange_wrench())
    for world in worlds:
        run(world, 0.1)
    first.command("position", first.home)
    second.command("position", second.home)
    for world in worlds:
        run(world, 0.1)
    assert np.array_equal(worlds[0].save(), worlds[1].save())


def test_measuring_does_not_disturb() -> None:
    worlds = [cell(arm={"part": "panda"}) for _ in range(2)]
    for world in worlds:
        arm(world).command("torque", np.array([1.0, 2, 1, 2, 0.1, 0.1, 0.1]))
    for _ in range(100):
        for world in worlds:
            world.advance(world.time + MS)
        part = arm(worlds[0])
        for measure in (part.mass_matrix, part.gravity, part.flange_twist, part.flange_wrench):
            measure()
    assert np.array_equal(worlds[0].data.qpos, worlds[1].data.qpos)


def test_a_wrong_home_is_refused() -> None:
    with pytest.raises(ValidationError, match=r"parts\.arm\.home\n.*6 values for 7 elements \(joint1, "):
        cell(arm={"part": "panda", "home": [0.0] * 6})
    with pytest.raises(WiringError, match="within the limits of panda"):
        cell(arm={"part": "panda", "home": [0.0] * 7})
    cell(arm={"part": "panda", "robot": "fr3"})


def test_a_tool_on_the_flange_touches_things() -> None:
    ball = {
        "part": "box",
        "shape": "sphere",
        "size": (0.1,),
        "mass": 0.5,
        "at": {"parent": "arm/flange", "position": (0, 0, 0.06)},
    }
    slab = {"part": "box", "size": (0.4, 0.4, 0.1), "at": {"position": (0.4, 0, 0.4)}}
    world = cell(arm={"part": "panda"}, ball=ball, slab=slab)
    part = arm(world)
    part.tell_payload(0.5, (0, 0, 0.06))
    part.command("position", part.home + 0.15 * np.eye(7)[1])
    run(world, 2.0)
    pressed = world.truth_arrays["ball_contact_force"]
    assert pressed[2] > 10.0
    turn, _ = part.flange()
    np.testing.assert_allclose(turn @ part.flange_wrench()[:3], pressed - np.array([0, 0, 0.5 * 9.81]), atol=0.1)
    np.testing.assert_allclose(world.truth_arrays["slab_contact_force"], -pressed, atol=1e-9)
