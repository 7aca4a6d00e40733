"""Kairos' program: equal to the closed form where no limit is active, within limits where one is, without steps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.control import bound
from helpers.superman import MOUNT, Chain, KairosRig
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from srl.control.cobot import whole_body_qp
from srl.control.cobot.kairos_clik import KairosClik, KairosClikConfig
from srl.control.cobot.kairos_qp import KairosQp, KairosQpConfig
from srl.control.cobot.tool_pose import ToolPose, ToolPoseConfig
from srl.control.cobot.whole_body_qp import ACCELERATION, Nearest
from srl.runtime.contracts import rotation
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots import UR16E

TOOL = bound(ToolPose("tool", ToolPoseConfig(robot="ur16e")), mount=MOUNT)
WIDE = {"acceleration": 1e9, "base_acceleration": (1e9, 1e9, 1e9), "margin": 0.0, "approach": 0.002}
DT = 0.002
seeds = st.integers(0, 2**32 - 1)


def qp(**options: Any) -> KairosQp:
    law = bound(KairosQp("kairos", KairosQpConfig(**options)))
    law.applied = {"base_twist": np.zeros(3), "velocity": np.zeros(6)}
    return law


def measured(*laws: KairosClik, q: Array, base: Array) -> None:
    for name, value in {"q": q, "base_pose": base}.items():
        TOOL.input[name][:] = value
    TOOL.update(0.0)
    for law in laws:
        for name, value in {"q": q, "base_pose": base, **TOOL.output}.items():
            if name in law.input:
                law.input[name][:] = value


def anywhere(rng: np.random.Generator, *laws: KairosClik, fast: float = 0.3) -> None:
    """A random state and a random wish."""
    measured(*laws, q=rng.uniform(-2.9, 2.9, 6), base=rng.uniform(-3, 3, 3))
    wish, twist = laws[0].input["pose"].copy(), rng.normal(0, fast, 6)
    wish[:3] += rng.normal(0, 0.1, 3)
    turn = rotation.exp(*rng.normal(0, 0.2, 3).tolist())
    wish[3:] = rotation.product(turn, tuple(wish[3:].tolist()))
    mode = rng.integers(2)
    for law in laws:
        law.input["desired_pose"][:], law.input["desired_twist"][:] = wish, twist
        law.input["modes"][3] = mode


def test_one_word_of_a_profile_chooses() -> None:
    for options in ({}, {"force_feedback": {}}):
        mine, other = qp(**options), bound(KairosClik("kairos", KairosClikConfig(**options)))
        assert mine.inputs == other.inputs
        assert mine.outputs == other.outputs
        assert mine.parameters == other.parameters
    for name in set(KairosClikConfig.model_fields) - {"base_speed"}:
        assert getattr(KairosQpConfig(), name) == getattr(KairosClikConfig(), name)


@settings(max_examples=60, deadline=None)
@given(seeds, st.floats(-2, 3).map(lambda e: 10**e), st.floats(-2, 2).map(lambda e: 10**e), st.booleans())
def test_without_active_limits_it_is_the_closed_form(seed: int, w_b: float, w_a: float, feedback: bool) -> None:
    weights = {"base": w_b, "arm": w_a, "posture": 1.0}
    options: dict[str, Any] = {"manipulation": weights, "locomotion": weights, "speed": None, "base_speed": None}
    if feedback:
        options["force_feedback"] = {"hand": False}
    mine = qp(**options, limits=WIDE)
    other = bound(KairosClik("kairos", KairosClikConfig(**options)))
    rng = np.random.default_rng(seed)
    anywhere(rng, mine, other)
    mine.reset()
    other.reset()
    for _ in range(5):
        anywhere(rng, mine, other)
        if np.abs(mine.input["q"]).max() > 2.8:  # near enough to the elbow's end to brake
            continue
        mine.update(DT)
        other.update(DT)
        for name, value in other.output.items():
            np.testing.assert_allclose(mine.output[name], value, rtol=1e-6, atol=1e-6)


@settings(max_examples=40, deadline=None)
@given(seeds)
def test_the_solver_itself_agrees_with_the_closed_form(seed: int) -> None:
    """One speed limit that is only just touched, so that the program is solved: the rest stays where it was."""
    mine = qp(speed=None, base_speed=None, limits=WIDE)
    rng = np.random.default_rng(seed)
    anywhere(rng, mine)
    measured(mine, q=rng.uniform(-1.5, 1.5, 6), base=np.zeros(3))
    mine.reset()
    mine.update(DT)
    want = {name: value.copy() for name, value in mine.output.items()}
    assert mine.metrics()["limited"] == 0
    mine._base_speed[1] = abs(mine.output["base_twist"][1]) * (1 - 1e-9)
    mine.update(DT)
    assert mine.metrics()["limited"] == 0.5
    for name, value in want.items():
        np.testing.assert_allclose(mine.output[name], value, rtol=1e-6, atol=1e-6)


class Seen(Nearest):
    """Keeps what was asked and what was answered."""

    def __call__(self, *args: Any, **options: Any) -> Array | None:
        self.asked = [np.array(a) for a in args]
        self.answer = super().__call__(*args, **options)
        return self.answer


@settings(max_examples=60, deadline=None)
@given(seeds)
def test_the_tool_misses_no_more_than_must_be(seed: int) -> None:
    """Against scipy's bounded least squares."""
    law = qp(limits={"priority": 1e8, "base_acceleration": (100, 100, 100), "acceleration": 500.0})
    law._nearest = seen = Seen(1e8)
    rng = np.random.default_rng(seed)
    anywhere(rng, law, fast=1.0)
    law.reset()
    law.update(DT)
    if not hasattr(seen, "asked"):
        return
    A, Q, W, lower, upper, _ = seen.asked
    root = np.sqrt(Q)[:, None] * A
    best = lsq_linear(root, np.zeros(6), (lower, np.maximum(upper, lower + 1e-9)), tol=1e-14, max_iter=1000)
    x = seen.answer
    assert x is not None
    # The bound of the priority: what is given away is the weights' cost over it at most.
    scaled = float((root * root).sum(axis=0).max() / W.diagonal().min())
    bound_ = scaled / 1e8 * float(best.x @ W @ best.x)
    assert np.sum((root @ x) ** 2) <= 2 * best.cost * (1 + 1e-6) + bound_ + 1e-7


