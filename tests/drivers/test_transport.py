"""Links: what a peer that hangs up, stalls or isn't there does to a driver."""

from __future__ import annotations

import ctypes
import os
import pty
import select
import socket
import struct
import termios
import time
import tty
from typing import BinaryIO

import pytest
from helpers.wait import until

from srl.drivers.transport import Transport, open_transport
from srl.runtime.contracts.errors import DeviceError, DeviceLostError

COMMAND = bytes(range(1, 21))
SO_ATTACH_FILTER, SO_DETACH_FILTER = 26, 27


@pytest.fixture
def serial_pair():
    """A transport on a pty, and the descriptor of the other end, which a test may close."""
    master, slave = pty.openpty()
    with os.fdopen(master, "r+b", buffering=0) as end:
        tty.setraw(master)
        os.set_blocking(master, False)
        link = open_transport(os.ttyname(slave), place="device")
        os.close(slave)
        yield link, end
        link.close()


@pytest.fixture
def tcp_pair():
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = open_transport(f"tcp://127.0.0.1:{server.getsockname()[1]}", place="device")
        peer, _ = server.accept()
    peer.settimeout(2)
    yield link, peer
    link.close()
    peer.close()


def blackhole(peer: socket.socket) -> ctypes.Array[ctypes.c_char]:
    """From now on the peer's kernel drops every packet that comes in, as if the cable were cut."""
    drop = ctypes.create_string_buffer(struct.pack("HBBI", 0x06, 0, 0, 0))  # BPF: return 0 bytes
    peer.setsockopt(socket.SOL_SOCKET, SO_ATTACH_FILTER, struct.pack("HL", 1, ctypes.addressof(drop)))
    return drop


def arrived(link: Transport, count: int) -> bytes:
    data = bytearray()
    until(lambda: len(data) >= count, lambda: data.extend(link.read_wait(0.05)), what=lambda: f"more than {data!r}")
    return bytes(data)


def drain(end: BinaryIO, wait_s: float = 0.1) -> bytes:
    data = b""
    while select.select([end], [], [], wait_s)[0]:
        data += end.read(65536)
    return data


# -- both directions


def test_serial_carries_every_byte_value_unchanged(serial_pair):
    link, master = serial_pair
    every = bytes(range(256))
    master.write(every)
    assert arrived(link, 256) == every
    assert link.write(every)
    assert drain(master) == every


def test_serial_is_configured_as_asked():
    master, slave = pty.openpty()
    link = open_transport(os.ttyname(slave), place="device", baudrate=57600)
    iflag, oflag, cflag, lflag, ispeed, ospeed, _ = termios.tcgetattr(slave)
    assert (ispeed, ospeed) == (termios.B57600, termios.B57600)
    assert cflag & termios.CSIZE == termios.CS8
    assert not cflag & (termios.PARENB | termios.CSTOPB | termios.CRTSCTS)
    assert not iflag & (termios.IXON | termios.IXOFF | termios.ICRNL | termios.INLCR)
    assert not oflag & termios.OPOST
    assert not lflag & (termios.ECHO | termios.ICANON | termios.ISIG)
    link.close()
    os.close(master)
    os.close(slave)


def test_tcp_carries_bytes_both_ways(tcp_pair):
    link, peer = tcp_pair
    peer.sendall(COMMAND)
    assert arrived(link, 20) == COMMAND
    assert link.write(COMMAND)
    assert peer.recv(100) == COMMAND


def test_nothing_there_reads_as_no_bytes(serial_pair, tcp_pair):
    assert serial_pair[0].read() == b""
    assert tcp_pair[0].read() == b""


def test_flush_input_throws_away_what_arrived(serial_pair):
    link, master = serial_pair
    master.write(b"old")
    select.select([link.fileno()], [], [], 1)
    link.flush_input()
    master.write(b"new")
    assert arrived(link, 3) == b"new"


def test_a_loop_echoes_and_a_named_loop_joins_two():
    echo = open_transport("loop://", place="device")
    assert echo.write(b"abc")
    assert echo.read_wait(1) == b"abc"
    one, other = (open_transport("loop://bench", place="device") for _ in range(2))
    assert one.write(b"to other")
    assert other.write(b"to one")
    assert (one.read_wait(1), other.read_wait(1)) == (b"to one", b"to other")
    one.close()
    with pytest.raises(DeviceLostError):
        other.read()
    echo.close()
    other.close()


