"""The fakes of an OptiTrack system and of an Xsens suit give what the drivers read from their twins."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers import natnet, xsens
from helpers.twin import bound

from srl.runtime.contracts.errors import DeviceError, WiringError
from srl.sim.devices.natnet.fake import FakeNatNet
from srl.sim.devices.xsens_mvn.fake import FakeMvn
from srl.sim.world.cell import Cell, CellConfig

CASES: list[tuple[Any, dict[str, Any]]] = [
    (natnet, natnet.WANTED | {"unlabelled": 1}),
    (xsens, {"joints": ["RightElbow"], "centre_of_mass": True}),
]


def at_the_same_time(kit: Any, config: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """States of the fake and of the driver, of one simulated sample."""
    options = {"noise": 0.003, "delay": 0.0}
    made, new = (kit.motive, FakeNatNet) if kit is natnet else (kit.mvn, FakeMvn)
    with made(config, options) as bench, kit.opened(bench, config) as driver:
        kit.step(bench, driver, 3)
        twin_s = bench.twin.fake
        fake = bound(new(twin_s.name, twin_s.wanted if kit is natnet else twin_s.mvn, twin_s.world, twin_s.options))
        fake.open()
        # The twin's own fake has the samples; the new one is asked for the same.
        number = twin_s.newest()
        fake.fill(twin_s.sample(number), number)
        return fake.state_arrays, {name: np.array(values) for name, values in driver.state_arrays.items()}


@pytest.mark.parametrize(("kit", "config"), CASES, ids=["natnet", "xsens-mvn"])
def test_fake_and_twin_give_the_same(kit, config):
    fake, driver = at_the_same_time(kit, config)
    assert fake.keys() == driver.keys()
    for name, values in driver.items():
        np.testing.assert_allclose(fake[name], values, atol=2e-6, err_msg=name)


def test_a_simulated_motive_refuses_as_the_driver_does():
    for wanted, output in (
        ({"segments": {"tool": "Dril"}}, "no subject 'Dril'"),
        ({"segments": {"tool": "Drill/Tip"}}, "no segment 'Tip'"),
        ({"segments": {"tool": "Drill"}, "rate": 240}, "100 frames a second"),
    ):
        fake = natnet.motive(wanted).twin.fake
        with pytest.raises(DeviceError, match=output):
            fake.open()


def test_a_suit_needs_one_person():
    world = Cell(CellConfig.model_validate({"parts": {"thing": {"part": "box", "size": [0.1, 0.1, 0.1]}}}), seed=1)
    with pytest.raises(WiringError, match="0 persons"):
        FakeMvn("suit", FakeMvn.real.Config(port="udp://:9763"), world, FakeMvn.Options())
