"""The twin of motors on a CAN bus in real time: what it took, and what its limb did."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import can

from helpers.wait import until
from srl.sim.devices.shared.can import CanTwin


class Live:
    """A twin in real time, in a thread of its own; what it took, and how its limb moved.

    Its links lie level until their motors hold them: somebody supports them.

    Attributes:
        taken: (s, frame) of every frame of the host.
        felt: (s, rad (n,), N m (n,)) of every step.
    """

    def __init__(self, twin: CanTwin) -> None:
        self.twin, self.world = twin, twin.fake.world
        self.taken: list[tuple[float, can.Message]] = []
        self.felt: list[tuple[float, Any, Any]] = []
        take = twin.take

        def noted(message: can.Message, now: int) -> None:
            self.taken.append((time.monotonic(), message))
            take(message, now)

        twin.take = noted  # type: ignore[method-assign]
        self._asked: deque[Callable[[], object]] = deque()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> Live:
        self.twin.open()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self.twin.close()

    def do(self, what: Callable[[], object]) -> float:
        """Has it done between two steps; returns when it was, s."""
        started: list[float] = []

        def noted() -> None:
            started.append(time.monotonic())
            what()

        self._asked.append(noted)
        until(lambda: bool(started))
        return started[0]

    def _run(self) -> None:
        with contextlib.suppress(PermissionError):  # what else runs on this machine is no silence of the motors
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(5))
        started, chain, supported = time.monotonic_ns() - self.world.time, self.twin.fake.chain, True  # type: ignore[attr-defined]
        while not self._ended.wait(0.001):
            now = time.monotonic_ns() - started
            supported = supported and not (chain.motors.torque.all() and chain.motors.kp.all())
            if supported:
                chain._data.qpos[chain._q], chain._data.qvel[chain._v] = 0.0, 0.0
            while self._asked:
                self._asked.popleft()()
            self.world.advance(now)
            self.twin.service(now)
            truth = self.world.truth_arrays
            self.felt.append((time.monotonic(), truth["arm_position"].copy(), truth["arm_effort"].copy()))
