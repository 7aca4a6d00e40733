"""The simulated person: reaching, impedance, delays, limits, noise, muscles, buttons."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.control import bound
from helpers.person import MS, Trolley, alone, cell, finished, go_to, guided, hold, press, quiet, run
from pydantic import ValidationError

from srl.control.cobot.admittance import Admittance, AdmittanceConfig
from srl.control.cobot.ft_record import Unloaded
from srl.runtime.contracts.errors import RecordingError, WiringError
from srl.sim.parts.person.intention import Intention
from srl.sim.parts.person.path import ArcPath
from srl.sim.parts.person.person import PersonConfig, PersonPart
from srl.sim.parts.person.plans import Follow, GoTo, Wait, carrying, drilling, peg_in_hole, wire_path
from srl.sim.parts.things.box import BoxPart
from srl.sim.parts.things.ft_sensor import FtSensorPart, HandlePart
from srl.sim.parts.things.wire_ring import WirePart
from srl.sim.world.cell import Cell, CellConfig

STILL = (0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0)


def intention(plan: Any, **options: Any) -> Intention:
    made = Intention(
        plan,
        **{"speed": 0.25, "turn_speed": 1.0, "reaction": 0.25, "stiffness": 200.0} | options,
        find=lambda name: STILL,
        sites=lambda prefix: np.zeros((2, 3)),
    )
    made.begin(STILL)
    return made


# -- the will


def test_reaching_has_the_minimum_jerk_profile():
    mind = intention((go_to(0.4, 0.0, 1.0),))
    time = np.arange(0.0, 5.0, 0.001)
    place, speed = [], []
    for t in time:
        mind.update(t, 0.001, mind.aim.pose, mind.aim.pose, 0.0)
        place.append(mind.aim.pose[0])
        speed.append(mind.aim.velocity[0])
    place, speed = np.array(place), np.array(speed)
    length = 1.875 * 0.4 / 0.25
    s = np.clip((time - 0.25) / length, 0, 1)
    np.testing.assert_allclose(place, 0.4 * (10 * s**3 - 15 * s**4 + 6 * s**5), atol=1e-9)
    assert speed.max() == pytest.approx(0.25, rel=1e-5)
    moving = np.flatnonzero(speed > 1e-9)
    assert (moving[-1] - moving[0]) * 0.001 == pytest.approx(length, abs=0.01)
    np.testing.assert_allclose(speed[moving], speed[moving][::-1], atol=2e-4)
    np.testing.assert_allclose(np.gradient(place, time)[5:-5], speed[5:-5], atol=1e-4)


def test_steps_begin_a_reaction_time_after_the_last_one():
    world = guided([hold(1.0), press("grip", 0.5), hold(1.0)], reaction=0.3)
    person = world.parts["person"]
    down = []
    for k in range(2500):
        world.advance((k + 1) * MS)
        down.append(person.pressed("grip"))
        assert not person.pressed("other")
    edges = np.flatnonzero(np.diff(np.array(down).astype(int)))
    assert edges * 1e-3 == pytest.approx([0.3 + 1.0 + 0.3, 0.3 + 1.0 + 0.3 + 0.5], abs=0.006)
    assert person.buttons == ("grip",)


def test_a_curve_is_followed_by_arc_length_with_pauses_and_back():
    step = Follow(
        do="follow", points=((0, 0, 1), (0.3, 0, 1), (0.3, 0.3, 1)), speed=0.1, pauses=(0.5,), pause=2.0, back=True
    )
    mind = intention((step,))
    time = np.arange(0.0, 60.0, 0.002)
    places = []
    for t in time:
        mind.update(t, 0.002, mind.aim.pose, mind.aim.pose, 0.0)
        places.append(mind.aim.pose[:3])
        if mind.step is None:
            break
    assert mind.step is None
    way = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert way.sum() == pytest.approx(
        2 * ArcPath(np.array(step.points), (1.0, 0, 0, 0), turning=False).length, abs=1e-3
    )
    assert way.max() / 0.002 == pytest.approx(0.1, rel=0.02)
    still = np.flatnonzero(way[1000:] == 0) + 1000
    assert len(still) * 0.002 == pytest.approx(4.0, abs=0.1)
    np.testing.assert_allclose(places[-1], (0, 0, 1), atol=1e-6)
    assert max(p[1] for p in places) == pytest.approx(0.3, abs=1e-6)


def test_a_person_who_is_off_waits_on_the_curve():
    step = Follow(do="follow", points=((0, 0, 1), (1, 0, 1)), speed=0.1, caution=0.01)
    mind = intention((step,))
    for t in np.arange(0.0, 5.0, 0.002):
        mind.update(t, 0.002, mind.aim.pose, mind.aim.pose, 0.02)
    assert mind.aim.pose[0] < 1e-3
    for t in np.arange(5.0, 30.0, 0.002):
        mind.update(t, 0.002, mind.aim.pose, mind.aim.pose, 0.02)
    assert mind.step is None
    assert mind.aim.missed == 1


def test_an_orientation_is_carried_along_a_curve():
    angle = np.linspace(0, np.pi / 2, 40)
    arc = np.stack([np.sin(angle), 1 - np.cos(angle), 0 * angle], axis=1)
    path = ArcPath(arc, (1.0, 0.0, 0.0, 0.0), turning=True)
    *_, w, x, y, z = path.at(path.length)
    np.testing.assert_allclose([w, x, y, z], [np.sqrt(0.5), 0, 0, np.sqrt(0.5)], atol=0.02)  # a quarter about z
    assert path.length == pytest.approx(np.pi / 2, rel=1e-3)


# -- with a tool in the hand, and with a robot


@pytest.mark.parametrize("mass", [0.0, 3.0, 5.0])
def test_alone_with_a_tool_the_person_reaches_goals(mass):
    goals = [(0.3, 0.1, 1.2), (0.3, -0.2, 1.0), (0.0, 0.0, 1.1)]
    turned = [0.966, 0.259, 0, 0]
    steps = [go_to(*goal, quaternion=turned, tolerance=0.01) for goal in goals]
    world = alone([*steps, hold(2.0)], mass)
    seen = run(world, 40, until=finished)
    assert world.truth_arrays["person_progress"].tolist() == [4, 0, 0]
    for goal in goals:
        assert np.linalg.norm(seen["person_tool"] - goal, axis=1).min() < 0.01
    off = seen["person_tool"][-150:] - goals[-1]
    assert np.sqrt((off**2).mean()) < 0.006
    assert np.abs(world.data.qpos[4:7] - [0.259, 0, 0]).max() < 0.05


def test_the_speed_of_a_real_reach_looks_like_the_intended_one():
    world = alone([go_to(0.4, 0.0, 1.0), hold(2.0)], 2.0, **quiet())
    seen = run(world, 4.5)
    speed = np.gradient(seen["person_tool"][:, 0], seen["time"])
    assert speed.max() == pytest.approx(0.25, rel=0.1)
    assert seen["time"][speed.argmax()] == pytest.approx(0.25 + 1.5, abs=0.15)
    assert seen["person_tool"][:, 0].max() < 0.405


@pytest.mark.slow
def test_a_robot_is_guided_to_goals_within_human_forces():
    world = guided([go_to(0.4, 0.1, 0.2), hold(3.0), go_to(0.0, 0.0, 0.0), hold(2.0)])
    seen = run(world, 40, until=finished)
    assert world.truth_arrays["person_progress"].tolist() == [4, 0, 0]
    force = np.linalg.norm(seen["person_wrench"][:, :3], axis=1)
    assert 4 < force.max() < 25  # 0.25 m/s need 10 N
    assert np.sqrt((seen["person_tool"][-100:] ** 2).sum(axis=1).mean()) < 0.006


def test_a_robot_unlike_the_known_one_is_guided_by_sight():
    """A dead band and another damping: what was learned is wrong, sight puts it right."""
    world = guided([go_to(0.3, 0.0, 0.0, patience=60), hold(2.0)], trolley={"damping": 80.0})
    seen = run(world, 40, until=finished)
    assert world.truth_arrays["person_progress"].tolist() == [2, 0, 0]
    assert np.abs(seen["person_tool"][-100:] - [0.3, 0, 0]).max() < 0.012


@pytest.mark.sampled(1)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("stiffness", "damping"),
    [(50.0, 20.0), pytest.param(200.0, 5.0, marks=pytest.mark.slow), pytest.param(400.0, 40.0, marks=pytest.mark.slow)],
)
def test_arms_of_the_literature_come_to_rest(stiffness, damping):
    """With a tool, and with the paper's two admittances."""
    softer = {"mass": 3.0, "damping": 20.0, "inertia": 0.8, "turn_damping": 1.5}
    options = {**quiet(), "stiffness": stiffness, "damping": damping}
    for trolley in (None, softer, {}):
        goal = (0.2, 0.0, 1.0 if trolley is None else 0.0)
        plan = [go_to(*goal, quaternion=[0.966, 0.259, 0, 0], patience=100.0), hold(100.0)]
        world = alone(plan, 3.0, **options) if trolley is None else guided(plan, trolley=trolley, **options)
        seen = run(world, 20, every=50)["person_tool"]
        assert np.ptp(seen[-60:], axis=0).max() < 3e-4
        assert np.abs(seen[-60:] - goal).max() < 1e-3
        assert seen[:, 0].max() < 0.2 + 0.02


