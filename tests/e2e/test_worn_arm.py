"""The profile `worn-arm`, simulated: a point in the hand, the weight, a slip, a push, and energy at what it hits.

`-s` prints the tables of docs/worn-arm.md.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from helpers.worn_arm import RATE, TrueWeight, bench, worn

from srl.runtime.contracts.rotation import exp
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import State
from srl.testing import Lab, Simulated, simulate

pytestmark = pytest.mark.slow
STEADY, SLIPPED = (3.0, 6.0), (6.6, 8.0)  # s: the hand is up and goes round; the same after the slip
PUSHED = 4.0  # s, for 0.3 s


@cache
def slips(upright: str) -> Simulated:
    plain = worn(upright)
    plain["trial"] = "slip"
    return simulate(plain, 8.0)


def between(run: Simulated, signal: str, span: tuple[float, float]) -> Array:
    a, b = (round(t * RATE) for t in span)
    return run.value(signal)[a:b]


def off(run: Simulated) -> Array:
    """mm from the point in the hand, cycle by cycle; where both truly are, but for the cameras' 0.1 mm and 6 ms."""
    point = run.value("mocap.hand.pose")[:, :3] + worn()["controllers"][0]["offset"]
    return 1e3 * np.linalg.norm(point - run.value("world.arm_tip")[:, 0], axis=1)


def weight_left(run: Simulated, span: tuple[float, float]) -> Array:
    """(k, n) N m: what the weight truly is, less what the law holds, every 20 ms."""
    true = TrueWeight()
    q, base = between(run, "world.arm_position", span), between(run, "world.base_case_orientation", span)
    held = between(run, "arm.effort_command.gravity", span)
    return np.array([true(q[k], base[k]) - held[k] for k in range(0, len(q), 10)])


@pytest.mark.exhaustive
def test_the_tool_follows_a_point_in_the_hand() -> None:
    run = slips("imu")
    a, b = (round(t * RATE) for t in STEADY)
    found = off(run)[a:b]
    path = between(run, "mocap.hand.pose", STEADY)[:, :3]
    way = np.linalg.norm(np.diff(path[::25], axis=0), axis=1).sum()
    print(f"\nfollowed: rms {np.sqrt((found**2).mean()):.1f} mm, most {found.max():.1f} mm; the hand goes {way:.2f} m")
    assert np.sqrt((found**2).mean()) < 20.0
    assert np.ptp(path, axis=0).max() > 0.1  # it moves


def test_the_weight_is_held_while_the_strap_tilts_and_slips() -> None:
    left: dict[tuple[str, tuple[float, float]], Array] = {}
    print("\n| window | tilt | up by | shoulder, N m rms | all joints, most | point missed, mm rms |")
    for upright in ("imu", "base"):
        run = slips(upright)
        since = off(run)[round(6.0 * RATE) :]
        print(f"slip, up by {upright}: {since.max():.0f} mm off, within 40 mm after "
              f"{np.flatnonzero(since > 40.0)[-1] / RATE:.2f} s")  # fmt: skip
        assert run.states()[-1] is State.ACTIVE
        tilt = np.rad2deg(between(run, "world.straps_tilt", (7.0, 8.0))[:, 1])
        time = np.arange(len(tilt))
        rocks = float((tilt - np.polyval(np.polyfit(time, tilt, 3), time)).std())
        print(f"the strap rocks by {rocks:.2f} degrees rms a second after")
        assert rocks < 0.4  # arm and strap don't keep each other going
        for span in (STEADY, SLIPPED):
            torque = left[upright, span] = weight_left(run, span)
            tilt = np.rad2deg(np.linalg.norm(between(run, "world.straps_tilt", span), axis=1).mean())
            a, b = (round(t * RATE) for t in span)
            missed = np.sqrt((off(run)[a:b] ** 2).mean())
            shoulder = np.sqrt((torque[:, 1] ** 2).mean())
            print(f"| {span} | {tilt:.1f} | {upright} | {shoulder:.3f} | {np.abs(torque).max():.3f} | {missed:.1f} |")
    for span in (STEADY, SLIPPED):
        assert np.abs(left["imu", span]).max() < 0.2
        rms = {up: np.sqrt((left[up, span] ** 2).mean()) for up in ("imu", "base")}
        assert rms["imu"] < 0.5 * rms["base"]