def test_the_spy_logs_both_directions(tmp_path):
    file = tmp_path / "link.log"
    link = open_transport(f"spy:{file}:loop://", place="device")
    assert link.write(b"?S\x00")
    assert link.read_wait(1) == b"?S\x00"
    lines = file.read_text().splitlines()
    assert [line.split()[1] for line in lines] == [">", "<"]
    assert all("3f 53 00" in line and line.endswith("?S.") for line in lines)
    link.close()


# -- the other end goes away


def test_a_serial_port_that_is_unplugged_is_lost_though_no_bytes_were_due(serial_pair):
    link, master = serial_pair
    master.close()
    with pytest.raises(DeviceLostError, match="device"):
        link.read()
    with pytest.raises(DeviceLostError):
        link.write(COMMAND)
    with pytest.raises(DeviceLostError):
        link.unsent()


def test_last_bytes_before_a_hang_up_are_still_read(tcp_pair):
    link, peer = tcp_pair
    peer.sendall(b"last words")
    peer.close()
    assert arrived(link, 10) == b"last words"
    with pytest.raises(DeviceLostError):
        link.read_wait(1)


def test_a_tcp_reset_is_a_loss(tcp_pair):
    link, peer = tcp_pair
    peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    peer.close()
    with pytest.raises(DeviceLostError):
        link.read_wait(1)


def test_close_always_succeeds_and_nothing_works_after_it(serial_pair, tcp_pair):
    serial_pair[1].close()
    for link in (serial_pair[0], tcp_pair[0]):
        link.close()
        link.close()
        assert link.fileno() == -1
        for use in (link.read, link.unsent, lambda link=link: link.write(b"x")):
            with pytest.raises(DeviceLostError):
                use()


def test_the_last_command_before_close_still_arrives(serial_pair, tcp_pair):
    for link in (serial_pair[0], tcp_pair[0]):
        assert link.write(COMMAND)
        link.close()
    assert serial_pair[1].read(100) == COMMAND
    assert tcp_pair[1].recv(100) == COMMAND


# -- a peer that takes nothing


def test_a_dead_tcp_link_holds_back_one_command_only(tcp_pair):
    link, peer = tcp_pair
    assert link.write(COMMAND)
    assert peer.recv(100) == COMMAND
    kept = blackhole(peer)
    taken = []
    for number in range(50):
        taken.append(link.write(bytes([number] * 20)))
        assert link.unsent() <= 20
        time.sleep(0.002)
    assert taken == [True] + [False] * 49
    peer.setsockopt(socket.SOL_SOCKET, SO_DETACH_FILTER, 0)
    assert peer.recv(4096) == bytes(20)  # the one command, and none of the 49 that were refused
    until(lambda: not link.unsent())
    assert link.write(COMMAND)
    assert peer.recv(4096) == COMMAND
    assert kept


def test_closing_a_dead_tcp_link_discards_the_command_it_held(tcp_pair):
    link, peer = tcp_pair
    kept = blackhole(peer)
    assert link.write(COMMAND)
    link.close()
    peer.setsockopt(socket.SOL_SOCKET, SO_DETACH_FILTER, 0)
    peer.settimeout(0.7)  # longer than the retransmission that would bring it
    with pytest.raises((TimeoutError, ConnectionResetError)):
        peer.recv(100)
    assert kept


@pytest.mark.slow
def test_a_dead_tcp_link_is_lost_after_two_seconds(tcp_pair):
    link, peer = tcp_pair
    kept = blackhole(peer)
    assert link.write(COMMAND)
    with pytest.raises(DeviceLostError):
        until(lambda: False, link.read, what="the loss", timeout=10.0, pause=0.05)
    assert kept


def test_a_tcp_peer_that_does_not_read_never_has_more_than_one_command_on_our_side(tcp_pair):
    link, peer = tcp_pair
    command = bytes(4000)
    accepted = refused = 0
    for _ in range(100_000):
        accepted, refused = (accepted + 1, refused) if link.write(command) else (accepted, refused + 1)
        assert link.unsent() <= len(command)
        if refused > 1000 and accepted * len(command) > 40_000:
            break
    peer.settimeout(0.5)
    received = 0
    while received < accepted * len(command):
        received += len(peer.recv(65536))
        link.write(b"")
    assert received == accepted * len(command)


