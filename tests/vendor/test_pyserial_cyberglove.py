"""The sheet's golden vectors through pyserial, opened as the public CyberGlove clients open their port.

Those clients (C++ libraries and ROS nodes) aren't on PyPI, so the start-up sequences here are theirs as the
protocol sheet tells them, sent by an independent serial library.
"""

import numpy as np
import pytest
import serial
from helpers.twin import Bench, StillWorld

from srl.drivers.cyberglove.driver import CyberGloveConfig
from srl.sim.devices.cyberglove.fake import FakeCyberGlove, FakeCyberGloveConfig
from srl.sim.devices.cyberglove.twin import CyberGloveTwin

RAW = bytes(range(10, 221, 10))


@pytest.fixture
def glove(monkeypatch):
    """A port behind which the glove of the golden vectors runs, in a thread."""
    options = FakeCyberGloveConfig(switch=((0.0, 1e9),))
    fake = FakeCyberGlove("glove", CyberGloveConfig(port="/dev/null"), StillWorld(), options)
    angles = np.empty(22)
    fake.calibration().angles(RAW, angles)
    monkeypatch.setattr(fake, "sample", lambda number: angles.copy())
    with (
        Bench(CyberGloveTwin(fake)) as bench,
        bench.running(),
        serial.Serial(bench.twin.address, 115200, timeout=5) as port,
    ):
        yield port


def ask(port: serial.Serial, command: bytes, size: int) -> bytes:
    port.write(command)
    return port.read(size)


def test_start_up_and_polling_in_the_order_of_asr_cyberglove_lib(glove):
    assert ask(glove, b"?K", 6) == b"?K\xff\xff\x3f\0"
    assert ask(glove, b"M\xff\xff\x3f", 2) == b"M\0"
    assert ask(glove, b"?S", 4) == b"?S\x16\0"
    assert ask(glove, b"N\x16", 2) == b"N\0"
    assert ask(glove, b"?U", 4) == b"?U\0\0"
    assert ask(glove, b"?D", 4) == b"?D\0\0"
    for _ in range(20):
        assert ask(glove, b"G", 24) == b"G" + RAW + b"\0"


def test_status_and_the_stream_cut_at_its_zeros(glove):
    assert ask(glove, b"U\1", 2) == b"U\0"
    assert ask(glove, b"G", 25) == b"G" + RAW + b"\x07\0"
    glove.write(b"S")
    for _ in range(50):
        assert glove.read_until(b"\0") == b"S" + RAW + b"\x07\0"
    glove.write(b"^c")
    glove.timeout = 0.2
    while glove.read(25):
        pass
    assert ask(glove, b"?G", 4) == b"?G\3\0"


def test_text_commands_of_shadow_s_driver_whose_answers_nobody_reads(glove):
    for command in (b"t 1152 1\r", b"u 1\r", b"F\1"):
        glove.write(command)
    assert glove.read_until(b"F\0").endswith(b"F\0")
    glove.write(b"S")
    assert glove.read(25) == b"S" + RAW + b"\x07\0"
