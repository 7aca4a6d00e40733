"""The driver `lsl` and liblsl itself: run by `test_lsl_live.py` in a network namespace with loopback alone."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pylsl
import pytest
from helpers.wait import until
from helpers.zenoh import Served, Still, bound, cycles, lost, reopened

from srl.drivers.lsl import Lsl, LslConfig
from srl.drivers.lsl.process import configuration
from srl.runtime.contracts.errors import DeviceError
from srl.sim.devices.lsl import twin
from srl.sim.devices.lsl.fake import FakeLsl, FakeLslOptions

STREAM = {"source_id": "amp-7", "name": "Amp", "type": "EMG"}
SIGNALS: dict[str, Any] = {
    "emg": {"channels": {"biceps": "EMG 1", "triceps": "EMG 2"}, "unit": "V"},
    "samples": {"channels": {"biceps": "EMG 1", "triceps": "EMG 2"}, "unit": "V", "block": 64},
}
PORT = 27571
ADDRESS = f"lsl://127.0.0.1:{PORT}"

pylsl.set_config_content(configuration("127.0.0.1", PORT, here=True))


def made(port: str, **options: Any) -> Lsl:
    given: dict[str, Any] = {"port": port, "stream": STREAM, "rate": 500, "signals": SIGNALS} | options
    driver = Lsl("amp", LslConfig.model_validate(given))
    bound(driver)
    return driver


class Peer:
    """An outlet as any program has one: pylsl by hand, float32, in microvolts, a ramp of (k, -k)."""

    def __init__(
        self, rate: float = 500, labels: tuple[str, ...] = ("EMG 1", "EMG 2"), unit: str = "microvolts"
    ) -> None:
        self.rate, self.k = rate, 0
        info = pylsl.StreamInfo("Amp", "EMG", len(labels), rate, pylsl.cf_float32, "amp-7")
        channels = info.desc().append_child("channels")
        for label in labels:
            one = channels.append_child("channel")
            one.append_child_value("label", label)
            one.append_child_value("unit", unit)
        self.outlet = pylsl.StreamOutlet(info, chunk_size=0, max_buffered=5)
        self.start = time.monotonic()
        self.wrong: Callable[[int], float] = float

    def send(self, slower: float = 1.0) -> None:
        """What is due by now."""
        due = int((time.monotonic() - self.start) * self.rate * slower)
        for k in range(self.k, due):
            sample = [self.wrong(k), *[-float(k)] * (self.outlet.channel_count - 1)]
            self.outlet.push_sample(sample, self.start + k / self.rate)
        self.k = due


class Sending(threading.Thread):
    """Peers that send by themselves; `slower` is a share of their rate."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.peers: list[Peer] = []
        self.ending, self.muted, self.slower = False, False, 1.0

    def run(self) -> None:
        while not self.ending:
            if not self.muted:
                self.send()
            time.sleep(0.005)
        self.peers.clear()

    def send(self) -> None:
        for peer in list(self.peers):  # no name of this thread's may keep an outlet alive
            peer.send(self.slower)

    def add(self, **options: Any) -> Peer:
        peer = Peer(**options)
        self.peers.append(peer)
        return peer


@pytest.fixture
def peers() -> Iterator[Sending]:
    sending = Sending()
    sending.start()
    yield sending
    sending.ending = True
    sending.join()


def test_samples_stamps_and_units_of_a_program_that_isn_t_ours(peers: Sending) -> None:
    peer = peers.add()
    driver = made(ADDRESS)
    driver.open()
    cycles(driver, lambda: driver.health.frames > 300, "samples")
    state = driver.state_arrays
    k = round(state["emg"][0] * 1e6)
    np.testing.assert_allclose(state["emg"], [k * 1e-6, -k * 1e-6], rtol=1e-6)
    np.testing.assert_allclose(state["samples"][:, 0] * 1e6, np.arange(k - 63, k + 1), rtol=1e-5)
    assert driver.health.stamp == pytest.approx((peer.start + k / 500) * 1e9, abs=1e3)
    assert driver.health.errors == 0
    driver.close()
    assert driver.pid() is None


