"""A suit's frames: our text parser against `str.split` and `float`, and the driver's cost per frame.

The driver is compared with the kernel alone: the same bytes received, but not processed.
"""

from __future__ import annotations

import select
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from bench.pairs import PAIRS, Row, measure
from srl.drivers.noitom import Noitom, NoitomConfig
from srl.drivers.noitom.protocol import COUNTS, TextParser, encode_binary, encode_text
from srl.runtime.contracts.signals import Array
from srl.runtime.testing.bound import bound

FRAMES: Final = 300
RATE: Final = 120  # Hz
AIM: Final = 250.0  # us, 3 % of the time between frames at 120 Hz

clock = time.thread_time_ns  # time that other threads take on this processor counts for neither side


def run() -> list[Row]:
    """Measures the parser, then the driver over TCP with binary and with text frames."""
    frames = [encode_text(_numbers(k)) for k in range(FRAMES)]
    pairs = measure(lambda: _ours(frames), {"split and float": lambda: _plain(frames)}, PAIRS)
    rows = [
        pairs.row(
            "noitom-text", f"a text frame of 354 numbers, {what}", what, "split and float", "us", "faster", _faster
        )
        for what in ("p50", "p99")
    ]
    for form, encode in (
        ("binary", lambda k: encode_binary(_numbers(k), k)),
        ("text", lambda k: encode_text(_numbers(k))),
    ):
        with Software(encode) as software:
            pairs = measure(software.driver_frames, {"kernel alone": software.kernel_frames}, PAIRS)
        for what in ("p50", "p99"):
            row = pairs.row("noitom-frame", f"the driver's read of a {form} frame, {what}", what, "kernel alone", "us")
            rows.append(replace(row, aim=f"under {AIM:g} us", holds=row.ours < AIM))
    return rows


def _faster(ratio: float) -> bool:
    return ratio < 1.0


def _numbers(k: int) -> Array:
    """Returns a frame's 354 numbers, different ones for each k."""
    return np.random.default_rng(k).uniform(-180.0, 180.0, 354)


def _ours(frames: list[bytes]) -> dict[str, float]:
    parser, took = TextParser(), []
    for frame in frames:
        start = clock()
        found = parser.feed(frame)
        took.append(clock() - start)
        assert found is not None
    return _metrics(took)


def _plain(frames: list[bytes]) -> dict[str, float]:
    """Parses in the shortest way in plain Python: one complete record, no checks except of the count."""
    took = []
    for frame in frames:
        start = clock()
        words = frame.decode().partition("||")[0].split()
        values = np.array([float(word) for word in words[2:]])
        took.append(clock() - start)
        assert values.size in COUNTS
    return _metrics(took)


class Software:
    """A broadcast of frames to one client, and the open `driver`.

    Once it is open, a frame is sent when its time is measured, however fast the machine is. So the driver is told the
    time at which frames of RATE are due: by the real clock they would be late.
    """

    def __init__(self, encode: Callable[[int], bytes]) -> None:
        self._encode = encode
        self._sent = 0
        self._door = socket.create_server(("127.0.0.1", 0))
        port = f"tcp://127.0.0.1:{self._door.getsockname()[1]}"
        self.driver = bound(Noitom("suit", NoitomConfig(port=port)))
        self._client: socket.socket | None = None
        self._started = 0
        self._over = threading.Event()

    def __enter__(self) -> Software:
        thread = threading.Thread(target=self._serve)
        thread.start()
        try:
            self.driver.open()
        finally:
            self._over.set()
            thread.join()
        self._started = time.monotonic_ns() - self.now()
        return self

    def __exit__(self, *_: object) -> None:
        self.driver.close()
        for end in (self._client, self._door):
            if end is not None:
                end.close()

    def driver_frames(self) -> dict[str, float]:
        """Returns the us of a `read` with one frame to parse."""
        took = []
        for _ in range(FRAMES):
            before = self.driver.health.frames
            self.send()
            start = clock()
            self.driver.read(self.now())
            spent = clock() - start
            if self.driver.health.frames > before:
                took.append(spent)
            while self.driver.health.frames == before:  # its rest came later: that isn't the cost of one read
                self.driver.read(self.now())
        return _metrics(took)

    def now(self) -> int:
        """The ns at which the newest frame is due."""
        return self._started + self._sent * 1_000_000_000 // RATE

    def send(self) -> None:
        """Sends the next frame."""
        assert self._client is not None
        self._client.sendall(self._next())

    def kernel_frames(self) -> dict[str, float]:
        """Returns the us of receiving a frame."""
        took = []
        here, there = socket.socketpair()
        with here, there:
            for k in range(FRAMES):
                there.sendall(self._encode(k))
                start = clock()
                here.recv(65536)
                took.append(clock() - start)
        return _metrics(took)

    def _serve(self) -> None:
        """Sends frames at RATE at most while the driver opens."""
        if not select.select([self._door], [], [], 5)[0]:
            return
        self._client, _ = self._door.accept()
        self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        while not self._over.wait(1 / RATE):
            self._client.sendall(self._next())

    def _next(self) -> bytes:
        self._sent += 1
        return self._encode(self._sent)


def _metrics(took: list[int]) -> dict[str, float]:
    p50, p99 = np.percentile(np.array(took) / 1e3, [50, 99])
    return {"p50": float(p50), "p99": float(p99)}


if __name__ == "__main__":
    for row in run():
        print(f"{row.what}: {row.ours:g} us, {row.other_name} {row.other:g}, ratio {row.ratio:g}, A/A {row.control:g}")
