"""A glove's calibration over the wire: the glove's twin, the driver, the cut profile as a service, the guide."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.background import repeating
from helpers.glove_calibration import GAIN, NAMES, OFFSET, PROFILE

from srl.commissioning.calibration.cut import build
from srl.commissioning.calibration.glove.method import GloveMethod
from srl.commissioning.calibration.guide import Guide
from srl.commissioning.calibration.live import Live
from srl.commissioning.calibration.order import Order
from srl.commissioning.calibration.screen import Plain
from srl.commissioning.calibration.sources import Rows, RowSource, recorded
from srl.runtime.contracts.wearer import Instruction
from srl.runtime.ipc.run_folder import running
from srl.runtime.profile import profile
from srl.sim.devices.cyberglove.fake import FakeCyberGlove
from srl.sim.devices.cyberglove.twin import CyberGloveTwin

OPTION = ("read=1", "hold=1", "settle=0.5")


class Led(RowSource):
    """A live run whose simulated hand is told what the person is."""

    def __init__(self, live: Live, told: list[Instruction]) -> None:
        self._live, self._told, self.taps = live, told, live.taps

    def take(self) -> Rows:
        return self._live.take()

    def begin(self, procedure: Any) -> None:
        self._live.begin(procedure)
        self._told.append(procedure.instruction())

    def close(self) -> None:
        self._live.close()


def method(text: str, sim: bool, *override: str) -> GloveMethod:
    checked, source = profile.parse("worn.yaml", text, override)
    order = Order("worn.yaml", "glove", option=OPTION, sim=sim)
    return GloveMethod(order, checked, source, Path("p07.json"), lambda _: None)


@pytest.mark.slow
def test_a_worn_glove_is_calibrated_live(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SRL_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    hidden = {n: {"gain": float(GAIN[i]), "offset": float(OFFSET[i])} for i, n in enumerate(NAMES[:19])}
    simulated = method(PROFILE, True, f"sim.devices.glove.characteristic={json.dumps(hidden)}")
    graph = build(*simulated.cut("P07"), sim=True)
    (fake,) = graph.devices
    world = graph.world
    assert isinstance(fake, FakeCyberGlove)
    assert world is not None
    assert world.wearer is not None
    wearer, told = world.wearer, list[Instruction]()
    twin = CyberGloveTwin(fake)
    twin.open()
    start = time.monotonic_ns()

    def turn() -> None:
        if told:
            wearer.instruct(told.pop(0))
        now = time.monotonic_ns() - start
        world.advance(now)
        twin.service(now)

    lines: list[str] = []
    try:
        with repeating(turn, 0.005):
            made = method(PROFILE.replace("/dev/ttyUSB0", twin.address), False)
            checked, source = made.cut("P07")
            assert list(checked.devices) == ["glove"]
            live = Live(source, made.taps, checked.name, tmp_path / "live.rrd", False, lines.append)
            led = Led(live, told)
            guide = Guide(led, made.procedure([]), Plain(lines.append), lambda: False)
            try:
                guide.run()
            finally:
                led.close()
    finally:
        twin.close()
    assert guide.first is not None
    found = made.compute(led.taps, guide.samples, led.taps.date(guide.first))
    assert [str(reason) for reason in found.refusals] == [], lines
    assert not found.simulated
    np.testing.assert_allclose(found.glove.offset, OFFSET[:19], atol=1.0)
    np.testing.assert_allclose(found.glove.gain, GAIN[:19], rtol=0.03)
    taps, rows = recorded(tmp_path / "live.rrd", made.taps)
    again = made.compute(taps, [taps.samples(rows)], taps.date(rows))
    assert made.record(again) == made.record(found)
    assert running() == []
