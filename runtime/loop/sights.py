"""Poses that laws rely on: hidden, broken or jumping ones are lost, though their device goes on with the others."""

from __future__ import annotations

from collections.abc import Sequence
from math import dist

from runtime.contracts.frames import is_pose
from runtime.profile.graph import Sight


class Sights:
    """Watches each pose; see the module's docstring."""

    def __init__(self, sights: Sequence[Sight], max_age: Sequence[int]) -> None:
        """`max_age`: by device, ns for which a pose may be hidden."""
        self._sights = [(s, max_age[s.device]) for s in sights]
        self._places: list[list[float] | None] = [None] * len(sights)
        self._seen = [-1] * len(sights)  # ns
        self._moved = [-1] * len(sights)  # ns

    def lost(self, now: int) -> set[int]:
        """The devices, by index, of which a pose is lost: hidden for longer than `max_age`, or too fast."""
        found = set()
        for i, (sight, age) in enumerate(self._sights):
            if not is_pose(sight.pose):
                # One that never came is the device's own matter: a client may not have begun, a device is stale.
                if 0 <= self._seen[i] < now - age:
                    found.add(sight.device)
                continue
            place, before = sight.pose.tolist(), self._places[i]
            if before is not None and place != before:
                way = dist(place[:2], before[:2]) if len(place) < 4 else dist(place[:3], before[:3])
                if way > sight.speed * (now - self._moved[i]) * 1e-9:
                    found.add(sight.device)
            if place != before:
                self._places[i], self._moved[i] = place, now
            self._seen[i] = now
        return found
