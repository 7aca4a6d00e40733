"""The doors of network twins, over loopback."""

from __future__ import annotations

import socket

import pytest
from helpers.wait import until

from srl.runtime.contracts.errors import HostError
from srl.sim.devices.shared.sockets import TcpDoor, UdpDoor


def test_clients_come_and_go_and_come_back() -> None:
    door = TcpDoor(most=2)
    door.open()
    port = door.port
    one = socket.create_connection(("127.0.0.1", port))
    until(door.accept)
    (client,) = door.clients
    one.sendall(b"hello")
    got: list[bytes] = []
    until(lambda: (got.append(client.read()), b"".join(got) == b"hello")[1])
    client.write(b"welcome")
    assert one.recv(100) == b"welcome"
    one.close()
    until(lambda: (client.read(), client.gone)[1])
    assert door.accept() == []
    assert door.clients == []
    two, three, four = (socket.create_connection(("127.0.0.1", port)) for _ in range(3))
    until(lambda: (door.accept(), len(door.clients) == 2)[1])
    four.settimeout(5)
    assert four.recv(1) == b""  # one too many
    door.close()
    two.settimeout(5)
    with pytest.raises(ConnectionResetError):
        two.recv(1)
    door.open()
    assert door.port == port
    assert door.connects == 3
    door.close()
    for link in (two, three, four):
        link.close()


def test_a_client_that_doesn_t_read_loses_whole_frames_only() -> None:
    door = TcpDoor()
    door.open()
    end = socket.create_connection(("127.0.0.1", door.port))
    until(door.accept)
    (client,) = door.clients
    frame = bytes(range(256)) * 16
    sent = 0
    while not client.lost:
        client.write(frame)
        sent += 1
    for _ in range(5):
        client.write(frame)
    lost = client.lost // len(frame)
    assert client.lost == lost * len(frame)
    data = b""
    end.settimeout(0.2)
    while True:
        try:
            data += end.recv(1 << 20)
        except TimeoutError:
            client.write(frame)  # sends what is left of the frame that was begun
            if not client._kept and len(data) >= (sent + 5 - lost) * len(frame):
                break
    whole, rest = divmod(len(data), len(frame))
    assert (data[: whole * len(frame)], rest) == (frame * whole, 0)
    end.close()
    door.close()


def test_a_datagram_door_answers_who_asked() -> None:
    door = UdpDoor()
    door.open()
    with socket.socket(type=socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", 0))
        end.sendto(b"ask", ("127.0.0.1", door.port))
        found: list[tuple[bytes, tuple[str, int]]] = []
        until(lambda: (found.extend(door.read()), found)[1])
        assert found[0][0] == b"ask"
        door.write(b"answer", found[0][1])
        assert end.recv(100) == b"answer"
    door.write(b"nobody", found[0][1])
    assert door.read() == []
    port = door.port
    door.close()
    door.write(b"closed", found[0][1])
    door.open()
    assert door.port == port
    door.close()


def test_only_loopback_is_offered_and_a_taken_port_is_named() -> None:
    with pytest.raises(HostError, match="loopback"):
        TcpDoor("0.0.0.0")
    with pytest.raises(HostError, match="loopback"):
        UdpDoor("192.168.1.1")
    door, other = TcpDoor(), TcpDoor()
    door.open()
    with pytest.raises(HostError, match="can't listen there"):
        other.open(door.port)
    door.close()
