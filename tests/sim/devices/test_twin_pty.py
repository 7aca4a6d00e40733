"""The pty door: what a device sees of clients that come, go, and don't read."""

import os
import select
from pathlib import Path

import pytest
from helpers.wait import until

from srl.runtime.contracts.errors import HostError
from srl.sim.devices.shared.pty import PtyDoor


def client(door: PtyDoor) -> int:
    return os.open(door.address, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)


def read(fd: int) -> bytes:
    assert select.select([fd], [], [], 10)[0]
    return os.read(fd, 65536)


@pytest.fixture
def door():
    door = PtyDoor()
    door.open()
    yield door
    door.close()


def test_sees_clients_come_and_go(door):
    assert not door.connected()
    for count in (1, 2, 3):
        fd = client(door)
        assert door.connected()
        assert door.connected()
        os.close(fd)
        assert not door.connected()
        assert door.connects == count
        assert door.read() == b""


def test_bytes_pass_unchanged_both_ways(door):
    every = bytes(range(256))
    fd = client(door)
    door.connected()
    door.write(every)
    assert read(fd) == every
    os.write(fd, every)
    taken = bytearray()
    until(lambda: len(taken) == 256, lambda: taken.extend(door.read()))
    assert taken == every
    assert (door.bytes_in, door.bytes_out, door.lost) == (256, 256, 0)
    os.close(fd)


def test_last_words_of_a_client_are_heard(door):
    fd = client(door)
    door.connected()
    os.write(fd, b"stop")
    os.close(fd)
    heard = bytearray()
    until(lambda: heard == b"stop", lambda: (door.connected(), heard.extend(door.read())))


def test_what_a_client_does_not_take_is_lost_without_waiting(door):
    fd = client(door)
    door.connected()
    for _ in range(1000):
        door.write(b"x" * 1000)
    assert door.lost > 0
    assert door.bytes_out + door.lost == 1_000_000
    got = 0
    while select.select([fd], [], [], 0.05)[0]:
        got += len(os.read(fd, 65536))
    assert got == door.bytes_out
    door.write(b"again")
    assert read(fd) == b"again"
    os.close(fd)


def test_nobody_there_sees_nothing_and_the_next_client_gets_nothing_old(door):
    door.write(b"before")
    fd = client(door)
    door.connected()
    door.write(b"unread")
    os.close(fd)
    door.connected()
    door.write(b"unheard")
    fd = client(door)
    door.connected()
    door.write(b"new")
    assert read(fd) == b"new"
    assert door.bytes_out == len(b"unread" + b"new")
    os.close(fd)


def test_closing_hangs_up_and_the_link_follows_the_new_port(tmp_path: Path):
    door = PtyDoor(tmp_path / "glove")
    door.open()
    assert door.address == str(tmp_path / "glove")
    fd = client(door)
    first = os.readlink(door.address)
    door.close()
    assert not (tmp_path / "glove").is_symlink()
    assert door.address == ""
    assert select.select([fd], [], [], 10)[0]
    with pytest.raises(OSError, match="Input/output error"):
        os.write(fd, b"x")
    door.open()
    assert os.readlink(door.address) != first  # the old number is still held by the client
    other = client(door)
    assert door.connected()
    os.close(fd)
    assert door.connected()
    os.close(other)
    door.close()


def test_a_stale_link_is_replaced_but_a_file_is_not(tmp_path: Path):
    (tmp_path / "stale").symlink_to("/nowhere")
    door = PtyDoor(tmp_path / "stale")
    door.open()
    door.close()
    (tmp_path / "file").write_text("mine")
    with pytest.raises(HostError, match="can't be made"):
        PtyDoor(tmp_path / "file").open()
    assert (tmp_path / "file").read_text() == "mine"
