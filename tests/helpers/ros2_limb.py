"""servo-jog with a follower of trajectories, row by row and without a router."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from srl.runtime.ipc.header import CYCLE, State
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.messages import cdr
from srl.runtime.profile import profile, wiring
from srl.runtime.ros2.follower import PERIOD, Follower
from srl.runtime.ros2.names import TRAJECTORY


class Limb:
    """servo-jog, and what its follower sends and says."""

    def __init__(self, partial: bool = False) -> None:
        graph = wiring.build(*profile.load("servo-jog"), [])
        step = Lockstep(graph)
        for _ in range(20):
            step.step()
        graph.layout.meta["limits"] = {
            "finger.position_command": {"lower": [-1.0, -1.0], "upper": [1.0, 1.0], "velocity": [2.0, 2.0]}
        }
        self.row = graph.row.words.copy()
        self.stamp = graph.layout.stamped_by(graph.layout.fields["finger.position"])
        self.row[CYCLE.state] = State.ACTIVE
        self.sent: list[list[float]] = []
        self.said: list[str] = []
        self.follower = Follower(
            graph.layout, "client.position", lambda values: self.sent.append(values.tolist()), self.said.append, partial
        )
        self.lost = 0
        self.turn(State.ACTIVE)

    def turn(self, *states: State) -> None:
        rows = np.tile(self.row, (len(states), 1))
        rows[:, CYCLE.state] = states
        rows[:, CYCLE.now] = rows[:, self.stamp] = time.monotonic_ns()
        newest = rows[-1] if len(rows) else self.row
        self.follower.turn(rows, newest, self.lost, time.monotonic_ns())

    def ask(self, *positions: float, seconds: int = 2, came: int | None = None, stamp: int = 0) -> None:
        point = {
            "positions": np.array(positions), "velocities": np.empty(0), "accelerations": np.empty(0),
            "effort": np.empty(0), "time_from_start": {"sec": seconds, "nanosec": 0},
        }  # fmt: skip
        header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": ""}
        message: dict[str, Any] = {"header": header, "joint_names": ["proximal", "distal"], "points": [point]}
        now = time.monotonic_ns()
        self.follower.take(cdr.encode(TRAJECTORY, message), now if came is None else came)

    @property
    def moves(self) -> bool:
        before = len(self.sent)
        time.sleep(2 * PERIOD * 1e-9)
        self.turn(State.ACTIVE)
        return len(self.sent) > before
