"""The glove's twin: the sheet's golden vectors, the stream, faults, and our own driver on the other end."""

from typing import Any

import numpy as np
import pytest
from helpers.sim import world
from helpers.twin import Bench, Client, StillWorld, bound
from helpers.wait import until

from srl.drivers.cyberglove import CyberGlove
from srl.drivers.cyberglove.driver import CyberGloveConfig
from srl.drivers.cyberglove.protocol import Parser, Record
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.profile import profile, wiring
from srl.sim.devices.cyberglove.fake import FakeCyberGlove, FakeCyberGloveConfig
from srl.sim.devices.cyberglove.twin import CyberGloveTwin
from srl.sim.world.cell import Cell

RAW = bytes(range(10, 221, 10))
# Sheet cyberglove, §8, in its order: the host's bytes, the glove's.
GOLDEN = (
    ("3f 4b", "3f 4b ff ff 3f 00"),
    ("4d ff ff 3f", "4d 00"),
    ("3f 53", "3f 53 16 00"),
    ("4e 16", "4e 00"),
    ("3f 55", "3f 55 00 00"),
    ("3f 44", "3f 44 00 00"),
    ("47", f"47 {RAW.hex()} 00"),
    ("55 01", "55 00"),
    ("47", f"47 {RAW.hex()} 07 00"),
    ("44 01", "44 00"),
    ("47", f"47 {RAW.hex()} 01 00 12 34 56 07 00"),
    ("3f 56", "3f 56 02 01 01 03 00"),
    ("54 04 80 00 01", "54 00"),
    ("3f 47", "3f 47 03 00"),
    ("3f 52", "3f 52 01 00"),
)
GOLDEN_TIME = 0x00123456 * 1_000_000  # ns; the time stamp of the vectors, which counts ms here


def make(world: Any = None, sensors: int = 22, hand: str = "right", **options: Any) -> CyberGloveTwin:
    config = CyberGloveConfig(port="/dev/null", sensors=sensors, hand=hand)
    return CyberGloveTwin(FakeCyberGlove("glove", config, world or StillWorld(), FakeCyberGloveConfig(**options)))


def golden(monkeypatch: pytest.MonkeyPatch) -> CyberGloveTwin:
    """The glove of the golden vectors: sensors 10, 20 .. 220, switch on, its clock at their time stamp."""
    world = StillWorld()
    world.time = GOLDEN_TIME
    twin = make(world, rate=1000, delay=0.0, switch=((0.0, 1e9),))
    angles = np.empty(22)
    twin.glove.calibration().angles(RAW, angles)
    monkeypatch.setattr(twin.glove, "sample", lambda number: angles.copy())
    return twin


def test_golden_vectors_byte_for_byte(monkeypatch):
    with Bench(golden(monkeypatch)) as bench, Client(bench) as client:
        for host, glove in GOLDEN:
            expected = bytes.fromhex(glove)
            assert client.ask(bytes.fromhex(host), len(expected)).hex(" ") == expected.hex(" "), host
        client.ask(b"U\0D\0", 4)
        for stop in (b"\x5e\x63", b"\x03"):
            client.send(b"S")
            bench.run(0.1)
            assert client.rest() == (b"S" + RAW + b"\0") * 10  # T: 100 Hz
            client.send(stop)
            client.rest()
            bench.run(0.1)
            assert client.rest() == b""


def test_answers_do_not_depend_on_how_the_bytes_are_cut(monkeypatch):
    sent = b"".join(bytes.fromhex(host) for host, _ in GOLDEN)
    expected = b"".join(bytes.fromhex(glove) for _, glove in GOLDEN)
    for size in (1, 2, 5, len(sent)):
        twin = golden(monkeypatch)
        answers = b"".join(twin.receive(sent[i : i + size], 0) for i in range(0, len(sent), size))
        assert answers == expected
        assert twin.metrics()["unknown"] == 0


@pytest.mark.parametrize(
    ("host", "glove"),
    [
        (b"F\1?F", b"F\0?F\1\0"),
        (b"Q\1?Q", b"Q\0?Q\1\0"),
        (b"T\x0a\x00\x00\x01?T", b"T\0?T\x0a\x00\x00\x01\0"),
        (b"M\1\2\3?M", b"M\0?M\1\2\3\0"),
        (b"?T", b"?T\x04\x80\x00\x01\0"),  # 1152 x 1 / 115200 s: 100 Hz
        (b"A\xff\1\2\3\4\5\6?A", b"A\0?A\1\2\3\4\5\6\0"),
        (b"A\2\0\x10\5\x20?A", b"A\0?A\x10\0\0\0\0\x20\0"),
        (b"CO\2\x33CG\3\x44", b"CO\0CG\0"),
        (b"CA" + bytes(range(1, 45)) + b"?C", b"CA\0?C" + bytes(range(1, 45)) + b"\0"),
        (b"^I", b"^I\r\n\0"),
        (b"U\1^R?U", b"U\0^R\r\n\0?U\0\0"),
        (b"?WW\1?W", b"?W\0\0W\0?W\1\0"),
        (b"u 1\r?U", b"u\r\n\0?U\1\0"),
        (b"t 2560 1\r?T", b"t\r\n\0?T\x0a\x00\x00\x01\0"),
        (b"u 7\r", b"e?\0"),
        (b"t 1\r", b"e?\0"),
        (b"Z", b"e?\0"),
        (b"?Z", b"e?\0"),
        (b"^x", b"e?\0"),
        (b"Cx", b"e?\0"),
    ],
)
def test_other_commands_of_the_table(host, glove):
    assert make().receive(host, 0) == glove


