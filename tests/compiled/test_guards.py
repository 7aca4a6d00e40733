"""The guards in C leave the same bytes, flags and counts as the Python ones, whatever they are given."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.compiled import ODD, bits, needs_c
from helpers.guard import guard_of

from srl.runtime.contracts.compiled import NotCompiledError
from srl.runtime.contracts.signals import Array, Command, Kind, Limits, Stop
from srl.runtime.guard import GUARDS, CommandGuard
from srl.runtime.guard.compiled import compile_guard

pytestmark = needs_c
DT = 1e-3
FLAGS = ("rejected", "limited", "fallback", "resynchronised", "at_rest")
COUNTS = ("rejections", "limitations", "fallbacks", "resyncs")


class Side:
    """One of the two guards with its arrays."""

    def __init__(self, kind: Kind, n: int, given: dict[str, Any], measured: bool, gravity: bool, fast: bool) -> None:
        self.guard: CommandGuard = guard_of(kind, n, DT, rest=np.zeros(n) if measured else None, **given)
        names = ("asked", "rate", "applied", "position", "velocity", "sent", "gravity")
        self.arrays: dict[str, Array] = {name: np.zeros(n) for name in names}
        a = self.arrays
        self.guard.bind(a["applied"], a["position"] if measured else None, a["velocity"] if measured else None,
                        a["sent"], a["gravity"] if gravity else None)  # fmt: skip
        if fast:
            compile_guard(self.guard, a["asked"], a["rate"] if kind is Kind.POSITION else None)


def limits(rng: np.random.Generator, kind: Kind, n: int) -> dict[str, Any]:
    found: dict[str, Any] = {"velocity": rng.uniform(0.5, 3.0, n).tolist()}
    if kind is not Kind.TORQUE or rng.random() < 0.5:
        found["acceleration"] = rng.uniform(2.0, 40.0, n).tolist()
    if kind is Kind.TORQUE:
        found |= {
            "effort": 10.0,
            "effort_rate": rng.uniform(50.0, 3000.0),
            "inertia": rng.uniform(0.01, 0.5, n).tolist(),
        }
    if rng.random() < 0.7:
        found |= {"lower": rng.uniform(-2.0, -0.3, n).tolist(), "upper": rng.uniform(0.3, 2.0, n).tolist()}
    return found


@pytest.mark.parametrize("kind", [Kind.TORQUE, Kind.VELOCITY, Kind.POSITION])
@pytest.mark.parametrize("seed", range(12))
def test_both_guards_do_the_same(kind: Kind, seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.choice([1, 3, 7, 16]))
    given, gravity = limits(rng, kind, n), bool(rng.random() < 0.5)
    measured = kind is Kind.TORQUE or bool(rng.random() < 0.6) or (kind is Kind.VELOCITY and "lower" in given)
    sides = [Side(kind, n, given, measured, gravity, fast) for fast in (False, True)]
    fast, taken = sides[1].guard.fast, 0
    assert fast is not None
    position, phase, reported = np.zeros(n), rng.uniform(0, 6, n), kind is Kind.POSITION
    reach = {Kind.TORQUE: 12.0, Kind.VELOCITY: 2.0, Kind.POSITION: 0.15}[kind]
    # A position is followed at once, or planned, by how fast it moves; after a stop Python has it for a few cycles.
    wild, speed = (0.03, [0.03e-3, 1e-3, 4e-3][seed % 3]) if reported else (0.12, 4e-3)
    for k in range(250):
        chance = rng.random()
        values: dict[str, Array] = {
            "asked": reach * np.sin(speed * k * (1 + phase) + phase) * (1.0 if rng.random() > wild else rng.random()),
            "rate": reach * speed * (1 + phase) / DT * np.cos(speed * k * (1 + phase) + phase),
            "position": position, "velocity": rng.normal(0, 1.5, n), "gravity": rng.normal(0, 3, n),
        }  # fmt: skip
        if chance < wild:  # something that can't be in one of them
            name = rng.choice(list(values))
            values[name] = values[name].copy()
            values[name][rng.integers(n)] = rng.choice(ODD)
        sent = sides[0].arrays["applied"] if rng.random() > wild else rng.normal(0, 1, n)
        values["sent"] = np.array(sent) if rng.random() > wild / 4 else np.full(n, np.nan)
        left, unmeasured = bool(rng.random() < 0.8), bool(rng.random() < wild / 4)
        dt = DT if rng.random() > wild else float(rng.choice([2 * DT, 0.0, 0.3]))
        act = "reset" if k == 0 or chance > 0.985 else "stop" if 0.5 < chance < 0.5 + wild / 2 else "step"
        category = Stop(rng.choice([s.value for s in Stop]))
        start = np.clip(values["asked"], -0.2, 0.2) if np.isfinite(values["asked"]).all() else np.zeros(n)
        for side in sides:
            guard = side.guard
            for name, value in values.items():
                side.arrays[name][:] = value
            guard.unmeasured = unmeasured
            if act == "reset":
                guard.reset(start)
                continue
            with np.errstate(all="ignore"):
                guard.resynchronise(left, dt)
            if act == "stop":
                guard.stop(category, DT)
            else:
                guard.step(side.arrays["asked"], side.arrays["rate"] if reported else None, dt)
        position = position + DT * rng.normal(0, 1, n)
        taken += bool(getattr(fast, "_inside", False))
        a, b = (side.guard for side in sides)
        what = (k, act, category, values, dt)
        assert bits(sides[0].arrays["applied"]) == bits(sides[1].arrays["applied"]), what
        assert bits(a.velocity) == bits(b.velocity), what
        assert [getattr(a, f) for f in FLAGS] == [getattr(b, f) for f in FLAGS], what
        assert [getattr(a, f) for f in COUNTS] == [getattr(b, f) for f in COUNTS], what
        assert bits(a.last_sent()) == bits(b.last_sent())
    assert taken > 5  # what is compared was computed in C


def test_a_command_of_another_array_is_pythons_and_loses_nothing() -> None:
    sides = [
        Side(Kind.VELOCITY, 2, {"velocity": 1.0, "acceleration": 5.0}, False, False, fast) for fast in (False, True)
    ]
    for side in sides:
        side.guard.reset(np.zeros(2))
        for k in range(20):
            asked = side.arrays["asked"] if k % 3 else np.empty(2)
            asked[:] = 0.5, -2.0
            side.guard.step(asked, None, DT)
    assert bits(sides[0].guard.applied) == bits(sides[1].guard.applied)
    assert sides[0].guard.limitations == sides[1].guard.limitations > 0


def test_arrays_bound_anew_are_the_guards() -> None:
    side = Side(Kind.VELOCITY, 2, {"velocity": 1.0, "acceleration": 5.0}, False, False, True)
    side.guard.reset(np.zeros(2))
    side.guard.step(side.arrays["asked"], None, DT)
    other = np.zeros(2)
    side.guard.bind(other)
    side.arrays["asked"][:] = 1.0
    side.guard.step(side.arrays["asked"], None, DT)
    assert other.tolist() == [5e-3, 5e-3]
    assert not side.arrays["applied"].any()


def test_what_it_does_not_do_is_named() -> None:
    with pytest.raises(NotCompiledError, match="jerk"):
        Side(Kind.POSITION, 2, {"velocity": 1.0, "acceleration": 5.0, "jerk": 100.0}, False, False, True)
    with pytest.raises(NotCompiledError, match="17 joints"):
        Side(Kind.VELOCITY, 17, {"velocity": 1.0, "acceleration": 5.0}, False, False, True)


@pytest.mark.parametrize("far", [0.3, 1e10, 1e14, -1e99, 1e200])
def test_a_joint_that_may_not_move_and_a_target_beyond_all_reason_are_as_in_python(far: float) -> None:
    """Two joints without position limits; a device may give one a velocity limit of zero."""
    given = Limits(velocity=np.array([0.0, 4.0]), acceleration=np.array([40.0, 40.0]))
    command = Command(name="c", shape=(2,), unit="rad", kind=Kind.POSITION)
    guards = [GUARDS[command.kind]("guard.c", command, given, DT) for _ in range(2)]
    asked, rate = np.zeros(2), np.zeros(2)
    compile_guard(guards[1], asked, rate)
    taken = 0
    for guard in guards:
        guard.reset(np.array([0.0, 0.01]))
    for k in range(200):
        asked[:] = far if k % 50 < 25 else 0.2
        for guard in guards:
            guard.step(asked, rate, DT)
        a, b = guards
        assert bits(a.applied) == bits(b.applied)
        assert bits(a.velocity) == bits(b.velocity)
        assert [getattr(a, c) for c in COUNTS] == [getattr(b, c) for c in COUNTS]
        taken += bool(getattr(b.fast, "_inside", False))
    assert taken > 5


def at_rest(inertia: float) -> list[Side]:
    """A torque guard of one joint, kg m2 at least, in Python and in C; it begins at rest."""
    given = {"velocity": 2.0, "effort": 10.0, "effort_rate": 2000.0, "inertia": inertia}
    sides = [Side(Kind.TORQUE, 1, given, True, False, fast) for fast in (False, True)]
    for side in sides:
        side.guard.reset(np.zeros(1))
    return sides


@pytest.mark.parametrize("category", [Stop.DAMP, Stop.HOLD])
def test_a_stop_in_c_knows_nothing_of_the_stop_before(category: Stop) -> None:
    """The homing before a motion is a stop, too: at rest, and as long as the slowest limb takes."""
    sides = at_rest(inertia=2.0)
    for cycle in range(1000):
        for side in sides:
            a = side.arrays
            speed = 0.0 if cycle < 200 else 1.5 * 0.999 ** max(cycle - 300, 0)
            a["velocity"][:], a["position"][:] = speed, a["position"] + speed * DT
            if 200 <= cycle < 300:
                side.guard.step(a["asked"], None, DT)
            else:
                side.guard.stop(Stop.HOLD if cycle < 200 else category, DT)
            if cycle >= 300:
                assert not side.guard.at_rest
        assert bits(sides[0].arrays["applied"]) == bits(sides[1].arrays["applied"])


@pytest.mark.parametrize("force", [0.1, 2.0])
def test_a_torque_that_is_no_number_is_held_as_in_python(force: float) -> None:
    """C is tried now and then meanwhile. That must not let go of what Python holds: the limb would creep."""
    sides = at_rest(inertia=0.5)
    for cycle in range(2500):
        for side in sides:
            a = side.arrays
            a["asked"][:] = 0.0 if cycle < 5 else np.nan
            side.guard.step(a["asked"], None, DT)
            if cycle >= 5:
                a["velocity"] += (a["applied"] + force) / 0.5 * DT
                a["position"] += a["velocity"] * DT
        assert bits(sides[0].arrays["applied"]) == bits(sides[1].arrays["applied"]), cycle
        if cycle == 1500:
            there = sides[1].arrays["position"].item()
    assert sides[1].arrays["position"].item() == pytest.approx(there, abs=1e-3)
