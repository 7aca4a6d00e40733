"""The suit's software on the wire, alone and against the driver; one that hangs; real people's motion end to end."""

from __future__ import annotations

import contextlib
import socket
import struct
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
import pytest
from helpers.peer import Peer, cycles
from helpers.shared import shared
from helpers.twin import TIMEOUT, Bench, bound
from helpers.wait import until

from srl.drivers.noitom import Noitom, driver
from srl.runtime.contracts.errors import DeviceError, DeviceLostError, HostError
from srl.runtime.contracts.signals import Array
from srl.sim.devices.noitom.fake import FakeNoitom
from srl.sim.devices.noitom.twin import NoitomTwin
from srl.sim.world.cell import Cell, CellConfig

MS = 1_000_000
RATE = 100.0
TCP, UDP = "tcp://127.0.0.1:7001", "udp://:0"


def made(
    body: dict[str, Any] | None = None, config: dict[str, Any] | None = None, options: dict[str, Any] | None = None
) -> NoitomTwin:
    parts = {"person": {"part": "body", "script": "reach"} | (body or {})}
    world = Cell(CellConfig.model_validate({"parts": parts}), seed=2)
    settings = FakeNoitom.Config.model_validate({"port": TCP} | (config or {}))
    fake = FakeNoitom(
        "suit", settings, world, FakeNoitom.Options.model_validate({"rate": RATE, "delay": 0.0} | (options or {}))
    )
    bound(fake)
    return NoitomTwin(fake)


class Listener:
    """A TCP client without any protocol."""

    def __init__(self, bench: Bench) -> None:
        host, port = bench.twin.address.removeprefix("tcp://").split(":")
        self.link = socket.create_connection((host, int(port)))
        self.link.settimeout(TIMEOUT)
        self.heard = b""
        bench.twin.service(bench.now)

    def hear(self, size: int) -> bytes:
        """Exactly so many bytes, which must be on their way."""
        while len(self.heard) < size:
            self.heard += self.link.recv(65536)
        taken, self.heard = self.heard[:size], self.heard[size:]
        return taken

    def silent(self) -> bool:
        """Nothing comes for a while."""
        self.link.settimeout(0.05)
        try:
            self.heard += self.link.recv(65536)
        except TimeoutError:
            pass
        self.link.settimeout(TIMEOUT)
        return not self.heard


@contextlib.contextmanager
def listening(twin: NoitomTwin) -> Iterator[tuple[Bench, Listener]]:
    with Bench(twin) as bench:
        listener = Listener(bench)
        yield bench, listener
        listener.link.close()


# -- what is on the wire, read without our parsers


@pytest.mark.parametrize(
    ("options", "count"),
    [
        ({}, 354),
        ({"displacement": False}, 180),
        ({"reference": True}, 360),
        ({"displacement": False, "reference": True}, 186),
    ],
)
def test_binary_frames_are_what_the_sheet_says(options: dict[str, Any], count: int) -> None:
    with listening(made(options=options)) as (bench, listener):
        bench.run(0.03)
        first = None
        for _ in range(3):
            packet = listener.hear(64 + 4 * count)
            token, version, values, displacement, reference, avatar = struct.unpack_from("<HIHBBI", packet)
            number, end = struct.unpack_from("<I12xH", packet, 46)
            assert (token, version, values, end) == (0xDDFF, 0x01010000, count, 0xEEFF)
            assert (displacement, reference, avatar) == (options.get("displacement", True), "reference" in options, 0)
            assert packet[14:46] == b"Char00".ljust(32, b"\0")
            first = number if first is None else first
        assert number == first + 2
        numbers = struct.unpack(f"<{count}f", packet[64:])
        hips = numbers[6:12] if "reference" in options else numbers[:6]
        assert hips[1] == pytest.approx(91.43, abs=1.0)
        assert not any(numbers[:6]) or "reference" not in options


def test_text_is_what_the_sheet_says() -> None:
    with listening(made(options={"format": "text"})) as (bench, listener):
        bench.run(0.01)
        record = b""
        while not record.endswith(b"||\r\n"):
            record += listener.hear(1)
        words = record.decode().split(" ")
        assert words[:2] == ["0", "Char00"]
        assert words[-1] == "||\r\n"
        assert len(words) == 2 + 354 + 1
        assert all(len(word.partition(".")[2]) == 4 for word in words[2:-1])


def test_it_greets_nobody_and_heeds_nothing() -> None:
    with listening(made()) as (bench, listener):
        assert listener.silent()
        listener.link.sendall(b"hello\r\n" * 100)
        bench.run(0.01)
        assert listener.hear(2) == b"\xff\xdd"


