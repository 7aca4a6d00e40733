"""The simulated remote device: the world's truth or sines, sampled, noisy, late, lost; and the same in its twin."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.zenoh import Still, bound

from srl.drivers.zenoh import Zenoh, ZenohConfig
from srl.runtime.contracts.errors import DeviceLostError, WiringError
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.world import World
from srl.runtime.messages import messages
from srl.sim.devices.zenoh.fake import FakeZenoh, FakeZenohOptions
from srl.sim.devices.zenoh.twin import ZenohTwin

MS = 1_000_000
SIGNALS = {
    "position": {"key": "srl/other/state/glove/position", "shape": [2], "unit": "rad"},
    "pose": {"key": "robot/pose", "shape": [7], "unit": "m", "type": messages.POSE},
}


class Moving(Still):
    """A truth that is its own time in seconds."""

    def __init__(self, seed: int = 0) -> None:
        super().__init__(seed)
        self.truth = (Signal(name="hand", shape=(2,), unit="rad"),)
        self.bind({"hand": np.zeros(2)})

    def advance(self, until: int) -> None:
        super().advance(until)
        self.truth_arrays["hand"][:] = self.time * 1e-9


def fake(world: World | None = None, signals: dict[str, Any] = SIGNALS, **options: Any) -> FakeZenoh:
    config = ZenohConfig(port="tcp://127.0.0.1:7447", signals=signals)
    made = FakeZenoh("remote", config, world or Moving(), FakeZenohOptions(**options))
    bound(made)
    made.open()
    return made


def test_it_declares_what_the_driver_does() -> None:
    made = fake()
    real = Zenoh("remote", ZenohConfig(port="tcp://127.0.0.1:7447", signals=SIGNALS))
    assert (made.states, made.max_age) == (real.states, real.max_age)


def test_truth_and_sines_are_sampled_with_delay() -> None:
    made = _with_truth(rate=50.0, delay=0.03, period=2.0, amplitude=0.5)
    for k in range(1, 200):
        made.world.advance(k * 10 * MS)
        made.read(10**12 + made.world.time)
        if k < 4:
            continue
        number = (k * 10 - 30) // 20
        assert made.health.stamp == 10**12 + number * 20 * MS
        assert made.state_arrays["position"] == pytest.approx([number * 0.02] * 2, abs=1e-12)
        wave = 0.5 * np.sin(np.pi * number * 0.02 + 0.1 * np.arange(7))
        assert made.state_arrays["pose"] == pytest.approx(wave, abs=1e-9)
    assert made.health.frames == (1990 - 30) // 20 + 1


def _with_truth(**options: Any) -> FakeZenoh:
    config = ZenohConfig(port="tcp://127.0.0.1:7447", signals=SIGNALS)
    made = FakeZenoh("remote", config, Moving(), FakeZenohOptions(signals={"position": "hand"}, **options))
    bound(made)
    made.open()
    return made


def test_dropout_noise_and_loss_are_the_seeds() -> None:
    def trace(seed: int) -> tuple[list[bytes], int]:
        made = fake(Moving(seed), noise=0.1, dropout=0.3)
        rows = []
        for k in range(1, 100):
            made.world.advance(k * 10 * MS)
            made.read(made.world.time)
            rows.append(made.state_arrays["position"].tobytes())
        return rows, made.health.errors

    (one, lost), (same, _), (other, _) = trace(1), trace(1), trace(2)
    assert one == same != other
    assert 10 < lost < 50
    made = fake(loss=((0.1, 0.2),))
    made.world.advance(150 * MS)
    with pytest.raises(DeviceLostError):
        made.read(made.world.time)
    made.world.advance(250 * MS)
    made.open()
    made.read(made.world.time)
    assert made.health.stamp > 200 * MS


def test_a_restored_world_goes_on_from_there() -> None:
    made = _with_truth(delay=0.0)
    made.world.advance(500 * MS)
    state = made.world.save()
    made.read(0)
    made.world.advance(900 * MS)
    made.read(0)
    made.world.restore(state)
    made.world.advance(510 * MS)
    made.read(made.world.time)
    assert made.state_arrays["position"][0] == pytest.approx(0.51)
    assert made.health.stamp == 510 * MS


@pytest.mark.parametrize(
    ("signals", "output"),
    [({"position": "hnad"}, "Did you mean 'hand'"), ({"positon": "hand"}, "no signal"), ({"pose": "hand"}, "shape")],
)
def test_wrong_sources_are_refused(signals: dict[str, str], output: str) -> None:
    config = ZenohConfig(port="tcp://127.0.0.1:7447", signals=SIGNALS)
    with pytest.raises(WiringError, match=output):
        FakeZenoh("remote", config, Moving(), FakeZenohOptions(signals=signals))


def test_a_twin_says_what_it_cannot_send() -> None:
    joy = {"axes": {"key": "robot/joy", "shape": [2], "unit": "1", "type": "sensor_msgs/msg/Joy"}}
    with pytest.raises(WiringError, match="doesn't send"):
        ZenohTwin(fake(signals=joy))