@pytest.mark.slow
def test_a_known_tool_beside_the_hand_is_moved_and_turned_as_meant():
    """Of the known inertia and drag nothing is left to sight, whether the hand holds the tool's middle or not."""
    steps = [go_to(0.3, 0.1, 0.0, quaternion=[0.966, 0.0, 0.0, 0.259], speed=0.1), hold(2.0)]
    options = {**quiet(), "correction": (0.0, 0.0), "activation": 0.0, "tool": "robot/body"}
    unknown = {"learned_inertia": 0.0, "learned_turn_damping": 0.0}
    off = []
    for at, known in (([0.0, 0.0, 0.0], {}), ([0.2, 0.0, 0.1], {}), ([0.2, 0.0, 0.1], unknown)):
        place = {"parent": "robot/body", "position": at}
        seen = run(guided(steps, at=place, **options, **known), 6.0)
        off.append(np.linalg.norm(seen["person_tool"] - seen["person_aim"], axis=1).max())
    assert max(off[:2]) < 0.001
    assert off[2] > 0.005


def test_turning_is_guided_too():
    half = np.sqrt(0.5)
    world = guided([go_to(0.0, 0.0, 0.0, quaternion=[half, 0, 0, half]), hold(3.0)])
    run(world, 40, until=finished)
    assert world.truth_arrays["person_progress"].tolist() == [2, 0, 0]
    assert world.parts["robot"].q[5] == pytest.approx(np.pi / 2, abs=0.1)