@pytest.mark.slow
@settings(max_examples=3, deadline=None)
@given(seeds, st.sampled_from([0.0, 0.02]))
def test_limits_are_kept_whatever_is_wished_for(seed: int, lag: float) -> None:
    rng = np.random.default_rng(seed)
    rig = KairosRig(lag=lag)
    law = KairosQp("kairos", KairosQpConfig(gain=(5.0,) * 6))
    rig.chain = Chain(law, "ur16e")
    rig.chain.locked = True
    rig.chain.reset(rig.q, rig.qd, rig.base, rig.twist)
    V, A = np.array(law._base_speed), law._base_acceleration
    last, twist = np.zeros(6), np.zeros(3)
    for k in range(800):
        if k % 200 == 0:
            law.input["desired_pose"][:] = law.input["pose"]
            law.input["desired_pose"][:3] += rng.normal(0, 1.0, 3)
            rig.chain.keys.input["buttons"][3] = rng.integers(2)
        rig.step()
        v, w = law.output["velocity"].copy(), law.output["base_twist"].copy()
        assert (np.abs(v) <= UR16E.dq_max + 1e-9).all()
        assert (np.abs(w) <= V + 1e-9).all()
        assert (np.abs(v - last) <= ACCELERATION * DT + 1e-9).all()
        assert (np.abs(w - twist) <= A * DT + 1e-9).all()
        assert (rig.q <= UR16E.q_upper).all()
        assert (rig.q >= UR16E.q_lower).all()
        last, twist = v, w
    assert law.metrics()["limited"] > 0.05  # type: ignore[operator]
    assert law.metrics()["solver_failures"] == 0


