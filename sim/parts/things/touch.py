"""Counts touches between a fixture and a tool, and measures the force between them."""

from __future__ import annotations

from typing import Any, Final

import mujoco
import numpy as np

from srl.runtime.contracts.signals import Array

FIXTURE_BIT: Final = 16
# Fixtures and their tools touch only each other, so a counted touch is the tool's.
FIXTURE_CONTACT: Final = {"contype": FIXTURE_BIT, "conaffinity": FIXTURE_BIT, "condim": 3}
REARM: Final = 0.3  # s without contact after which the next contact is a new touch; ours: one buzz is one error


class Touches:
    """Contacts between the geoms of a part, `<part>/...`, and those of all other parts.

    They belong to the previous physics step. The result is stored, because a restored world can't compute it again.

    Attributes:
        touching: whether there is contact.
        force: (3,) N, on the part, world axes.
        count: number of touches so far.
        spent: s of contact so far.
    """

    SIZE = 7

    def __init__(self, model: Any, data: Any, part: str, without: str = "") -> None:
        """Args: without, prefix of the geom names of the part that aren't counted."""
        self._model, self._data = model, data
        names = [model.geom(i).name for i in range(model.ngeom)]
        own = [n.startswith(f"{part}/") and not (without and n.startswith(without)) for n in names]
        self._own = np.array(own)
        self._frame, self._wrench = np.zeros((3, 3)), np.zeros(6)
        self.touching, self.count, self.spent, self._last = False, 0, 0.0, -REARM
        self.force = np.zeros(3)
        self._at = -1.0

    def look(self, dt: float) -> None:
        """Counts touches; call it every `dt` seconds of world time."""
        data = self._data
        now = float(data.time)
        if self._at != now:
            self._at = now
            self._measure()
        if not self.touching:
            return
        if now - self._last >= REARM:
            self.count += 1
        self._last = now
        self.spent += dt

    def _measure(self) -> None:
        data, force = self._data, self.force
        force[:] = 0.0
        self.touching = False
        if not data.ncon:
            return
        owned = self._own[data.contact.geom]
        for i in np.flatnonzero(owned[:, 0] != owned[:, 1]).tolist():
            contact = data.contact[i]
            if contact.dist > 0.0:
                continue
            self.touching = True
            mujoco.mj_contactForce(self._model, data, i, self._wrench)
            # The contact's x axis points from the first geom to the second; the force acts on the second.
            on_second = contact.frame.reshape(3, 3).T @ self._wrench[:3]
            force += -on_second if owned[i, 0] else on_second

    def save(self) -> list[float]:
        """The state as SIZE numbers."""
        return [float(self.touching), float(self.count), self.spent, self._last, *self.force.tolist()]

    def restore(self, values: Array) -> None:
        """Restores a state returned by `save`, in a world that has been restored."""
        touching, count, self.spent, self._last, *force = values.tolist()
        self.touching, self.count, self.force[:] = bool(touching), int(count), force
        self._at = float(self._data.time)
