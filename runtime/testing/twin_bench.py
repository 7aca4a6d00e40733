"""The twin of one device of a profile, in a simulated world that moves only when it is told to."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Self

from srl.runtime.contracts import registry
from srl.runtime.contracts.world import Twin
from srl.runtime.profile import wiring
from srl.runtime.testing.given import Given, driver_of, read


class TwinBench:
    """The twin of one device of a profile, in a simulated world that moves only when it is told to.

    Use it as a context manager. The driver under test opens `address` and reads while `run` lets time pass.

    Attributes:
        twin: the twin, open.
        address: what the driver's `port` should be.
        now: ns of the twin's clock and of the world's.
    """

    def __init__(self, given: Given, device: str) -> None:
        """
        Args:
            given: the profile: its YAML, its path, its name or its keys; see `read`.
            device: its name in the profile.
        Raises:
            ProfileError, WiringError: as `srl check` says it; also where the device has no twin.
        """
        checked, source = read(given)
        driver = driver_of(checked, source, device)
        graph = wiring.build(checked, source, [])
        fake = next(d for d in graph.devices if d.name == device)
        cls = registry.load("twins", driver, source.place(f"devices.{device}"))
        self._take(cls(fake))

    @classmethod
    def of(cls, twin: Twin) -> Self:
        """The bench of a twin that is there already; its fake's world hasn't moved yet."""
        made = cls.__new__(cls)
        made._take(twin)
        return made

    def _take(self, twin: Twin) -> None:
        self.twin, self._world, self.now, self.address = twin, twin.fake.world, 0, ""

    def __enter__(self) -> Self:
        self.twin.open()
        self.address = self.twin.address
        return self

    def __exit__(self, *_: object) -> None:
        self.twin.close()
        self._world.close()

    def run(self, seconds: float) -> None:
        """Lets so much of the world's time pass, in steps of a millisecond; takes as long as the physics does."""
        for _ in range(round(seconds * 1e3)):
            self.now += 1_000_000
            self._world.advance(self.now)
            self.twin.service(self.now)

    @contextmanager
    def serving(self) -> Iterator[None]:
        """Lets time pass in a thread: for what waits for the twin, as a driver's `open` does."""
        ended = threading.Event()

        def serve() -> None:
            while not ended.is_set():
                self.run(0.01)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()
