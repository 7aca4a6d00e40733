"""A two-link arm under the verified stop, a disc as the person, and what both may do."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st

from helpers.guard import guard_of
from helpers.planar import LABELS, PlanarClearance, PlanarConfig, distances
from srl.runtime.contracts.signals import Command, Kind, Stop
from srl.runtime.guard import CommandGuard

DT, V, A = 0.01, 2.0, np.array([6.0, 12.0])
A_H, C, LAG = 4.0, 0.02, 0.03
LIMITS: dict[str, Any] = {"velocity": V, "acceleration": A.tolist(), "lower": -3.0, "upper": 3.0}
points = st.tuples(st.floats(-0.7, 0.7), st.floats(-0.7, 0.7))
slow = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
wanted = st.tuples(st.floats(-3, 3), st.floats(-3, 3))


class Scene:
    """An arm that obeys each command `late` cycles later, and a disc that is seen `age` s late.

    `measured`: s, the age that the guard is told of the arm's measured position.

    `seen` and `speed` are the disc's as the clearance is told; tests move them.
    """

    def __init__(
        self, kind: Kind = Kind.POSITION, start: tuple[float, float] = (0.0, 0.0), late: int = 0, age: float = 0.02,
        tracking: float = 0.0, timeout: float = 0.02, measured: float = 0.0, feedback: bool = True,
        period: float | None = None, **limits: Any,
    ) -> None:  # fmt: skip
        command = Command(name="command", shape=(2,), unit="rad", kind=kind, labels=LABELS)
        self.clearance = PlanarClearance("guard.arm.clear", PlanarConfig(acceleration=A_H, least=C), command)
        self.disc, self.speed = np.array([9.0, 9.0]), np.zeros(2)
        self.clearance.bind({"centre": self.disc, "velocity": self.speed})
        self.guard: CommandGuard = guard_of(kind, 2, DT, **(LIMITS | limits))
        self.at, self.applied = np.array(start), np.zeros(2)
        self.guard.bind(self.applied, self.at if feedback else None)
        self.guard.keep_clear(self.clearance, LAG, np.full(2, tracking), timeout, period=period)
        self.guard.reset(self.at)
        self.age, self.measured, self.now = age, measured, 10_000_000_000
        rest = self.at.copy() if kind is Kind.POSITION else np.zeros(2)
        self.queue = [rest] * late

    @property
    def held(self) -> bool:
        assert self.guard.verified is not None
        return self.guard.verified.held

    def look(self, seen: bool = True) -> None:
        self.now += round(DT * 1e9)
        assert self.guard.verified is not None
        stamp = self.now - round(self.age * 1e9) if seen else -1
        self.guard.verified.begin(self.now, {"centre": stamp, "velocity": stamp}, self.measured)

    def step(self, desired: Any, seen: bool = True, late: int = 0) -> None:
        """A cycle. late: periods by which it comes late, as many times as `wait` was called before."""
        self.look(seen)
        self.guard.step(np.array(desired, np.float64), None, (1 + late) * DT)
        self._obey()

    def wait(self) -> None:
        """A period without a cycle: the arm has its last command."""
        self.now += round(DT * 1e9)
        self._obey()

    def stop(self, category: Stop = Stop.HOLD) -> None:
        self.look()
        self.guard.stop(category, DT)
        self._obey()

    def _obey(self) -> None:
        self.queue.append(self.applied.copy())
        obeyed = self.queue.pop(0)
        if self.guard.command.kind is Kind.POSITION:
            self.at[:] = obeyed
        else:
            self.at += DT * obeyed

    def clearest(self) -> float:
        """The distance now."""
        return float(distances(self.at[None], self.disc)[0].min())
