"""The Trigno's driver, fake and twin: the sheet's vectors, samples, lost sensors, a server that hangs."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from threading import Event, Thread
from typing import Any

import numpy as np
import pytest
from helpers.fuzz import fuzz, size_of
from helpers.twin import StillWorld, bound
from helpers.wait import until

from srl.drivers.trigno import Trigno, TrignoConfig
from srl.drivers.trigno.envelope import Envelope
from srl.drivers.trigno.protocol import RATE, Answers, Samples, command, encode
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.sim.devices.shared.sockets import Client
from srl.sim.devices.trigno.fake import FakeTrigno, FakeTrignoConfig
from srl.sim.devices.trigno.twin import TrignoTwin

MS = 1_000_000
CHANNELS = {"biceps": 2, "triceps": 1, "deltoid": 16}
SHEET = (  # §7: slot j has j * 1e-5 V
    "acc52737acc5a73782a8fb37acc5273817b7513882a87b38f7cc9238acc5a738"
    "62bebc3817b7d138cdafe63882a8fb389c500839f7cc123952491d39acc52739"
)


class Pair:
    def __init__(self, channels: dict[str, int] | None = None, block: int = 0, **options: Any) -> None:
        self.world = StillWorld()
        config = {"channels": channels or CHANNELS, "block": block}
        self.fake = bound(
            FakeTrigno("emg", TrignoConfig(port="tcp://x", **config), self.world, FakeTrignoConfig(**options))
        )
        self.twin = TrignoTwin(self.fake)
        self.twin.open()
        self.driver = bound(Trigno("emg", TrignoConfig(port=self.twin.address, **config)))

    def serve(self, what: Callable[[], object]) -> None:
        done = Event()
        server = Thread(target=lambda: [self.step() for _ in iter(lambda: done.wait(0.0002), True)])
        server.start()
        try:
            what()
        finally:
            done.set()
            server.join()

    def opened(self) -> Pair:
        self.serve(self.driver.open)
        self.fake.open()
        return self

    def step(self, ms: int = 1) -> None:
        self.world.time += ms * MS
        self.twin.service(self.world.time)

    def cycles(self, count: int, read: bool = True) -> None:
        for _ in range(count):
            self.step(10)
            if read:
                frames = self.driver.health.frames
                sent = self.fake.newest()
                until(lambda f=frames, s=sent: self._arrived(f, s), lambda: self.driver.read(self.world.time))
                self.fake.read(self.world.time)

    def _arrived(self, frames: int, sent: int) -> bool:
        return self.driver.health.frames > frames or sent == getattr(self, "_was", -2) or self._note(sent)

    def _note(self, sent: int) -> bool:
        self._was = sent
        return False

    def close(self) -> None:
        self.driver.close()
        self.twin.close()


@pytest.fixture
def pair() -> Iterator[Pair]:
    made = Pair(activation={"biceps": [[0, 1.0]], "triceps": [[0, 0.0]]}).opened()
    yield made
    made.close()


def test_the_sheets_sample_in_both_orders() -> None:
    volts = np.arange(1, 17) * 1e-5
    assert encode(volts[None]).hex() == SHEET
    assert encode(volts[None], little=False).hex().startswith("3727c5ac37a7c5ac37fba8823827c5ac")
    np.testing.assert_allclose(Samples().feed(bytes.fromhex(SHEET)), [volts], rtol=1e-6)
    assert command("SENSOR 1 PAIRED?").hex() == "53454e534f522031205041495245443f0d0a0d0a"
    assert Answers().feed(bytes.fromhex("4f4b0d0a0d0a4259450d0a0d0a")) == ["OK", "BYE"]


def test_driver_and_fake_show_the_same_muscles(pair: Pair) -> None:
    pair.cycles(60)
    driver, fake = pair.driver.state_arrays, pair.fake.state_arrays
    np.testing.assert_allclose(driver["emg"], fake["emg"], atol=1e-9)
    np.testing.assert_allclose(driver["envelope"], fake["envelope"], rtol=1e-5)
    assert driver["envelope"][0] == pytest.approx(5e-4, rel=0.3)  # the biceps contracts wholly
    assert driver["envelope"][1] < 5e-6
    assert driver["present"].tolist() == [1, 1, 1]
    age = pair.world.time - pair.driver.health.stamp
    assert 0 <= age < 30 * MS
    assert pair.driver.health.errors == 0


def test_every_sample_is_kept_where_a_block_is_asked_for() -> None:
    pair = Pair(block=64).opened()
    pair.cycles(3)
    seen: list[float] = []
    count = pair.driver.state_arrays["count"][0]
    for _ in range(40):
        pair.cycles(1)
        now = pair.driver.state_arrays["count"][0]
        new = int(now - count)
        count = now
        if new:
            seen += pair.driver.state_arrays["samples"][-new:, 0].tolist()
    last = pair.fake.newest()
    truth = np.concatenate([pair.fake.frame(k)[:, 1] for k in range(last + 1)])  # type: ignore[index]
    np.testing.assert_allclose(seen, truth[-len(seen) :], atol=1e-9)
    assert len(seen) > 700
    pair.close()


def test_emg_has_the_muscles_band() -> None:
    fake = Pair({"biceps": 1}, activation={"biceps": [[0, 1.0]]}, noise=0).fake
    x = np.concatenate([fake.frame(k)[:, 0] for k in range(800)])  # type: ignore[index]
    power = np.abs(np.fft.rfft(x)) ** 2
    frequency = np.fft.rfftfreq(len(x), 1 / RATE)
    inside = (frequency > 20) & (frequency < 450)
    assert power[inside].sum() > 0.95 * power.sum()
    assert x.std() == pytest.approx(5e-4, rel=0.05)


def test_a_sensor_out_of_reach_makes_the_device_stale() -> None:
    pair = Pair(out_of_reach={"deltoid": [[1.0, 2.0]]}).opened()
    pair.world.time = 900 * MS
    pair.cycles(30)
    assert pair.driver.state_arrays["present"].tolist() == [1, 1, 0]
    assert "deltoid" in pair.driver.health.message
    assert pair.world.time - pair.driver.health.stamp > 50 * MS
    pair.cycles(100)
    assert pair.driver.state_arrays["present"].tolist() == [1, 1, 1]
    assert pair.world.time - pair.driver.health.stamp < 30 * MS
    pair.close()


@pytest.mark.slow
def test_samples_that_waited_aren_t_fresh_and_after_lost_ones_it_is_connected_anew(pair: Pair) -> None:
    pair.cycles(20)
    stamp = pair.driver.health.stamp
    pair.world.time += 3_000 * MS  # the server hangs: what it measured meanwhile is gone
    pair.step(1)
    pair.cycles(3)
    assert pair.world.time - pair.driver.health.stamp > 1_500 * MS  # it can't be told from a queue yet
    assert pair.driver.health.stamp > stamp
    pair.cycles(130)
    assert pair.world.time - pair.driver.health.stamp > 1_500 * MS  # nor later: over TCP it may have waited
    with pytest.raises(DeviceLostError, match=r"late"):
        pair.cycles(400)
    assert not pair.driver.health.connected
    pair.opened()
    pair.cycles(5)
    assert pair.world.time - pair.driver.health.stamp < 40 * MS


def test_the_servers_end_is_a_loss_and_it_comes_back(pair: Pair) -> None:
    pair.cycles(5)
    pair.twin.close()
    with pytest.raises(DeviceLostError):
        until(lambda: False, lambda: pair.driver.read(1))
    with pytest.raises(DeviceError, match="refuses a connection"):
        pair.driver.open()
    pair.twin.open()
    pair.opened()
    pair.cycles(5)
    assert pair.driver.health.reconnects == 1


def test_a_server_that_was_told_to_stop_is_started_anew(pair: Pair) -> None:
    pair.cycles(5)
    pair.twin.muted = True
    now = pair.world.time
    pair.driver.read(now + 4_900 * MS)
    with pytest.raises(DeviceLostError, match="no samples for 5 s"):
        pair.driver.read(now + 5_100 * MS)
    assert not pair.driver.health.connected
    pair.twin.muted = False
    pair.opened()
    pair.cycles(5)
    assert pair.driver.health.reconnects == 1


def test_a_client_of_the_emg_port_that_came_within_the_cycle_of_start_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    pair = Pair()
    twin, door = pair.twin, pair.twin.legacy
    looked, links = door.accept, list[socket.socket]()

    def connect_then_start() -> list[Client]:
        """The twin has looked for clients of the EMG port; now one connects, and then sends START."""
        if len(links) == 1:
            links.append(socket.create_connection(("127.0.0.1", twin.emg.port), 2))
            links[0].sendall(b"START\r\n\r\n")
        return looked()

    monkeypatch.setattr(door, "accept", connect_then_start)
    links.append(socket.create_connection(("127.0.0.1", twin.control.port), 2))
    try:
        until(lambda: "START" in twin.commands, pair.step)
        assert len(links) == 2
        assert twin.running
    finally:
        for link in links:
            link.close()
        twin.close()


def test_a_stream_out_of_step_is_given_up(pair: Pair) -> None:
    pair.cycles(5)
    for client in pair.twin.emg.clients:
        client.write(b"x")  # one byte too many: nothing after it fits
    with pytest.raises(DeviceLostError, match="no electrode's voltages"):
        until(lambda: False, lambda: (pair.step(10), pair.driver.read(pair.world.time)))
    assert not pair.driver.health.connected
    pair.opened()
    pair.cycles(5)
    assert pair.driver.health.stamp > 0


def test_a_muscle_without_a_sensor_is_named() -> None:
    pair = Pair()
    wrong = Trigno("emg", TrignoConfig(port=pair.twin.address, channels={"biceps": 2, "soleus": 7}))
    with pytest.raises(DeviceError, match=r"no sensor is on for soleus \(slot 7\); slots with one: 1, 2, 16"):
        pair.serve(wrong.open)
    pair.twin.close()


def test_another_server_is_refused() -> None:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()

        def serve() -> None:
            end, _ = listener.accept()
            end.sendall(b"220 mail.example ESMTP\r\n\r\n")
            end.recv(1)
            end.close()

        server = Thread(target=serve)
        server.start()
        driver = Trigno("emg", TrignoConfig(port=f"tcp://127.0.0.1:{listener.getsockname()[1]}", channels={"a": 1}))
        with pytest.raises(DeviceError, match="expected a Trigno server's greeting, got '220 mail"):
            driver.open()
        server.join()
    for port in ("/dev/ttyUSB0", "tcp://", "tcp://h/x", "tcp://h:70000"):
        with pytest.raises(DeviceError, match="isn't tcp://HOST"):
            Trigno("emg", TrignoConfig(port=port, channels={"a": 1})).open()
    for channels in ({"a": 0}, {"a": 17}, {"a": 1, "b": 1}, {}):
        with pytest.raises(ValueError, match=r"slot|at least 1"):
            TrignoConfig(port="tcp://x", channels=channels)


def test_the_envelope_is_the_rms_of_the_window() -> None:
    rng = np.random.default_rng(1)
    x = rng.normal(size=(500, 3))
    envelope = Envelope(3, 100)
    at = 0
    for size in (1, 7, 250, 0, 99, 100, 43):
        envelope.take(x[at : at + size])
        at += size
        if at >= 100:
            np.testing.assert_allclose(envelope.value, np.sqrt((x[at - 100 : at] ** 2).mean(axis=0)))


def test_a_million_damaged_bytes_on_both_channels() -> None:
    samples, answers = Samples(), Answers()
    good = np.random.default_rng(0).normal(0, 1e-4, (50, 16))
    fuzz(samples.feed, encode(good))
    fuzz(answers.feed, b"OK\r\n\r\nYES\r\n\r\n1925.92592592593\r\n\r\nNEW MASTER\r\n\r\n" * 10)
    assert size_of(samples) < 5000
    assert size_of(answers) < 10_000
    answers.feed(b"\r\n\r\n")
    assert answers.feed(b"YES\r\n\r\n") == ["YES"]
    assert samples.errors > 0
