"""What URScript's commands do to the twin's arm: Cartesian motion, TCP, kinematics, force mode, contact, limits."""

from math import pi

import numpy as np
import pytest
from helpers.twin import Bench
from helpers.ur import make_fake, speed
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.drivers.ur.status import SafetyMode
from srl.runtime.models.robots import UR16E
from srl.sim.devices.ur.kinematics import Kinematics, placement, vector
from srl.sim.devices.ur.twin import UrTwin

HOME = [0.0, -pi / 2, pi / 2, -pi / 2, -pi / 2, 0.0]
# What touches a table 2 cm below is a tool: forces are felt at the flange only.
TOOL = {"part": "box", "at": {"parent": "arm/flange", "position": [0, 0, 0.03]}, "size": [0.06] * 3, "mass": 0.3}
TABLE = {
    "tool": TOOL,
    "table": {"part": "table", "size": [0.3, 0.2], "at": {"position": [-0.48, -0.174, 0.462]}},
}
PAYLOAD = "  set_payload(0.3, [0, 0, 0.03])\n"


@pytest.fixture
def bench():
    with Bench(UrTwin(make_fake())) as bench:
        yield bench


def run(bench, body, seconds=5.0):
    """Runs a program until it ends; what it said."""
    twin = bench.twin
    twin._load("def test():\n" + body + "\nend\n")
    output = len(twin.texts)
    for _ in range(round(seconds / 0.05)):
        bench.run(0.05)
        if twin.controller.program is None:
            return twin.texts[output:]
    raise AssertionError(f"it still runs; {twin.metrics()}")


def pose_of(bench):
    return bench.twin.controller.tool()


def arrived(bench, goal, within):
    """Whether the TCP is at a pose; a rotation by pi has two rotation vectors."""
    off = Kinematics.error(placement(goal), placement(pose_of(bench)))
    return bool(np.abs(off).max() < within)


def moved(pose, x, y, z):
    return np.concatenate([np.add(pose[:3], (x, y, z)), pose[3:]])


def text(values):
    return "[" + ", ".join(f"{value:.9f}" for value in values) + "]"


def test_movel_goes_straight_and_arrives(bench):
    start = pose_of(bench)
    goal = moved(start, 0.1, -0.05, 0.08)
    way = []
    controller = bench.twin.controller
    cycle = controller.force.cycle
    controller.force.cycle = lambda *given: (way.append(controller.tool()), cycle(*given))
    run(bench, f"  movel(p{text(goal)}, a=1, v=0.2)")
    assert arrived(bench, goal, 3e-4)
    line = (goal - start)[:3] / np.linalg.norm((goal - start)[:3])
    off = np.array(way)[:, :3] - start[:3]
    beside = off - np.outer(off @ line, line)
    assert np.abs(beside).max() < 1e-3
    steps = np.diff(off @ line)
    assert steps.max() < 0.2 * 0.002 * 1.1


def test_a_blended_path_passes_its_corner_without_rest(bench):
    start = pose_of(bench)
    corner, end = moved(start, 0.1, 0.0, 0.0), moved(start, 0.1, 0.1, 0.0)
    slowest, nearest = [1.0], [1.0]
    controller = bench.twin.controller
    cycle = controller.force.cycle

    def watch(*given):
        at, rate = controller.tool(), np.linalg.norm(controller.tool_twist()[:3])
        if np.linalg.norm(at[:3] - corner[:3]) < 0.02:
            slowest[0] = min(slowest[0], rate)
        nearest[0] = min(nearest[0], np.linalg.norm(at[:3] - corner[:3]))
        cycle(*given)

    controller.force.cycle = watch
    run(bench, f"  movel(p{text(corner)}, a=1, v=0.2, r=0.02)\n  movel(p{text(end)}, a=1, v=0.2)")
    assert arrived(bench, end, 3e-4)
    assert slowest[0] > 0.05
    assert 1e-4 < nearest[0] < 0.02


def test_speedl_moves_the_tcp_and_stopl_rests(bench):
    turned = 0.1
    run(bench, f"  set_tcp(p[0, 0, 0.2, {turned}, 0, 0])\n  speedl([0.05, 0, -0.05, 0, 0, 0.2], 1, 0.4)\n"
        "  v = get_actual_tcp_speed()\n  textmsg(v[0])\n  textmsg(v[2])\n  textmsg(v[5])\n  stopl(2)")  # fmt: skip
    vx, vz, wz = map(float, bench.twin.texts[-3:])
    assert (vx, vz, wz) == pytest.approx((0.05, -0.05, 0.2), abs=5e-3)
    assert speed(bench.twin.arm) < 5e-3