def test_nan_is_silence_that_says_why(peers: Sending) -> None:
    peer = peers.add()
    driver = made(ADDRESS)
    driver.open()
    cycles(driver, lambda: driver.health.frames > 50, "samples")
    peer.wrong = lambda _: float("nan")
    cycles(driver, lambda: "NaN" in driver.health.message, "the message")
    assert "emg: biceps" in driver.health.message or "samples: biceps" in driver.health.message
    stamp, count = driver.health.stamp, driver.state_arrays["count"][0]
    errors = driver.health.errors
    cycles(driver, lambda: driver.health.errors > errors + 50, "errors")
    assert driver.health.stamp == stamp
    assert driver.state_arrays["count"][0] > count + 64
    assert np.isfinite(driver.state_arrays["emg"]).all()
    peer.wrong = float
    cycles(driver, lambda: driver.health.stamp > stamp, "the stream is back")
    assert driver.health.message == ""
    driver.close()


def test_silence_is_a_loss(peers: Sending) -> None:
    peers.add()
    driver = made(ADDRESS, silence=0.3)
    driver.open()
    peers.muted = True
    assert "nothing came for 0.3 s" in lost(driver)
    peers.muted = False
    reopened(driver)
    assert driver.health.reconnects == 1
    assert driver.health.message == ""  # the same start of the sender
    driver.close()


def test_a_sender_that_starts_anew_is_looked_at_anew(peers: Sending) -> None:
    peers.add()
    driver = made(ADDRESS)
    driver.open()
    peers.peers.clear()
    assert "the stream has ended" in lost(driver)
    peers.add()
    reopened(driver)
    assert driver.health.message == "the sender has started anew"
    peers.peers.clear()
    lost(driver)
    peers.add(rate=1000)
    with pytest.raises(DeviceError, match="rate is 1000 Hz, the profile's 500 Hz"):
        driver.open()


def test_two_that_fit_and_none_are_refused(peers: Sending) -> None:
    peers.add()
    with pytest.raises(DeviceError, match=r"no stream has .*'other'; there are: Amp \(EMG, source_id 'amp-7'\)"):
        made(ADDRESS, stream={"source_id": "other"}).open()
    peers.add()
    with pytest.raises(DeviceError, match="2 streams have source_id='amp-7'"):
        made(ADDRESS).open()


def test_its_process_killed_is_a_loss_and_ends_with_the_driver(peers: Sending) -> None:
    peers.add()
    driver = made(ADDRESS)
    driver.open()
    pid = driver.pid()
    assert pid is not None
    os.kill(pid, signal.SIGKILL)
    assert "its LSL process has ended" in lost(driver)
    reopened(driver)
    pid = driver.pid()
    assert pid is not None
    driver._helper._end.close()  # type: ignore[union-attr]  # as the kernel does when the loop is killed
    until(lambda: driver._helper._process.poll() is not None)  # type: ignore[union-attr]


def test_the_twin_is_such_a_program(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(twin, "_library", lambda: (pylsl, PORT))  # it is told its configuration once in a process
    options = {"port": ADDRESS, "stream": {"source_id": "twin-1"}, "rate": 500, "signals": SIGNALS}
    config = LslConfig.model_validate(options)
    fake = FakeLsl("amp", config, Still(), FakeLslOptions(amplitude=1e-3))
    bound(fake)
    fake.open()
    sender = twin.LslTwin(fake)
    with Served(fake.world, sender):
        driver = made(sender.address, stream={"source_id": "twin-1"})
        driver.open()
        cycles(driver, lambda: driver.health.frames > 200, "samples")
        assert np.abs(driver.state_arrays["samples"]).max() <= 1e-3
        assert np.ptp(driver.state_arrays["samples"][:, 0]) > 0
        age = time.monotonic_ns() - driver.health.stamp
        assert 10_000_000 <= age < 10_000_000_000  # its delay of 10 ms at least
        sender.muted = True
        assert "nothing came" in lost(driver)
        sender.muted = False
        reopened(driver)
        driver.close()
