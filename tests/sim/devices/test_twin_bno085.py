"""The BNO085's driver, fake and twin: the same values through the wire, gaps, a sensor that hangs or begins anew."""

from __future__ import annotations

from math import degrees, radians
from typing import Any

import numpy as np
import pytest
from helpers.twin import Bench
from helpers.wait import until
from scipy.spatial.transform import Rotation

from srl.drivers.bno085 import Bno085, Bno085Config
from srl.drivers.bno085.protocol import Record, encode
from srl.drivers.transport import open_transport
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.sim.devices.bno085.fake import FakeBno085, FakeBno085Config
from srl.sim.devices.bno085.twin import Bno085Twin
from srl.sim.world.cell import Cell, CellConfig
from srl.testing import bound

MS = 1_000_000
EXACT = {"noise": 0.0, "delay": 0.0, "drift": 0.0}
ABOUT_X = [np.cos(0.2), np.sin(0.2), 0.0, 0.0]  # w x y z: 0.4 rad


def cell(quaternion: Any = (1, 0, 0, 0), **part: Any) -> Cell:
    imu = {"part": "imu", "at": {"position": [0, 0, 1], "quaternion": list(quaternion)}} | part
    return Cell(CellConfig.model_validate({"parts": {"imu": imu}}), seed=3)


def fake(world: Cell | None = None, config: dict[str, Any] | None = None, **options: Any) -> FakeBno085:
    settings = Bno085Config.model_validate({"port": "/dev/null"} | (config or {}))
    made = FakeBno085("imu", settings, world or cell(), FakeBno085Config.model_validate(EXACT | options))
    return bound(made)


def run(device: FakeBno085, seconds: float, step: int = 10) -> list[np.ndarray]:
    rows = []
    for _ in range(round(1000 * seconds / step)):
        device.world.advance(device.world.time + step * MS)
        device.read(device.world.time)
        rows.append(device.state_arrays["orientation"].copy())
    return rows


class Pair:
    """A twin, and our driver at its port."""

    def __init__(self, **options: Any) -> None:
        self.fake = fake(cell(ABOUT_X), **options)
        self.twin = Bno085Twin(self.fake)
        self.bench = Bench(self.twin)
        self.driver = bound(Bno085("imu", Bno085Config(port=self.twin.address)))
        with self.bench.running():
            self.driver.open()

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            self.bench.run(0.01)
            self.driver.read(self.bench.now)

    def close(self) -> None:
        self.driver.close()
        self.twin.close()


@pytest.fixture
def pair():
    made = []

    def make(**options: Any) -> Pair:
        made.append(Pair(**{"noise": 0.002} | options))
        return made[-1]

    yield make
    for one in made:
        one.close()


def test_at_rest_it_says_how_it_lies_and_what_holds_it():
    device = fake(cell(ABOUT_X))
    device.open()
    run(device, 1.0)
    w, x, y, z = device.state_arrays["orientation"]
    true = Rotation.from_rotvec([0.4, 0, 0])
    assert (true.inv() * Rotation.from_quat([x, y, z, w])).magnitude() < radians(0.01)
    np.testing.assert_allclose(device.state_arrays["acceleration"], true.inv().apply([0, 0, 9.81]), atol=0.012)


def test_yaw_drifts_and_roll_and_pitch_are_off_by_the_options():
    device = fake(cell(ABOUT_X), drift=0.1, yaw=0.5, tilt={"x": 0.02, "y": -0.01})
    device.open()
    run(device, 2.0)
    w, x, y, z = device.state_arrays["orientation"]
    measured = Rotation.from_quat([x, y, z, w])
    off = Rotation.from_rotvec([0, 0, 0.7]) * Rotation.from_rotvec([0.02, -0.01, 0])
    wanted = off * Rotation.from_rotvec([0.4, 0, 0])
    assert (wanted.inv() * measured).magnitude() < 0.002


