"""An arm's numbers for the laws in C (native/chain.h), from its pinocchio model."""

from __future__ import annotations

from typing import Any

import numpy as np

from srl.runtime.contracts.compiled import NotCompiledError, numbers
from srl.runtime.contracts.signals import Array


def place_of(placement: Any) -> Array:
    """(12,) of a `pinocchio.SE3`: the rotation matrix by rows, then the position, m."""
    return numbers(placement.rotation, placement.translation)


def joint_places(model: Any) -> Array:
    """(n, 12): the place of each joint in the one before. Raises NotCompiledError: they aren't all turning about z."""
    joints = list(model.joints)[1:]
    if any(joint.shortname() != "JointModelRZ" for joint in joints):
        raise NotCompiledError("an arm with a joint that slides")
    return np.array([place_of(model.jointPlacements[k + 1]) for k in range(len(joints))])


def body_of(inertia: Any) -> Array:
    """(10,) of a `pinocchio.Inertia`: mass kg, centre m, inertia about it kg m2 (xx xy yy xz yz zz)."""
    I = inertia.inertia  # noqa: E741
    return numbers(inertia.mass, inertia.lever, I[0, 0], I[1, 0], I[1, 1], I[2, 0], I[2, 1], I[2, 2])


def bodies_of(model: Any) -> Array:
    """(n, 10): the body of each joint."""
    return np.array([body_of(model.inertias[k + 1]) for k in range(model.njoints - 1)])
