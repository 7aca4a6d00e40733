"""Analog inputs of a Firmata board: values in the profile's unit, their age, and what is no reading."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from helpers.twin import Bench
from helpers.wait import until
from pydantic import ValidationError

from srl.drivers.firmata import Firmata
from srl.drivers.firmata.analog import Analog
from srl.drivers.firmata.config import AnalogConfig, FirmataConfig
from srl.sim.devices.examples import THING
from srl.sim.devices.firmata.fake import FakeFirmata, FakeFirmataConfig
from srl.sim.devices.firmata.twin import FirmataTwin
from srl.sim.world.cell import Cell, CellConfig
from srl.testing import Lab, bound

TOES = {"left": {"pin": 14, "gain": 50.0}, "right": {"pin": 16, "gain": 50.0, "offset": -1.0, "upper": 40.0}}


def config(**changes: Any) -> FirmataConfig:
    return FirmataConfig.model_validate({"port": "/dev/null", "analog": TOES, "analog_unit": "N"} | changes)


class Rig:
    """The driver on the twin of a board, in lockstep."""

    def __init__(self, plan: dict[str, Any]) -> None:
        world = Cell(CellConfig.model_validate({"parts": THING}), 1)
        self.fake = FakeFirmata("toes", config(), world, FakeFirmataConfig.model_validate({"analog": plan}))
        self.twin = FirmataTwin(self.fake)
        self.bench = Bench(self.twin)
        self.driver = bound(Firmata("toes", config(port=self.twin.address)))
        with self.bench.running():
            self.driver.open()

    def cycle(self, count: int) -> None:
        for _ in range(count):
            sent = self.twin.metrics()["bytes_out"]
            self.bench.run(0.01)
            if self.twin.metrics()["bytes_out"] != sent:
                frames = self.driver.health.frames
                until(
                    lambda frames=frames: self.driver.health.frames > frames,
                    lambda: self.driver.read(self.bench.now), pause=0.0,
                )  # fmt: skip
            self.driver.read(self.bench.now)


@pytest.fixture
def rig(request: pytest.FixtureRequest) -> Iterator[Rig]:
    made = Rig(getattr(request, "param", {"left": [[0, 0.0], [10, 1.0]], "right": [[0, 0.5]]}))
    yield made
    made.driver.close()
    made.twin.close()


def test_the_board_s_readings_are_the_state(rig: Rig) -> None:
    rig.cycle(100)
    t = rig.fake.world.time * 1e-9
    left, right = rig.driver.state_arrays["analog"]
    assert left == pytest.approx(50.0 * t / 10.0, abs=0.2)
    assert right == pytest.approx(24.0, abs=0.05)
    assert 0 <= rig.bench.now - rig.driver.health.stamp < 30_000_000
    assert rig.twin.firmware.seen["report_analog"] >= 2


@pytest.mark.parametrize("rig", [{"left": [[0, 0.2]], "right": [[0, 0.5], [2, 0.5], [2.000001, 0.9]]}], indirect=True)
def test_a_reading_beyond_its_bounds_makes_the_device_old(rig: Rig) -> None:
    until(lambda: rig.fake.world.time > 2.5e9, lambda: rig.cycle(10), pause=0.0)
    assert rig.bench.now - rig.driver.health.stamp > 300_000_000
    assert rig.driver.state_arrays["analog"][1] == pytest.approx(24.0, abs=0.05)
    assert "analog[right] 44" in rig.driver.health.message
    assert rig.driver.max_age == 0.2


def test_an_input_that_isnt_heard_makes_the_device_old() -> None:
    analog = Analog({name: AnalogConfig.model_validate(entry) for name, entry in TOES.items()}, 0.01)
    analog.take(0, 100, 5)
    assert analog.stamp == -1
    analog.take(2, 100, 6)
    assert analog.stamp == 5
    for now in range(7, 1000):
        analog.take(0, 100, now)
    assert analog.stamp == 6
    analog.take(2, 1024, 2000)  # beyond ten bits: garbled
    analog.take(1, 5, 2000)  # an input that isn't of the profile
    assert analog.stamp == 6


@pytest.mark.parametrize(
    ("entry", "words"),
    [({"pin": 13}, "14"), ({"pin": 22}, "21"), ({"pin": 14, "gain": 0}, "gain: 0"),
     ({"pin": 14, "lower": 2, "upper": 1}, "less than upper")],
)  # fmt: skip
def test_options_that_dont_fit_are_refused(entry: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        config(analog={"toe": entry})
    with pytest.raises(ValidationError, match="pin 14 is used twice"):
        config(buttons={"go": {"pin": 14}})


def test_a_foot_moves_a_limb_in_a_simulation() -> None:
    profile = {
        "name": "foot", "rate": 100, "devices": {
            "toes": {"driver": "firmata", "port": "/dev/null", "analog": TOES, "analog_unit": "N"}},
        "controllers": [{"use": "one-euro", "name": "smooth", "labels": ["left", "right"], "unit": "N",
                         "in": {"x": "toes.analog"}}],
        "sim": {"world": "cell", "parts": THING, "devices": {"toes": {"analog": {"left": [[0, 0.1], [4, 0.9]]}}}},
    }  # fmt: skip
    with Lab(profile) as lab:
        lab.run(3.0)
        left = lab.layout.value(lab.rows, "smooth.y")[:, 0]
    assert np.diff(left[50:]).min() > -1e-6
    assert left[-1] == pytest.approx(50.0 * (0.1 + 0.8 * 3.0 / 4.0), abs=2.0)
