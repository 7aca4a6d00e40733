"""The laws in C compute what the Python ones do: on any input, through resets, parameters, switches and NaNs.

`admittance` has the same order of operations, so the same bits. The others' sums are made otherwise by pinocchio and
Eigen: 1e-10 of a signal's scale in any posture, and no NaN more or less.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import pytest
from helpers.compiled import EXACT, ODD, Pair, difference, needs_c
from helpers.control import bound
from helpers.superman import MOUNT

from srl.control.cobot.admittance import Admittance, AdmittanceConfig
from srl.control.cobot.compiled_moca import CompiledMoca
from srl.control.cobot.kairos_clik import KairosClik, KairosClikConfig
from srl.control.cobot.moca_impedance import MocaImpedance, MocaImpedanceConfig
from srl.control.cobot.tool_pose import ToolPose, ToolPoseConfig
from srl.runtime.contracts.compiled import NotCompiledError, compiled
from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots import ARMS

pytestmark = needs_c
DT = 1e-3
TIMES = (2 * DT, 0.0, 0.027, 0.3)
TILTED = (0.2, -0.1, 0.5, *(np.array([0.8, 0.2, -0.3, 0.4]) / np.linalg.norm([0.8, 0.2, -0.3, 0.4])))


def quaternion(rng: np.random.Generator) -> Array:
    q = rng.normal(size=4)
    return np.array(q / np.linalg.norm(q))


def spoil(rng: np.random.Generator, value: Array, chance: float) -> Array:
    """Now and then, something in it that can't be."""
    if rng.random() < chance:
        value = np.array(value, float)
        value.flat[rng.integers(value.size)] = rng.choice(ODD)
    return value


def time(rng: np.random.Generator) -> float:
    """s; now and then another than the period."""
    return DT if rng.random() > 0.05 else float(rng.choice(TIMES))


ADMITTANCES: list[dict[str, Any]] = [
    {}, {"leash": None}, {"tank": None, "release": None}, {"release": {"draw_in": None}},
    {"calibration": {"bias": [1.0, -2.0, 0.5, 0.1, 0.0, -0.2], "tool_mass": 0.7, "tool_com": [0.01, 0.02, 0.09]},
     "mass": [1e-3, 2.0, 3.0, 0.01, 0.2, 5.0], "damping": [80.0, 1e-6, 3.0, 1e-4, 2.0, 0.1]},
]  # fmt: skip


@pytest.mark.parametrize("options", ADMITTANCES)
@pytest.mark.parametrize("seed", range(3))
def test_admittance(options: dict[str, Any], seed: int) -> None:
    rng = np.random.default_rng(seed)
    sensor = (0.1, -0.05, 0.02, *quaternion(rng))
    pair = Pair(lambda: bound(Admittance("guide", AdmittanceConfig.model_validate(options)), sensor=sensor))
    pose, modes = np.array([0.5, 0.2, 1.0, *quaternion(rng)]), np.zeros(4)

    def step(k: int) -> None:
        if rng.random() < 0.03:
            modes[:2] = rng.random(2) < 0.6
        if rng.random() < 0.03:
            pair.give(str(rng.choice(["scale", "damping", "leash"])), rng.uniform(0.3, 3.0), "param")
        # The robot follows, or stands; now and then it is somewhere else.
        made = pair.python.output["pose"]
        if np.isfinite(made).all() and rng.random() < 0.7 and made.any():
            pose[:] = made
        elif rng.random() < 0.05:
            pose[:3], pose[3:] = rng.normal(0, 1, 3), quaternion(rng)
        pair.give("wrench", spoil(rng, rng.choice([0.2, 20.0, 300.0]) * rng.normal(size=6), 0.03))
        pair.give("pose", spoil(rng, pose, 0.03))
        pair.give("twist", spoil(rng, rng.normal(0, 0.3, 6), 0.03))
        pair.give("modes", modes)

    for k in range(400):
        step(k)
        if k == 0 or rng.random() < 0.03:
            pair.reset()
        pair.step(time(rng))
        assert pair.same_bits() if EXACT else pair.gap() < 1e-10, k
    pair.fast.leave()
    assert pair.python.metrics() == pair.c.metrics()
    assert pair.fast.rare < 200  # most was computed in C


def postures(rng: np.random.Generator, robot: Any) -> Array:
    q = rng.uniform(robot.q_lower, robot.q_upper)
    if rng.random() < 0.2:  # stretched out, or folded: singular
        q = np.where(rng.random(robot.n) < 0.7, 0.0, q)
    return np.array(q)


