"""Parameters changed while the laws run: they are reached within the stated time, without a step in a command."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.control import bound
from helpers.superman import MOUNT

from srl.control.cobot.kairos_clik import KairosClik, KairosClikConfig
from srl.control.cobot.kairos_qp import KairosQp, KairosQpConfig
from srl.control.cobot.moca_impedance import MocaImpedance, MocaImpedanceConfig
from srl.control.cobot.moca_qp import MocaQp, MocaQpConfig
from srl.control.cobot.tool_pose import ToolPose, ToolPoseConfig
from srl.runtime.models.robots import PANDA, UR16E

DT = 1e-3


def standing(law: MocaImpedance | KairosClik, robot: str, q: np.ndarray) -> None:
    """The robot at q, 30 mm and 0.2 rad beside where it should be, and wanted to move."""
    tool = bound(ToolPose("tool", ToolPoseConfig(robot=robot)), mount=MOUNT)
    tool.input["q"][:] = law.input["q"][:] = q
    tool.update(0.0)
    for name, array in tool.output.items():
        if name in law.input:
            law.input[name][:] = array
    law.input["desired_pose"][:] = law.input["pose"]
    law.reset()
    law.input["desired_pose"][:3] += [0.03, 0.0, 0.0]
    law.input["desired_twist"][:] = [0.0, 0.2, 0.0, 0.0, 0.0, 0.3]


@pytest.mark.parametrize("made", [MocaImpedance, MocaQp])
@pytest.mark.parametrize(("name", "to"), [("stiffness", 1.5), ("stiffness", 0.2), ("damping", 0.5)])
def test_moca_s_stiffness_and_damping_change_without_a_step_in_force(
    made: type[MocaImpedance], name: str, to: float
) -> None:
    law = bound(made("moca", (MocaQpConfig if made is MocaQp else MocaImpedanceConfig)()))
    standing(law, "panda", PANDA.home)
    law.update(DT)
    first = law.output["force"].copy()
    law.param[name][()] = to
    steps, before = [], first
    for _ in range(1000):
        law.update(DT)
        steps.append(np.abs(law.output["force"] - before).max())
        before = law.output["force"].copy()
    assert max(steps) < 0.06  # N and N m in a millisecond
    K, D = (to, np.sqrt(to)) if name == "stiffness" else (1.0, to)
    pull = np.array([*MocaImpedanceConfig().stiffness]) * [0.03, 0.0, 0.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(before, K * pull + D * (first - pull), rtol=1e-9, atol=1e-9)
    assert steps[-1] == 0.0  # within a second


@pytest.mark.sampled(1)
@pytest.mark.slow
@pytest.mark.parametrize("made", [KairosClik, KairosQp])
def test_kairos_gain_and_speed_change_without_a_step(made: type[KairosClik]) -> None:
    law = bound(made("kairos", (KairosQpConfig if made is KairosQp else KairosClikConfig)(base_speed=(0.1, 0.1, 0.1))))
    standing(law, "ur16e", np.array(UR16E.home))
    law.input["desired_twist"][:3] = [0.0, 3.0, 0.0]  # more than it may
    for _ in range(500):
        law.update(DT)
    free, before, steps = law.output["velocity"].copy(), law.output["velocity"].copy(), []
    law.param["speed"][()], law.param["gain"][()] = 0.1, 4.0
    for _ in range(4000):
        law.update(DT)
        steps.append(np.abs(law.output["velocity"] - before).max())
        before = law.output["velocity"].copy()
    fastest = UR16E.dq_max
    assert 0.3 < (np.abs(free) / fastest).max() <= 1 + 1e-9
    assert (np.abs(before) / fastest).max() <= 0.1 * (1 + 1e-9)
    assert np.abs(law.output["base_twist"]).max() <= 0.01 * (1 + 1e-6)
    assert max(steps) <= 1.1 * DT * max(fastest)
    assert steps[-1] < 1e-6