def test_every_client_gets_every_frame_from_when_it_came() -> None:
    with listening(made()) as (bench, one):
        bench.run(0.02)
        two = Listener(bench)
        bench.run(0.01)
        frames = [one.hear(1480) for _ in range(3)]
        assert two.hear(1480) == frames[-1]
        two.link.close()
        bench.run(0.02)
        one.hear(2 * 1480)
        assert bench.twin.metrics() | {"connects": 2, "frames": 5, "bytes_lost": 0} == bench.twin.metrics()


def test_avatars_take_turns() -> None:
    with listening(made(config={"avatar": 1}, options={"others": 2})) as (bench, listener):
        bench.run(0.01)
        packets = [listener.hear(1480) for _ in range(3)]
        assert [struct.unpack_from("<I6s", p, 10) for p in packets] == [(k, f"Char0{k}".encode()) for k in range(3)]
        standing, _, other = (p[64:] for p in packets)
        assert standing == other
        assert struct.unpack_from("<6f", standing) == pytest.approx((0, 91.43, 0, 0, 0, 0), abs=1e-5)


def test_a_lost_frame_leaves_a_gap_in_the_numbers() -> None:
    with listening(made(options={"dropout": 0.3})) as (bench, listener):
        bench.run(1.0)
        sent = bench.twin.metrics()["frames"]
        assert isinstance(sent, int)
        numbers = [struct.unpack_from("<I", listener.hear(1480), 46)[0] for _ in range(sent)]
        assert 50 < sent < 90
        assert (np.diff(numbers) > 1).any()


@pytest.mark.slow
def test_a_client_that_doesnt_read_delays_nobody() -> None:
    with listening(made({"script": "t-pose"}, options={"others": 7})) as (bench, _lazy):
        eager = Listener(bench)
        numbers = []
        while not bench.twin.metrics()["bytes_lost"]:
            bench.run(0.2)
            numbers += [struct.unpack_from("<I", eager.hear(8 * 1480), 46)[0] for _ in range(20)]
            assert len(numbers) < 5000
        assert set(np.diff(numbers)) == {1}


def test_datagrams_go_to_the_profiles_port() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here:
        here.bind(("127.0.0.1", 0))
        here.settimeout(TIMEOUT)
        port = here.getsockname()[1]
        with Bench(made(config={"port": f"udp://:{port}"})) as bench:
            assert bench.twin.address == f"udp://127.0.0.1:{port}"
            bench.run(0.02)
            packets = [here.recv(65536) for _ in range(2)]
            assert [len(packet) for packet in packets] == [1480, 1480]


def test_it_listens_on_loopback_alone() -> None:
    from srl.sim.devices.shared.sockets import TcpDoor

    with pytest.raises(HostError):
        TcpDoor("0.0.0.0")


# -- against the driver


def driver_of(bench: Bench, config: dict[str, Any] | None = None) -> Noitom:
    """Open, in step with the bench's clock."""
    device = Noitom("suit", Noitom.Config.model_validate({"port": bench.twin.address} | (config or {})))
    bound(device)
    open_in(bench, device)
    return device


def open_in(bench: Bench, device: Noitom) -> None:
    """Opens by the bench's clock, so that the rate is the world's, whatever this machine's pace."""
    clock = SimpleNamespace(monotonic=lambda: bench.now * 1e-9)
    with mock.patch.multiple(driver, time=clock, MEASURE=0.1), bench.running():
        device.open()


@pytest.mark.parametrize("options", [{}, {"displacement": False}, {"reference": True, "others": 1}])
@pytest.mark.parametrize("form", ["binary", "text"])
@pytest.mark.parametrize("port", [TCP, UDP])
def test_the_driver_reads_what_the_fake_reads(options: dict[str, Any], form: str, port: str) -> None:
    twin = made(config={"port": port}, options=options | {"format": form})
    with Bench(twin) as bench:
        device = driver_of(bench)
        twin.fake.open()
        for _ in range(25):
            bench.run(0.01)
            twin.fake.read(bench.now)
            until(lambda: device._link is None or _caught_up(device, twin), lambda: device.read(bench.now))
            for name, values in device.state_arrays.items():
                np.testing.assert_allclose(values, twin.fake.state_arrays[name], atol=1e-9)
        assert device.health.errors == device.health.resyncs == 0
        assert device.metrics()["gaps"] == 0
        assert bench.now - device.health.stamp < 11 * MS
        device.close()


def _caught_up(device: Noitom, twin: NoitomTwin) -> bool:
    return bool(np.allclose(device.state_arrays["rotation"], twin.fake.state_arrays["rotation"], atol=1e-9))


