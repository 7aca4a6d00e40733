"""A suit's errors differ from sample to sample: they are in the place of a segment, and in its speed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.blame import Wearer

from srl.control.skeleton.body_clearance import BodyClearance, BodyClearanceConfig
from srl.runtime.contracts.clearance import Braking
from srl.runtime.contracts.rotation import product
from srl.runtime.contracts.signals import Array, Command, Kind

MS = 1_000_000
STEP = 16 * MS  # a suit of 60 Hz
TURNED = 0.012  # rad, by which an upper arm is beside where it is, to one side and the other


def judge(**options: Any) -> BodyClearance:
    config = BodyClearanceConfig(**({"least": 0.02, "uncertainty": 0.0} | options))
    command = Command(name="c", shape=(7,), unit="rad", kind=Kind.POSITION, labels=config.arms.arms.labels)
    made = BodyClearance("guard.c.clear", config, command)
    wearer = Wearer(config, np.random.default_rng(0), 1.0)
    made.bind({"rotation": wearer.aside(), "translation": wearer.translation.copy()})
    return made


def turned(rotation: Array, joint: int, angle: float) -> Array:
    made = rotation.copy()
    made[joint] = product(rotation[joint], (np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)))
    return made


def motion(k: int) -> Braking:
    """A motion that brakes within 0.1 s, another one at each sample."""
    rng = np.random.default_rng(k)
    start, way = rng.uniform(-0.8, 0.2, 7), rng.uniform(-0.06, 0.06, 7)
    start[4], way[4] = 0.03, 0.1 * way[4]
    path = start + np.linspace(0.0, 1.0, 4)[:, None] * way
    return Braking(path, np.array([0.0, 0.04, 0.08, 0.14]), way / 0.1, np.zeros(7))


def errors(made: BodyClearance, exact: BodyClearance, past: list[Array]) -> tuple[float, float]:
    """m: the greatest of this sample, and the greatest change since one that is `span` older or less."""
    past.append(made._motion.ends - exact._motion.ends)
    near = past[-6:]
    return float(np.linalg.norm(near[-1], axis=-1).max()), max(
        float(np.linalg.norm(near[-1] - each, axis=-1).max()) for each in near
    )


def judged(noise: str) -> tuple[int, float]:
    """Of a wearer whose upper arm is off to both sides in turn: motions, and by how much more margin one seems to have.

    noise: measured, zero, or none is declared.
    """
    exact, reported = judge(), judge()
    joint = exact.options.figure.labels.index("RightArm")
    wearer = Wearer(exact.options, np.random.default_rng(4), 1.0)
    past: list[Array] = []
    worst, most, count = 0.0, -np.inf, 0
    found: list[tuple[float, float]] = []
    for trial in range(2):  # first the errors are measured, then they are declared
        if trial:
            u, change = (max(each) for each in zip(*found, strict=True))
            given = {"measured": change, "zero": 0.0, "none": None}[noise]
            exact, reported = judge(), judge(uncertainty=u, noise=given)
        for k in range(90):
            now = 10_000 * MS + k * STEP
            pose = wearer.rotation(k * STEP * 1e-9)
            exact.input["rotation"][:] = pose
            reported.input["rotation"][:] = turned(pose, joint, TURNED * (-1) ** (k // 2))
            stamps = {"rotation": now, "translation": now}
            usable = exact.begin(now, stamps), reported.begin(now, stamps)
            if k > 0:
                found.append(errors(reported, exact, past))
            if trial and all(usable):
                exact.clear(motion(k)), reported.clear(motion(k))
                count += 1
                worst = reported.margin - exact.margin
                most = max(most, worst)
    return count, most


@pytest.mark.parametrize("noise", ["measured", "none"])
def test_what_is_declared_of_errors_never_makes_a_motion_look_clearer_than_it_is(noise: str) -> None:
    count, most = judged(noise)
    assert count > 50
    assert most <= 1e-9


def test_the_place_alone_isnt_enough() -> None:
    """Else the test above would say nothing."""
    assert judged("zero")[1] > 1e-3


def test_a_limb_that_repeats_itself_goes_on_as_it_was_seen_last() -> None:
    """A suit hangs while a hand comes: the hand counts as coming until it is seen to stand."""
    made = judge(repeat=0.1)
    joint = made.options.figure.labels.index("RightArm")
    start = made.input["rotation"].copy()
    speeds = []
    for k in range(60):
        now = 10_000 * MS + k * 10 * MS
        made.input["rotation"][:] = turned(start, joint, 0.02 * min(k, 40))
        made.begin(now, {"rotation": now, "translation": now})
        speeds.append(float(made._pace.max()))
    assert speeds[39] > 0.5  # m/s
    assert speeds[49] == speeds[40] == pytest.approx(speeds[39], rel=0.05)


def test_joints_that_repeat_themselves_in_turn_make_no_speed_old() -> None:
    """Shoulder and forearm change in every other sample each: what is known of the hand's speed is never too little."""
    exact, turns = judge(), judge(repeat=0.05)
    joints = [exact.options.figure.labels.index(name) for name in ("RightArm", "RightForeArm")]
    wearer = Wearer(exact.options, np.random.default_rng(4), 1.0)
    a_e = np.zeros_like(exact._pace)
    a_e[exact._segments] = exact._a_e
    missing = []
    for k in range(120):
        now = 10_000 * MS + k * 10 * MS
        pose = wearer.rotation(k * 0.01)
        exact.input["rotation"][:] = pose
        held = turns.input["rotation"][joints[k % 2]].copy()
        turns.input["rotation"][:] = pose
        turns.input["rotation"][joints[k % 2]] = held
        usable = [each.begin(now, {"rotation": now, "translation": now}) for each in (exact, turns)]
        if k > 20 and all(usable):
            bound = np.zeros_like(a_e)
            bound[turns._segments] = turns._swing.T
            off = np.linalg.norm(turns._velocity - exact._velocity, axis=-1) - bound
            missing.append(float(off[turns._compared].max()))
    assert len(missing) > 50
    assert max(missing) < 0.2  # m/s: what is left is the place that `repeat` declares new, over the window


def test_an_undeclared_noise_is_remarked() -> None:
    assert any("noise" in line for line in judge(uncertainty=0.02).remarks())
    assert not any("noise" in line for line in judge(uncertainty=0.02, noise=0.001).remarks())