def test_a_full_pty_refuses_and_never_cuts_a_command(serial_pair):
    link, master = serial_pair
    frames = [b"<" + number.to_bytes(2, "big") * 48 + b">" for number in range(1000)]
    taken = [frame for frame in frames if link.write(frame)]
    assert 0 < len(taken) < 1000
    assert link.unsent() < len(frames[0])
    got = drain(master)
    while link.unsent():  # the rest of the frame that was cut goes first
        assert link.write(b"")
        got += drain(master)
    assert link.write(b"END")
    assert got + drain(master) == b"".join(taken) + b"END"


def test_a_cut_command_is_finished_before_anything_else():
    """The kernel is made to take three bytes at a time; the real one does so when a port's buffer is full."""
    echo = open_transport("loop://", place="device")
    give = echo._give
    echo._give = lambda data: give(data[:3])
    assert echo.write(b"abcdefg")
    assert echo.unsent() >= 4
    assert not echo.write(b"other")
    assert not echo.write(b"other")
    assert echo.unsent() > 0
    assert echo.read_wait(1) == b"abcdefg"
    assert echo.write(b"xyz")
    assert echo.read_wait(1) == b"xyz"
    echo.close()


def test_write_all_gives_up_on_a_peer_that_takes_nothing():
    one = open_transport("loop://stalled", place="device")
    assert one.write(b"first")
    with pytest.raises(DeviceError, match="took no 6 bytes") as caught:
        one.write_all(b"second", 0.05)
    assert not isinstance(caught.value, DeviceLostError)
    other = open_transport("loop://stalled", place="device")
    assert other.read_wait(1) == b"first"
    one.write_all(b"second", 0.05)
    assert other.read_wait(1) == b"second"
    one.close()
    other.close()


# -- what can't be opened


def test_a_port_that_does_not_exist_is_named_with_those_that_do():
    with pytest.raises(DeviceError, match=r"glove: there is no port /dev/ttyUSB99\. .*(Ports that|No /dev)"):
        open_transport("/dev/ttyUSB99", place="glove")


def test_a_port_that_another_holds_is_refused_until_it_is_closed(serial_pair):
    link, _ = serial_pair
    with pytest.raises(DeviceError, match="in use by another program"):
        open_transport(link.url, place="second")
    link.close()
    open_transport(link.url, place="second").close()


def test_no_permission_names_the_group(monkeypatch):
    def refuse(*_args, **_options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", refuse)  # the tests may run as root, who may open anything
    with pytest.raises(DeviceError, match="dialout"):
        open_transport("/dev/ttyUSB0", place="glove")


def test_what_is_not_a_serial_port_is_refused(tmp_path):
    file = tmp_path / "file"
    file.write_text("")
    with pytest.raises(DeviceError, match="can't be opened as a serial port"):
        open_transport(str(file), place="glove")


def test_nobody_listening_is_said():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(DeviceError, match="refuses a connection"):
        open_transport(f"tcp://127.0.0.1:{port}", place="glove")


@pytest.mark.parametrize(
    "url",
    [
        "tcp://",
        "tcp://host",
        "tcp://host:port",
        "tcp://host:99999",
        "tcp://h:1/path",
        "udp://h:1",
        "spy:log",
        "spy::x",
    ],
)
def test_a_malformed_url_is_refused_with_an_example(url):
    with pytest.raises(DeviceError, match=r"glove: .*tcp://|spy:"):
        open_transport(url, place="glove")


def test_a_spy_without_a_writable_log_closes_the_link(serial_pair):
    link, _ = serial_pair
    link.close()
    with pytest.raises(DeviceError, match="can't be written"):
        open_transport(f"spy:/nonexistent/x.log:{link.url}", place="glove")
    open_transport(link.url, place="glove").close()


@pytest.mark.parametrize("host", ["a..b", "a" * 70])
def test_what_can_t_be_a_host_s_name_is_said(host):
    with pytest.raises(DeviceError, match=f"no host is called '{host}'"):
        open_transport(f"tcp://{host}:1", place="glove")


def test_a_full_disk_under_a_spy_s_log_doesn_t_keep_the_link(serial_pair):
    link, _ = serial_pair
    link.close()
    spy = open_transport(f"spy:/dev/full:{link.url}", place="glove")
    spy._log.write("the rest of a line")  # what is left for the log's end
    spy.close()
    assert spy.fileno() == -1
    open_transport(link.url, place="glove").close()
