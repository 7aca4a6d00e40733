"""Measures of a grasp from its contacts: grasp matrix, isotropy, closure, epsilon.

Contacts are points with friction: a force, no moment. Forces act on the object, and torques are about its centre.
A torque becomes comparable with a force when it is divided by a length, and most measures depend on which: each
function takes it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from srl.runtime.contracts.signals import Array

EDGES: Final = 8  # of a linearised friction cone; from here on epsilon hardly grows
_CLOSED: Final = 1e-9  # least share of a cone's edge in an equilibrium, above the linear program's own tolerance
_RANK: Final = 1e-9  # singular value, relative to the largest, that counts as zero


@dataclass(frozen=True)
class Contacts:
    """Where an object is touched.

    Attributes:
        points: (k, 3) m, from the object's centre.
        normals: (k, 3) unit vectors into the object.
    """

    points: Array
    normals: Array

    def __len__(self) -> int:
        return len(self.points)

    def joined(self, other: Contacts) -> Contacts:
        """These and others."""
        return Contacts(np.concatenate([self.points, other.points]), np.concatenate([self.normals, other.normals]))


def grasp_matrix(points: Array, length: float) -> Array:
    """G (6, 3k): the wrench (force; torque / length) of contact forces in the object's axes.

    Args:
        points: (k, 3) m, from the object's centre.
        length: m, by which torques are divided; 0.001 gives them in N mm, as the paper's tool has them.
    """
    G = np.zeros((6, 3 * len(points)))
    for i, (x, y, z) in enumerate(np.asarray(points) / length):
        G[:3, 3 * i : 3 * i + 3] = np.eye(3)
        G[3:, 3 * i : 3 * i + 3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    return G


def isotropy(points: Array, length: float) -> float:
    """The grasp isotropy index sigma_min(G) / sigma_max(G), 0 to 1; 0 with fewer than three contacts.

    It ignores normals and friction: a large one doesn't say that the object is held.
    """
    if len(points) < 3:
        return 0.0
    sigma = np.linalg.svd(grasp_matrix(points, length), compute_uv=False)
    share = float(sigma[5] / sigma[0])
    return share if share > _RANK else 0.0


def isotropy_of_moments(n: int, first: Array, second: Array, length: float) -> Array:
    """The same index for many grasps at once, from G G^T, which needs only moments of the contact points.

    Args:
        n: contacts of each grasp.
        first: (m, 3) m, sums of their points r.
        second: (m, 3, 3) m^2, sums of r r^T.
        length: as in `grasp_matrix`.
    Returns:
        (m,)
    """
    x, y, z = first.T / length
    zero = np.zeros_like(x)
    S = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    moments = second / length**2
    GG = np.zeros((len(first), 6, 6))
    GG[:, :3, :3] = n * np.eye(3)
    GG[:, 3:, :3], GG[:, :3, 3:] = S, -S
    GG[:, 3:, 3:] = np.trace(moments, axis1=1, axis2=2)[:, None, None] * np.eye(3) - moments
    lam = np.clip(np.linalg.eigvalsh(GG), 0.0, None)
    # What is left of a zero by rounding of squares is its root.
    return np.where(lam[:, 0] > 1e-14 * lam[:, 5], np.sqrt(lam[:, 0] / lam[:, 5]), 0.0)


def wrenches(contacts: Contacts, friction: float, length: float, edges: int = EDGES) -> Array:
    """(k edges, 6) wrenches of the friction cones' edges, each with a normal force of 1 N."""
    G = grasp_matrix(contacts.points, length)
    found = []
    for i, normal in enumerate(contacts.normals):
        first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
        first /= np.linalg.norm(first)
        second = np.cross(normal, first)
        turns = 2.0 * np.pi * np.arange(edges) / edges
        forces = normal + friction * (np.outer(np.cos(turns), first) + np.outer(np.sin(turns), second))
        found.append(forces @ G[:, 3 * i : 3 * i + 3].T)
    return np.concatenate(found) if found else np.zeros((0, 6))


def force_closure(W: Array) -> bool:
    """Whether positive combinations of wrenches W (m, 6) make every wrench.

    By a linear program: they span the space, and zero is a combination of all of them with positive shares.
    """
    from scipy.optimize import linprog

    if len(W) < 7 or np.linalg.matrix_rank(W, _RANK * np.linalg.norm(W, 2)) < 6:
        return False
    m = len(W)
    # Shares s_i = t + a_i with a_i >= 0 and t >= 0; the largest t.
    total = W.sum(axis=0)
    equal = np.vstack([np.column_stack([W.T, total]), np.append(np.ones(m), m)])
    found = linprog(np.append(np.zeros(m), -1.0), A_eq=equal, b_eq=[0.0] * 6 + [1.0], bounds=(0.0, None))
    return found.fun is not None and bool(found.fun < -_CLOSED)


def epsilon(W: Array) -> float:
    """The largest wrench that is resisted in every direction when all normal forces together are 1 N; 0: no closure.

    It is the distance from zero to the nearest facet of the hull of W (m, 6) (Ferrari and Canny 1992). In N; torques
    count by the length that W was made with.
    """
    from scipy.spatial import ConvexHull, QhullError

    if len(W) < 7:
        return 0.0
    try:
        facets = ConvexHull(W).equations
    except QhullError:  # flat
        return 0.0
    return max(float(-facets[:, 6].max()), 0.0)
