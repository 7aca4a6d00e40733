"""The RFT driver against its twin on a bus of python-can, and against scripted frames."""

import itertools
import os
import time

import can
import numpy as np
import pytest
from helpers.ft import Server, at_sensor, bound, cell, push, read
from helpers.wait import until

from srl.drivers.can_ft import CanFt
from srl.drivers.can_ft.driver import CanFtConfig
from srl.drivers.can_ft.protocol import Command, Record, record, response
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.sim.devices.can_ft.fake import FakeCanFt, FakeCanFtOptions
from srl.sim.devices.can_ft.twin import CanFtTwin

_buses = itertools.count()


def twin(world=None, bus=None, config=None, **options):
    # python-can's virtual bus stays in the process: no two tests share one.
    bus = bus or f"can://virtual/ft{os.getpid()}.{next(_buses)}"
    options = {"noise": 0.0, "bus": bus} | options
    device = CanFtConfig(port="can://virtual/none", **(config or {}))
    return CanFtTwin(FakeCanFt("ft", device, world or cell(), FakeCanFtOptions(**options)))


def driver(server, **options):
    return bound(CanFt("ft", CanFtConfig(port=server.twin.address, **options)))


@pytest.fixture
def server():
    with Server(twin()) as running:
        yield running


@pytest.fixture
def opened(server):
    ft = driver(server)
    ft.open()
    yield ft
    ft.close()


def fresh(ft):
    before = ft.health.stamp
    until(lambda: ft.health.stamp > before, lambda: read(ft))


def settled(ft, wrench, within=0.011):
    until(lambda: np.allclose(ft.state_arrays["wrench"], wrench, atol=within), lambda: read(ft))


def test_the_wrench_is_what_pushes_the_handle(server, opened):
    for wrench in ((12.0, 0, 0, 0, 0, 0), (0, -7.0, 3.0, 0, 0, 0.5)):
        with server.paused():
            push(server.world, *wrench)
        settled(opened, at_sensor(server.world, *wrench))
    assert opened.metrics() == {
        "model": "RFT64-SB01", "serial": "SIM0001", "firmware": "SIM 1.0", "overloads": 0, "asked_again": 0,
    }  # fmt: skip
    assert opened.health.message == "RFT64-SB01"


@pytest.mark.parametrize("rate", [10, 333, 1000])
def test_the_rate_is_the_profile_s(rate):
    with Server(twin(config={"rate": rate})) as server:
        ft = driver(server, rate=rate)
        ft.open()
        fresh(ft)
        assert server.twin.sensor.rate == rate
        fresh(ft)
        ft.close()


def test_the_filter_is_the_profile_s(server):
    ft = driver(server, filter=10)
    ft.open()
    assert server.twin.sensor.cutoff == 10
    with server.paused():
        push(server.world, 20.0, 0, 0, 0, 0, 0)
    seen = []
    until(
        lambda: ft.state_arrays["wrench"][0] > 19,
        lambda: (read(ft), seen.append(float(ft.state_arrays["wrench"][0]))),
    )
    assert any(2 < force < 18 for force in seen)  # it rises, it doesn't jump
    settled(ft, at_sensor(server.world, 20.0, 0, 0, 0, 0, 0), 0.05)
    ft.close()


def test_an_overload_isn_t_a_sample(server, opened):
    fresh(opened)
    with server.paused():
        push(server.world, 0, 300.0, 0, 0, 0, 0)
    until(lambda: "overload of Fy" in opened.health.message, lambda: read(opened))
    stamp, errors = opened.health.stamp, opened.health.errors
    until(lambda: opened.health.errors > errors + 5, lambda: read(opened))
    assert opened.health.stamp == stamp
    assert abs(opened.state_arrays["wrench"][1]) < 200
    with server.paused():
        push(server.world, 0, 1.0, 0, 0, 0, 0)
    settled(opened, at_sensor(server.world, 0, 1.0, 0, 0, 0, 0))


def test_the_zero_is_taken_once_and_outlives_the_sensor_s_power():
    with Server(twin(offset=(5.0, -6.0, 30.0, 0.4, 0.0, -0.2))) as server:
        ft = driver(server, bias=True)
        ft.open()
        settled(ft, np.zeros(6))
        with server.paused():
            push(server.world, 0, 0, 8.0, 0, 0, 0)
            server.twin.power_up()
        ft.open()  # a person holds it now: that isn't zero
        settled(ft, at_sensor(server.world, 0, 0, 8.0, 0, 0, 0))
        ft.close()


def test_a_load_that_moves_isn_t_taken_for_zero():
    pushes = [{"start": 0.06 * k, "end": 0.06 * k + 0.03, "wrench": (30, 0, 0, 0, 0, 0)} for k in range(1000)]
    moved = twin(cell(handle={"pushes": pushes}))
    with Server(moved) as server, pytest.raises(DeviceError, match=r"load moves.*Let go"):
        driver(server, bias=True).open()