def test_the_light_shows_the_switch_until_the_host_takes_it_over():
    twin = make(switch=((0.0, 9.0),))
    status = [twin.receive(command + b"U\1G", 0)[-2] for command in (b"", b"J\1", b"L\1", b"J\0W\0", b"W\1")]
    assert status == [0b111, 0b011, 0b111, 0b001, 0b111]
    assert twin.receive(b"?P", 0) == b"?P" + bytes((0b111, 1 << 2 | 1 << 6 | 1 << 7, 0)) + b"\0"


def test_a_left_glove_of_18_sensors_and_fewer_of_them():
    twin = make(sensors=18, hand="left")
    assert twin.receive(b"?S?R?K", 0) == b"?S\x12\0?R\0\0?K\xff\xff\x03\0"
    assert len(twin.receive(b"G", 0)) == 20
    assert len(twin.receive(b"N\4G", 0)) == 2 + 6


@pytest.mark.parametrize(
    ("command", "records", "slow"),
    [
        (b"", 100, False),
        (b"T\x0a\x00\x00\x01", 45, False),
        (b"t 11520 1\r", 10, False),
        (b"t 1152 0\r", 150, False),  # as fast as possible
        (b"t 100 1\r", 150, True),  # faster than the glove can
    ],
)
def test_streams_at_its_sample_period_by_its_own_clock(command, records, slow):
    parser = Parser(22)
    with Bench(make()) as bench, Client(bench) as client:
        client.send(command + b"S")
        start = client.rest()
        bench.run(1.0)
        found = [m for m in parser.feed(start[start.find(0) + 1 :] + client.rest()) if isinstance(m, Record)]
        assert abs(len(found) - records) <= 1
        assert all(record.slow == slow for record in found)


def test_unplugged_from_its_interface_it_says_so():
    twin = make()
    twin.unplugged = True
    assert twin.receive(b"?G", 0) == b"?G\1\0"
    assert twin.receive(b"G", 0)[-3:] == b"eg\0"
    assert twin.receive(b"U\1G", 0)[-4:] == b"\0eg\0"
    twin.unplugged = False
    assert twin.receive(b"?G", 0) == b"?G\3\0"


def hand() -> Cell:
    return world(seed=3)


def driver_at(bench: Bench, **options: Any) -> CyberGlove:
    driver = CyberGlove("glove", CyberGloveConfig(port=bench.twin.address, **options))
    bound(driver)
    return driver


def read_all(driver: CyberGlove, bench: Bench, until_frames: int) -> None:
    for _ in range(10_000):
        driver.read(bench.now)
        if driver.health.frames >= until_frames:
            return
    raise AssertionError(f"{driver.health.frames} of {until_frames} records")


def test_both_doors_show_the_same_hand():
    """Our driver on the twin's port reads the angles that the fake in another, equal world gives."""
    twin = make(hand(), dropout=0.1)
    other = FakeCyberGlove("glove", twin.glove.config, hand(), FakeCyberGloveConfig(dropout=0.1))
    bound(other)
    with Bench(twin) as bench:
        driver = driver_at(bench)
        with bench.running():
            driver.open()
        other.world.advance(bench.now)
        other.open()
        driver.read(bench.now)
        moved = []
        for _ in range(100):
            sent = twin.metrics()["bytes_out"]
            bench.run(0.010)
            new = (int(str(twin.metrics()["bytes_out"])) - int(str(sent))) // 25
            read_all(driver, bench, driver.health.frames + new)
            other.world.advance(bench.now)
            other.read(bench.now)
            if new:
                np.testing.assert_array_equal(driver.state_arrays["position"], other.state_arrays["position"])
            moved.append(driver.state_arrays["position"].copy())
        assert np.ptp(moved, axis=0).max() > 0.5
        assert driver.health.errors == 0
        driver.close()


def test_the_driver_survives_a_glove_that_hangs_and_sees_one_that_is_gone():
    with Bench(make(loss=((6.0, 7.0),), rate=100)) as bench:
        driver = driver_at(bench)
        with bench.running():
            driver.open()
        assert isinstance(bench.twin, CyberGloveTwin)
        bench.twin.muted = True
        bench.run(0.2)
        before = driver.health.frames
        driver.read(bench.now)
        bench.run(0.2)
        driver.read(bench.now)
        assert driver.health.frames <= before + 5
        bench.twin.muted = False
        bench.run(0.05)
        read_all(driver, bench, driver.health.frames + 1)
        assert bench.now < 6_000_000_000
        bench.run(6.01 - bench.now * 1e-9)
        with pytest.raises(DeviceLostError):
            until(lambda: False, lambda: driver.read(bench.now))
        driver.close()
        assert bench.twin.address == ""
        bench.run(1.0)
        driver = driver_at(bench)
        with bench.running():
            driver.open()
        driver.close()


def test_the_driver_refuses_an_unplugged_glove_and_the_wrong_one():
    twin = make(hand="left")
    twin.unplugged = True
    with Bench(twin) as bench, bench.running():
        with pytest.raises(DeviceError, match="isn't plugged into its interface"):
            driver_at(bench).open()
        twin.unplugged = False
        with pytest.raises(DeviceError, match="this is a left glove"):
            driver_at(bench).open()
        with pytest.raises(DeviceError, match="has 22 sensors"):
            driver_at(bench, sensors=18).open()


def test_the_profile_s_glove_has_this_twin():
    checked, source = profile.load("sixth-finger")
    graph = wiring.build(checked, source, [])
    CyberGloveTwin(next(d for d in graph.devices if d.name == "glove"))
