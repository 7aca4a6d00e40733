"""The simulated SoftHand by its contract door."""

import numpy as np
import pytest
from helpers.ft import bound

from srl.drivers.softhand import SoftHand
from srl.drivers.softhand.config import SoftHandConfig
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Stop
from srl.sim.devices.softhand.fake import FakeSoftHand, FakeSoftHandOptions
from srl.sim.parts.robots.softhand import SoftHandConfig as PartOptions
from srl.sim.parts.robots.softhand import SoftHandPart
from srl.sim.world.cell import Cell, CellConfig

MS = 1_000_000


def fake(**options):
    parts = {"hand": (SoftHandPart, PartOptions())}
    world = Cell(
        CellConfig.model_construct(timestep=0.001, gravity=(0.0, 0.0, 0.0), floor=False, duration=None, parts=parts), 1
    )
    config = SoftHandConfig(port="/dev/null")
    return bound(FakeSoftHand("hand", config, world, FakeSoftHandOptions(**({"noise": 0.0} | options))))


def cycle(hand, closure=None, period=10 * MS):
    hand.world.advance(hand.world.time + period)
    hand.read(hand.world.time)
    if closure is not None:
        hand.command_arrays["position_command"][:] = closure
        hand.write(hand.world.time)
    return float(hand.state_arrays["position"][0])


def test_same_signals_as_the_driver():
    hand, real = fake(), SoftHand("hand", SoftHandConfig(port="/dev/null"))
    assert (hand.states, hand.commands) == (real.states, real.commands)
    assert hand.limits.keys() == real.limits.keys()


def test_it_moves_as_the_motor_does_and_isn_t_an_echo():
    hand = fake()
    hand.open()
    assert not hand.active
    path = [cycle(hand, 0.8) for _ in range(300)]
    assert hand.active
    assert path[5] < 0.2
    assert np.max(np.abs(np.diff(path))) < 0.03
    assert 0.6 < path[-1] < 0.85
    assert not np.isclose(path[-1], 0.8, atol=1e-6)  # the tendon pulls back
    assert hand.state_arrays["current"][0] > 0.01


def test_readings_are_ticks_and_late():
    hand = fake(delay=0.004, rate=200)
    hand.open()
    for _ in range(50):
        value = cycle(hand, 1.0)
    assert value * 19_000 == pytest.approx(round(value * 19_000), abs=1e-6)
    assert 4 * MS <= hand.world.time - hand.health.stamp < 10 * MS


def test_a_command_beyond_the_range_or_no_number():
    hand = fake()
    hand.open()
    cycle(hand, 3.0)
    full = hand.part.commanded
    cycle(hand, np.nan)
    assert hand.part.commanded == full
    cycle(hand, -1.0)
    assert hand.part.commanded == 0.0


def test_limp_takes_the_power_and_the_next_command_gives_it_back():
    hand = fake()
    hand.open()
    for _ in range(50):
        cycle(hand, 0.5)
    hand.stop(Stop.HOLD)
    assert hand.active
    hand.stop(Stop.LIMP)
    assert not hand.active
    cycle(hand)
    assert hand.state_arrays["current"][0] == 0.0
    cycle(hand, 0.5)
    assert hand.active
    hand.close()
    assert not hand.active


def test_loss_windows():
    hand = fake(loss=((0.05, 0.1),))
    hand.open()
    for _ in range(4):
        cycle(hand, 0.4)
    with pytest.raises(DeviceLostError):
        cycle(hand, 0.4)
    hand.close()
    assert not hand.active  # its watchdog
    with pytest.raises(DeviceError):
        hand.open()
    hand.world.advance(110 * MS)
    hand.open()
    assert hand.health.reconnects == 1
    assert not hand.active


def test_a_restored_world_gives_the_same_bits():
    hand = fake(noise=5.0)
    hand.open()
    for _ in range(30):
        cycle(hand, 0.7)
    kept = hand.world.save()
    first = [cycle(hand, 0.7) for _ in range(30)]
    hand.world.restore(kept)
    assert first == [cycle(hand, 0.7) for _ in range(30)]
