"""What a simulated Franka's controller feels, in C and in Python: two robots in two equal worlds, pushed alike."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.compiled import needs_c
from helpers.panda import Cabinet

from srl.drivers.panda.protocol import Status
from srl.drivers.panda.requests import SetEEToK, SetNEToEE
from srl.runtime.contracts import compiled as module
from srl.runtime.contracts.rotation import from_euler_xyz, homogeneous

pytestmark = needs_c


def transform(rng: np.random.Generator) -> tuple[float, ...]:
    """Any frame at most 0.1 m away, column by column."""
    placed = homogeneous((*rng.uniform(-0.1, 0.1, 3), *from_euler_xyz(*rng.uniform(-3.0, 3.0, 3))))
    return tuple(placed.T.ravel().tolist())


@pytest.mark.parametrize("seed", range(3))
def test_the_wrench_the_pose_and_what_is_touched(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(seed)
    pair = [Cabinet()]
    with monkeypatch.context() as without:
        without.setattr(module, "extension", None)
        pair.append(Cabinet())
    flange = pair[0].world.model.body("arm/flange").id
    touched, bits = set(), False
    for turn in range(6):
        if turn % 2:
            for command in (SetNEToEE(transform(rng)), SetEEToK(transform(rng))):
                assert all(cabinet.control.apply(command) is Status.SUCCESS for cabinet in pair)
        push = rng.normal(0.0, 40.0, 6) * (1.0, 1.0, 1.0, 0.1, 0.1, 0.1) * (turn > 0)
        for cabinet in pair:
            cabinet.world.data.xfrc_applied[flange] = push
        for _ in range(20):
            for cabinet in pair:
                cabinet.run(1)
            c, python = (cabinet.control for cabinet in pair)
            np.testing.assert_array_equal(c.external, python.external)
            np.testing.assert_allclose(c.pose, python.pose, atol=1e-12)
            np.testing.assert_allclose(c.wrench, python.wrench, atol=1e-9)
            np.testing.assert_array_equal(c.touching, python.touching)
            bits |= bool((c.wrench != python.wrench).any())
            touched.add(c.touching.tobytes())
    assert len(touched) > 3  # they went through several of the thresholds
    assert bits  # else both were computed alike: the extension here is older than this