def test_a_push_of_50_n_is_given_way_to_and_comes_back() -> None:
    run = simulate(worn() | {"trial": "push"}, 7.0)
    found, since = off(run), round(PUSHED * RATE)
    late = np.flatnonzero(found[since:] > 40.0)
    effort, speed = (np.abs(run.value(f"world.arm_{what}")[since:]).max(axis=0) for what in ("effort", "velocity"))
    shift, tilt = (
        np.linalg.norm(run.value(f"world.straps_{what}")[since:], axis=1).max() for what in ("shift", "tilt")
    )
    print(
        f"\n50 N for 0.3 s: moved {found[since:].max():.0f} mm, within 40 mm for good after {late[-1] / RATE:.1f} s; "
        f"torques {effort.round(1)} N m, joints {speed.round(1)} rad/s; strap {1e3 * shift:.0f} mm, "
        f"{np.rad2deg(tilt):.0f} degrees; work {run.value('world.knock_work')[-1, 0]:.0f} J"
    )
    assert found[since:].max() > 100.0
    assert run.states()[-1] is State.ACTIVE
    assert (effort <= [9.1, 14.1, 14.1, 6.1]).all()  # the guard's, and a step of the wire
    assert np.sqrt((found[-RATE:] ** 2).mean()) < 30.0


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("device", "fault", "most"),
    [("mocap", {"loss": [[3.0, 9.0]]}, 0.02), ("base", {"silent": [[3.0, 9.0]]}, 0.65)],
    ids=["hand lost", "sensor silent"],
)
def test_without_hand_or_sensor_it_holds_where_it_is(device: str, fault: dict[str, Any], most: float) -> None:
    plain = worn()
    plain["sim"]["devices"][device] |= fault
    with Lab(plain) as lab:
        lab.run(2.9)
        lab.until("stopped", most=3.0)
        reported, before = lab.time - 3.0, np.array(lab["world.arm_tip"])
        lab.run(1.0)
        sunk = 1e3 * float(np.linalg.norm(lab["world.arm_tip"] - before))
        print(f"\n{device}: stopped after {reported:.2f} s by {lab.cause}; {sunk:.0f} mm in the second after")
        assert reported < most
        assert sunk < 25.0


@pytest.mark.sampled(1)
@pytest.mark.parametrize("lean", [1.2, -0.7], ids=["bends forward", "leans back"])
def test_a_stopped_arm_stays_where_it_is_while_its_wearer_leans(lean: float) -> None:
    """Its weight changes with the tilt: what was held when the stop began would swing it."""
    plain = worn() | {"trial": "slip"}
    plain["choices"]["trial"]["slip"]["sim"]["parts"]["straps"]["slip"] = {"at": 4.0, "tilt": [0.0, lean, 0.0]}
    with Lab(plain) as lab:
        lab.run(3.0)
        lab.stop()
        lab.run(0.9)
        before = np.array(lab["world.arm_position"])
        lab.run(1.6)
        moved = np.abs(np.array(lab["world.arm_position"]) - before)
        print(f"\nstopped, the base tilts by {lean}: joints moved by {moved.round(2)} rad")
        assert moved.max() < 0.2


def leaning(tilt: float) -> Lab:
    """The bench, whose base leans forward by so many rad from 0.3 s on."""
    plain = bench()
    plain["sim"]["parts"]["plate"]["slip"] = {"at": 0.3, "tilt": [0.0, tilt, 0.0]}
    del plain["sim"]["parts"]["knock"]
    return Lab(plain)


@pytest.mark.parametrize(("turned", "axis"), [(np.pi, 0), (np.pi / 2, 1)], ids=["upside down", "on its side"])
def test_a_sensor_that_is_mounted_wrong_is_refused_before_anything_moves(turned: float, axis: int) -> None:
    plain = bench()
    plain["sim"]["parts"]["base_case"]["off_by"] = {"quaternion": list(exp(*turned * np.eye(3)[axis]))}
    with Lab(plain) as lab:
        lab.until("stopped")
        before = np.array(lab["world.arm_position"])
        (output,) = (text for text in lab.events if text.startswith("controller 'body'"))
        assert "in the arm's base, and a worn base leans by 60 at most ('tilt_limit')" in output
        lab.reset()
        lab.run(2.0)
        moved = np.abs(np.array(lab["world.arm_position"]) - before)
        print(f"\nmounted wrong by {np.rad2deg(turned):.0f} degrees: joints moved by {moved.round(3)} rad")
        assert (lab.state, lab.cause, lab.fault_source) == ("stopped", "intent_loss", "base")
        assert moved.max() < 0.05


