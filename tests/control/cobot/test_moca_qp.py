"""MOCA's program: equal to the closed form where no limit is active, within limits where one is, without steps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.control import bound
from helpers.superman import MOUNT, Chain, MocaRig
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.control.cobot import whole_body_qp
from srl.control.cobot.moca_impedance import MocaImpedance, MocaImpedanceConfig
from srl.control.cobot.moca_qp import MocaQp, MocaQpConfig
from srl.control.cobot.tool_pose import ToolPose, ToolPoseConfig
from srl.control.cobot.whole_body import ArmDynamics
from srl.control.cobot.whole_body_qp import Nearest
from srl.runtime.contracts import rotation
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots import PANDA

TOOL = bound(ToolPose("tool", ToolPoseConfig()), mount=MOUNT)
DYNAMICS = ArmDynamics(PANDA, rotors=True)
WIDE = {
    "speed": None,
    "base_speed": None,
    "acceleration": 1e9,
    "base_acceleration": (1e9, 1e9, 1e9),
    "approach": 0.001,
    "margin": 0.0,
}
DT = 1e-3
seeds = st.integers(0, 2**32 - 1)


def qp(**options: Any) -> MocaQp:
    law = bound(MocaQp("moca", MocaQpConfig(**options)))
    law.applied = {"base_twist": np.zeros(3)}
    return law


def measured(*laws: MocaImpedance, q: Array, qd: Array, base: Array, twist: Array) -> None:
    given = {"q": q, "qd": qd, "base_pose": base, "base_twist": twist}
    for name, value in given.items():
        TOOL.input[name][:] = value
    TOOL.update(0.0)
    for law in laws:
        for name, value in {**given, **TOOL.output}.items():
            if name in law.input:
                law.input[name][:] = value


def anywhere(rng: np.random.Generator, *laws: MocaImpedance) -> None:
    """A random state and a random wish."""
    q = rng.uniform(PANDA.q_lower + 0.1, PANDA.q_upper - 0.1)
    qd = rng.uniform(-0.3, 0.3, 7)
    measured(*laws, q=q, qd=qd, base=rng.uniform(-3, 3, 3), twist=rng.uniform(-0.3, 0.3, 3))
    wish, twist = laws[0].input["pose"].copy(), rng.normal(0, 0.2, 6)
    wish[:3] += rng.normal(0, 0.05, 3)
    turn = rotation.exp(*rng.normal(0, 0.2, 3).tolist())
    wish[3:] = rotation.product(turn, tuple(wish[3:].tolist()))
    mode, applied = rng.integers(2), rng.uniform(-0.3, 0.3, 3)
    for law in laws:
        law.input["desired_pose"][:], law.input["desired_twist"][:] = wish, twist
        law.input["modes"][3] = mode
        law.applied["base_twist"][:] = applied  # type: ignore[index]


def test_one_word_of_a_profile_chooses() -> None:
    mine, other = qp(), bound(MocaImpedance("moca", MocaImpedanceConfig()))
    assert mine.inputs == other.inputs
    assert mine.outputs == other.outputs
    assert mine.parameters == other.parameters
    assert set(MocaImpedanceConfig.model_fields) < set(MocaQpConfig.model_fields)
    for name in set(MocaImpedanceConfig.model_fields) - {"rotors"}:
        assert getattr(MocaQpConfig(), name) == getattr(MocaImpedanceConfig(), name)


@settings(max_examples=30, deadline=None)
@given(seeds, st.floats(-2, 2).map(lambda e: 10**e), st.floats(-2, 2).map(lambda e: 10**e))
def test_without_active_limits_it_is_the_closed_form(seed: int, eta_B: float, eta_A: float) -> None:
    weights = {"base": eta_B, "arm": eta_A, "posture": 5.0}
    options: dict[str, Any] = {"manipulation": weights, "locomotion": {**weights, "posture": 50.0}}
    mine = qp(**options, limits=WIDE)
    mine._effort = np.full(7, np.inf)
    other = bound(MocaImpedance("moca", MocaImpedanceConfig(rotors="all", **options)))
    other.applied = {"base_twist": np.zeros(3)}
    rng = np.random.default_rng(seed)
    anywhere(rng, mine, other)
    mine.reset()
    other.reset()
    for _ in range(5):
        anywhere(rng, mine, other)
        mine.update(DT)
        other.update(DT)
        for name, value in other.output.items():
            np.testing.assert_allclose(mine.output[name], value, rtol=1e-6, atol=1e-6)
    assert mine.metrics()["limited"] == 0


@settings(max_examples=15, deadline=None)
@given(seeds, st.floats(-1, 1).map(lambda e: 10**e), st.floats(-1, 1).map(lambda e: 10**e))
def test_the_solver_itself_agrees_with_the_closed_form(seed: int, eta_B: float, eta_A: float) -> None:
    """One limit that is only just touched, so that the program is solved: the rest stays where it was."""
    weights = {"base": eta_B, "arm": eta_A, "posture": 5.0}
    mine = qp(manipulation=weights, locomotion=weights, limits=WIDE)
    mine._effort = np.full(7, np.inf)
    rng = np.random.default_rng(seed)
    anywhere(rng, mine)
    mine.input["modes"][3] = 0
    mine.reset()
    mine.update(DT)
    want = {name: value.copy() for name, value in mine.output.items()}
    assert mine.metrics()["limited"] == 0
    mine._effort[2] = abs(mine.output["torque"][2]) * (1 - 1e-9)
    mine.update(DT)
    assert mine.metrics()["limited"] == 0.5
    for name, value in want.items():
        np.testing.assert_allclose(mine.output[name], value, rtol=1e-6, atol=1e-6)


@pytest.mark.slow
@settings(max_examples=3, deadline=None)
@given(seeds, st.floats(0.3, 1.0))
def test_limits_are_kept_whatever_is_wished_for(seed: int, effort: float) -> None:
    """The arm as its model says, the base as it is told; wishes jump about."""
    rng = np.random.default_rng(seed)
    law = qp(limits={"effort": effort}, stiffness=(2000, 2000, 2000, 100, 100, 100))
    c = law._config.limits  # type: ignore[attr-defined]
    V, A = np.array(c.base_speed), np.array(c.base_acceleration)
    q, qd, base, twist = np.array(PANDA.home), np.zeros(7), np.zeros(3), np.zeros(3)
    measured(law, q=q, qd=qd, base=base, twist=twist)
    law.input["desired_pose"][:] = law.input["pose"]
    law.reset()
    for k in range(600):
        if k % 150 == 0:
            law.input["desired_pose"][:3] = law.input["pose"][:3] + rng.normal(0, 0.4, 3)
            law.input["modes"][3] = rng.integers(2)
        law.update(DT)
        tau = law.output["torque"]
        assert (np.abs(tau) <= effort * PANDA.tau_max + 1e-9).all()
        a = DYNAMICS.inverse_mass(q) @ (tau - DYNAMICS.bias(q, qd, gravity=False, coriolis=True))
        step = law.output["base_twist"] - twist
        assert (np.abs(step) <= A * DT + 1e-9).all()
        twist = law.output["base_twist"].copy()
        assert (np.abs(twist) <= V + 1e-9).all()
        law.applied["base_twist"][:] = twist
        if law.metrics()["too_weak"] == 0:
            assert (np.abs(a) <= PANDA.ddq_max + 1e-5).all()
        q, qd = q + DT * qd + DT * DT / 2 * a, qd + DT * a
        co, si = np.cos(base[2]), np.sin(base[2])
        base = base + DT * np.array([co * twist[0] - si * twist[1], si * twist[0] + co * twist[1], twist[2]])
        if law.metrics()["too_weak"] == 0:
            assert (np.abs(qd) <= PANDA.dq_max + 1e-6).all()
            assert (q >= PANDA.q_lower).all()
            assert (q <= PANDA.q_upper).all()
        measured(law, q=q, qd=qd, base=base, twist=twist)
    assert law.metrics()["solver_failures"] == 0
    assert law.metrics()["limited"] > 0.05  # type: ignore[operator]


class Seen(Nearest):
    """Keeps what was asked and what was answered."""

    def __call__(self, *args: Any, **options: Any) -> Array | None:
        self.asked = [np.array(a) for a in args]
        self.answer = super().__call__(*args, **options)
        return self.answer


def test_the_whole_bodys_limits_meet_in_one_point_and_the_task_comes_first() -> None:
    """With and without the base's help for a joint at its limit: with it the tool misses less."""
    rng, better = np.random.default_rng(5), 0
    for _ in range(60):
        law = qp(limits={"priority": 1e8, "base_acceleration": (50, 50, 50), "base_speed": None})
        law._nearest = seen = Seen(1e8)
        anywhere(rng, law)
        law.reset()
        law.update(DT)
        if not hasattr(seen, "asked") or seen.answer is None:
            continue
        A, Q, _, lower, upper, rows = seen.asked
        x = seen.answer
        both = np.concatenate([x, rows @ x])
        assert (both >= lower - 1e-6).all()
        assert (both <= upper + 1e-6).all()
        alone = lower.copy(), upper.copy()
        for k in range(3):  # the base does what the closed form says
            alone[0][k], alone[1][k] = min(0, upper[k]), max(0, lower[k])
        fixed = Nearest(1e8)(A, Q, seen.asked[2], *alone, rows)
        missed = np.sum(Q * (A @ x) ** 2)
        if fixed is not None:
            assert missed <= np.sum(Q * (A @ fixed) ** 2) * (1 + 1e-6) + 1e-6
        better += 1
    assert better > 10


