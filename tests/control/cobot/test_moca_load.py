"""What MOCA carries: told, identified, dropped."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.control import bound
from helpers.superman import MocaRig
from scipy.spatial.transform import Rotation

from srl.control.cobot.moca_impedance import MocaImpedance, MocaImpedanceConfig
from srl.control.cobot.whole_body import WholeBody
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots import PANDA


@pytest.mark.slow
def test_a_load_sags_untold_and_is_held_when_told() -> None:
    sagged = []
    for payload in (None, {"mass": 3.0}):
        rig = MocaRig(payload=payload, admittance={"leash": None})
        rig.step(200)
        start = rig.tip
        rig.chain.press("G")
        before, steps = rig.chain.law.output["torque"].copy(), []
        for k in range(4000):
            rig.push[2] = -29.43 * min(k / 300, 1.0)  # lifted off the table
            rig.step()
            rig.chain.press()
            steps.append(np.abs(rig.chain.law.output["torque"] - before).max())
            before = rig.chain.law.output["torque"].copy()
        sagged.append(start[2] - rig.tip[2])
        assert max(steps) < 0.5
    assert 0.9 * 0.0589 < sagged[0] < 1.02 * 0.0589
    assert abs(sagged[1]) < 0.001


def test_an_identified_loads_weight_comes_in_and_goes_without_a_step_and_is_there_after_a_reset() -> None:
    law = bound(MocaImpedance("m", MocaImpedanceConfig(payload="identified")))
    law.input["q"][:] = PANDA.home
    law.input["pose"][3] = law.input["desired_pose"][3] = 1.0
    body = WholeBody(PANDA, np.eye(4), np.eye(4))
    body.update(np.concatenate([np.zeros(3), PANDA.home]))
    law.input["jacobian"][:] = body.jacobian

    def weight(mass: float, com: list[float]) -> Array:
        """(7,) N m that hold it: by the Jacobian of its middle, which the law doesn't use."""
        J = body.jacobian[:, 3:]
        R = Rotation.from_quat(np.array(body.orientation)[[1, 2, 3, 0]])
        moved = J[:3] + np.cross(J[3:].T, R.apply(com)).T
        return moved.T @ [0, 0, 9.81 * mass]

    law.reset()
    empty = law.output["torque"].copy()
    changes: list[float] = []

    def run(cycles: int) -> Array:
        for _ in range(cycles):
            before = law.output["torque"].copy()
            law.update(1e-3)
            changes.append(float(np.abs(law.output["torque"] - before).max()))
        return law.output["torque"] - empty

    law.input["load"][:] = 2.0, 0.05, 0.0, 0.1
    held = weight(2.0, [0.05, 0.0, 0.1])
    assert np.abs(run(1)).max() < 0.1 < np.abs(held).max()
    np.testing.assert_allclose(run(300), held, atol=1e-9)
    law.input["load"][0] = np.nan
    np.testing.assert_allclose(run(3), held, atol=1e-9)
    law.input["load"][:] = 0.0
    np.testing.assert_allclose(run(30), 0.0, atol=1e-9)
    assert max(changes) < 1.0  # N m in 1 ms: the arm's torque rate
    law.input["load"][:] = 2.0, 0.05, 0.0, 0.1
    law.reset()  # somebody supports it already
    np.testing.assert_allclose(law.output["torque"] - empty, held, atol=1e-9)


@pytest.mark.slow
def test_a_dropped_load_throws_the_arm_up_when_it_was_assumed_and_not_when_it_was_identified() -> None:
    thrown = []
    for payload in ({"mass": 3.0}, "identified"):
        rig = MocaRig(payload=payload, admittance={"leash": None})
        rig.step(200)
        rig.chain.press("G")
        law, heights = rig.chain.law, []
        before, largest = law.output["torque"].copy(), 0.0
        for k in range(1600):
            rig.push[2] = -29.43 * min(k / 300, 1.0) if k < 1200 else 0.0
            rig.step()
            rig.chain.press()
            heights.append(rig.tip[2])
            largest = max(largest, float(np.abs(law.output["torque"] - before).max()))
            before = law.output["torque"].copy()
        if payload == "identified":
            assert rig.chain.payload is not None
            assert rig.chain.payload.metrics()["contacts"] == 0
            assert rig.chain.payload.output["load"][0] < 0.1
        assert largest < 1.0  # N m in 1 ms: the arm's torque rate
        thrown.append(max(heights[1200:]) - heights[1199])
        assert abs(heights[1199] - heights[0]) < 0.003  # it was held
    assert thrown[0] > 0.04
    assert thrown[1] < 0.015