@pytest.mark.parametrize("lean", [1.4, -1.4], ids=["bends by 80 degrees", "back by 80 degrees"])
def test_a_base_that_leans_too_far_stops_the_limb_and_does_not_drop_it(lean: float) -> None:
    with leaning(lean) as lab:
        lab.until("stopped", most=2.0)
        assert (lab.cause, lab.fault_source) == ("intent_loss", "base")
        assert any("a worn base leans by 60 at most ('tilt_limit')" in text for text in lab.events)
        lab.run(0.2)
        before = np.array(lab["world.arm_position"])
        lab.run(1.5)
        moved = np.abs(np.array(lab["world.arm_position"]) - before)
        print(f"\nthe base leans by {np.rad2deg(lean):.0f} degrees, stopped: joints moved by {moved.round(3)} rad")
        assert moved.max() < 0.05


def test_who_leans_by_45_degrees_may_go_on_and_reset() -> None:
    with leaning(np.pi / 4) as lab:
        lab.run(2.0)
        assert lab.state == "active"
        lab.stop()
        lab.until("stopped")
        lab.reset()
        lab.run(0.5)
        assert lab.state == "active"


WALLS = {"stiff wall": {"stiffness": 4e4, "damping": 0.0}, "soft person": {"stiffness": 400.0, "damping": 5.0}}


def energies(plain: dict[str, Any]) -> tuple[Simulated, Array, Array]:
    """What push and wall gave the arm, and what the law gave its joints on top of gravity, J from before the push on.

    The second is exact for torques that are held from cycle to cycle: their sum times the joints' true steps.
    """
    run = simulate(plain, 2.2)
    start = round(0.58 * plain["rate"])
    port = run.value("world.knock_work")[:, 0] + run.value("world.wall_work")[:, 0]
    torque = (run.value("world.arm_effort") - run.value("arm.effort_command.gravity"))[1:]
    law = np.concatenate([[0.0], (torque * np.diff(run.value("world.arm_position"), axis=0)).sum(axis=1).cumsum()])
    return run, port[start:] - port[start], law[start:] - law[start]


@pytest.mark.parametrize("what", WALLS)
def test_it_gives_nothing_to_what_it_hits(what: str) -> None:
    """Both ports' energy, with the discretisation at 500 Hz, the bus and its rounding in it."""
    run, port, law = energies(bench(wall=WALLS[what]))
    back = float((np.maximum.accumulate(port) - port).max())
    force = np.linalg.norm(run.value("world.wall_force"), axis=1).max()
    print(f"\n| {what} | {RATE} | {port.max():.2f} | {back:.3f} | {law.max():.3f} | {force:.0f} |")
    assert force > 30.0
    assert port.min() > -1e-3  # never more out than in
    assert law.max() < 0.01  # the law itself gave the joints nothing
    assert np.abs(run.value("world.arm_velocity")[-1]).max() < 0.1


@pytest.mark.parametrize(("rate", "gives"), [(500, False), (250, True)])
def test_pushed_down_on_a_table_it_gives_energy_at_the_rate_that_check_doubts(rate: int, gives: bool) -> None:
    plain = bench(rate, WALLS["stiff wall"] | {"normal": [0.0, 0.0, 1.0]})
    plain["sim"]["parts"]["knock"]["force"] = [0.0, 0.0, -50.0]
    _, port, law = energies(plain)
    print(f"\n| table | {rate} | {port.max():.2f} | {-port.min():.3f} more out than in | {law.max():.3f} | |")
    assert (law.max() > 0.01) == gives
    assert (port.min() < -1e-2) == gives


def test_at_125_hz_the_law_is_no_longer_passive_against_a_stiff_wall() -> None:
    _, port, law = energies(bench(125, WALLS["stiff wall"]))
    print(f"\n| stiff wall | 125 | {port.max():.2f} | | {law.max():.3f} | |")
    assert law.max() > 0.01
    assert port.min() > -1e-3  # friction still takes it