def test_a_loss_of_power_is_noticed_and_everything_set_again(server):
    ft = driver(server, filter=50, rate=500)
    ft.open()
    fresh(ft)
    with server.paused():
        server.twin.power_up()
        assert (server.twin.sensor.rate, server.twin.sensor.cutoff) == (200, 0)
    until(lambda: ft.metrics()["asked_again"], lambda: read(ft))
    fresh(ft)
    assert (server.twin.sensor.rate, server.twin.sensor.cutoff) == (500, 50)
    ft.close()


def test_a_dead_sensor_is_lost_and_comes_back(server, opened):
    fresh(opened)
    server.twin.muted = True
    with pytest.raises(DeviceLostError, match="no records for 2 s"):
        until(lambda: False, lambda: opened.read(time.monotonic_ns() + 2_500_000_000))
    assert not opened.health.connected
    with pytest.raises(DeviceError, match=r"expected an RFT's answer to MODEL.*got no frame.*terminator"):
        opened.open()
    server.twin.muted = False
    opened.open()
    assert opened.health.reconnects == 1
    fresh(opened)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"model": "RFT82-HA02"}, r"is a 'RFT64-SB01', the profile says 'RFT82-HA02'"),
        ({"serial": "00017"}, r"serial number is 'SIM0001', the profile says '00017'"),
        ({"ids": (0x64, 0x11, 0x12)}, r"answer to MODEL on ids 0x11 and 0x12, got no frame"),
    ],
)
def test_another_sensor_is_refused(server, options, words):
    with pytest.raises(DeviceError, match=words):
        driver(server, **options).open()


def test_an_unknown_model_needs_its_counts(server):
    server.twin.sensor.model = "RFT99"
    with pytest.raises(DeviceError, match=r"counts of the model 'RFT99' aren't known.*Give 'counts'"):
        driver(server).open()
    ft = driver(server, counts={"force": 50, "torque": 2000})
    ft.open()
    fresh(ft)
    ft.close()


def test_a_sensor_that_streams_already_is_taken_over(server):
    one = driver(server)
    one.open()
    link, one._link = one._link, None  # a program that was killed: nobody has stopped the stream
    two = driver(server)
    two.open()
    fresh(two)
    two.close()
    link.close()


@pytest.mark.parametrize(
    ("options", "words"),
    [({"filter": 77}, "must be one of"), ({"ids": (1, 1, 2)}, "three different"), ({"rate": 150}, "Input should be")],
)
def test_wrong_options_are_said(options, words):
    with pytest.raises(ValueError, match=words):
        CanFtConfig(port="can://virtual/x", **options)


class Bus:
    """The sensor's end of a bus, by hand; stamps as an interface would give them."""

    def __init__(self, ft):
        self.ft, self.frames = ft, []
        ft._link = self

    def read(self):
        frames, self.frames = self.frames, []
        return frames

    def write(self, message):
        return True

    def close(self):
        """Nothing to close."""

    def send(self, at, fx, overload=0):
        for number, data in zip((1, 2), record(Record((fx, 0, 0, 0, 0, 0), overload)), strict=True):
            self.frames.append(can.Message(timestamp=at, arbitration_id=number, data=data, is_extended_id=False))


@pytest.fixture
def scripted():
    ft = bound(CanFt("ft", CanFtConfig(port="can://virtual/none")))
    ft._scale, ft._names = np.full(6, 0.02), {"model": "RFT"}
    ft.health.connected = True
    return ft, Bus(ft)


def test_stamps_are_the_interface_s_and_a_queue_is_drained_to_the_newest(scripted):
    ft, bus = scripted
    epoch, now = 1.7e9, 10**12
    bus.send(epoch, 50)
    ft.read(now)
    assert ft.health.stamp == now
    for k in range(1, 6):
        bus.send(epoch + 0.005 * k, 50 * k)
    ft.read(now + 400_000_000)  # the loop was away for long, the queue was full of old ones
    assert ft.state_arrays["wrench"][0] == pytest.approx(5.0)
    assert ft.health.stamp == pytest.approx(now + 25_000_000, abs=200_000)


def test_a_clock_that_is_set_back_doesn_t_stop_the_samples(scripted):
    ft, bus = scripted
    now = 10**12
    bus.send(1.7e9, 1)
    ft.read(now)
    bus.send(1.7e9 - 3600, 2)
    ft.read(now + 5_000_000)
    assert ft.health.stamp == now + 5_000_000


def test_remote_and_extended_frames_are_none_of_its(scripted):
    ft, bus = scripted
    bus.frames = [
        can.Message(arbitration_id=1, is_extended_id=False, is_remote_frame=True, dlc=8),
        can.Message(arbitration_id=1, is_extended_id=True, data=bytes(8)),
    ]
    ft.read(10**12)
    assert (ft.health.frames, ft.health.errors) == (0, 0)


def test_a_refused_setting_is_said():
    ft = CanFt("ft", CanFtConfig(port="can://virtual/none", filter=10))
    ft._ask = lambda link, frame: (
        ft._parser.feed(1, response(Command.SET_FILTER, b"\0\2")[0])
        or next(iter(ft._parser.feed(2, response(Command.SET_FILTER, b"\0\2")[1])))
    )
    with pytest.raises(DeviceError, match="refused the filter: value out of range"):
        ft._set(None, ft._settings[0])
