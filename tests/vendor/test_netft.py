"""The public Net F/T client NetFT (PyPI), unchanged, against the twin."""

import itertools
import os

import numpy as np
import pytest
from helpers.ft import Server, at_sensor, cell, push

from srl.drivers.ati_netft.config import AtiNetFtConfig
from srl.sim.devices.ati_netft.fake import FakeAtiNetFt, FakeAtiNetFtOptions
from srl.sim.devices.ati_netft.twin import AtiNetFtTwin

NetFT = pytest.importorskip("NetFT")
WRENCH = (1.5, -2.5, 10.0, 0.1, -0.2, 0.3)


PORT = 49152  # the client knows no other
_hosts = itertools.count(2)


@pytest.fixture
def host():
    """A loopback address of this test's own, so that the port is free."""
    pid = os.getpid()
    return f"127.{1 + (pid >> 8) % 254}.{pid % 256}.{next(_hosts)}"


@pytest.fixture
def server(host):
    options = FakeAtiNetFtOptions(noise=0.0, host=host, port=PORT)
    fake = FakeAtiNetFt("ft", AtiNetFtConfig(port="udp://127.0.0.1"), cell(), options)
    with Server(AtiNetFtTwin(fake)) as running:
        assert running.twin.address.startswith(f"udp://{host}:{PORT}?http=")
        yield running


@pytest.fixture
def sensor(server, host):
    client = NetFT.Sensor(host)
    client.sock.settimeout(10)
    yield client
    client.sock.close()


def settled(read, expected):
    for _ in range(2000):
        if np.allclose(np.array(read()) / 1e6, expected, atol=1e-5):
            return
    raise AssertionError(f"{np.array(read()) / 1e6} isn't {expected}")


def test_polled(server, sensor):
    with server.paused():
        push(server.world, *WRENCH)
    settled(sensor.getMeasurement, at_sensor(server.world, *WRENCH))
    assert len(sensor.getForce()) == len(sensor.getTorque()) == 3


def _drain(sensor):
    for _ in range(10_000):
        sensor.receive()


def test_streamed(server, sensor):
    with server.paused():
        push(server.world, *WRENCH)
    sensor.startStreaming(handler=False)
    settled(sensor.receive, at_sensor(server.world, *WRENCH))
    sensor.stopStreaming()
    sensor.sock.settimeout(0.3)
    with pytest.raises(TimeoutError):
        _drain(sensor)


def test_tared(server, sensor):
    with server.paused():
        push(server.world, *WRENCH)
    settled(sensor.getMeasurement, at_sensor(server.world, *WRENCH))
    sensor.tare(50)
    np.testing.assert_allclose(np.array(sensor.getMeasurement()) / 1e6, np.zeros(6), atol=1e-4)