@pytest.mark.slow
def test_a_pulled_cable_and_its_return() -> None:
    twin = made(options={"loss": [[3.0, 3.5]]})
    with Bench(twin) as bench:
        device = driver_of(bench)
        bench.run(max(0.0, 3.1 - bench.now * 1e-9))
        with pytest.raises(DeviceLostError):
            until(lambda: False, lambda: device.read(bench.now))
        device.close()
        with pytest.raises(DeviceError, match="refuses a connection"):
            device.open()
        bench.run(0.5)
        open_in(bench, device)
        assert device.health.reconnects == 1
        device.close()


def test_muted_software_goes_silent_and_its_samples_grow_old() -> None:
    twin = made()
    with Bench(twin) as bench:
        device = driver_of(bench)
        bench.run(0.1)
        until(lambda: device.health.stamp > 0, lambda: device.read(bench.now))
        twin.muted = True
        stamp = device.health.stamp
        bench.run(0.5)
        device.read(bench.now)
        assert device.health.stamp <= stamp + 20 * MS
        twin.muted = False
        bench.run(0.05)
        until(lambda: bench.now - device.health.stamp < 15 * MS, lambda: device.read(bench.now))
        device.close()


# -- software that hangs


@pytest.mark.sampled(1)
@pytest.mark.slow
@pytest.mark.parametrize("form", ["binary", "text"])
@pytest.mark.parametrize("port", [TCP, UDP])
def test_software_that_hangs_for_three_seconds_gives_no_old_pose_for_a_fresh_one(form: str, port: str) -> None:
    world = {"world": "cell", "parts": {"person": {"part": "body", "script": "walk"}}}
    with Peer("noitom", {"port": port}, {"format": form, "noise": 0.0}, world) as peer:
        device = Noitom("suit", Noitom.Config.model_validate({"port": peer.address}))
        bound(device)
        device.open()
        cycles(device, 1.0, 100)
        peer.stop()
        seen: list[tuple[int, int]] = []
        cycles(device, 3.0, 100, lambda now: seen.append((now, device.health.stamp)))
        assert seen[-1][0] - seen[-1][1] > 2_800 * MS  # it says that its newest sample is old
        stamp = device.health.stamp
        peer.cont()
        ages: list[int] = []
        fresh: list[tuple[int, Array]] = []

        def look(now: int) -> None:
            if device.health.stamp != stamp:
                ages.append(now - device.health.stamp)
                if ages[-1] < 100 * MS:
                    x, y, z = device.state_arrays["translation"][0]
                    fresh.append((now, np.array([z, x, y])))

        until(lambda: ages and ages[-1] <= 100 * MS, lambda: cycles(device, 0.1, 100, look), what="fresh samples")
        cycles(device, 0.5, 100, look)
        now, hips = time.monotonic_ns(), np.array(peer.metrics()["truth"]["person_position"][0])
        # It walks 1 m/s; during the pause it went on by 2 m. What counts as fresh must fit where the person was.
        for at, place in fresh:
            assert np.linalg.norm(hips - place) < 1.1 * (now - at) * 1e-9 + 0.4
        assert device.health.connected
        assert device.health.errors == 0
        device.close()


# -- real people


ORDERS = {"fullbody_walk_yxz": ("YXZ", 2.0), "fullbody_xyz": ("XYZ", 1.0), "left_arm_fingers_yxz": ("YXZ", 0.6)}


@pytest.mark.parametrize("name", ORDERS)
def test_recorded_motion_comes_out_at_the_other_end(name: str) -> None:
    """File -> person -> software -> TCP -> driver. Within degrees (RMS over joints and time) of the file."""
    order, within = ORDERS[name]
    path = str(shared(f"data/axis_neuron_bvh/{name}.bvh"))
    twin = made({"recording": path, "fingers": True}, {"order": order}, {"noise": 0.0})
    person = twin.software.body
    assert person.duration is not None
    with Bench(twin) as bench:
        device = driver_of(bench, {"order": order})
        off = []
        while bench.now * 1e-9 < min(person.duration, 1.5):
            bench.run(0.01)
            frames = device.health.frames
            until(lambda before=frames: device.health.frames > before, lambda: device.read(bench.now))
            wanted = person.wanted(device._number / RATE)[1]
            dots = np.abs(np.sum(device.state_arrays["rotation"] * wanted, axis=1))
            off.append(np.degrees(2 * np.arccos(np.clip(dots, 0, 1))))
        assert len(off) > 100
        assert np.sqrt((np.array(off) ** 2).mean()) < within
        assert device.metrics()["gaps"] == 0
        device.close()