def test_noise_depends_on_the_seed_and_the_sample_alone():
    rows = []
    for step in (10, 20):
        device = fake(noise=0.01)
        device.open()
        rows.append(run(device, 1.0, step)[-1])
    np.testing.assert_array_equal(rows[0], rows[1])
    device = fake(noise=0.01)
    device.open()
    turned = [2 * np.arccos(min(1.0, abs(row[0]))) for row in run(device, 5.0)]
    assert 0.008 < np.sqrt(np.mean(np.square(turned)) / 3) < 0.012


def test_silence_becomes_nan_after_hold_and_stale_later():
    device = fake(silent=[[0.5, 2.0]])
    device.open()
    assert np.isfinite(run(device, 0.58)[-1]).all(), "the last one stands for 0.1 s"
    assert np.isnan(run(device, 0.1)[-1]).all()
    assert device.health.connected
    assert device.health.stamp < 500 * MS
    assert np.isfinite(run(device, 1.5)[-1]).all()


def test_the_driver_reads_what_the_fake_gives(pair):
    p = pair(noise=0.003)
    p.run(1.0)
    p.fake.open()
    p.fake.read(p.bench.now)
    np.testing.assert_array_equal(p.driver.state_arrays["orientation"], p.fake.state_arrays["orientation"])
    np.testing.assert_array_equal(p.driver.state_arrays["acceleration"], p.fake.state_arrays["acceleration"])
    assert p.driver.health.frames >= 99
    assert (p.driver.health.errors, p.driver.health.resyncs) == (0, 0)
    assert p.bench.now - p.driver.health.stamp <= 20 * MS


def test_lost_samples_are_gaps(pair):
    p = pair(dropout=0.3)
    p.run(4.0)
    assert 80 < p.driver.metrics()["gaps"] < 160
    assert p.driver.metrics()["restarts"] == 0
    assert p.driver.health.errors == 0
    lag = p.bench.now - p.driver.health.stamp
    assert lag < 100 * MS


def test_it_begins_anew_after_a_dip_of_its_supply(pair):
    p = pair()
    p.run(0.9)  # the index is beyond zero and below half a turn, or it would seem to have gone on
    p.twin.restart()
    p.run(0.5)
    assert p.driver.metrics()["restarts"] == 1
    assert p.driver.health.resyncs == 1, "its text at the start"
    assert np.isfinite(p.driver.state_arrays["orientation"]).all()


def test_a_muted_sensor_is_nan_then_stale_then_lost(pair):
    p = pair()
    p.run(0.5)
    p.twin.muted = True
    p.run(0.2)
    assert np.isnan(p.driver.state_arrays["orientation"]).all()
    assert np.isnan(p.driver.state_arrays["acceleration"]).all()
    assert p.driver.health.connected
    with pytest.raises(DeviceLostError, match="no frames for 5 s"):
        p.run(5.5)
    assert not p.driver.health.connected


def test_an_unplugged_cable_is_a_loss(pair):
    p = pair()
    p.run(0.2)
    p.twin.close()
    with pytest.raises(DeviceLostError):
        p.run(0.2)


def opened(name: str, *records: Record) -> tuple[Any, Any]:
    cable = open_transport(f"loop://{name}", place="test")
    cable.write_all(encode(Record(0, 0, 0, 0, 0, 0, 1000)), 1.0)
    driver = bound(Bno085("imu", Bno085Config(port=f"loop://{name}")))
    driver.open()
    return cable, driver


def test_an_index_that_stands_still_is_an_old_frame():
    cable, driver = opened("stuck")
    still, stamps = Record(7, 0, 0, 0, 0, 0, 1000), []
    for k in range(20):
        cable.write_all(encode(still), 1.0)
        until(lambda k=k: driver.health.frames == k + 1, lambda k=k: driver.read((k + 1) * 10 * MS), pause=0.0)
        stamps.append(driver.health.stamp)
    assert driver.metrics()["stuck"] == 19
    assert len(set(stamps)) == 1
    assert "stands still" in driver.health.message
    assert np.isnan(driver.state_arrays["orientation"]).all(), "frozen for longer than `hold`"
    driver.close()
    cable.close()