def test_torques_too_weak_for_the_limits_still_have_an_answer() -> None:
    law = qp(limits={"effort": 0.01})
    measured(law, q=PANDA.home, qd=PANDA.dq_max, base=np.zeros(3), twist=np.zeros(3))
    law.input["desired_pose"][:] = law.input["pose"]
    law.reset()
    law.update(DT)
    assert (np.abs(law.output["torque"]) <= 0.01 * PANDA.tau_max + 1e-9).all()
    assert law.metrics()["too_weak"] == 1
    assert law.metrics()["solver_failures"] == 0


def test_a_solver_that_fails_gives_a_damped_stop_and_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    law = qp()
    qd = np.array([0.5, -0.4, 0.3, -0.5, 0.6, -0.2, 0.4])
    measured(law, q=PANDA.home, qd=qd, base=np.zeros(3), twist=np.zeros(3))
    law.input["desired_pose"][:] = law.input["pose"]
    law.input["desired_pose"][:3] += 0.5
    law.applied["base_twist"][:] = 0.3
    law.reset()
    nothing = np.zeros(10)
    monkeypatch.setattr(whole_body_qp.daqp, "solve", lambda *_, **__: (nothing, 0.0, -1, {}))
    law.update(DT)
    bias = DYNAMICS.bias(PANDA.home, qd, gravity=False, coriolis=True)
    a = DYNAMICS.inverse_mass(PANDA.home) @ (law.output["torque"] - bias)
    assert (a * qd < 0).all()
    assert (np.abs(a) <= PANDA.ddq_max + 1e-9).all()
    assert (law.output["base_twist"] < 0.3).all()
    assert (law.output["base_twist"] >= 0.3 - DT * np.array([0.6, 0.6, 1.5]) - 1e-9).all()
    assert law.metrics()["solver_failures"] == 1


