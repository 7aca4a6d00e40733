"""The simulated Net F/T by its contract door."""

import numpy as np
import pytest
from helpers.ft import at_sensor, bound, cell, push

from srl.drivers.ati_netft import AtiNetFt
from srl.drivers.ati_netft.config import AtiNetFtConfig
from srl.runtime.contracts.errors import DeviceError, DeviceLostError, WiringError
from srl.sim.devices.ati_netft.fake import FakeAtiNetFt, FakeAtiNetFtOptions

MS = 1_000_000


def fake(world=None, bias=False, name="ft", **options):
    config = AtiNetFtConfig(port="udp://192.168.1.1", bias=bias)
    return bound(FakeAtiNetFt(name, config, world or cell(), FakeAtiNetFtOptions(**options)))


def cycle(device, period=10 * MS):
    device.world.advance(device.world.time + period)
    device.read(device.world.time)
    return device.state_arrays["wrench"].copy()


def test_same_signals_as_the_driver():
    device = fake()
    assert device.states == AtiNetFt("ft", device.config).states
    assert device.states[0].frame == "sensor"
    assert not device.commands


def test_it_measures_pushes_with_delay_and_stamp():
    device = fake(noise=0.0, delay=0.003)
    device.open()
    cycle(device)
    push(device.world, 9, 0, 0, 0, 0, 0)
    first = cycle(device, 2 * MS)
    assert first[0] == 0.0
    assert device.health.stamp == device.world.time - 3 * MS
    np.testing.assert_allclose(cycle(device), at_sensor(device.world, 9, 0, 0, 0, 0, 0), atol=2e-6)


def test_noise_has_the_size_asked_for_and_repeats():
    def run(name):
        device = fake(name=name, noise=0.5)
        device.open()
        return np.array([cycle(device, MS) for _ in range(800)])

    one = run("ft")
    np.testing.assert_array_equal(one, run("ft"))
    assert not np.array_equal(one, run("other"))
    np.testing.assert_allclose(one[5:].std(axis=0), [0.5] * 3 + [0.01] * 3, rtol=0.15)


def test_saturated_samples_don_t_arrive():
    device = fake(noise=0.0, range=(50, 50, 50, 5, 5, 5))
    device.open()
    before = cycle(device)
    push(device.world, 60, 0, 0, 0, 0, 0)
    stamp, errors = device.health.stamp, device.health.errors
    for _ in range(5):
        after = cycle(device)
    assert device.health.stamp - stamp < 3 * MS
    assert device.health.errors >= errors + 45
    np.testing.assert_array_equal(after, before)


def test_offset_and_bias():
    offset = (4.0, 0, -20.0, 0, 0.3, 0)
    plain = fake(noise=0.0, offset=offset)
    plain.open()
    np.testing.assert_allclose(cycle(plain), offset, atol=1e-6)
    zeroed = fake(noise=0.0, offset=offset, bias=True)
    zeroed.open()
    np.testing.assert_allclose(cycle(zeroed), np.zeros(6), atol=1e-6)
    push(zeroed.world, 0, 2, 0, 0, 0, 0)
    zeroed.open()  # opened again under load: the zero stays
    cycle(zeroed)
    np.testing.assert_allclose(cycle(zeroed)[:3], [0, 2, 0], atol=1e-6)


def test_loss_windows():
    device = fake(loss=((0.05, 0.1),))
    device.open()
    for _ in range(4):
        cycle(device)
    with pytest.raises(DeviceLostError):
        cycle(device)
    with pytest.raises(DeviceError, match="doesn't answer"):
        device.open()
    device.world.advance(120 * MS)
    device.open()
    cycle(device)
    assert device.health.reconnects == 1


def test_a_restored_world_gives_the_same_bits():
    device = fake(noise=0.1)
    device.open()
    push(device.world, 3, 1, 0, 0, 0, 0)
    cycle(device)
    kept = device.world.save()
    first = [cycle(device) for _ in range(20)]
    device.world.restore(kept)
    np.testing.assert_array_equal(first, [cycle(device) for _ in range(20)])


def test_a_cell_without_a_sensor_is_said():
    world = cell()
    del world.parts["sensor"]
    with pytest.raises(WiringError, match=r"'ft' needs one part of kind FtSensorPart, the cell has none"):
        fake(world)
