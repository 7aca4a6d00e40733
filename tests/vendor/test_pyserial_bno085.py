"""The datasheet's frame, read through pyserial by hand, against the twin: none of the driver's own code is used."""

import struct

import numpy as np
import pytest
import serial
from helpers.ft import Server
from scipy.spatial.transform import Rotation

from srl.drivers.bno085 import Bno085Config
from srl.sim.devices.bno085.fake import FakeBno085, FakeBno085Config
from srl.sim.devices.bno085.twin import Bno085Twin
from srl.sim.world.cell import Cell, CellConfig

TILT = Rotation.from_euler("ZXY", [0.0, -1.1, 20.85], degrees=True)  # as in the datasheet's example


@pytest.fixture
def port():
    x, y, z, w = TILT.as_quat().tolist()
    imu = {"part": "imu", "at": {"position": [0, 0, 1], "quaternion": [w, x, y, z]}}
    world = Cell(CellConfig.model_validate({"parts": {"imu": imu}}), seed=1)
    fake = FakeBno085("imu", Bno085Config(port="/dev/null"), world, FakeBno085Config(noise=0.0, drift=0.0))
    with Server(Bno085Twin(fake)) as running, serial.Serial(running.twin.address, 115200, timeout=10) as link:
        yield link


def frames(link, count):
    """(index, yaw, pitch, roll, x, y, z) of frames that follow one another."""
    link.read_until(b"\xaa\xaa")
    found = []
    for _ in range(count):
        body = link.read(17)
        assert sum(body[:16]) % 256 == body[16]
        assert body[13:16] == b"\0\0\0"
        found.append(struct.unpack("<B6h", body[:13]))
        assert link.read(2) == b"\xaa\xaa"
    return np.array(found)


def test_a_bare_reader_sees_the_datasheets_example(port):
    rows = frames(port, 60)
    np.testing.assert_array_equal(np.diff(rows[:, 0]) % 256, 1)
    assert np.abs(rows[-1, 1:4] - [0, -110, 2085]).max() <= 1
    up = rows[-1, 4:] / np.linalg.norm(rows[-1, 4:])
    np.testing.assert_allclose(up, np.array([-371, -20, 977]) / np.linalg.norm([-371, -20, 977]), atol=2e-3)