def test_a_sensor_that_repeats_itself_to_the_bit_hangs_though_its_index_goes_on():
    cable, driver = opened("frozen")

    def frame(k: int, x: int) -> None:
        cable.write_all(encode(Record((k + 1) % 256, 0, 0, 0, x, 0, 1000)), 1.0)
        until(lambda: driver.health.frames == k + 1, lambda: driver.read((k + 1) * 10 * MS), pause=0.0)

    for k in range(50):
        frame(k, 0)
    assert np.isfinite(driver.state_arrays["orientation"]).all()
    for k in range(50, 70):
        frame(k, 0)
    assert "stand still to the last bit" in driver.health.message
    assert np.isnan(driver.state_arrays["orientation"]).all()
    assert 700 * MS - driver.health.stamp >= 180 * MS
    frame(70, 1)
    assert np.isfinite(driver.state_arrays["orientation"]).all()
    assert driver.health.message == ""
    driver.close()
    cable.close()


def test_frames_that_a_queue_delays_stay_old_until_the_port_is_opened_anew():
    cable, driver = opened("queue")

    def frame(k: int, late: int) -> int:
        cable.write_all(encode(Record((k + 1) % 256, 0, 0, 0, 0, k % 2, 1000)), 1.0)
        now = (k + 1) * 10 * MS + late
        until(lambda: driver.health.frames == k + 1, lambda: driver.read(now), pause=0.0)
        return now - driver.health.stamp

    assert [frame(k, 0) for k in range(50)][-1] < 20 * MS
    ages = [frame(k, 600 * MS) for k in range(50, 550)]
    assert min(ages) > 500 * MS
    with pytest.raises(DeviceLostError, match=r"0\.6 s late"):
        [frame(k, 600 * MS) for k in range(550, 560)]
    assert not driver.health.connected
    driver.close()
    cable.close()


def test_what_gravity_contradicts_grows_stale():
    cable, driver = opened("contradiction")
    for k in range(600):
        cable.write_all(encode(Record((k + 1) % 256, 0, 0, 3000, 0, k % 2, 1000)), 1.0)
        until(lambda k=k: driver.health.frames == k + 1, lambda k=k: driver.read((k + 1) * 10 * MS), pause=0.0)
    assert "disagree by 30 degrees" in driver.health.message
    assert 600 * 10 * MS - driver.health.stamp > 500 * MS
    driver.close()
    cable.close()


def test_who_is_at_a_port(pair):
    p = pair()
    p.driver.close()
    with p.bench.running():
        assert Bno085.who_is_at(p.twin.address) == "a BNO085 in UART-RVC mode, heard only"


def test_silence_and_another_device_are_refused_with_a_remedy():
    cable = open_transport("loop://silent", place="test")
    driver = Bno085("imu", Bno085Config(port="loop://silent"))
    with pytest.raises(DeviceError, match="got nothing") as caught:
        driver.open()
    assert "PS0" in caught.value.remedy
    cable.close()
    cable = open_transport("loop://another", place="test")
    cable.write_all(b"$GPGGA,123519,4807.038,N" * 3, 1.0)
    with pytest.raises(DeviceError, match="got the bytes 24 47 50"):
        Bno085("imu", Bno085Config(port="loop://another")).open()
    cable.close()


def test_a_wrong_mounting_shows_as_a_wrong_orientation():
    device = fake(cell(off_by={"rpy": [0.0, 0.1, 0.0]}))
    device.open()
    run(device, 0.5)
    w, x, y, z = device.state_arrays["orientation"]
    assert degrees(Rotation.from_quat([x, y, z, w]).magnitude()) == pytest.approx(degrees(0.1), abs=0.02)
