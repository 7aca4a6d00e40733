"""python-can's own Notifier and readers, unchanged, against the RFT twin: the order of the public script."""

import queue
import struct

import can
import numpy as np
import pytest
from helpers.ft import Server, at_sensor, cell, push

from srl.drivers.can_ft.driver import CanFtConfig
from srl.sim.devices.can_ft.fake import FakeCanFt, FakeCanFtOptions
from srl.sim.devices.can_ft.twin import CanFtTwin

WRENCH = (12.34, -5.0, 98.7, 0.5, -0.25, 0.1)


@pytest.fixture
def server():
    config = CanFtConfig(port="can://virtual/none")
    fake = FakeCanFt("ft", config, cell(), FakeCanFtOptions(noise=0.0, range=(600, 600, 600, 16, 16, 16)))
    try:
        with Server(CanFtTwin(fake)) as running:
            yield running
    except Exception as error:
        if "can't be opened" not in str(error):
            raise
        pytest.skip(f"no multicast here: {error}")


class Client:
    """A host on the bus; frames come through a Notifier's thread."""

    def __init__(self, address):
        options = dict(pair.split("=") for pair in address.partition("?")[2].split("&"))
        self.bus = can.Bus(
            interface="udp_multicast", channel="239.74.163.2", port=int(options["port"]), hop_limit=0,
            can_filters=[{"can_id": 1, "can_mask": 0x7FF}, {"can_id": 2, "can_mask": 0x7FF}],
        )  # fmt: skip
        self.reader = can.BufferedReader()
        self.notifier = can.Notifier(self.bus, [self.reader], timeout=0.1)

    def send(self, *data):
        frame = bytes(data).ljust(8, b"\1")  # the script leaves junk in the unused bytes
        self.bus.send(can.Message(arbitration_id=0x64, data=frame, is_extended_id=False))

    def receive(self, code):
        """The 16 bytes of the next response that begins with `code`."""
        first = None
        for _ in range(5000):
            message = self.reader.get_message(10)
            assert message is not None, "the sensor is silent"
            if message.arbitration_id == 1:
                first = bytes(message.data)
            elif first is not None and first[0] == code:
                return first + bytes(message.data)
        raise AssertionError("only other responses came")

    def close(self):
        self.notifier.stop()
        self.bus.shutdown()


@pytest.fixture
def client(server):
    host = Client(server.twin.address)
    yield host
    host.close()


def wrench(data):
    forces, torques = struct.unpack(">3h", data[1:7]), struct.unpack(">3h", data[7:13])
    return np.array([f / 50 for f in forces] + [t / 2000 for t in torques])


def test_the_order_of_the_public_script(server, client):
    with server.paused():
        push(server.world, *WRENCH)
    client.send(0x0C)
    client.send(0x01)
    assert client.receive(0x01)[1:].split(b"\0")[0] == b"RFT64-SB01"
    client.send(0x02)
    assert client.receive(0x02)[1:8] == b"SIM0001"
    client.send(0x08, 1, 1)
    assert client.receive(0x08)[1:3] == b"\1\0"
    client.send(0x0F, 8)
    assert client.receive(0x0F)[1:3] == b"\1\0"
    client.send(0x0B)
    expected = at_sensor(server.world, *WRENCH)
    for _ in range(3000):
        data = client.receive(0x0B)
        if np.allclose(wrench(data), expected, atol=0.011):
            break
    else:
        raise AssertionError(f"{wrench(data)} isn't {expected}")
    assert data[13] == 0
    client.send(0x0C)
    for _ in range(5000):
        if client.reader.get_message(0.3) is None:
            break
    else:
        raise AssertionError("it goes on after the stop")
    client.send(0x0A)
    np.testing.assert_allclose(wrench(client.receive(0x0A)), expected, atol=0.011)


def test_bias_has_no_answer_and_zeroes(server, client):
    with server.paused():
        push(server.world, *WRENCH)
    for _ in range(2000):
        client.send(0x0A)
        if wrench(client.receive(0x0A))[2] > 98:
            break
    client.send(0x11, 1)
    client.send(0x0A)
    np.testing.assert_allclose(wrench(client.receive(0x0A)), np.zeros(6), atol=0.021)
    client.send(0x11, 0)
    client.send(0x0A)
    assert wrench(client.receive(0x0A))[2] > 98


def test_overloads_show_and_count(server, client):
    with server.paused():
        push(server.world, 0, 700, 0, 0, 0, 0)
    for _ in range(2000):
        client.send(0x0A)
        if client.receive(0x0A)[13]:
            break
    else:
        raise AssertionError("no overload shows")
    client.send(0x12)
    assert client.receive(0x12)[2] >= 1


def test_wrong_settings_and_commands_are_refused(client):
    client.send(0x0F, 9)
    assert client.receive(0x0F)[1:3] == b"\0\2"
    client.send(0x08, 1, 15)
    assert client.receive(0x08)[1:3] == b"\0\2"
    client.send(0x33)
    assert client.receive(0x33)[1:3] == b"\0\1"


def test_nothing_else_is_obeyed_while_it_streams(client):
    client.send(0x0B)
    client.receive(0x0B)
    client.send(0x01)
    client.send(0x10)
    assert client.receive(0x10)[1] == 0
    found: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    for _ in range(100):
        found.put(client.receive(0x0B)[:1])
    assert found.qsize() == 100
