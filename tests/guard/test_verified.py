"""The verified stop: what is accepted can be stopped from, on its path, before a disc doing its worst comes near."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.guard import PLACE, guard_of
from helpers.planar import LABELS, REACH, PlanarClearance, PlanarConfig, distances
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from runtime.contracts.clearance import Braking
from runtime.contracts.errors import WiringError
from runtime.contracts.signals import Array, Command, Kind, Stop
from runtime.guard import CommandGuard
from runtime.guard.base import LONGEST
from runtime.guard.verified import brake_together, stop_time

DT, V, A = 0.01, 2.0, np.array([6.0, 12.0])
A_H, C, LAG = 4.0, 0.02, 0.03
LIMITS: dict[str, Any] = {"velocity": V, "acceleration": A.tolist(), "lower": -3.0, "upper": 3.0}
points = st.tuples(st.floats(-0.7, 0.7), st.floats(-0.7, 0.7))
slow = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
wanted = st.tuples(st.floats(-3, 3), st.floats(-3, 3))


class Scene:
    """An arm that obeys each command `late` s later, and a disc that is seen `age` s late.

    `seen` and `speed` are the disc's as the clearance is told; tests move them.
    """

    def __init__(
        self, kind: Kind = Kind.POSITION, start: tuple[float, float] = (0.0, 0.0), late: int = 0, age: float = 0.02,
        tracking: float = 0.0, **limits: Any,
    ) -> None:  # fmt: skip
        command = Command(name="command", shape=(2,), unit="rad", kind=kind, labels=LABELS)
        self.clearance = PlanarClearance("guard.arm.clear", PlanarConfig(acceleration=A_H, least=C), command)
        self.disc, self.speed = np.array([9.0, 9.0]), np.zeros(2)
        self.clearance.bind({"centre": self.disc, "velocity": self.speed})
        self.guard: CommandGuard = guard_of(kind, 2, DT, **(LIMITS | limits))
        self.at, self.applied = np.array(start), np.zeros(2)
        self.guard.bind(self.applied, self.at)
        self.guard.keep_clear(self.clearance, LAG, np.full(2, tracking))
        self.guard.reset(self.at)
        self.age, self.now = age, 10_000_000_000
        rest = self.at.copy() if kind is Kind.POSITION else np.zeros(2)
        self.queue = [rest] * late

    @property
    def held(self) -> bool:
        assert self.guard.verified is not None
        return self.guard.verified.held

    def look(self, seen: bool = True) -> None:
        self.now += round(DT * 1e9)
        assert self.guard.verified is not None
        stamp = self.now - round(self.age * 1e9) if seen else -1
        self.guard.verified.begin(self.now, {"centre": stamp, "velocity": stamp}, 0.0)

    def step(self, desired: Any, seen: bool = True) -> None:
        self.look(seen)
        self.guard.step(np.array(desired, np.float64), None, DT)
        self._obey()

    def stop(self, category: Stop = Stop.HOLD) -> None:
        self.look()
        self.guard.stop(category, DT)
        self._obey()

    def _obey(self) -> None:
        self.queue.append(self.applied.copy())
        obeyed = self.queue.pop(0)
        if self.guard.command.kind is Kind.POSITION:
            self.at[:] = obeyed
        else:
            self.at += DT * obeyed

    def clearest(self) -> float:
        """The distance now."""
        return float(distances(self.at[None], self.disc)[0].min())


def worst(
    scene: Scene, states: list[tuple[float, float, float]], before: Array, push: Array, stall: float = 0.0
) -> float:
    """The least distance while the arm brakes from `states`, and the disc accelerates as much as it may.

    stall: s, by which the loop's next cycle is late.

    Every millisecond: the arm is where its command was LAG ago, or where the command is, whichever is nearer.
    """
    A_, J = A.tolist(), [np.inf, np.inf]
    T, step = stop_time([v for _, v, _ in states], A_), 0.001
    n = int(np.ceil((DT + stall + T + LAG) / step)) + 1
    command = []
    for t in np.arange(n) * step:
        if t < DT:
            command.append(before + (np.array([p for p, _, _ in states]) - before) * t / DT)
        else:
            late = max(t - DT - stall, 0.0)
            command.append(np.array([p for p, _, _ in brake_together(states, A_, J, late)]))
    lag = round(LAG / step)
    late = [before] * lag + command[: n - lag]
    centre, speed, least = scene.disc.copy(), scene.speed.copy(), np.inf
    for k in range(-int(scene.age / step), n):  # the disc moves since it was seen
        if k >= 0:
            least = min(least, distances(np.array([command[k], late[k]]), centre)[0].min())
        centre, speed = centre + step * speed + 0.5 * step * step * A_H * push, speed + step * A_H * push
    return float(least)


@pytest.mark.slow
@given(st.lists(st.tuples(wanted, points, slow), min_size=1, max_size=5), st.floats(0, 0.08), st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None, phases=[Phase.generate])
def test_whatever_was_accepted_can_be_stopped_from_before_the_disc_is_near(pieces, age, seed):
    """The arm may be anywhere between its command and LAG behind it; the disc heads for it as hard as it can."""
    rng = np.random.default_rng(seed)
    scene = Scene(age=age)
    for desired, centre, speed in pieces:
        scene.disc[:], scene.speed[:] = centre, speed
        if scene.clearest() < C:
            scene.disc[:] = 9.0
        for _ in range(15):
            before = scene.applied.copy()
            scene.step(desired)
            states = scene.guard._states
            if scene.held or scene.guard.verified.margin < 0 or not scene.guard.velocity.any():
                continue
            middle = np.array([0.3 * np.cos(before[0]), 0.3 * np.sin(before[0])])
            way = middle - scene.disc
            turn = rng.normal(size=2)
            for aim in (way / np.linalg.norm(way), turn / np.linalg.norm(turn)):
                for stall in (0.0, 4 * DT):
                    assert worst(scene, states, before, aim, stall) >= C - 1e-6


@given(st.lists(st.tuples(wanted, points, slow), min_size=1, max_size=8), st.sampled_from([0, 3]))
@settings(max_examples=40, deadline=None)
def test_the_limits_hold_and_the_command_never_jumps(pieces, late):
    scene = Scene(late=late)
    p, v = scene.applied.copy(), scene.guard.velocity.copy()
    for desired, centre, speed in pieces:
        scene.disc[:], scene.speed[:] = centre, speed
        for _ in range(20):
            scene.step(desired)
            q, u = scene.applied, scene.guard.velocity
            assert (abs(u - v) <= A * DT * (1 + 1e-6)).all()
            assert (abs(q - p - DT * (u + v) / 2) <= A * DT * DT / 4 * (1 + 1e-6)).all()
            assert (abs(q) <= 3 + 1e-9).all()
            p, v = q.copy(), u.copy()


def test_a_stop_leaves_the_line_neither_when_held_nor_when_told_to():
    """Without a clearance the joint with less to brake stops first, and the limb leaves its path."""
    off = {}
    for clear in (True, False):
        off[clear] = 0.0
        scene = Scene()
        if not clear:
            scene.guard.verified = None
        start, way = np.zeros(2), np.array([1.0, 0.2])
        scene.guard.reset(start)
        for k in range(40):
            if clear:
                scene.look()
            scene.guard.step(start + way * 0.5 * ((k + 1) / 40) ** 2, None, DT)
        assert scene.guard.velocity[0] > 0.5
        begin, direction = scene.applied.copy(), scene.guard.velocity / np.linalg.norm(scene.guard.velocity)
        while not scene.guard.at_rest:
            scene.guard.stop(Stop.HOLD, DT)
            gone = scene.applied - begin
            off[clear] = max(off[clear], float(np.linalg.norm(gone - gone @ direction * direction)))
    assert off[True] < 1e-12
    assert off[False] > 1e-3


@pytest.mark.parametrize("kind", [Kind.POSITION, Kind.VELOCITY])
def test_it_stops_before_a_disc_in_its_way_and_goes_on_when_that_is_gone(kind):
    scene = Scene(kind, start=(-1.0, 0.0))
    scene.disc[:] = 0.5, 0.0

    def go() -> None:
        scene.step((1.0, 0.0) if kind is Kind.POSITION else (0.8 if scene.at[0] < 1.0 else 0.0, 0.0))

    for _ in range(300):
        go()
        assert scene.clearest() >= C
    assert scene.held
    assert scene.guard.limited
    assert scene.clearest() < 0.06, "it comes as near as it may"
    assert not scene.guard.velocity.any()
    stopped = scene.at.copy()
    scene.disc[:] = 9.0
    go()
    assert 0 < scene.at[0] - stopped[0] <= A[0] * DT * DT * (1 + 1e-9)
    for _ in range(300):
        go()
    assert scene.at[0] == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("kind", [Kind.POSITION, Kind.VELOCITY])
@pytest.mark.parametrize("lost", ["missing", "old", "nan", "error"])
def test_without_good_data_it_comes_to_rest_and_goes_on_with_it(kind, lost, monkeypatch):
    scene = Scene(kind, start=(-1.0, 0.0))
    desired = (1.0, 0.5) if kind is Kind.POSITION else (0.8, 0.2)
    for _ in range(40):
        scene.step(desired)
    assert scene.guard.velocity.all()
    before = scene.guard.velocity.copy()
    if lost == "old":
        scene.age = 0.6
    if lost == "nan":
        scene.disc[:] = np.nan
    if lost == "error":
        monkeypatch.setattr(scene.clearance, "clear", lambda motion: 1 / 0)
    for _ in range(int(np.ceil(max(abs(before) / A) / DT)) + 1):
        scene.step(desired, seen=lost != "missing")
        assert scene.held
        assert scene.guard.velocity @ before >= 0
    assert not scene.guard.velocity.any()
    assert scene.guard.verified is not None
    assert ("ZeroDivisionError" if lost == "error" else "the disc isn't seen") in scene.guard.verified.why
    assert np.isnan(scene.guard.verified.margin)
    scene.age, scene.disc[:] = 0.02, 9.0
    monkeypatch.undo()
    scene.step(desired)
    assert not scene.held
    assert scene.guard.velocity.any()


def test_a_limb_that_is_too_near_may_creep_away_and_nothing_else():
    scene = Scene(start=(0.0, 0.0))
    scene.disc[:] = 0.3, 0.09  # 0.01 m from the first link, to its left
    scene.step((0.5, 0.0))
    assert scene.held
    assert not scene.guard.velocity.any()
    gap = scene.clearest()
    for _ in range(50):
        scene.step((-1.0, 0.0))
        assert not scene.held
        assert np.abs(scene.guard.velocity) @ REACH.max(axis=1) <= 0.02 + 1e-9 or scene.clearance.margin >= 0
        assert scene.clearest() >= gap
        gap = scene.clearest()
    for _ in range(800):
        scene.step((-1.0, 0.0))
    assert scene.at[0] == pytest.approx(-1.0, abs=1e-3), "once it is clear it goes at full speed"


def test_a_velocity_is_checked_as_if_the_next_cycle_were_late():
    """The limb goes on at what it was told, from where it was measured; then it brakes."""
    scene, seen = Scene(Kind.VELOCITY, start=(-1.0, 0.0)), list[Array]()
    judge = scene.clearance.clear

    def keep(motion: Braking) -> bool:
        seen.append(motion.path.copy())
        return judge(motion)

    scene.clearance.clear = keep  # type: ignore[method-assign]
    for _ in range(30):
        scene.step((0.5, 0.1))
    at = scene.at - DT * scene.applied
    assert seen[-1][0] == pytest.approx(at)
    assert seen[-1][1] == pytest.approx(at + (LAG + LONGEST * DT) * scene.applied)


def test_a_limb_that_was_pushed_aside_doesn_t_creep_into_what_pushed_it():
    """Its command is on one side of the disc, the limb on the other: away for one is nearer for the other."""
    scene = Scene()
    for _ in range(5):
        scene.step((0.0, 0.0))
    pushed = np.array([0.62, 0.0])
    scene.disc[:] = 0.3 * np.cos(0.3), 0.3 * np.sin(0.3)
    for _ in range(100):
        scene.at[:] = pushed
        scene.step((-1.0, 0.0))
        assert scene.held
    assert not scene.applied.any()
    scene.disc[:] = 0.3 * np.cos(0.45), -0.3 * np.sin(0.45)  # now it is on the other side of both
    for _ in range(100):
        scene.at[:] = pushed + scene.applied
        scene.step((1.0, 0.0))
    assert scene.applied[0] > 0.01


def test_the_slack_is_what_is_measured_where_that_is_more():
    scene = Scene(start=(-1.0, 0.0), tracking=0.01)
    assert scene.guard.verified is not None
    for _ in range(5):
        scene.step((-1.0, 0.0))
    for beside, slack in ((0.0, 0.01), (0.005, 0.01), (0.1, 0.1)):
        scene.at[1] = beside
        scene.look()
        scene.guard.step(np.array([-1.0, 0.0]), None, DT)
        assert scene.guard.verified._slack == pytest.approx([0.01, slack])


def test_the_slack_is_measured_while_the_guard_halts_too():
    """A hand takes the limb during a stop, or while the command is none: the first cycle after it must know."""
    for halt in ("stop", "nan"):
        scene = Scene(start=(-1.0, 0.0))
        assert scene.guard.verified is not None
        for _ in range(60):
            scene.step((1.0, 0.0))
        for _ in range(60):
            scene.stop() if halt == "stop" else scene.step((np.nan, 0.0))
        rest = scene.applied.copy()
        scene.at[0] -= 0.15
        scene.look()
        scene.guard.stop(Stop.HOLD, DT)
        assert scene.guard.verified._slack[0] == pytest.approx(0.15)
        scene.look()
        scene.guard.step(rest, None, DT)
        assert scene.guard.verified._slack[0] == pytest.approx(0.15)


def test_a_limb_late_by_the_lag_needs_no_more_slack_and_one_that_is_later_does():
    slack = {}
    for late in (0, 3, 6, 12):
        scene = Scene(start=(-1.0, 0.0), late=late)
        assert scene.guard.verified is not None
        most = 0.0
        for _ in range(60):
            scene.step((1.0, 0.5))
            most = max(most, float(scene.guard.verified._slack.max()))
        slack[late] = most
    assert slack[0] == slack[3] == 0.0
    assert slack[12] > slack[6] > 0.02


def test_retract_is_checked_too():
    scene = Scene(start=(-1.0, 0.0))
    scene.guard.rest = [1.0, 0.0]
    scene.disc[:] = 0.5, 0.0
    for _ in range(400):
        scene.stop(Stop.RETRACT)
        assert scene.clearest() >= C
        assert not scene.guard.at_rest
    assert scene.held
    scene.disc[:] = 9.0
    for _ in range(600):
        scene.stop(Stop.RETRACT)
    assert scene.guard.at_rest


def test_with_a_bounded_jerk_the_stop_that_is_carried_out_is_the_one_that_was_checked():
    scene = Scene(start=(-1.0, 0.0), jerk=200.0)
    seen: list[Braking] = []
    judge = scene.clearance.clear

    def keep(motion: Braking) -> bool:
        seen.append(Braking(motion.path.copy(), motion.until.copy(), motion.velocity.copy(), motion.slack.copy()))
        return judge(motion)

    scene.clearance.clear = keep  # type: ignore[method-assign]
    for _ in range(40):
        scene.step((1.0, 0.5))
    checked = seen[-1]
    assert not scene.held
    times = checked.until[1:] - LAG - LONGEST * DT
    at = [scene.applied.copy()]
    for _ in range(round(times[-1] / DT) + 2):
        scene.stop()
        at.append(scene.applied.copy())
    for i in range(2):
        planned = np.interp(DT * np.arange(len(at)), times, checked.path[1:, i])
        assert planned == pytest.approx(np.array(at)[:, i], abs=1e-3)


def test_a_torque_and_a_velocity_without_its_positions_are_refused():
    torque = guard_of(Kind.TORQUE, 2, velocity=1.0, effort=1.0, effort_rate=10.0, inertia=1.0)
    judge = Scene().clearance
    with pytest.raises(WiringError, match="how the limb brakes"):
        torque.keep_clear(judge, LAG, np.zeros(2))
    velocity = guard_of(Kind.VELOCITY, 2, velocity=1.0, acceleration=1.0)
    velocity.bind(np.zeros(2))
    with pytest.raises(WiringError, match=f"{PLACE}.*positions"):
        velocity.keep_clear(judge, LAG, np.zeros(2))


@given(st.lists(st.tuples(st.floats(-V, V), st.floats(-V, V)), min_size=1, max_size=20), st.floats(0, 0.3))
@settings(deadline=None)
def test_the_rest_of_a_stop_is_the_stop_of_the_rest(speeds, t):
    for v in speeds:
        states = [(0.1, v[0], 0.0), (-0.2, v[1], 0.0)]
        whole = brake_together(states, A.tolist(), [np.inf] * 2, t + 0.07)
        parts = brake_together(brake_together(states, A.tolist(), [np.inf] * 2, t), A.tolist(), [np.inf] * 2, 0.07)
        assert np.array(whole)[:, :2] == pytest.approx(np.array(parts)[:, :2], abs=1e-12)


@given(st.sampled_from([Kind.POSITION, Kind.VELOCITY]), st.sampled_from([None, 150.0]), st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None, phases=[Phase.generate])
def test_no_disc_within_its_acceleration_meets_an_arm_that_moves(kind, jerk, seed):
    """It hunts the arm, seen 20 ms late; the arm obeys 30 ms late. What is nearer than C finds the arm at rest, or
    creeping."""
    rng = np.random.default_rng(seed)
    scene = Scene(kind, start=(-2.0, 0.5), late=3, age=0.02, jerk=jerk)
    disc, speed, seen = rng.uniform(-0.8, 0.8, 2), np.zeros(2), []
    if distances(scene.at[None], disc)[0].min() < 0.1:
        disc += 2.0
    goal, hunts, moved = scene.at.copy(), True, 0
    for k in range(300):
        if k % 50 == 0:
            goal, hunts = rng.uniform(-2.5, 2.5, 2), rng.random() < 0.7
        seen.append((disc.copy(), speed.copy()))
        then = seen[max(k - 2, 0)]
        scene.disc[:], scene.speed[:] = then
        desired = goal if kind is Kind.POSITION else np.clip(3 * (goal - scene.at), -1.5, 1.5)
        before, near = scene.at.copy(), distances(scene.at[None], disc)
        scene.step(desired)
        push = near[1][0, near[0][0].argmin()] if hunts else rng.normal(size=2)
        if np.linalg.norm(speed) > 1.2:
            push = -speed  # so fast is no limb
        push = push / max(np.linalg.norm(push), 1e-9)
        disc, speed = disc + DT * speed + 0.5 * DT * DT * A_H * push, speed + DT * A_H * push
        quick = np.abs(scene.at - before) / DT @ REACH
        gap = np.minimum(near[0][0], distances(scene.at[None], disc)[0][0])
        assert ((quick <= 0.02 + 1e-6) | (gap >= C - 1e-6)).all(), (k, quick, gap)
        moved += bool(quick.max() > 0.1)
    assert moved > 0
