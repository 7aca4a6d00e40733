"""A glove that dials in over Wi-Fi: driver and twin over TCP, with the roles of client and server swapped."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from threading import Event, Thread
from typing import Any

import numpy as np
import pytest
from helpers.twin import StillWorld, bound
from helpers.wait import until

from srl.drivers.cyberglove import CyberGlove
from srl.drivers.cyberglove.driver import CyberGloveConfig
from srl.drivers.transport import listening, open_transport
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.sim.devices.cyberglove.fake import FakeCyberGlove, FakeCyberGloveConfig
from srl.sim.devices.cyberglove.twin import CyberGloveTwin


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Wifi:
    def __init__(self) -> None:
        self.world = StillWorld()
        config = CyberGloveConfig(port=f"tcp-listen://127.0.0.1:{free_port()}")
        self.twin = CyberGloveTwin(FakeCyberGlove("glove", config, self.world, FakeCyberGloveConfig(noise=0)))
        self.twin.open()
        self.driver = bound(CyberGlove("glove", config))

    def step(self) -> None:
        self.world.time += 1_000_000
        self.twin.service(self.world.time)

    def opened(self) -> Wifi:
        done = Event()
        server = Thread(target=lambda: [self.step() for _ in iter(lambda: done.wait(0.0005), True)])
        server.start()
        try:
            self.driver.open()
        finally:
            done.set()
            server.join()
        return self


@pytest.fixture
def wifi() -> Iterator[Wifi]:
    made = Wifi()
    yield made
    made.driver.close()
    made.twin.close()


def test_it_streams_and_comes_back(wifi: Wifi) -> None:
    assert wifi.twin.address.startswith("tcp-listen://")
    wifi.opened()
    read: Any = lambda: (wifi.step(), wifi.driver.read(wifi.world.time))  # noqa: E731
    frames = wifi.driver.health.frames
    until(lambda: wifi.driver.health.frames > frames + 20, read)
    np.testing.assert_allclose(wifi.driver.state_arrays["position"], 0.0, atol=0.02)
    assert wifi.driver.health.errors == 0
    wifi.twin.close()
    with pytest.raises(DeviceLostError):
        until(lambda: False, read)
    wifi.twin.open()
    wifi.opened()
    frames = wifi.driver.health.frames
    until(lambda: wifi.driver.health.frames > frames, read)
    assert wifi.driver.health.reconnects == 1
    assert wifi.twin.door.connects == 2


def test_nobody_dialling_in_is_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listening, "AWAIT", 0.05)
    with pytest.raises(DeviceError, match="no device dialled in"):
        open_transport(f"tcp-listen://127.0.0.1:{free_port()}", place="glove")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(DeviceError, match="is taken by another program"):
            open_transport(f"tcp-listen://127.0.0.1:{taken.getsockname()[1]}", place="glove")
    for wrong in ("tcp-listen://:5", "tcp-listen://host", "tcp-listen://h:5/x", "tcp-listen://h:99999"):
        with pytest.raises(DeviceError, match="isn't tcp-listen://HOST:PORT"):
            open_transport(wrong, place="glove")
    with pytest.raises(DeviceError, match="can't listen at"):
        open_transport(f"tcp-listen://203.0.113.5:{free_port()}", place="glove")
