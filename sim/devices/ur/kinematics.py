"""What a UR controller computes of its arm: forward and inverse kinematics, and arithmetic of poses.

A pose is p[x, y, z, rx, ry, rz]: m, and the rotation vector, rad. The arm's nominal model is used, as on a controller
without a calibration of its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import isfinite, pi
from typing import Any, Final, cast

import numpy as np
import pinocchio as pin

from srl.drivers.ur.models import REACH
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots import RobotDescription
from srl.runtime.models.robots.pinocchio_model import FLANGE, pinocchio_model

_TURNS: Final = 40  # Newton steps of one search
_STEP: Final = 1.0  # rad, longest of them
_DAMPING: Final = 1e-6
_HUGE: Final = 1e6
_STARTS: Final = 8  # searches from elsewhere, if the one from the near angles fails


class Kinematics:
    """Kinematics of an arm whose TCP is somewhere at its flange.

    Attributes:
        tcp: the TCP in the flange's frame, a `pinocchio.SE3`.
    """

    def __init__(self, robot: RobotDescription) -> None:
        self._model = pinocchio_model(robot)
        self._data = self._model.createData()
        self._flange = self._model.getFrameId(FLANGE)
        self.tcp = pin.SE3.Identity()
        placements = [*self._model.jointPlacements[2:], self._model.frames[self._flange].placement]
        self._shoulder = self._model.jointPlacements[1].translation.copy()
        self._longest = float(sum(np.linalg.norm(link.translation) for link in placements))

    def forward(self, q: Sequence[float] | Array, tcp: Any = None) -> Any:
        """The TCP in `base` (`pinocchio.SE3`) at angles q (6,), rad; `tcp`: another than the one that is set."""
        pin.framesForwardKinematics(self._model, self._data, np.asarray(q, dtype=float))
        return self._data.oMf[self._flange] * (self.tcp if tcp is None else tcp)

    def jacobian(self, q: Array) -> Array:
        """(6, 6): the TCP's velocity, m/s and rad/s, axes of `base`, for joint velocities."""
        found = pin.computeFrameJacobian(
            self._model, self._data, q, self._flange, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        lever = self._data.oMf[self._flange].rotation @ self.tcp.translation
        found[:3] -= pin.skew(lever) @ found[3:]
        return cast(Array, found)

    def inverse(
        self, target: Any, near: Array, position: float = 1e-10, orientation: float = 1e-10, tcp: Any = None
    ) -> Array | None:
        """Angles (6,), rad, that bring the TCP to `target`, if possible those next to `near`; None: there are none.

        Damped Newton steps from `near`, then from fixed other angles. The controller's own search isn't public.

        Args:
            target: `pinocchio.SE3`, TCP in `base`.
            near: (6,) rad.
            position, orientation: greatest error, m and rad.
            tcp: another than the one that is set.
        """
        flange = target * (self.tcp if tcp is None else tcp).inverse()
        if np.linalg.norm(flange.translation - self._shoulder) > self._longest:
            return None
        best: Array | None = None
        elsewhere = np.random.default_rng(1).uniform(-pi, pi, (_STARTS, 6))
        for k, start in enumerate((near, *elsewhere)):
            q = self._search(flange, start, max(position, 1e-10), max(orientation, 1e-10))
            if q is None:
                continue
            if k == 0:
                return q
            q = near + (q - near + pi) % (2 * pi) - pi  # each joint's turn next to the near angle
            q = np.where(np.abs(q) > REACH, q - np.copysign(2 * pi, q), q)
            if best is None or np.abs(q - near).max() < np.abs(best - near).max():
                best = q
        return best

    def _search(self, flange: Any, start: Array, position: float, orientation: float) -> Array | None:
        q = start.copy()
        for _ in range(_TURNS):
            left = self.error(flange, self.forward(q, pin.SE3.Identity()))
            if np.linalg.norm(left[:3]) <= position and np.linalg.norm(left[3:]) <= orientation:
                return q if np.abs(q).max() <= REACH else None
            J = pin.computeFrameJacobian(
                self._model, self._data, q, self._flange, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            )
            step = J.T @ np.linalg.solve(J @ J.T + _DAMPING * np.eye(6), left)
            q += step * min(1.0, _STEP / max(float(np.abs(step).max()), 1e-12))
        return None

    @staticmethod
    def error(goal: Any, now: Any) -> Array:
        """(6,): the way and the turn, m and rad, axes of `base`, from one placement to another."""
        return np.concatenate([goal.translation - now.translation, pin.log3(goal.rotation @ now.rotation.T)])


def bounded(values: Iterable[float]) -> bool:
    """Whether all are finite and of a size with which one can reckon."""
    return all(isfinite(value) and abs(value) <= _HUGE for value in values)


def placement(pose: Iterable[float]) -> Any:
    """A pose as `pinocchio.SE3`. Raises ValueError: it isn't six finite numbers."""
    values = np.array([float(value) for value in pose])
    if values.shape != (6,) or not bounded(values):
        raise ValueError("a pose is six finite numbers")
    return pin.SE3(pin.exp3(values[3:]), values[:3])


def vector(place: Any) -> Array:
    """A `pinocchio.SE3` as a pose (6,)."""
    return np.concatenate([place.translation, pin.log3(place.rotation)])