@pytest.mark.parametrize("name", ["panda", "ur16e"])
def test_tool_pose(name: str) -> None:
    rng, robot = np.random.default_rng(1), ARMS[name]
    tool = (0.01, 0.02, 0.15, *quaternion(rng))
    pair = Pair(lambda: bound(ToolPose("tool", ToolPoseConfig(robot=robot)), mount=TILTED, tool=tool))

    def step(k: int) -> None:
        pair.give("q", spoil(rng, postures(rng, robot), 0.1))
        pair.give("qd", spoil(rng, rng.normal(0, 1, robot.n), 0.05))
        pair.give("base_pose", spoil(rng, rng.uniform(-4, 4, 3), 0.05))
        pair.give("base_twist", spoil(rng, rng.normal(0, 1, 3), 0.05))

    # A quaternion and its opposite mean the same: near w = 0 either may come.
    for k in range(400):
        step(k)
        pair.step(DT)
        a, b = pair.python.output["pose"][3:], pair.c.output["pose"][3:]
        if abs(a[0]) < 1e-9 and a @ b < 0:
            b *= -1
        assert pair.gap() < 1e-12, k
    assert pair.fast.rare < 150


MOCAS: list[dict[str, Any]] = [
    {}, {"unit_mass": True, "rotors": "none", "coriolis": False}, {"rotors": "all", "gravity": "here", "blend": 0.0},
    {"payload": {"mass": 2.0, "com": [0.02, 0.01, 0.1]}, "base_acceleration": [1.0, 1.0, 1.0]},
    {"payload": {"mass": 2.0, "com": [0.02, 0.01, 0.1]}, "gravity": "here", "payload_time": 0.01},
]  # fmt: skip


def moca(options: dict[str, Any], robot: Any, mount: Sequence[float]) -> MocaImpedance:
    law = bound(MocaImpedance("body", MocaImpedanceConfig.model_validate({"robot": robot, **options})), mount=mount)
    for name in ("torque", "base_twist"):
        law.applied = {**law.applied, name: np.zeros_like(law.output[name])}
    return law


@pytest.mark.parametrize("options", MOCAS)
@pytest.mark.parametrize("name", ["panda", "ur16e"])
def test_moca_impedance(options: dict[str, Any], name: str) -> None:
    rng, robot = np.random.default_rng(2), ARMS[name]
    mount = TILTED if name == "panda" else MOUNT
    pair = Pair(lambda: moca(options, robot, mount))
    tool = bound(ToolPose("tool", ToolPoseConfig(robot=robot)), mount=mount)
    modes = np.zeros(4)

    def step(k: int) -> None:
        if rng.random() < 0.05:
            modes[2:] = rng.random(2) < 0.5
        if rng.random() < 0.03:
            pair.give(str(rng.choice(["stiffness", "damping"])), rng.uniform(0.5, 1.5), "param")
        tool.input["q"][:], tool.input["qd"][:] = postures(rng, robot), rng.normal(0, 1, robot.n)
        tool.input["base_pose"][:], tool.input["base_twist"][:] = rng.uniform(-4, 4, 3), rng.normal(0, 1, 3)
        tool.update(DT)
        for key in ("q", "qd", "base_pose"):
            pair.give(key, spoil(rng, tool.input[key], 0.02))
        for key in ("pose", "twist", "jacobian"):
            pair.give(key, spoil(rng, tool.output[key], 0.02))
        away = np.array([*rng.normal(0, 0.1, 3), *quaternion(rng)])
        pair.give("desired_pose", spoil(rng, np.array([*(tool.output["pose"][:3] + away[:3]), *away[3:]]), 0.02))
        pair.give("desired_twist", spoil(rng, rng.normal(0, 0.3, 6), 0.02))
        pair.give("modes", modes)
        asked = pair.python.output["torque"]
        pair.give("torque", np.where(np.isfinite(asked), asked, 0.0) + rng.choice([0.0, 1.0]), "applied")
        pair.give("base_twist", rng.normal(0, 0.3, 3), "applied")

    def settle() -> None:
        """What each makes of the last bits must not add up: both go on from the Python's outputs."""
        for key, value in pair.python.output.items():
            pair.c.output[key][...] = value

    worst = 0.0
    for k in range(250):
        step(k)
        if k == 0 or rng.random() < 0.03:
            pair.reset()
        pair.step(time(rng))
        worst = max(worst, pair.gap())
        settle()
    pair.fast.leave()
    assert worst < 1e-10
    a, b = pair.python.metrics(), pair.c.metrics()
    assert a["strongest_force_n"] == pytest.approx(b["strongest_force_n"], rel=1e-10)
    assert (a["held_back"], a["near_singular"]) == (b["held_back"], b["near_singular"])
    assert pair.fast.rare < 150


KAIROS: list[dict[str, Any]] = [
    {}, {"speed": None, "damping": 0.0, "blend": 0.0},
    {"base_speed": [0.6, 0.5, 0.7], "base_acceleration": [1.0, 1.0, 1.0], "acceleration": 15.0, "speed": 0.7},
    {"base_acceleration": [0.1, 3.0, 0.2], "manipulability": 0.2},
    {"force_feedback": {"load": "identified", "carrying": {"force": 15.0, "torque": 3.0}}, "acceleration": 15.0},
    {"force_feedback": {"load": "identified", "firm": [1e-3, 1.0], "load_time": 0.003, "release": 0.01},
     "base_acceleration": [1.0, 1.0, 1.0]},
]  # fmt: skip