def test_at_a_blocked_handle_force_is_stiffness_times_what_is_lacking():
    options = {**quiet(), "stiffening": 0.0, "correction": (0.0, 0.0), "learned_mass": 0.0, "learned_damping": 0.0}
    world = guided([go_to(0.05, 0.0, 0.0, patience=100)], trolley={"damping": 1e7, "turn_damping": 1e7}, **options)
    run(world, 4.0)
    np.testing.assert_allclose(world.truth_arrays["person_wrench"][:3], [10.0, 0, 0], atol=0.05)


def test_a_stiffening_arm_gives_more():
    options = {**quiet(), "stiffening": 5.0, "correction": (0.0, 0.0), "learned_mass": 0.0, "learned_damping": 0.0}
    world = guided([go_to(0.05, 0.0, 0.0, patience=100)], trolley={"damping": 1e7, "turn_damping": 1e7}, **options)
    run(world, 6.0)
    assert world.truth_arrays["person_wrench"][0] == pytest.approx(10 / (1 - 5 * 0.05), rel=0.01)  # F = (K + 5 F) x


@pytest.mark.slow
def test_strength_is_a_limit_whatever_is_lacking():
    world = guided([go_to(2.0, 0.0, 0.0)], trolley={"damping": 1e7}, strength=60.0)
    seen = run(world, 20)
    size = np.linalg.norm(seen["person_wrench"][:, :3], axis=1)
    assert size.max() == pytest.approx(60.0)
    assert np.linalg.norm(seen["person_wrench"][:, 3:], axis=1).max() <= 8.0 + 1e-9
    weak = alone([hold(1.0)], 10.0, strength=60.0)  # 98 N of weight
    assert run(weak, 1.0)["person_tool"][-1, 2] < 0.0


