"""The simulated stream: truth, muscles and sines; blocks without a hole; NaN, loss, and what its outlet sends."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.zenoh import Still, bound

from srl.drivers.lsl import LslConfig
from srl.runtime.contracts.errors import DeviceLostError, HostError, WiringError
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.world import World
from srl.sim.devices.lsl import twin
from srl.sim.devices.lsl.fake import FakeLsl, FakeLslOptions
from srl.sim.world.cell import Cell, CellConfig

MS = 1_000_000
SIGNALS: dict[str, Any] = {
    "position": {"channels": {"a": "A", "b": 7}, "unit": "rad", "sent": "degrees"},
    "samples": {"channels": {"a": "A"}, "unit": "rad", "sent": "degrees", "block": 16},
}


def fake(world: World | None = None, streamed: dict[str, Any] = SIGNALS, **options: Any) -> FakeLsl:
    given: dict[str, Any] = {"stream": {"source_id": "x"}, "rate": 500, "signals": streamed, "count": 8}
    made = FakeLsl("amp", LslConfig.model_validate(given), world or Still(), FakeLslOptions(**options))
    bound(made)
    made.open()
    return made


def test_every_sample_is_in_a_block() -> None:
    made, last = fake(amplitude=0.5, period=1.0), 0.0
    for k in range(1, 60):
        made.world.advance(k * 20 * MS)
        made.read(10**12 + made.world.time)
        count = made.state_arrays["count"][0]
        assert count - last == (10 if k > 2 else count - last)
        last = count
    taken = (made.world.time - 10 * MS) * 1e-9 - np.arange(16)[::-1] / 500
    np.testing.assert_allclose(made.state_arrays["samples"][:, 0], 0.5 * np.sin(2 * np.pi * taken), atol=1e-9)
    assert made.health.stamp == 10**12 + made.world.time - 10 * MS


def test_truth_goes_by_name() -> None:
    names = {"position": {"channels": {"b": 2, "a": 1}, "unit": "rad", "sent": "rad"}}

    class Named(Still):
        def __init__(self) -> None:
            super().__init__()
            self.truth = (Signal(name="hand", shape=(2,), unit="rad", labels=("a", "b")),)
            self.bind({"hand": np.zeros(2)})

        def advance(self, until: int) -> None:
            super().advance(until)
            self.truth_arrays["hand"][:] = self.time * 1e-9, -self.time * 1e-9

    made = fake(Named(), names, signals={"position": "hand"}, delay=0.0)
    made.world.advance(100 * MS)
    made.read(0)
    np.testing.assert_allclose(made.state_arrays["position"], [-0.1, 0.1])
    with pytest.raises(WiringError, match="the world's truth has no 'hnad'"):
        fake(Named(), names, signals={"position": "hnad"})
    with pytest.raises(WiringError, match="has no signal 'x'"):
        fake(Named(), names, signals={"x": "hand"})


def test_emg_is_of_the_part_s_muscles() -> None:
    world = Cell(CellConfig(parts={"muscles": {"part": "muscles"}}), 0)
    emg = {"samples": {"channels": {"biceps": "A"}, "unit": "V", "block": 128}}
    made = fake(world, emg, part="muscles", mvc=1e-3)
    for k in range(1, 10):
        world.advance(k * 100 * MS)
        made.read(world.time)
    rest = np.sqrt(np.mean(made.state_arrays["samples"] ** 2))
    assert 1e-6 < rest < 1e-5  # tone and electronics
    world.parts["muscles"].activation = lambda _: 0.5  # type: ignore[attr-defined]
    for k in range(10, 20):
        world.advance(k * 100 * MS)
        made.read(world.time)
    assert np.sqrt(np.mean(made.state_arrays["samples"] ** 2)) == pytest.approx(5e-4, rel=0.2)
    with pytest.raises(WiringError, match="no part 'nobody'"):
        fake(world, emg, part="nobody")


def test_nan_and_loss() -> None:
    made = fake(nan=((1.0, 2.0),), loss=((3.0, 4.0),))
    made.world.advance(990 * MS)
    made.read(0)
    assert made.health.message == ""
    made.world.advance(1500 * MS)
    made.read(0)
    assert "NaN" in made.health.message
    assert np.isfinite(made.state_arrays["position"]).all()
    made.world.advance(3500 * MS)
    with pytest.raises(DeviceLostError):
        made.read(0)


def test_the_outlet_sends_what_the_profile_asks_for_in_the_sender_s_units() -> None:
    sender = twin.LslTwin(fake())
    values = sender._sender(np.radians([10.0, 20.0, 30.0]))
    assert len(values) == 8
    assert (values[6], values[0]) == pytest.approx((20.0, 30.0))


def test_the_outlet_is_refused_where_others_could_reach_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("srl.runtime.contracts.exposure._addresses", lambda: ["192.0.2.7"])
    monkeypatch.setattr("srl.runtime.contracts.exposure.reachable", lambda: ["192.0.2.7"])
    with pytest.raises(HostError, match=r"at 192\.0\.2\.7.*unshare"):
        twin.LslTwin(fake()).open()
