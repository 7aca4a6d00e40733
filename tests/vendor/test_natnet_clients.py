"""Two clients that others wrote against the twin, unchanged: the maker's Python sample (natnetsdk), and natnet.

What they can't read themselves is left out: natnet reads no frames of 4.1 rightly, natnetsdk none of 4.0, and it
binds so that Linux gives it no multicast.
"""

from __future__ import annotations

import contextlib
import io
import socket
from typing import Any

import numpy as np
import pytest
from helpers.natnet import EXACT, TOOL, WANTED
from helpers.peer import Peer
from helpers.wait import until

from srl.drivers.natnet import protocol

pytestmark = pytest.mark.slow
natnet = pytest.importorskip("natnet", reason="pip install natnet")
sample = pytest.importorskip("natnetsdk.NatNetClient", reason="pip install natnetsdk")

WORLD = {"world": "cell", "parts": {"tool": TOOL}}
HIDDEN = {"occlusion": {"Drill/A": [[0.0, 1e6]]}}
PLACE = [0.4, 1.1, 0.2]  # (0.4, -0.2, 1.1) with y up
TURN = [0.5, 0.5, 0.5, 0.5]  # x, y, z, w, likewise


def peer(**options: Any) -> Peer:
    return Peer("natnet", WANTED, EXACT | HIDDEN | options, WORLD)


def port(address: str) -> int:
    return int(address.rpartition(":")[2])


@pytest.mark.parametrize("version", ["3.1", "4.1"])
def test_the_maker_s_sample_reads_poses_and_definitions(version):
    seen: list[tuple[int, Any, Any]] = []
    reported = io.StringIO()
    with peer(natnet=version) as twin, contextlib.redirect_stdout(reported):
        client = sample.NatNetClient()
        client.set_client_address("127.0.0.1")
        client.set_server_address("127.0.0.1")
        client.set_use_multicast(False)
        client.command_port = port(twin.address)
        client.rigid_body_listener = lambda *found: seen.append(found)
        client.set_print_level(1)
        assert client.run()
        try:
            until(client.connected)
            until(lambda: len(seen) > 20)
            target = ("127.0.0.1", client.command_port)
            client.send_request(client.command_socket, client.NAT_REQUEST_MODELDEF, "", target)
            until(lambda: "Drill" in reported.getvalue() and "Data Descriptions" in reported.getvalue())
            until(lambda: client.get_server_version()[0] > 0)
            assert client.get_application_name().startswith("Motive")
            assert list(client.get_nat_net_version_server())[:2] == [int(n) for n in version.split(".")]
        finally:
            _end(client)
    number, place, turn = seen[-1]
    assert number == 1
    np.testing.assert_allclose(place, PLACE, atol=2e-3)
    np.testing.assert_allclose(turn, TURN, atol=2e-3)


@pytest.mark.parametrize("version", ["3.1", "4.0"])
@pytest.mark.parametrize("multicast", [False, True])
def test_another_client_reads_frames_markers_and_definitions(version, multicast):
    frames: list[Any] = []
    models: list[Any] = []
    with peer(natnet=version, multicast=multicast) as twin:
        # In multicast it can't be told the group's port by the server, as it reads too little of its answer.
        data = _data_port(twin.address)
        client = natnet.NatNetClient(
            "127.0.0.1", "127.0.0.1", command_port=port(twin.address), data_port=data, use_multicast=multicast
        )
        client.on_data_frame_received_event.handlers.append(frames.append)
        client.on_data_description_received_event.handlers.append(models.append)
        with client:
            client.request_modeldef()
            until(lambda: len(frames) > 20 and models, client.update_sync)
            assert str(client.server_info.nat_net_protocol_version).startswith(version)
    (body,) = frames[-1].rigid_bodies
    assert (body.id_num, body.tracking_valid) == (1, True)
    np.testing.assert_allclose(body.pos, PLACE, atol=2e-3)
    np.testing.assert_allclose(body.rot, TURN, atol=2e-3)
    assert [marker.id_num for marker in frames[-1].labeled_markers] == [0x10001, 0x10002, 0x10003, 0x10004]
    assert [marker.param & 1 for marker in frames[-1].labeled_markers] == [1, 0, 0, 0]
    numbers = [frame.prefix.frame_number for frame in frames]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    (described,) = models[0].rigid_bodies
    assert (described.name, described.id_num, len(described.markers)) == ("Drill", 1, 4)
    np.testing.assert_allclose(described.markers[0].pos, [0.0, 0.05, 0.0], atol=1e-6)  # z of the body is its y there


def _end(client: Any) -> None:
    """Its own end waits for a datagram on a socket that gets none in unicast."""
    client.stop_threads = True
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.sendto(bytes(8), ("127.0.0.1", client.data_socket.getsockname()[1]))
    for thread in (client.data_thread, client.command_thread):
        thread.join(10.0)
    client.shutdown()


def _data_port(address: str) -> int:
    """Of the server's own answer."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.settimeout(10)
        link.sendto(protocol.connect(), ("127.0.0.1", port(address)))
        return protocol.server_info(protocol.split(link.recv(65536))[1]).data_port
