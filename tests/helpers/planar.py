"""A planar arm of two links among discs: a clearance whose geometry is plain, for the guard's own tests."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from srl.control.shared.approach import Separation, is_clear, margins, travels
from srl.runtime.contracts.clearance import NEVER, Braking, Clearance, ClearanceConfig
from srl.runtime.contracts.signals import Array, Command, Signal

LINKS = np.array([0.3, 0.25])  # m
RADII = np.array([0.03, 0.02])  # m, of the links
DISC = 0.05  # m, radius
REACH = np.array([[0.3, 0.55], [0.0, 0.25]])  # (joint, link) m/rad
LABELS = ("shoulder", "elbow")


class PlanarConfig(ClearanceConfig):
    acceleration: float = 4.0
    least: float = 0.02
    uncertainty: float = 0.0
    creep: float = 0.02
    max_age: float = 0.5


class PlanarClearance(Clearance):
    """Keeps the two links clear of a disc whose centre (2,) and velocity (2,) it is told."""

    Config = PlanarConfig

    def __init__(self, place: str, config: ClearanceConfig, command: Command) -> None:
        super().__init__(place, config, command)
        assert isinstance(config, PlanarConfig)
        xy = ("x", "y")
        self.inputs = (
            Signal(name="centre", shape=(2,), unit="m", labels=xy),
            Signal(name="velocity", shape=(2,), unit="m/s", labels=xy),
        )
        self.reach = np.array([0.55, 0.25])
        self.creep = config.creep
        self.options = config
        self.needed = Separation(config.acceleration, config.least, config.uncertainty)
        self._age, self.judged = 0.0, 0
        self._near = ""

    def begin(self, now: int, stamps: Mapping[str, int]) -> bool:
        oldest = min(stamps.values())
        self._age = max(now - oldest, 0) * 1e-9
        self._near = "the disc isn't seen"
        return oldest != NEVER and self._age <= self.options.max_age and bool(np.isfinite(self.input["centre"]).all())

    def clear(self, motion: Braking) -> bool:
        self.judged += 1
        distance, normal = distances(motion.path, self.input["centre"])
        speed = np.maximum(normal @ self.input["velocity"], 0.0)
        travel = travels(motion.path, REACH)
        found = margins(
            distance[..., None], speed[..., None], travel, motion.until, self._age, motion.slack @ REACH, self.needed
        )
        self.margin = float(found.min())
        self._near = f"link {int(found.min(axis=0).argmin()) + 1} and the disc, {distance[0].min():.3f} m"
        return is_clear(found, distance, np.abs(motion.velocity) @ REACH, self.creep)

    def why(self) -> str:
        return self._near


def distances(path: Array, centre: Array) -> tuple[Array, Array]:
    """Distance (m, 2) of each link's surface from the disc's, and the unit vector (m, 2, 2) from disc to link."""
    a, b = path[:, 0], path[:, 0] + path[:, 1]
    elbow = LINKS[0] * np.stack([np.cos(a), np.sin(a)], axis=1)
    tip = elbow + LINKS[1] * np.stack([np.cos(b), np.sin(b)], axis=1)
    starts = np.stack([np.zeros_like(elbow), elbow], axis=1)
    ways = np.stack([elbow, tip - elbow], axis=1)
    t = np.clip(((centre - starts) * ways).sum(axis=2) / (LINKS**2), 0.0, 1.0)
    gap = starts + t[..., None] * ways - centre
    size = np.linalg.norm(gap, axis=2)
    return size - RADII - DISC, gap / np.maximum(size, 1e-12)[..., None]
