"""The MTi's driver, fake and twin: opening, the same values through the wire, restarts, silence, what it refuses."""

from __future__ import annotations

import struct
from contextlib import closing
from typing import Any

import numpy as np
import pytest
from helpers.twin import Bench
from helpers.wait import until
from scipy.spatial.transform import Rotation

from srl.drivers.transport import open_transport
from srl.drivers.xsens_mti import XsensMti, XsensMtiConfig, data
from srl.drivers.xsens_mti.protocol import Id, Message, encode
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.sim.devices.xsens_mti.fake import FakeXsensMti, FakeXsensMtiConfig
from srl.sim.devices.xsens_mti.twin import XsensMtiTwin
from srl.sim.world.cell import Cell, CellConfig
from srl.testing import bound

MS = 1_000_000
ABOUT_X = [np.cos(0.2), np.sin(0.2), 0.0, 0.0]  # w x y z: 0.4 rad


def fake(**options: Any) -> FakeXsensMti:
    imu = {"part": "imu", "at": {"position": [0, 0, 1], "quaternion": ABOUT_X}}
    world = Cell(CellConfig.model_validate({"parts": {"imu": imu}}), seed=3)
    given = {"delay": 0.0, "drift": 0.0} | options
    return bound(FakeXsensMti("imu", XsensMtiConfig(port="/dev/null"), world, FakeXsensMtiConfig.model_validate(given)))


class Pair:
    """A twin, and our driver at its port."""

    def __init__(self, config: dict[str, Any] | None = None, **options: Any) -> None:
        self.fake = fake(**options)
        self.twin = XsensMtiTwin(self.fake)
        self.bench = Bench(self.twin)
        self.driver = bound(
            XsensMti("imu", XsensMtiConfig.model_validate({"port": self.twin.address} | (config or {})))
        )

    def open(self) -> None:
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

    def make(config: dict[str, Any] | None = None, **options: Any) -> Pair:
        made.append(Pair(config, **options))
        return made[-1]

    yield make
    for one in made:
        one.close()


def test_at_rest_it_says_how_it_lies_what_holds_it_and_that_it_is_still() -> None:
    device = fake()
    device.open()
    device.world.advance(200 * MS)
    device.read(device.world.time)
    w, x, y, z = device.state_arrays["orientation"]
    true = Rotation.from_rotvec([0.4, 0, 0])
    assert (true.inv() * Rotation.from_quat([x, y, z, w])).magnitude() < 0.01
    np.testing.assert_allclose(device.state_arrays["acceleration"], true.inv().apply([0, 0, 9.81]), atol=0.03)
    assert np.abs(device.state_arrays["turn"]).max() < 0.01


def test_the_driver_sets_it_up_once_and_reads_what_the_fake_gives(pair: Any) -> None:
    p = pair()
    p.open()
    assert p.twin.questions[-5:] == [
        Id.GO_TO_CONFIG,
        Id.REQ_DEVICE,
        Id.CONFIGURATION,
        Id.CONFIGURATION,
        Id.GO_TO_MEASUREMENT,
    ]
    p.run(0.5)
    p.fake.open()
    p.fake.read(p.bench.now)
    for name, value in p.driver.state_arrays.items():
        np.testing.assert_array_equal(value, p.fake.state_arrays[name])
    assert p.driver.metrics()["id"] == "0080005A"
    assert (p.driver.health.errors, p.driver.health.resyncs) == (0, 0)
    assert p.bench.now - p.driver.health.stamp <= 20 * MS
    p.open()  # what it keeps is right now: it is read, and not written
    assert p.twin.questions[-4:] == [Id.GO_TO_CONFIG, Id.REQ_DEVICE, Id.CONFIGURATION, Id.GO_TO_MEASUREMENT]


def test_its_bytes_read_by_hand(pair: Any) -> None:
    """None of the driver's own code is used: the sum, and the items by the sheet."""
    p = pair(noise=0.0)
    p.open()
    p.driver.close()
    with closing(open_transport(p.twin.address, place="test")) as link:
        heard = bytearray()
        with p.bench.running():
            until(lambda: len(heard) > 900, lambda: heard.extend(link.read()), pause=0.0)
    at = heard.rindex(b"\xfa\xff\x36\x44", 0, len(heard) - 69)
    message = heard[at : at + 73]
    assert sum(message[1:]) % 256 == 0
    w, x, y, z = struct.unpack(">4f", message[4 + 5 + 7 + 3 :][:16])
    assert (Rotation.from_rotvec([-0.4, 0, 0]) * Rotation.from_quat([x, y, z, w])).magnitude() < 1e-6
    force = struct.unpack(">3f", message[4 + 5 + 7 + 19 + 3 :][:12])
    np.testing.assert_allclose(force, [0.0, 9.81 * np.sin(0.4), 9.81 * np.cos(0.4)], atol=0.02)