def test_a_hand_that_waits_goes_along():
    world = guided([Wait(do="wait", seconds=20.0)], trolley={"damping": 1.0}, **quiet())
    world.advance(500 * MS)
    world.parts["robot"].v[0] = 0.1
    seen = run(world, 5.0)
    assert np.linalg.norm(seen["person_wrench"][:, :3], axis=1).max() < 5.0
    assert np.abs(seen["person_wrench"][-1]).max() < 0.1


# -- the same seed, the same bits


def busy(seed: int) -> Any:
    plan = [
        press("admittance"),
        GoTo(do="go_to", target="wire/path_0", tolerance=0.02, patience=1.0),
        Follow(do="follow", along="wire/path_", speed=0.2, turning=True, pauses=(0.5,), pause=0.5),
        Wait(do="wait", seconds=0.5),
        hold(0.5),
    ]
    tool = {"at": "person/hand", "size": [0.05, 0.05, 0.05], "mass": 2.0, "touches": False}
    parts: Any = {
        "wire": (WirePart, {"at": {"position": [0.05, 0, 1]}, "points": [(0, 0, 0), (0.1, 0.02, 0.05), (0.3, 0, 0)]}),
        "person": (PersonPart, {"at": {"position": [0, 0, 1]}, "plan": plan, "fatigue": True}),
        "tool": (BoxPart, tool),
    }
    return cell(parts, seed)


@pytest.mark.slow
def test_a_seed_fixes_every_bit_and_a_saved_world_goes_on():
    one, two, other = busy(3), busy(3), busy(4)
    saved = []
    for k in range(9):
        one.advance((k + 1) * 1000 * MS - 3 * MS)
        for ms in range(0, 1000, 7):
            two.advance(k * 1000 * MS + ms * MS)
        two.advance(one.time)
        np.testing.assert_array_equal(one.save(), two.save())
        saved.append(one.save())
    other.advance(one.time)
    assert not np.array_equal(other.save(), saved[-1])
    assert one.truth_arrays["person_progress"][0] >= 3
    fresh = busy(3)
    for k in (7, 2, 4):
        for world in (fresh, two):
            world.restore(saved[k])
            world.advance((k + 2) * 1000 * MS - 3 * MS)
            np.testing.assert_array_equal(world.save(), saved[k + 1])


# -- what it refuses


@pytest.mark.parametrize(
    ("step", "match"),
    [
        ({"do": "go_to"}, "one of 'position'"),
        ({"do": "go_to", "position": [0, 0, 0], "by": [0, 0, 1]}, "one of 'position'"),
        ({"do": "go_to", "position": [0, 0, 0], "align": True}, "needs a 'target'"),
        ({"do": "insert", "direction": [0, 0, 0], "depth": 0.1, "force": 5}, "has a length"),
        ({"do": "follow", "points": [[0, 0, 0]]}, "two points"),
        ({"do": "follow", "circle": 0.1, "pauses": [0.5, 0.2]}, "must rise"),
        ({"do": "dance"}, "do"),
        ({"do": "hold", "second": 1}, "second"),
    ],
)
def test_a_wrong_step_is_refused_with_the_reason(step, match):
    with pytest.raises(ValidationError, match=match):
        PersonConfig.model_validate({"plan": [step]})


def test_wrong_names_are_refused():
    parts: Any = {
        "robot": (Trolley, {}),
        "free": (BoxPart, {"size": [0.1, 0.1, 0.1], "free": True, "at": {"position": [1, 0, 0]}}),
    }
    person = {"at": "robot/body"}
    with pytest.raises(WiringError, match="no site or body is called 'robot/tip'"):
        cell(parts | {"person": (PersonPart, person | {"tool": "robot/tip"})})
    with pytest.raises(WiringError, match="can move against the hand"):
        cell(parts | {"person": (PersonPart, person | {"tool": "free/body"})})
    lost = cell(parts | {"person": (PersonPart, person | {"plan": [{"do": "go_to", "target": "plate/hole_1"}]})})
    with pytest.raises(WiringError, match="no site or body is called 'plate/hole_1'"):
        lost.advance(1000 * MS)


