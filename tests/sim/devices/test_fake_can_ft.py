"""The simulated RFT by its contract door."""

import numpy as np
from helpers.ft import bound, cell, push

from srl.drivers.can_ft import CanFt
from srl.drivers.can_ft.driver import CanFtConfig
from srl.sim.devices.can_ft.fake import FakeCanFt, FakeCanFtOptions

MS = 1_000_000


def fake(options=None, **config):
    device = CanFtConfig(port="can://socketcan/can0", **config)
    return bound(FakeCanFt("ft", device, cell(), FakeCanFtOptions(**({"noise": 0.0} | (options or {})))))


def cycle(device, period=5 * MS):
    device.world.advance(device.world.time + period)
    device.read(device.world.time)
    return device.state_arrays["wrench"].copy()


def test_same_signals_as_the_driver():
    device = fake()
    assert device.states == CanFt("ft", device.config).states


def test_it_samples_at_the_device_s_rate():
    device = fake(rate=50)
    device.open()
    for _ in range(100):
        cycle(device, 10 * MS)
    assert device.health.frames in (49, 50, 51)


def test_it_resolves_a_count():
    device = fake()
    device.open()
    push(device.world, 1.234567, 0, 0, 0.12345, 0, 0)
    for _ in range(4):
        values = cycle(device)
    np.testing.assert_allclose(values[:4] * [50, 50, 50, 2000], np.rint(values[:4] * [50, 50, 50, 2000]), atol=1e-9)
    np.testing.assert_allclose(values[:4], [1.24, 0, 0, 0.1235], atol=1e-9)


def test_the_filter_is_a_low_pass_of_its_cutoff():
    device = fake(filter=10, rate=1000)
    device.open()
    cycle(device, 900 * MS)
    push(device.world, 50, 0, 0, 0, 0, 0)
    rise = [cycle(device, MS)[0] for _ in range(100)]
    begin = next(i for i, force in enumerate(rise) if force > 0)
    at_time_constant = rise[begin + 15]  # 1 / (2 pi 10 Hz) = 15.9 ms
    assert abs(at_time_constant - 31.6) < 1.5
    assert rise[-1] > 49.5


def test_a_restored_world_gives_the_same_bits_also_behind_the_filter():
    device = fake({"noise": 0.3}, filter=20)
    device.open()
    push(device.world, 30, 0, 0, 0, 0, 0)
    for _ in range(30):
        cycle(device)
    kept = device.world.save()
    first = [cycle(device) for _ in range(20)]
    device.world.restore(kept)
    np.testing.assert_array_equal(first, [cycle(device) for _ in range(20)])
