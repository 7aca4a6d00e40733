"""Poses that laws rely on: hidden, broken or jumping ones are lost, though their device goes on with the others."""

from __future__ import annotations

from collections.abc import Sequence
from math import acos, dist, pi, remainder
from typing import Final

from srl.runtime.contracts.frames import are_pose
from srl.runtime.profile.graph import MonitoredPose

TURNING: Final = 50.0  # rad/s: faster than a hand
SPAN: Final = 0.05  # s: after a longer pause no more motion is believed than in this time
SLACK: Final = 0.03, 0.3  # m, rad: noise, and a sample that came late


class PoseMonitor:
    """Watches each pose; see the module's docstring."""

    def __init__(self, monitored_poses: Sequence[MonitoredPose]) -> None:
        self._poses = monitored_poses
        self._last: list[list[float] | None] = [None] * len(monitored_poses)
        self._moved = [0] * len(monitored_poses)  # ns

    def lost(self, now: int) -> set[int]:
        """The devices, by index, of which a pose is none, never came, or jumps."""
        found = set()
        for i, monitored in enumerate(self._poses):
            last, pose = self._last[i], monitored.pose.tolist()
            if pose == last:
                continue
            if not are_pose(pose):
                if last is not None or not monitored.client:  # a client may not have begun
                    found.add(monitored.device)
                continue
            if last is not None and _jumps(last, pose, monitored.speed, min((now - self._moved[i]) * 1e-9, SPAN)):
                found.add(monitored.device)
            self._last[i], self._moved[i] = pose, now
        return found


def _jumps(a: list[float], b: list[float], speed: float, dt: float) -> bool:
    """Whether two poses, (7,) or (3,) planar, are further apart than a motion in dt seconds."""
    if len(a) == 3:
        way, turn = dist(a[:2], b[:2]), abs(remainder(b[2] - a[2], 2 * pi))
    else:
        way = dist(a[:3], b[:3])
        turn = 2 * acos(min(abs(sum(p * q for p, q in zip(a[3:], b[3:], strict=True))), 1.0))
    return way > speed * dt + SLACK[0] or (turn > TURNING * dt + SLACK[1] and speed < float("inf"))
