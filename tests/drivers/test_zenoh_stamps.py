"""When a remote sample was taken: senders that repeat, stall, set their clock back, or say nothing of it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers.zenoh import bound, cycles, lost, reopened

from srl.drivers.zenoh import Zenoh, ZenohConfig, driver
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.field import Field
from srl.runtime.messages import attachment, messages
from srl.sim.devices.zenoh.twin import ZenohDoor


def device(address: str, signals: dict[str, Any], **options: Any) -> Zenoh:
    return bound(Zenoh("remote", ZenohConfig(port=address, signals=signals, **options)))  # type: ignore[return-value]


class Sender:
    """Publishes what a test tells it to, 100 times a second; without metadata, as a bridge."""

    def __init__(self, content: Callable[[int], tuple[bytes, int] | None]) -> None:
        """`content`: the number of a sample to its payload and source stamp (-1: no attachment)."""
        self.content = content
        self.door = ZenohDoor("router", [], [], [])
        self.door.open()
        self._ending = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        number = 0
        while not self._ending:
            found = self.content(number)
            if found is not None:
                payload, stamp = found
                extra = attachment.encode(number + 1, stamp, bytes(16)) if stamp >= 0 else None
                self.door.write("lab/hand/position", payload, messages.encoding(messages.JOINT_STATE), extra)
            number += 1
            time.sleep(0.01)

    def close(self) -> None:
        self._ending = True
        self._thread.join()
        self.door.close()


ENCODER = messages.Encoder(Field("hand.position", "state", 0, (1,), "rad"))
HAND = {"position": {"key": "lab/hand/position", "shape": [1], "unit": "rad"}}


def payload(value: float, stamp: int) -> bytes:
    return ENCODER.encode(np.array([value]), stamp)


@pytest.mark.slow
def test_samples_that_repeat_their_stamp_are_not_fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a runtime does whose own device is lost."""
    monkeypatch.setattr(driver, "FIRST", 1.5)
    frozen: list[int] = []

    def content(number: int) -> tuple[bytes, int]:
        stamp = frozen[0] if frozen else time.time_ns()
        return payload(float(number), stamp), stamp

    sender = Sender(content)
    try:
        remote = device(sender.door.address, HAND, silence=0.5)
        remote.open()
        cycles(remote, lambda: remote.health.frames > 20, "samples")
        frozen.append(time.time_ns())
        at = time.monotonic_ns()
        assert "nothing new" in lost(remote)
        assert remote.health.stamp <= at + 20_000_000  # what was on its way may be a little newer
        with pytest.raises(DeviceError, match="same stamp"):
            remote.open()
    finally:
        sender.close()


@pytest.mark.slow
def test_what_waited_on_its_way_is_as_old_as_it_is() -> None:
    """A stall of the network: its samples come late, all at once, and are old; then all is well again."""
    base = 3_000_000_000 * 10**9 // 2  # another host's clock
    held: list[bool] = []
    waiting: list[tuple[bytes, int]] = []

    def content(number: int) -> tuple[bytes, int] | None:
        now = time.monotonic_ns()
        item = payload(now * 1e-9, base + now), base + now
        if held:
            waiting.append(item)
            return None
        return waiting.pop(0) if waiting else item  # from the stall on, each is late by as much

    sender = Sender(content)
    try:
        remote = device(sender.door.address, HAND, silence=5.0)
        remote.open()
        cycles(remote, lambda: remote.health.frames > 30, "samples")
        held.append(True)
        cycles(remote, lambda: len(waiting) > 30, "the stall")
        held.clear()
        frames = remote.health.frames
        cycles(remote, lambda: remote.health.frames > frames + 5, "late samples")
        taken = float(remote.state_arrays["position"][0]) * 1e9  # when the value was made
        assert remote.health.stamp - taken < 100_000_000  # said to be no newer than that
        assert time.monotonic_ns() - remote.health.stamp > 200_000_000  # so it is stale
    finally:
        sender.close()


def test_a_clock_that_is_set_back_opens_the_link_anew() -> None:
    back: list[int] = [0]

    def content(number: int) -> tuple[bytes, int]:
        stamp = time.time_ns() - back[0]
        return payload(1.0, stamp), stamp

    sender = Sender(content)
    try:
        remote = device(sender.door.address, HAND, silence=0.4)
        remote.open()
        back[0] = 3600 * 10**9
        assert "nothing new" in lost(remote)
        reopened(remote)
        cycles(remote, lambda: remote.health.frames > 5, "samples")
    finally:
        sender.close()


@pytest.mark.slow
def test_garbage_is_counted_and_the_next_good_sample_is_taken() -> None:
    def content(number: int) -> tuple[bytes, int]:
        stamp = time.time_ns()
        good = payload(float(number), stamp)
        return (good if number % 2 else good[: number % len(good)] + b"\xff" * 5), stamp

    sender = Sender(content)
    try:
        remote = device(sender.door.address, HAND)
        reopened(remote)  # it may see garbage first, and says so
        cycles(remote, lambda: remote.health.frames > 10 and remote.health.errors > 5, "both")
        assert remote.state_arrays["position"][0] % 2 == 1
    finally:
        sender.close()


@pytest.mark.slow
def test_without_stamps_arrival_counts_and_is_said() -> None:
    key = {"value": {"key": "lab/hand/position", "shape": [2], "unit": "1", "type": messages.MULTI_ARRAY}}
    encoder = messages.Encoder(Field("hand.value", "state", 0, (2,), "1"))
    sender = Sender(lambda number: None)
    try:
        door = sender.door
        sender.content = lambda number: door.write("lab/hand/position", encoder.encode(np.ones(2), 0))  # type: ignore[func-returns-value]
        remote = device(door.address, key)
        remote.open()
        assert "no stamps in value" in remote.health.message
        cycles(remote, lambda: remote.health.frames > 5, "samples")
        assert remote.state_arrays["value"].tolist() == [1.0, 1.0]
    finally:
        sender.close()


def test_a_node_that_sends_old_values_anew_is_not_fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another maker's attachment says when it sent; the header says when the values were taken."""
    monkeypatch.setattr(driver, "FIRST", 1.5)
    frozen = time.time_ns()
    sender = Sender(lambda number: (payload(1.0, frozen), time.time_ns()))
    try:
        with pytest.raises(DeviceError, match="same stamp"):
            device(sender.door.address, HAND).open()
    finally:
        sender.close()
