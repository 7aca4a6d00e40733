"""The simulated server: with its own fake's eyes, through the real driver, and with clients that misbehave."""

from __future__ import annotations

import select
import socket

import numpy as np
import pytest
from helpers.peer import Peer, cycles
from helpers.twin import Bench, bound
from helpers.vicon import PARTS, WANTED, config, driver, live, twin
from helpers.wait import until

from srl.drivers.transport import open_transport
from srl.drivers.vicon import blocks, protocol
from srl.drivers.vicon.protocol import Block, Parser
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.sim.devices.vicon import twin_blocks as encode

MS = 1_000_000
TIMEOUT = 10.0


class Client:
    """A bare client, in lockstep with the twin."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.link = open_transport(bench.twin.address, place="client")
        self.parser = Parser()
        self.found: list[list[tuple[int, bytes]]] = []

    def send(self, data: bytes) -> None:
        self.link.write_all(data, 5.0)
        self.bench.take(len(data))

    def packets(self, count: int):
        """The next `count` packets, which must be on their way."""

        def look() -> None:
            self.bench.twin.service(self.bench.now)
            for sent in self.parser.feed(self.link.read_wait(0.01)):
                self.found.append([(item.type, bytes(item.body)) for item in sent])

        until(lambda: len(self.found) >= count, look)
        taken, self.found = self.found[:count], self.found[count:]
        return taken

    def nothing(self) -> bool:
        """No packet is on its way."""
        self.bench.twin.service(self.bench.now)
        return not self.found and not select.select([self.link], [], [], 0.02)[0]


@pytest.fixture
def bench():
    with Bench(twin(noise=0.0, delay=0.0)) as made:
        yield made


@pytest.fixture
def client(bench):
    made = Client(bench)
    made.packets(1)
    yield made
    made.link.close()


def kinds(packet):
    return [kind for kind, _ in packet]


def frame_number(packet) -> int:
    return next(blocks.whole(body) for kind, body in packet if kind == Block.FRAME_INFO)


# -- the protocol


def test_it_speaks_first_and_says_what_it_offers(bench):
    ((greeting,),) = [Client(bench).packets(1)[0]]
    assert greeting[0] == Block.OBJECT_ENUMS
    assert blocks.enums(greeting[1]) >= {1, 2, 5, 6, 7, 8, 9, 23, 26, 28, 29, 36, 37, 39, 40, 42, 901, 28001, 100008}


def test_only_what_was_subscribed_to_is_sent_and_static_blocks_once(bench, client):
    client.send(protocol.object_enums({1, 2, 5, 9, 37, 100004}) + protocol.request_frame(False))
    bench.run(0.01)
    (first,) = client.packets(1)
    assert kinds(first) == [100004, 1, 2, 2, 37, 5, 9, 9]
    assert blocks.contents(first[0][1]) == ({1: 1, 2: 2, 5: 1, 9: 2, 37: 1}, frozenset())
    client.send(protocol.request_frame(False))
    (second,) = client.packets(1)
    assert kinds(second) == [100004, 5, 9, 9]
    assert blocks.contents(second[0][1]) == ({5: 1, 9: 2}, {1, 2, 37})
    client.send(protocol.object_enums({2, 5, 28, 100004}) + protocol.request_frame(False))
    (third,) = client.packets(1)
    assert kinds(third) == [100004, 28, 28, 5]  # the list of subjects is known from before


def test_a_pulled_frame_comes_once_and_at_once(bench, client):
    bench.run(0.1)
    client.send(protocol.object_enums({5}) + protocol.request_frame(False))
    assert frame_number(client.packets(1)[0]) == 10
    bench.run(0.05)
    assert client.nothing()


def test_next_frames_come_as_they_are_taken(bench, client):
    bench.run(0.1)
    client.send(protocol.object_enums({5}) + protocol.request_next_frame(2))
    assert client.nothing()
    bench.run(0.05)
    assert [frame_number(packet) for packet in client.packets(2)] == [11, 12]
    assert client.nothing()


def test_pushed_frames_come_until_one_is_pulled(bench, client):
    client.send(protocol.object_enums({5}) + protocol.request_frame(True))
    bench.run(0.1)
    assert [frame_number(packet) for packet in client.packets(10)] == list(range(1, 11))
    client.send(protocol.request_frame(False))
    client.packets(1)
    bench.run(0.1)
    assert client.nothing()


def test_a_ping_is_echoed_and_strangers_are_hung_up_on(bench, client):
    client.send(protocol.ping(77))
    assert client.packets(1) == [[(Block.PING, (77).to_bytes(8, "little"))]]
    other = Client(bench)
    other.packets(1)
    other.send(b"GET / HTTP/1.1\r\n\r\n")

    def read() -> None:
        bench.twin.service(bench.now)
        other.link.read()

    with pytest.raises(DeviceLostError):
        until(lambda: False, read)
    client.send(protocol.ping(78))
    client.packets(1)


def test_a_filter_leaves_out_the_other_subjects(bench, client):
    allowed = b"\1\0\0\0" + b"\x09\0\0\0" + b"\1\0\0\0" + b"\2\0\0\0"  # GlobalSegments: subject 2
    client.send(
        protocol.packet(protocol.block(Block.FILTER, allowed))
        + protocol.object_enums({5, 8, 9})
        + protocol.request_frame(False)
    )
    bench.run(0.01)
    (packet,) = client.packets(1)
    assert [(kind, blocks.segments_of(body)) for kind, body in packet if kind in (8, 9)] == [(8, 1), (8, 2), (9, 2)]


@pytest.mark.parametrize("data", [b"\1\0\0\0", b"\1\0\0\0\x09\0\0\0\xff\xff\xff\xff", b""])
def test_a_short_filter_ends_the_connection(bench, client, data):
    client.send(protocol.packet(protocol.block(Block.FILTER, data)))

    def read() -> None:
        bench.twin.service(bench.now)
        client.link.read()

    with pytest.raises(DeviceLostError):
        until(lambda: False, read)


def test_local_and_light_segments_are_relative_to_their_parents():
    bodies = {"Rig": {"Base": "hand/body", "Tip": "tool/body"}}
    with Bench(twin(noise=0.0, delay=0.0, bodies=bodies)) as bench:
        made = twin(noise=0.0, delay=0.0, bodies=bodies)
        made.fake.world.advance(500 * MS)
        number = made.vicon.newest()
        data = made.maker.packet(number, made.vicon.sample(number), {8, 9, 901}, set(), {})
        (packet,) = Parser().feed(data)
        poses = {
            kind: dict(blocks.find_segments(body, {1: 1, 2: 2}))
            for kind, body in packet
            if kind in (8, 9) and blocks.segments_of(body) == 3
        }
        turn = {kind: {n: np.reshape(v[3:], (3, 3)) for n, v in found.items()} for kind, found in poses.items()}
        np.testing.assert_allclose(turn[9][1] @ turn[8][2], turn[9][2], atol=1e-12)
        moved = turn[9][1] @ poses[8][2][:3] + poses[9][1][:3]
        np.testing.assert_allclose(moved, poses[9][2][:3])
        light = next(bytes(body) for kind, body in packet if kind == 901 and blocks.segments_of(body) == 3)
        tip = np.frombuffer(light[8 + 28 + 4 :], "<f4")
        np.testing.assert_allclose(tip[:3], poses[8][2][:3], rtol=1e-5)
        angle = np.arccos((np.trace(turn[8][2]) - 1) / 2)
        assert np.linalg.norm(tip[3:]) == pytest.approx(angle, rel=1e-4)
        assert bench.twin.address.startswith("tcp://127.0.0.1:")


# -- the driver against it


@pytest.mark.parametrize("mode", ["push", "pull"])
@pytest.mark.parametrize("y_up", [False, True])
def test_the_driver_reads_what_a_client_of_the_fake_reads(mode, y_up):
    options = {
        "noise": 0.001,
        "delay": 0.012,
        "occlusion": {"Hand": [[0.5, 0.6]], "Tool/M2": [[0.7, 0.9]]},
        "reflections": [[1.0, 2.0, 3.0]],
        "y_up": y_up,
    }
    with Bench(twin(**options)) as bench:
        device = driver(bench.twin.address, **WANTED, mode=mode)
        fake = bound(bench.twin.fake)
        with bench.running():
            device.open()
        fake.open()
        number = 0
        start = bench.now - bench.now % (10 * MS)
        while bench.now < start + 1200 * MS:
            bench.run(0.001)
            frames = device.health.frames
            device.read(bench.now)
            fake.read(bench.now)
            # Frames that were under way at the opening come as a backlog and give the offset its first value.
            if device.health.frames > frames and bench.now > start + 50 * MS:
                number += 1
                for name, values in device.state_arrays.items():
                    sign = np.sign(np.dot(values[3:], fake.state_arrays[name][3:])) if name.endswith(".pose") else 1.0
                    if name != "pose":
                        scaled = np.concatenate([values[:3], sign * values[3:]]) if name.endswith(".pose") else values
                        np.testing.assert_allclose(scaled, fake.state_arrays[name], atol=1e-9, err_msg=name)
                assert device.health.stamp == pytest.approx(fake.health.stamp, abs=MS)
        assert number > 100
        assert device.health.errors == 0
        assert device.metrics()["missed_frames"] <= 1
        device.close()


def test_the_driver_over_the_object_stream_reads_the_same():
    device_config = config("udp://127.0.0.1:0", segments={"hand": "Hand", "tool": "Tool"})
    with Bench(twin(device_config, noise=0.0001, delay=0.004)) as bench:
        device = driver(bench.twin.address, segments={"hand": "Hand", "tool": "Tool"})
        with live(bench.twin):
            device.open()
        bench.now = bench.world.time
        fake = bound(bench.twin.fake)
        fake.open()
        device.read(bench.now)
        for _ in range(50):
            bench.run(0.01)
            frames = device.health.frames
            until(lambda count=frames: device.health.frames > count, lambda: device.read(bench.now))
            fake.read(bench.now)
            for name in ("hand.pose", "tool.pose"):
                ours, truth = device.state_arrays[name], fake.state_arrays[name]
                np.testing.assert_allclose(ours[:3], truth[:3], atol=1e-9)
                assert abs(ours[3:] @ truth[3:]) == pytest.approx(1.0)
        device.close()


def test_a_subject_switched_off_and_on_again(bench):
    device = driver(bench.twin.address)
    with bench.running():
        device.open()
    bench.run(0.05)
    device.read(bench.now)
    assert device.state_arrays["visible"].tolist() == [1, 1]
    bench.twin.disable("Tool")
    bench.run(0.05)
    until(lambda: device.state_arrays["visible"].tolist() == [1, 0], lambda: device.read(bench.now))
    assert "no tip, second" in device.health.message
    bench.twin.enable("Tool")
    bench.run(0.05)
    until(lambda: device.state_arrays["visible"].tolist() == [1, 1], lambda: device.read(bench.now))
    assert device.health.message == ""


def test_frame_numbers_that_wrap():
    with Bench(twin(noise=0.0, delay=0.0)) as bench:
        bench.twin.maker.offset = 2**32 - 30
        device = driver(bench.twin.address)
        with bench.running():
            device.open()
        bench.run(0.05)
        device.read(bench.now)
        for _ in range(60):
            bench.run(0.01)
            device.read(bench.now)
            assert device.health.stamp == pytest.approx(bench.now, abs=11 * MS)
        assert device.metrics()["missed_frames"] == 0


def test_a_pulled_cable_is_a_loss_and_the_server_is_found_again(bench):
    device = driver(bench.twin.address)
    with bench.running():
        device.open()
    bench.twin.close()

    def read():
        with pytest.raises(DeviceLostError):
            device.read(bench.now)

    until(lambda: not device.health.connected, read)
    with pytest.raises(DeviceError, match="refuses a connection"):
        device.open()
    bench.twin.open()
    with bench.running():
        device.open()
    assert device.health.reconnects == 1
    bench.run(0.05)
    device.read(bench.now)
    assert bench.now - device.health.stamp <= 10 * MS


def test_a_muted_server_goes_stale_and_wakes_up(bench):
    device = driver(bench.twin.address)
    with bench.running():
        device.open()
    bench.run(0.05)
    device.read(bench.now)
    bench.twin.muted = True
    for _ in range(30):
        bench.run(0.01)
        device.read(bench.now)
    assert bench.now - device.health.stamp >= 300 * MS
    bench.twin.muted = False
    bench.run(0.02)
    until(lambda: bench.now - device.health.stamp <= 10 * MS, lambda: device.read(bench.now))


def test_a_client_that_doesn_t_read_loses_frames_and_then_gets_the_names_again(bench, client):
    (served,) = bench.twin.doors()[0].clients
    served._link.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
    client.link._writer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    client.send(protocol.object_enums({2, 5, 9, 100004}) + protocol.request_frame(True))
    until(lambda: served.lost, lambda: bench.run(0.1))
    bench.twin.disable("Tool")  # the packet with the new names gets lost, too
    bench.run(0.05)
    newest = bench.twin.vicon.newest()
    seen: list[str] = []

    def read() -> None:
        bench.run(0.01)
        for packet in client.packets(len(client.found) or 1):
            if named := [blocks.subject_info(body).name for kind, body in packet if kind == 2]:
                seen[:] = named
            client.last = frame_number(packet)

    client.last = -1
    until(lambda: client.last > newest, read)
    assert seen == ["Hand"]


@pytest.mark.slow
def test_a_process_that_hangs_goes_stale_and_comes_back():
    world = {"world": "cell", "parts": PARTS}
    with Peer("vicon", WANTED, {"noise": 0.0}, world) as peer:
        device = driver(peer.address)
        device.open()
        cycles(device, 0.5, 200)
        assert device.health.stamp > 0
        peer.stop()
        held = []
        cycles(device, 0.5, 200, lambda now: held.append((now, device.health.stamp)))
        assert held[-1][1] < held[-1][0] - 300 * MS  # stale long since
        peer.cont()
        after = [held[-1]]
        until(
            lambda: after[-1][1] > held[-1][0],
            lambda: cycles(device, 0.1, 200, lambda now: after.append((now, device.health.stamp))),
        )
        stamps = np.array([stamp for _, stamp in after])
        assert (np.diff(stamps) >= -MS).all()
        assert all(stamp <= now for now, stamp in after)
        device.close()


def test_encoded_empty_lists_are_read():
    assert blocks.unlabeled(encode.unlabeled(np.empty((0, 3)), [])[8:], 5) == []
    assert blocks.find_labeled(encode.labeled([], np.empty((0, 3)), [])[8:], {(1, 1): 0}) == []


def test_figures_and_log(bench, client):
    bench.twin.keep_log = True
    client.send(protocol.object_enums({5}) + protocol.request_frame(True))
    bench.run(0.05)
    client.packets(5)
    log = bench.twin.log()
    np.testing.assert_array_equal(log["frame"], [1, 2, 3, 4, 5])
    np.testing.assert_array_equal(log["taken_ns"], np.arange(1, 6) * 10 * MS)
    assert bench.twin.metrics()["frames"] == 5
