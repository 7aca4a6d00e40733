"""What a client may set on a Franka robot, and which values the robot refuses.

Sources: protocol sheet franka-fci, section 3; the ranges of stiffness and filters are those of the vendor's FCI
documentation. The robot's own defaults of the collision behaviour aren't published. The values used here are those
that the vendor's examples set.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from srl.drivers.panda.requests import (
    Body,
    SetCartesianImpedance,
    SetCollisionBehavior,
    SetEEToK,
    SetFilters,
    SetGuidingMode,
    SetJointImpedance,
    SetLoad,
    SetNEToEE,
)
from srl.runtime.contracts.signals import Array

STIFFEST_JOINT: Final = 14250.0  # N m/rad
CARTESIAN_STIFFNESS: Final = ((10.0, 3000.0), (1.0, 300.0))  # N/m, N m/rad
FILTERS: Final = (1.0, 1000.0)  # Hz
HEAVIEST: Final = 100.0  # kg; beyond any payload, but the robot's model stays valid
FARTHEST: Final = 10.0  # m, likewise
LARGEST: Final = 1000.0  # kg m^2, likewise
_TORQUES: Final = (20.0, 20.0, 18.0, 18.0, 16.0, 14.0, 12.0)
_FORCES: Final = (20.0, 20.0, 20.0, 25.0, 25.0, 25.0)


@dataclass(slots=True)
class Settings:
    """Values that stay until a client sets them again. Matrices (4, 4); the load's inertia (3, 3) about its centre."""

    lower_torque_acceleration: Array = field(default_factory=lambda: np.array(_TORQUES))
    upper_torque_acceleration: Array = field(default_factory=lambda: np.array(_TORQUES))
    lower_torque: Array = field(default_factory=lambda: np.array(_TORQUES))
    upper_torque: Array = field(default_factory=lambda: np.array(_TORQUES))
    lower_force_acceleration: Array = field(default_factory=lambda: np.array(_FORCES))
    upper_force_acceleration: Array = field(default_factory=lambda: np.array(_FORCES))
    lower_force: Array = field(default_factory=lambda: np.array(_FORCES))
    upper_force: Array = field(default_factory=lambda: np.array(_FORCES))
    stiffness: Array = field(default_factory=lambda: np.array([3000.0, 3000.0, 3000.0, 2500.0, 2500.0, 2000.0, 2000.0]))
    F_T_NE: Array = field(default_factory=lambda: np.eye(4))
    NE_T_EE: Array = field(default_factory=lambda: np.eye(4))
    EE_T_K: Array = field(default_factory=lambda: np.eye(4))
    load_mass: float = 0.0
    load_centre: Array = field(default_factory=lambda: np.zeros(3))
    load_inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))

    def apply(self, command: Body) -> bool:
        """Takes a setter's values; returns False for values that the robot would call an invalid argument."""
        match command:
            case SetCollisionBehavior():
                return self._collision(command)
            case SetJointImpedance(stiffness):
                return self._within(stiffness, 0.0, STIFFEST_JOINT) and self._stiffness(stiffness)
            case SetCartesianImpedance(stiffness):
                return all(
                    self._within(part, *bounds)
                    for part, bounds in zip((stiffness[:3], stiffness[3:]), CARTESIAN_STIFFNESS, strict=True)
                )
            case SetEEToK(transform):
                return self._transform(transform, self.EE_T_K)
            case SetNEToEE(transform):
                return self._transform(transform, self.NE_T_EE)
            case SetLoad(mass, centre, inertia):
                return self._load(mass, np.array(centre), np.array(inertia).reshape(3, 3))
            case SetFilters(frequencies):
                return self._within(frequencies, *FILTERS)
            case SetGuidingMode():
                return True
        raise ValueError(f"{type(command).__name__} sets nothing")

    @property
    def F_T_EE(self) -> Array:
        """The end effector's frame in the flange's frame, (4, 4)."""
        return self.F_T_NE @ self.NE_T_EE

    def _collision(self, command: SetCollisionBehavior) -> bool:
        for kind in ("torque_acceleration", "torque", "force_acceleration", "force"):
            lower, upper = np.array(getattr(command, f"lower_{kind}")), np.array(getattr(command, f"upper_{kind}"))
            if not (np.isfinite(upper).all() and ((lower > 0) & (lower <= upper)).all()):
                return False
        for kind in ("torque_acceleration", "torque", "force_acceleration", "force"):
            setattr(self, f"lower_{kind}", np.array(getattr(command, f"lower_{kind}")))
            setattr(self, f"upper_{kind}", np.array(getattr(command, f"upper_{kind}")))
        return True

    def _stiffness(self, stiffness: tuple[float, ...]) -> bool:
        self.stiffness = np.array(stiffness)
        return True

    def _load(self, mass: float, centre: Array, inertia: Array) -> bool:
        known = (np.abs(centre) <= FARTHEST).all() and (np.abs(inertia) <= LARGEST).all()
        if not known or not 0 <= mass <= HEAVIEST or not np.allclose(inertia, inertia.T):
            return False
        if np.linalg.eigvalsh(inertia).min() < -1e-9:
            return False
        self.load_mass, self.load_centre, self.load_inertia = mass, centre, inertia
        return True

    @staticmethod
    def _within(values: tuple[float, ...], low: float, high: float) -> bool:
        return all(low <= value <= high for value in values)

    @staticmethod
    def _transform(values: tuple[float, ...], out: Array) -> bool:
        matrix = np.array(values).reshape(4, 4).T
        rotation = matrix[:3, :3]
        rigid = (
            (np.abs(matrix) <= FARTHEST).all()
            and np.array_equal(matrix[3], [0.0, 0.0, 0.0, 1.0])
            and np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-5)
            and np.linalg.det(rotation) > 0
        )
        if rigid:
            out[:] = matrix
        return bool(rigid)
