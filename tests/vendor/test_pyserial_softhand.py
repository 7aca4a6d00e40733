"""The golden requests of the public qbAPI through pyserial, an independent serial library, against the twin.

The public Python utilities for these hands aren't on PyPI; the order here is theirs: ping, activate, ask, move.
"""

import struct

import pytest
import serial
from helpers.ft import Server
from helpers.wait import until

from srl.drivers.softhand.config import SoftHandConfig
from srl.sim.devices.softhand.fake import FakeSoftHand, FakeSoftHandOptions
from srl.sim.devices.softhand.twin import SERIAL, SoftHandTwin
from srl.sim.parts.robots.softhand import SoftHandConfig as PartOptions
from srl.sim.parts.robots.softhand import SoftHandPart
from srl.sim.world.cell import Cell, CellConfig


@pytest.fixture
def server():
    parts = {"hand": (SoftHandPart, PartOptions())}
    world = Cell(
        CellConfig.model_construct(timestep=0.001, gravity=(0.0, 0.0, 0.0), floor=False, duration=None, parts=parts), 1
    )
    fake = FakeSoftHand("hand", SoftHandConfig(port="/dev/null"), world, FakeSoftHandOptions(noise=0.0))
    with Server(SoftHandTwin(fake)) as running:
        yield running


@pytest.fixture
def port(server):
    with serial.Serial(server.twin.address, 2_000_000, timeout=10) as link:
        yield link


def ask(port, request, size):
    port.write(bytes.fromhex(request))
    answer = port.read(size)
    assert answer[:2] == b"::"
    body = 0
    for byte in answer[4:-1]:
        body ^= byte
    assert body == answer[-1]
    assert answer[3] == len(answer) - 4
    return answer[5:-1]


def test_the_order_of_the_public_utilities(server, port):
    assert int.from_bytes(ask(port, "3a3a01020000", 10), "big") == SERIAL
    assert ask(port, "3a3a01028181", 7) == b"\0"
    port.write(bytes.fromhex("3a3a0103800383"))
    assert ask(port, "3a3a01028181", 7) == b"\x03"
    port.write(bytes.fromhex("3a3a0106821f400000dd"))
    assert struct.unpack(">2h", ask(port, "3a3a01028383", 10)) == (8000, 0)

    def reached() -> int:
        (ticks, *_) = struct.unpack(">3h", ask(port, "3a3a01028484", 12))
        return ticks if ticks > 6000 else 0

    ticks = until(reached)
    milliamperes, _, again, *_ = struct.unpack(">5h", ask(port, "3a3a01028686", 16))
    assert milliamperes > 0
    assert abs(again - ticks) < 4000
    port.write(bytes.fromhex("3a3a0103800080"))
    assert ask(port, "3a3a01028181", 7) == b"\0"


def test_what_isn_t_for_it_or_is_damaged_gets_no_answer(port):
    port.timeout = 0.2
    for request in ("3a3a02028181", "3a3a01028180", "3a3a01018181", "3a3a00028181"):
        port.write(bytes.fromhex(request))
        assert port.read(1) == b""
    port.timeout = 10
    assert ask(port, "3a3a01028181", 7) == b"\0"


def test_the_watchdog_acknowledges_and_bites(server, port):
    assert ask(port, "3a3a01038f7df2", 8) == b"\1\1"
    port.write(bytes.fromhex("3a3a0103800383"))
    assert ask(port, "3a3a01028181", 7) == b"\x03"
    until(lambda: ask(port, "3a3a01028181", 7) == b"\0")
    assert server.twin.metrics()["watchdog_trips"] == 1


def test_information_in_words(port):
    port.write(bytes.fromhex("3a3a010406000006"))
    assert b"SoftHand" in port.readline()