@pytest.mark.slow
def test_the_base_takes_over_from_a_joint_at_its_limit() -> None:
    """The base turns for the shoulder, which may turn no further; the closed form goes on beyond the limit."""
    left = []
    for law in (qp(gain=(2.0,) * 6), bound(KairosClik("kairos", KairosClikConfig(gain=(2.0,) * 6)))):
        start = np.array(UR16E.home)
        start[0] = UR16E.q_upper[0] - 0.1
        rig = KairosRig(q=start)
        rig.chain = Chain(law, "ur16e")
        rig.chain.locked = True
        rig.chain.reset(rig.q, rig.qd, rig.base, rig.twist)
        pose = law.input["pose"].copy()
        rest = np.array([0.2, 0.0])  # the shoulder, about which the tool is to turn by 0.3 rad
        c, s = np.cos(0.3), np.sin(0.3)
        pose[:2] = rest + np.array([[c, -s], [s, c]]) @ (pose[:2] - rest)
        pose[3:] = rotation.product(rotation.exp(0, 0, 0.3), tuple(pose[3:].tolist()))
        law.input["desired_pose"][:] = pose
        rig.step(2500)
        left.append((np.linalg.norm(law.input["pose"][:3] - pose[:3]), rig.q[0]))
    assert left[0][0] < 0.01
    assert left[0][1] <= UR16E.q_upper[0]
    assert left[1][1] > UR16E.q_upper[0]


def test_a_solver_that_fails_brakes_and_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    law = qp()
    measured(law, q=UR16E.home, base=np.zeros(3))
    law.input["desired_pose"][:] = law.input["pose"]
    law.input["desired_twist"][:3] = 3
    before = np.array([0.5, -0.5, 0.3, 0.005, 0.0, -0.2])
    law.applied["velocity"][:] = before
    law.applied["base_twist"][:] = 0.3
    law.reset()
    np.testing.assert_allclose(law.output["velocity"], before)
    nothing = np.zeros(9)
    monkeypatch.setattr(whole_body_qp.daqp, "solve", lambda *_, **__: (nothing, 0.0, -1, {}))
    failures = law._nearest.failures
    law.update(DT)
    want = np.sign(before) * np.maximum(np.abs(before) - ACCELERATION * DT, 0)
    np.testing.assert_allclose(law.output["velocity"], want, atol=1e-12)
    np.testing.assert_allclose(law.output["base_twist"], 0.3 - DT * np.array([0.6, 0.6, 1.5]), atol=1e-12)
    assert law.metrics()["solver_failures"] == failures + 1


def test_it_begins_at_rest_and_gains_speed_within_its_limits() -> None:
    law = qp()
    measured(law, q=UR16E.home, base=np.zeros(3))
    law.input["desired_pose"][:] = law.input["pose"]
    law.input["desired_twist"][:3] = 0.5
    law.reset()
    np.testing.assert_array_equal(law.output["velocity"], 0)
    np.testing.assert_array_equal(law.output["base_twist"], 0)
    law.update(DT)
    assert np.abs(law.output["velocity"]).max() == pytest.approx(ACCELERATION * DT)


def test_a_measurement_that_is_no_number_leaves_nothing_behind() -> None:
    """Before, all later velocities were no numbers either, until the next reset."""
    law = qp()
    measured(law, q=UR16E.home, base=np.zeros(3))
    law.input["desired_pose"][:] = law.input["pose"]
    law.reset()
    law.input["desired_twist"][0] = np.nan
    law.update(DT)
    assert np.isnan(law.output["velocity"]).all()  # the guard refuses it
    law.input["desired_twist"][0] = 0.0
    law.update(DT)
    np.testing.assert_allclose(law.output["velocity"], 0.0, atol=1e-9)