def kairos(options: dict[str, Any], robot: Any, guarded: bool) -> KairosClik:
    law = bound(KairosClik("body", KairosClikConfig.model_validate({"robot": robot, **options})))
    for name in ("velocity", "base_twist") if guarded else ():
        law.applied = {**law.applied, name: np.zeros_like(law.output[name])}
    return law


@pytest.mark.parametrize("options", KAIROS)
@pytest.mark.parametrize("name", ["panda", "ur16e"])
def test_kairos_clik(options: dict[str, Any], name: str) -> None:
    rng, robot = np.random.default_rng(3), ARMS[name]
    guarded = name == "ur16e"  # else what it has asked for last counts as sent
    pair = Pair(lambda: kairos(options, robot, guarded))
    tool = bound(ToolPose("tool", ToolPoseConfig(robot=robot)), mount=MOUNT)
    modes, reaching, pressed = np.zeros(4), 1.0, 0.0

    def step(k: int) -> None:
        nonlocal reaching, pressed
        if rng.random() < 0.05:
            modes[2:] = rng.random(2) < 0.5
        if rng.random() < 0.03:
            pair.give(str(rng.choice(["speed", "gain"])), rng.uniform(0.1, 1.0), "param")
        if rng.random() < 0.1:
            reaching, pressed = float(rng.choice([0.0, 0.01, 1.0])), float(rng.choice([0.1, 5.0, 200.0]))
        tool.input["q"][:], tool.input["base_pose"][:] = postures(rng, robot), rng.uniform(-4, 4, 3)
        tool.update(DT)
        for key in ("q", "base_pose"):
            pair.give(key, spoil(rng, tool.input[key], 0.01))
        for key in ("pose", "jacobian"):
            pair.give(key, spoil(rng, tool.output[key], 0.01))
        away = np.array([*rng.normal(0, 0.1, 3), *quaternion(rng)])
        pair.give("desired_pose", spoil(rng, np.array([*(tool.output["pose"][:3] + away[:3]), *away[3:]]), 0.01))
        pair.give("desired_twist", spoil(rng, reaching * rng.normal(0, 0.3, 6), 0.01))
        pair.give("modes", modes)
        if "outside" in pair.python.input:
            pair.give("outside", spoil(rng, pressed * rng.normal(size=6), 0.01))
        if guarded:
            pair.give("velocity", rng.normal(0, 0.3, robot.n), "applied")
            pair.give("base_twist", rng.normal(0, 0.3, 3), "applied")

    singular = 0
    for k in range(250):
        step(k)
        if k == 0 or rng.random() < 0.03:
            pair.reset()
        pair.step(time(rng))
        for key, a in pair.python.output.items():
            b = pair.c.output[key]
            if key == "manipulability":  # its zero is one of the Jacobian's last bits
                assert np.allclose(a, b, rtol=1e-12, atol=1e-12, equal_nan=True), k
                singular += a.item() < 1e-6
            elif key == "contact" and EXACT:
                assert np.array_equal(a, b, equal_nan=True), k
            else:
                assert difference(a, b) < 1e-10, (k, key)
            b[...] = a  # what each makes of the last bits must not add up
    pair.fast.leave()
    a, b = pair.python.metrics(), pair.c.metrics()
    assert a["least_manipulability"] == pytest.approx(b["least_manipulability"], abs=1e-12)
    assert (a["near_singular"], a["slowed"]) == (b["near_singular"], b["slowed"])
    assert singular > 5
    assert pair.fast.rare < 150


def test_what_it_does_not_do_is_named() -> None:
    with pytest.raises(NotCompiledError, match="only with an identified load"):
        compiled(kairos({"force_feedback": {}}, ARMS["ur16e"], False))
    with pytest.raises(NotCompiledError, match="identified"):
        CompiledMoca(moca({"payload": "identified"}, ARMS["panda"], MOUNT))
    with pytest.raises(NotCompiledError, match="force_age"):
        compiled(bound(Admittance("guide", AdmittanceConfig(force_age=0.02))))


def test_state_goes_to_c_and_back_without_loss() -> None:
    """Python and C take turns; the bits are those of Python alone."""
    law = lambda: bound(Admittance("guide", AdmittanceConfig()))  # noqa: E731
    pair = Pair(law)
    pair.give("pose", [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    pair.give("modes", [1.0, 1.0, 0.0, 0.0])
    pair.reset()
    for k in range(300):
        pair.give("wrench", [5.0 * np.sin(0.1 * k), 3.0, 0.0, 0.4, 0.0, 0.2])
        pair.python.update(DT)
        if k % 7 == 3:
            pair.fast.leave()
            cast(Controller, pair.c).update(DT)
        else:
            pair.fast.update(DT)
        assert pair.same_bits()
    assert pair.fast.rare == 0
