"""Scripted senders of the suit's software, and the driver on them."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable, Iterator

import numpy as np

from helpers.twin import bound
from srl.drivers.noitom import Noitom, NoitomConfig
from srl.drivers.noitom.protocol import encode_binary, encode_text
from srl.drivers.noitom.skeleton import Skeleton
from srl.drivers.streamtime import StreamTime
from srl.runtime.contracts.signals import Array

MS = 1_000_000


PERIOD = 10 * MS


START = 10**12  # ns on the loop's clock


Make = Callable[[int], bytes]


def numbers(hips: float = 0.0, displacement: bool = True) -> Array:
    """A frame's numbers: the T-pose, hips `hips` cm to the left, turned by (10, 20, 30) degrees."""
    rows = np.zeros((59, 6))
    rows[:, :3] = Skeleton("axis-neuron").offsets * 100
    rows[0] = hips, 95.5, -2.0, 10, 20, 30
    return rows.ravel() if displacement else np.concatenate([rows[0], rows[1:, 3:].ravel()])


def binary(number: int) -> bytes:
    return encode_binary(numbers(number % 1000), number)


def text(number: int) -> bytes:
    return encode_text(numbers(number % 1000))


class Sender:
    """The software: serves one client; sends by itself, in real time, only while the driver opens."""

    def __init__(self, make: Make = binary) -> None:
        self.door = socket.create_server(("127.0.0.1", 0))
        self.door.settimeout(0)
        self.url = f"tcp://127.0.0.1:{self.door.getsockname()[1]}"
        self.client: socket.socket | None = None
        self.make, self.number = make, 100

    def give(self, data: bytes) -> None:
        """Sends bytes to the client, the newest that has come."""
        with contextlib.suppress(BlockingIOError):
            self.client, _ = self.door.accept()
            self.client.settimeout(5.0)
            self.client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if self.client is not None:
            with contextlib.suppress(ConnectionError):
                self.client.sendall(data)

    def send(self, count: int = 1, skip: int = 0) -> None:
        """The next frames, after some that get lost."""
        self.number += skip
        for _ in range(count):
            self.give(self.make(self.number))
            self.number += 1

    def close(self) -> None:
        for end in (self.client, self.door):
            if end is not None:
                end.close()

    @contextlib.contextmanager
    def sending(self, period: float = 0.01) -> Iterator[None]:
        end = threading.Event()

        def run() -> None:
            while not end.wait(period):
                self.send()

        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield
        finally:
            end.set()
            thread.join()


def suit(url: str, **options: object) -> Noitom:
    return bound(Noitom("suit", NoitomConfig.model_validate({"port": url} | options)))  # type: ignore[return-value]


def opened(make: Make = binary, **options: object) -> tuple[Sender, Noitom]:
    """A sender and the open driver, which has taken in all that was sent meanwhile."""
    sender = Sender(make)
    device = suit(sender.url, **options)
    with sender.sending():
        device.open()
    device._clock = StreamTime(
        1e9 / PERIOD, learn=True, lossless=device._clock.lossless
    )  # the rate as known after a while, whatever this machine's pace
    device.read(START)
    return sender, device


# -- when it was taken


def steady(sender: Sender, device: Noitom, count: int, now: int) -> int:
    for _ in range(count):
        now += PERIOD
        sender.send()
        device.read(now)
    return now