def test_a_curve_from_a_file(tmp_path):
    file = tmp_path / "way.csv"
    file.write_text("x,y,z\n0,0,1\n0.1,0,1\n0.2,0,1\n")
    world = alone([Follow(do="follow", file=file, speed=0.1)], 1.0)
    run(world, 20, until=finished)
    assert world.truth_arrays["person_aim"] == pytest.approx([0.2, 0, 1], abs=1e-6)
    file.write_text("a,b,c\n0,0,1\n0.1,0,1\n")
    with pytest.raises(RecordingError, match="x, y, z"):
        run(alone([Follow(do="follow", file=file)], 1.0), 1.0)


def test_the_plans_of_the_experiments_are_plans():
    for plan in (wire_path(), drilling(), peg_in_hole(), carrying("load", ((1, 0, 1), (2, 0, 1)))):
        text = [step.model_dump(mode="json", exclude_none=True) for step in plan]
        assert PersonConfig.model_validate({"plan": text}).plan == plan


# -- with the runtime's own admittance


@pytest.mark.slow
def test_an_admittance_is_guided_through_a_sensor_with_its_dead_band():
    """The controller reads the sensor behind the handle; a robot follows its desired velocity within 20 ms."""
    plan = [press("admittance"), go_to(0.3, 0.1, 0.2, tolerance=0.008), hold(3.0), press("admittance"), hold(1.0)]
    parts: Any = {
        "robot": (Trolley, {"mass": 1e3, "inertia": 1e2, "damping": 0.0, "turn_damping": 0.0}),
        "sensor": (FtSensorPart, {"at": {"parent": "robot/body", "position": [0, 0, 0.035]}}),
        "handle": (HandlePart, {"at": "sensor/tool"}),
        "person": (
            PersonPart,
            {"at": {"parent": "handle/grip", "position": [0, 0, 0.06]}, "tool": "robot/body", "plan": plan},
        ),
    }
    world = cell(parts)
    robot, sensor, person = (world.parts[name] for name in ("robot", "sensor", "person"))
    config = AdmittanceConfig(calibration=Unloaded(tool_mass=0.2, tool_com=(0.0, 0.0, 0.045)))
    law = bound(Admittance("admittance", config), sensor=(0.0, 0.0, 0.035, 1.0, 0.0, 0.0, 0.0))
    law.input["pose"][3] = 1.0
    law.reset()
    on, down, speed, places, forces = False, False, np.zeros(6), [], []
    while not person.done:
        assert world.time < 40e9
        on, down = on != (person.pressed("admittance") and not down), person.pressed("admittance")
        law.input["wrench"][:], law.input["twist"][:] = sensor.wrench, robot.v
        law.input["pose"][:3], law.input["modes"][0] = robot.q[:3], on
        law.update(0.001)
        speed += (law.output["twist"] - speed) * 0.05
        robot.v[:] = speed
        world.advance(world.time + MS)
        places.append(robot.q[:3].copy())
        forces.append(world.truth_arrays["person_wrench"][:3].copy())
    assert world.truth_arrays["person_progress"].tolist() == [5, 0, 0]
    off = np.array(places[-4500:-2000]) - [0.3, 0.1, 0.2]
    assert np.abs(off).max() < 0.015
    assert np.abs(np.diff(places[-300:], axis=0)).max() < 1e-5  # off again: it stands
    assert np.linalg.norm(forces, axis=1).max() < 30


def test_a_run_can_end_with_a_persons_plan():
    world = alone([hold(0.5)], tool=0.0)
    run(world, 2.0)
    assert not world.finished  # nobody asked for it
    person = (PersonPart, PersonPart.Config.model_validate({"at": {"position": [0, 0, 1]}, "plan": [hold(0.5)]}))
    world = Cell(CellConfig.model_construct(parts={"person": person}, ends_with="person"), 1)
    seen = run(world, 5.0, until=lambda w: w.finished)
    assert finished(world)
    assert 0.5 < seen["time"][-1] < 1.0
    with pytest.raises(WiringError, match="no person 'persona'"):
        Cell(CellConfig.model_construct(parts={"person": person}, ends_with="persona"), 1)