def test_the_tcp_that_is_set_is_the_one_that_is_reported(bench):
    before = placement(pose_of(bench))
    tcp = [0.01, -0.02, 0.15, 0.1, 0.2, -0.3]
    run(bench, f"  set_tcp(p{text(tcp)})\n  t = get_tcp_offset()\n  textmsg(t[2])")
    assert float(bench.twin.texts[-1]) == pytest.approx(0.15)
    assert arrived(bench, vector(before * placement(tcp)), 1e-6)
    np.testing.assert_allclose(bench.twin.controller.flange()[:3], before.translation, atol=1e-6)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(-2.5, 2.5), min_size=6, max_size=6), st.lists(st.floats(-0.2, 0.2), min_size=6, max_size=6))
def test_inverse_kinematics_undoes_forward_kinematics(q, tcp):
    kinematics = Kinematics(UR16E)
    kinematics.tcp = placement(tcp)
    goal = kinematics.forward(q)
    found = kinematics.inverse(goal, np.array(q) + 0.05)
    if found is None:  # only next to a singularity
        assert np.linalg.svd(kinematics.jacobian(np.array(q)))[1][-1] < 0.03
        return
    assert np.linalg.norm(kinematics.error(goal, kinematics.forward(found))) < 1e-8


def test_forward_kinematics_is_that_of_the_world(bench):
    controller = bench.twin.controller
    assert arrived(bench, vector(controller.kinematics.forward(controller.arm.position)), 1e-9)


def test_poses_out_of_reach_end_the_program_and_move_nothing(bench):
    run(bench, "  movej(get_inverse_kin(p[3, 0, 0, 0, 0, 0]))")
    assert "no joint angles reach" in bench.twin.errors[-1]
    np.testing.assert_allclose(bench.twin.controller.arm.position, HOME, atol=1e-2)
    assert run(bench, "  if get_inverse_kin_has_solution(p[3, 0, 0, 0, 0, 0]):\n    textmsg(1)\n"
               "  else:\n    textmsg(0)\n  end") == ["0"]  # fmt: skip


@pytest.mark.slow
def test_a_singularity_stops_the_arm_protectively(bench):
    run(bench, "  movej([0, -1.5708, 0.3, -1.5708, -1.5708, 0], a=3, v=2)")
    bench.twin._load("def test():\n  speedl([0, 0, 0.4, 0, 0, 0], 2, 5)\nend\n")
    bench.run(1.0)
    assert bench.twin.controller.safety_mode is SafetyMode.PROTECTIVE_STOP
    assert "singularity" in bench.twin.controller.stops[-1]
    assert speed(bench.twin.arm) < 1e-2


def test_a_joint_beyond_its_limit_stops_and_gets_back():
    parts = {"arm": {"part": "ur16e", "home": [2 * pi - 0.1, *HOME[1:]]}}
    with Bench(UrTwin(make_fake(parts=parts))) as bench:
        beyond_and_back(bench)


def beyond_and_back(bench):
    controller = bench.twin.controller
    bench.twin._load("def test():\n  speedj([0.5, 0, 0, 0, 0, 0], 2, 10)\nend\n")
    bench.run(1.0)
    assert "beyond its limit" in controller.stops[-1]
    assert controller.arm.position[0] > 2 * pi
    assert not controller.unlock()
    controller.locked_until = 0  # instead of waiting for 5 s
    assert controller.unlock()
    bench.run(0.1)
    assert controller.safety_mode is SafetyMode.NORMAL
    run(bench, "  speedj([-0.5, 0, 0, 0, 0, 0], 2, 0.6)")
    assert controller.arm.position[0] < 2 * pi
    assert len(controller.stops) == 1


def test_programs_can_stop_the_arm_protectively(bench):
    bench.twin._load("def test():\n  speedj([0.5, 0, 0, 0, 0, 0], 2, 0.5)\n  protective_stop()\n  textmsg(1)\nend\n")
    bench.run(1.0)
    assert bench.twin.controller.safety_mode is SafetyMode.PROTECTIVE_STOP
    assert speed(bench.twin.arm) < 5e-3