def test_it_begins_with_nothing_on_top_of_gravity_compensation() -> None:
    law = qp()
    measured(law, q=PANDA.home, qd=np.zeros(7), base=np.zeros(3), twist=np.zeros(3))
    law.input["desired_pose"][:] = law.input["pose"]
    law.reset()
    for name in ("torque", "base_twist", "force"):
        np.testing.assert_allclose(law.output[name], 0, atol=1e-12)


# -- in MuJoCo


@pytest.mark.slow
@pytest.mark.parametrize(("push", "mode"), [((-15, 0, 0), ""), ((0, 0, -15), ""), ((0, 0, -15), "P")])
def test_dragged_to_the_arms_limits_it_stays_within_them_and_smooth(push: tuple[float, ...], mode: str) -> None:
    """By 15 N until the arm can go no further, then let go. `moca-impedance` runs into the end stops here."""
    rig = MocaRig()
    rig.chain = Chain(MocaQp("moca", MocaQpConfig()), "panda")
    rig.chain.reset(*rig._measured())
    rig.chain.press("A", *mode)
    torque, base, q = [], [], []
    for k in range(4500):
        w, x, y, z = rig.chain.tool.output["pose"][3:].tolist()
        hand = rotation.turned(rotation.conjugate((w, x, y, z)), (push[0], push[1], push[2]))
        rig.chain.wrench[:3] = hand if 0 < k < 3500 else 0.0
        rig.step()
        rig.chain.press()
        law = rig.chain.law
        torque.append(law.output["torque"].copy())
        base.append(law.output["base_twist"].copy())
        q.append(rig.arm.position.copy())
    assert law.metrics()["limited"] > 0.05  # type: ignore[operator]
    assert law.metrics()["solver_failures"] == 0
    room = np.minimum(np.array(q) - PANDA.q_lower, PANDA.q_upper - np.array(q))
    assert room.min() > 0.01
    assert np.abs(np.diff(torque, axis=0)).max() < 1.0  # N m in 1 ms: what the Panda allows
    assert (np.abs(np.diff(base, axis=0)) <= np.array([0.6, 0.6, 1.5]) * 1e-3 + 1e-9).all()