def test_lost_messages_are_gaps_and_a_restart_is_one(pair: Any) -> None:
    p = pair(dropout=0.3)
    p.open()
    p.run(2.0)
    assert 30 < p.driver.metrics()["gaps"] < 90
    assert p.driver.metrics()["restarts"] == 0
    p.twin.restart()
    p.run(0.5)
    assert p.driver.metrics()["restarts"] >= 1
    assert np.isfinite(p.driver.state_arrays["orientation"]).all()
    assert p.bench.now - p.driver.health.stamp < 100 * MS


def test_an_orientation_that_it_calls_invalid_is_none(pair: Any) -> None:
    p = pair()
    p.open()
    p.run(0.2)
    p.twin.valid = False
    p.run(0.2)
    assert np.isnan(p.driver.state_arrays["orientation"]).all()
    assert "isn't valid" in p.driver.health.message
    assert p.bench.now - p.driver.health.stamp > 150 * MS
    p.twin.valid = True
    p.run(0.1)
    assert np.isfinite(p.driver.state_arrays["orientation"]).all()
    assert p.driver.health.message == ""


def test_a_sensor_that_repeats_itself_to_the_bit_hangs(pair: Any) -> None:
    p = pair(noise=0.0)  # in a world without motion
    p.open()
    p.run(1.0)
    assert "stand still" in p.driver.health.message
    assert np.isnan(p.driver.state_arrays["orientation"]).all()


def test_a_muted_sensor_is_nan_then_lost(pair: Any) -> None:
    p = pair()
    p.open()
    p.run(0.3)
    p.twin.muted = True
    p.run(0.1)
    assert np.isnan(p.driver.state_arrays["turn"]).all()
    assert p.driver.health.connected
    with pytest.raises(DeviceLostError, match="no messages for 5 s"):
        p.run(5.5)


def test_an_unplugged_cable_is_a_loss(pair: Any) -> None:
    p = pair()
    p.open()
    p.twin.close()
    with pytest.raises(DeviceLostError):
        p.run(0.2)


@pytest.mark.parametrize(
    ("config", "problem"),
    [
        ({"device": "00300011"}, "it is 0080005A, not 00300011"),
        ({"configure": False}, "it sends 1020, 1060, 2030 at 100 Hz, not 1020"),
    ],
)
def test_another_sensor_or_another_output_is_refused(pair: Any, config: dict[str, Any], problem: str) -> None:
    p = pair(config)
    with pytest.raises(DeviceError, match=problem):
        p.open()
    assert p.twin.output[0x2030] == 100  # nothing was written


def test_who_is_at_a_port(pair: Any) -> None:
    p = pair()
    with p.bench.running():
        assert XsensMti.who_is_at(p.twin.address) == "an MTi, id 0080005A"
    assert Id.CONFIGURATION not in p.twin.questions
    assert p.twin.questions[-1] == Id.GO_TO_MEASUREMENT


@pytest.mark.parametrize(
    ("sent", "problem", "remedy"),
    [
        (b"", "got nothing in", "supply"),
        (b"$GPGGA,123519,4807.038,N" * 3, "72 bytes that are no message", "baudrate"),
        (encode(Message(Id.DATA, data.encode({data.COUNTER: 1}))), "doesn't answer", "RX"),
        (encode(Message(Id.ERROR, b"\x03")), "the period isn't supported", "rate"),
    ],
    ids=["silence", "another device", "its RX is open", "an error"],
)
def test_what_is_no_mti_is_refused_with_a_remedy(
    monkeypatch: pytest.MonkeyPatch, sent: bytes, problem: str, remedy: str
) -> None:
    monkeypatch.setattr("srl.drivers.xsens_mti.opening.TIMEOUT", 0.05)
    cable = open_transport("loop://mti", place="test")
    cable.write_all(sent, 1.0)
    with pytest.raises(DeviceError, match=problem) as caught:
        XsensMti("imu", XsensMtiConfig(port="loop://mti")).open()
    assert remedy in caught.value.remedy
    cable.close()


def test_a_rate_that_it_does_not_take_is_refused(pair: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("srl.drivers.xsens_mti.opening.TIMEOUT", 0.3)
    p = pair()
    taken = p.twin._configure

    def other(given: bytes) -> Message:
        answer = taken(given)
        return Message(answer.id, answer.data.replace(b"\x80\x20\x00\x64", b"\x80\x20\x00\x32"))

    monkeypatch.setattr(p.twin, "_configure", other)
    with pytest.raises(DeviceError, match=r"it took .*8020 at 50 Hz"):
        p.open()
