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

from srl.commissioning.calibration.glove.method import GloveMethod
from srl.commissioning.calibration.guide import Guide
from srl.commissioning.calibration.live import Live
from srl.commissioning.calibration.profile_subset import build
from srl.commissioning.calibration.request import CalibrationRequest
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

    def __init__(self, live: Live, reported: list[Instruction]) -> None:
        self._live, self._reported, self.channel_map = live, reported, live.channel_map

    def take(self) -> Rows:
        return self._live.take()

    def begin(self, procedure: Any) -> None:
        self._live.begin(procedure)
        self._reported.append(procedure.instruction())

    def close(self) -> None:
        self._live.close()


def method(text: str, sim: bool, *override: str) -> GloveMethod:
    checked, source = profile.parse("worn.yaml", text, override)
    order = CalibrationRequest("worn.yaml", "glove", option=OPTION, sim=sim)
    return GloveMethod(order, checked, source, Path("p07.json"), lambda _: None)


@pytest.mark.slow
def test_a_worn_glove_is_calibrated_live(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SRL_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    hidden = {n: {"gain": float(GAIN[i]), "offset": float(OFFSET[i])} for i, n in enumerate(NAMES[:19])}
    simulated = method(PROFILE, True, f"sim.devices.glove.characteristic={json.dumps(hidden)}")
    graph = build(*simulated.subset("P07"), sim=True)
    (fake,) = graph.devices
    world = graph.world
    assert isinstance(fake, FakeCyberGlove)
    assert world is not None
    assert world.wearer is not None
    wearer, reported = world.wearer, list[Instruction]()
    twin = CyberGloveTwin(fake)
    twin.open()
    start = time.monotonic_ns()

    def turn() -> None:
        if reported:
            wearer.instruct(reported.pop(0))
        now = time.monotonic_ns() - start
        world.advance(now)
        twin.service(now)

    lines: list[str] = []
    try:
        with repeating(turn, 0.005):
            made = method(PROFILE.replace("/dev/ttyUSB0", twin.address), False)
            checked, source = made.subset("P07")
            assert list(checked.devices) == ["glove"]
            live = Live(source, made.channel_map, checked.name, tmp_path / "live.rrd", False, lines.append)
            led = Led(live, reported)
            guide = Guide(led, made.procedure([]), Plain(lines.append), lambda: False)
            try:
                guide.run()
            finally:
                led.close()
    finally:
        twin.close()
    assert guide.first is not None
    found = made.compute(led.channel_map, guide.samples, led.channel_map.date(guide.first))
    assert [str(reason) for reason in found.refusals] == [], lines
    assert not found.simulated
    np.testing.assert_allclose(found.found.offset, OFFSET[:19], atol=1.0)
    np.testing.assert_allclose(found.found.gain, GAIN[:19], rtol=0.03)
    channel_map, rows = recorded(tmp_path / "live.rrd", made.channel_map)
    again = made.compute(channel_map, [channel_map.samples(rows)], channel_map.date(rows))
    assert made.record(again) == made.record(found)
    assert running() == []