@pytest.mark.slow
def test_force_mode_presses_with_its_force_and_keeps_the_other_directions():
    with Bench(UrTwin(make_fake(parts=TABLE))) as bench:
        controller = bench.twin.controller
        start = pose_of(bench)
        bench.twin._load(
            "def test():\n" + PAYLOAD + "  force_mode_set_damping(0.025)\n  force_mode_set_gain_scaling(0.5)\n"
            "  down = [0, 0, -20, 0, 0, 0]\n  limits = [0.1, 0.1, 0.15, 1, 1, 1]\n"
            "  force_mode(p[0, 0, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], down, 2, limits)\n  sleep(60)\nend\n"
        )
        bench.run(0.15)
        assert controller.tool_twist()[2] < -0.02
        bench.run(1.0)
        felt = np.mean([(bench.run(0.01), controller.wrench[2])[1] for _ in range(20)])
        assert felt == pytest.approx(20, abs=3)
        np.testing.assert_allclose(pose_of(bench)[:2], start[:2], atol=5e-3)
        assert pose_of(bench)[2] < start[2] - 0.01
        controller.end_program()
        bench.run(0.5)
        assert speed(bench.twin.arm) < 5e-3
        assert not controller.force.on


def test_a_contact_is_noticed_and_ends_the_motion():
    with Bench(UrTwin(make_fake(parts=TABLE))) as bench:
        output = run(
            bench,
            PAYLOAD + "  while tool_contact([0, 0, -1]) == 0:\n    speedl([0, 0, -0.05, 0, 0, 0], 1, 0.002)\n  end\n"
            "  n = tool_contact([0, 0, -1])\n  q = get_actual_joint_positions_history(n)\n  stopl(5)\n  textmsg(n)\n"
            "  movel(q)\n  textmsg(2)",
            8.0,
        )
        assert int(output[0]) >= 1
        assert output[1] == "2"
        assert np.linalg.norm(bench.twin.controller.wrench[:3]) < 10.0


@pytest.mark.slow
def test_freedrive_yields_to_a_hand_and_holds_afterwards(bench):
    bench.twin._load("def test():\n  freedrive_mode()\n  sleep(60)\nend\n")
    bench.run(0.3)
    arm, world = bench.twin.controller.arm, bench.world
    start = arm.position
    np.testing.assert_allclose(start, HOME, atol=2e-2)
    body = int(world.model.body("arm/flange").id)
    world.data.xfrc_applied[body, 1] = 30.0
    bench.run(0.5)
    world.data.xfrc_applied[body, 1] = 0.0
    assert np.abs(arm.position - start).max() > 0.02
    bench.twin.controller.end_program()
    bench.run(0.5)
    held = arm.position
    bench.run(0.3)
    np.testing.assert_allclose(arm.position, held, atol=2e-3)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        ("movec(p[0, 0, 0, 0, 0, 0], p[0, 0, 0, 0, 0, 0])", "movec"), ("set_gravity([0, 0, 9.82])", "set_gravity"),
        ("force_mode(p[0,0,0,0,0,0], [1,0,0,0,0,0], [1,0,0,0,0,0], 3, [1,1,1,1,1,1])", "force_mode"),
        ("enable_external_ft_sensor(True)", "enable_external_ft_sensor"),
        ("freedrive_mode(freeAxes=[1, 0, 0, 0, 0, 0])", "freedrive_mode"),
    ],
)  # fmt: skip
def test_what_the_twin_doesnt_do_ends_the_program_and_is_counted_for_good(bench, call, name):
    for _ in range(2):
        run(bench, f"  {call}\n  textmsg(1)")
        assert "refused by this twin" in bench.twin.errors[-1]
    run(bench, '  textmsg("another")')
    assert bench.twin.metrics()["refused"] == {name: 2}
    assert bench.twin.texts == ["another"]


def test_a_killed_motion_comes_to_rest(bench):
    bench.twin._load(
        "def test():\n  thread away():\n    movej([1, -1.57, 1.57, -1.57, -1.57, 0], a=2, v=1)\n  end\n"
        "  moving = run away()\n  sleep(0.5)\n  kill moving\n  sleep(0.6)\n  textmsg(1)\n  sleep(60)\nend\n"
    )
    bench.run(0.45)
    assert speed(bench.twin.arm) > 0.5
    bench.run(0.6)
    assert speed(bench.twin.arm) < 1e-2
    assert bench.twin.controller.arm.position[0] < 0.9
