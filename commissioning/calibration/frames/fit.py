"""Where one frame is in another, from points or from poses that were measured in both. Pure functions.

Points: p_i in the parent and q_i in the frame are the same place, p_i = R q_i + t. Least squares by the singular
values of the correlation (Arun, Huang, Blostein 1987, doi:10.1109/TPAMI.1987.4767965; that no mirror image comes out:
Umeyama 1991, eq. 39 and 43, doi:10.1109/34.88573).

Poses: A_i in the parent is that of one body, B_i in the frame that of another one, and the two are fixed to each
other: A_i X = Y B_i, with Y what is looked for and X the second body in the first. The rotations come first, by
Kronecker products (Shah 2013, doi:10.1115/1.4024473: R_Y and R_X are the singular vectors of sum R_Bi (x) R_Ai that
belong to its greatest singular value), then the places, which are linear. Both are then refined together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from srl.runtime.contracts import rotation
from srl.runtime.contracts.errors import SrlError
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array

What = Literal["points", "poses"]
Indices = NDArray[np.intp]
FEWEST: Final[dict[What, int]] = {"points": 4, "poses": 6}
_AGAIN: Final = "Do it again: r N, or --redo N --from FILE.rrd"
_SCALE: Final = 0.02
_MUCH: Final = 0.25  # what leaves less than this share of the sum of squares fits much better


class MountError(SrlError):
    """A frame can't be calibrated from these points or poses."""


class Thresholds(Options):
    """What a calibration must reach."""

    steady: float = Field(0.002, gt=0, description="m, by which a place may move while it is held")
    apart: float = Field(0.05, gt=0, description="m, by which two points must differ")
    turned: float = Field(0.2, gt=0, description="rad, by which two poses must differ")
    spread: float = Field(0.03, gt=0, description="m, root mean square of the points' distances from a line")
    axes: float = Field(0.2, gt=0, description="rad, of the rotations about the second of their axes, root mean square")
    position: float = Field(0.005, gt=0, description="m, the most that may be left of a point or a pose")
    rotation: float = Field(0.02, gt=0, description="rad, the most that may be left of a pose")
    uncertain: float = Field(0.005, gt=0, description="m, standard deviation that the frame's place may have")
    askew: float = Field(0.01, gt=0, description="rad, standard deviation that the frame's rotation may have")
    lever: float = Field(0.1, gt=0, description="m: a pose's error of 1 rad counts as this; poses only")


@dataclass(frozen=True)
class Mount:
    """What was found, from n points or poses.

    Attributes:
        what: points or poses.
        numbers: (n,) as the person knows them.
        pose: (7,) m, w x y z: of the frame in its parent.
        body: (7,) of poses: that of the body measured in the parent, in the one measured in the frame; None of points.
        parent, frame: (n, 3) m of points, (n, 7) of poses, as measured.
        left: (n,) m, what is left.
        askew: (n,) rad, what is left of a rotation; 0 of points.
        without: (n,) m, how far each is from where the others alone say.
        spread: m of points, rad of poses: as the threshold `spread` or `axes` says.
        uncertain: m, rad: standard deviation of the frame's place and of its rotation.
    """

    what: What
    numbers: tuple[int, ...]
    pose: Array
    body: Array | None
    parent: Array
    frame: Array
    left: Array
    askew: Array
    without: Array
    spread: float
    uncertain: tuple[float, float]


def fit(what: What, numbers: Sequence[int], parent: Array, frame: Array, noise: float, limits: Thresholds) -> Mount:
    """The frame in its parent.

    Args:
        what: points or poses.
        numbers: of them, for errors.
        parent, frame: (n, 3) m, or (n, 7) m and w x y z: each as measured in the parent, and in the frame.
        noise: m, standard deviation of one of these places.
        limits: what they must reach.
    Raises:
        MountError: too few, two are alike, or they don't say where the frame is; how it looks is said.
    """
    if len(numbers) < FEWEST[what]:
        problem = f"{len(numbers)} are held, {FEWEST[what]} are needed"
        raise MountError(what, problem, "Do more, far from each other")
    if not (np.isfinite(parent).all() and np.isfinite(frame).all()):
        raise MountError(what, "some aren't measured", _AGAIN)
    _differ(what, numbers, parent, frame, limits)
    return (_of_points if what == "points" else _of_poses)(tuple(numbers), parent, frame, noise, limits)


def refusals(found: Mount, limits: Thresholds) -> tuple[MountError, ...]:
    """Why the result can't be used; none if it can."""
    bad = (found.left > limits.position) | (found.askew > limits.rotation)
    made = []
    if bad.any():
        made += _outlier(found, limits) or [
            MountError(f"{found.what[:-1]} {found.numbers[i]}", _leaves(found, i), _AGAIN)
            for i in np.flatnonzero(bad).tolist()
        ]
    for value, most, unit, of in (
        (found.uncertain[0], limits.uncertain, "m", "place"), (found.uncertain[1], limits.askew, "rad", "rotation"),
    ):  # fmt: skip
        if value > most:
            problem = f"the frame's {of} is uncertain by {value:.3g} {unit}, {most:g} {unit} are allowed"
            made.append(MountError(found.what, problem, "Do more, farther from each other, and hold them longer"))
    return tuple(made)


def rigid(p: Array, q: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,) m that bring q (n, 3) nearest to p (n, 3). (Umeyama eq. 39 to 43.)"""
    middle, own = p.mean(axis=0), q.mean(axis=0)
    U, _, Vt = np.linalg.svd((p - middle).T @ (q - own))
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt)) or 1.0]) @ Vt
    return R, middle - R @ own


def hand_eye(A: Array, B: Array) -> tuple[Array, Array]:
    """X and Y (4, 4) of A_i X = Y B_i, of A, B (n, 4, 4): in closed form. (Shah 2013, eq. 20 to 31.)"""
    K = sum(np.kron(b[:3, :3], a[:3, :3]) for a, b in zip(A, B, strict=True))
    U, _, Vt = np.linalg.svd(K)
    # The columns are stacked: vec(R_A R_X R_B^T) = (R_B (x) R_A) vec(R_X).
    RX, RY = (_nearest_rotation(v.reshape(3, 3).T) for v in (Vt[0], U[:, 0]))
    # R_A t_X + t_A = R_Y t_B + t_Y
    C = np.concatenate([np.hstack([a[:3, :3], -np.eye(3)]) for a in A])
    d = np.concatenate([RY @ b[:3, 3] - a[:3, 3] for a, b in zip(A, B, strict=True)])
    t = np.linalg.lstsq(C, d, rcond=None)[0]
    X, Y = np.eye(4), np.eye(4)
    X[:3, :3], X[:3, 3], Y[:3, :3], Y[:3, 3] = RX, t[:3], RY, t[3:]
    return X, Y


def axes(poses: Array) -> float:
    """rad: how far poses (n, 7) turn about the second of their axes, root mean square; 0 if they turn about one."""
    turns = Rotation.from_quat(poses[:, 3:], scalar_first=True)
    relative = (turns.mean().inv() * turns).as_rotvec()
    return float(np.linalg.svd(relative, compute_uv=False)[1] / np.sqrt(len(poses)))


def _of_points(numbers: tuple[int, ...], p: Array, q: Array, noise: float, limits: Thresholds) -> Mount:
    n = len(p)
    _same_size(p, q)
    values = np.linalg.svd(q - q.mean(axis=0), compute_uv=False)
    spread = float(np.sqrt(np.sum(values[1:] ** 2) / n))
    if spread < limits.spread:
        problem = f"they lie near a line: {1000 * spread:.0f} mm from it, {1000 * limits.spread:.0f} mm are needed"
        raise MountError("points", problem, "Touch points beside that line, too: how the frame turns about it is open")
    R, t = rigid(p, q)
    left = np.linalg.norm(p - q @ R.T - t, axis=1)
    turned, mirrored = rigid(p, -q)
    other = np.linalg.norm(p + q @ turned.T - mirrored, axis=1)
    if left.max() > limits.position and np.sum(other**2) < _MUCH * np.sum(left**2):
        problem = "the one set is the other's mirror image"
        raise MountError(
            "points", problem, "One of them has a left-handed frame: an axis' sign, or two axes, are wrong"
        )
    without = _each_without(
        lambda keep: rigid(p[keep], q[keep]), lambda found, i: p[i] - found[0] @ q[i] - found[1], n
    )  # fmt: skip
    # To first order p = R q + t turns by e about the middle: dp = e x d, so the information on e is sum |d|^2 - d d^T.
    d = q @ R.T - (q @ R.T).mean(axis=0)
    sigma = max(float(np.sqrt(np.sum(left**2) / max(3 * n - 6, 1))), noise)
    turning = sigma**2 * np.linalg.inv(np.sum(d**2) * np.eye(3) - d.T @ d)
    away = _cross(t - p.mean(axis=0))
    place = sigma**2 / n * np.eye(3) + away @ turning @ away.T
    uncertain = float(np.sqrt(np.trace(place))), float(np.sqrt(np.trace(turning)))
    pose = np.array([*t, *rotation.from_matrix(R)])
    return Mount("points", numbers, pose, None, p, q, left, np.zeros(n), without, spread, uncertain)


def _of_poses(numbers: tuple[int, ...], parent: Array, frame: Array, noise: float, limits: Thresholds) -> Mount:
    spread = min(axes(parent), axes(frame))
    if spread < limits.axes:
        problem = f"they turn about one axis: about others by {spread:.2f} rad, {limits.axes:g} are needed"
        raise MountError("poses", problem, "Turn the flange about another axis, too, by 30 degrees and more")
    A, B = (np.array([rotation.homogeneous(pose) for pose in poses]) for poses in (parent, frame))

    def off(found: tuple[Array, Array], i: int) -> Array:
        seen: Array = (found[1] @ B[i] - A[i] @ found[0])[:3, 3]
        return seen

    n = len(A)
    X, Y, J = _refined(A, B, limits.lever)
    both = _errors(A, B, X, Y)
    left, askew = np.linalg.norm(both[:, :3], axis=1), np.linalg.norm(both[:, 3:], axis=1)
    variance = _variances(both * [1.0, 1.0, 1.0, limits.lever, limits.lever, limits.lever], J, noise)[6:]
    uncertain = float(np.sqrt(variance[:3].sum())), float(np.sqrt(variance[3:].sum()))
    without = _each_without(lambda keep: hand_eye(A[keep], B[keep]), off, n)
    pose, mount = (np.array([*T[:3, 3], *rotation.from_matrix(T[:3, :3])]) for T in (Y, X))
    body = np.array(rotation.inverted(tuple(mount.tolist())))
    return Mount("poses", numbers, pose, body, parent, frame, left, askew, without, spread, uncertain)


def _refined(A: Array, B: Array, lever: float) -> tuple[Array, Array, Array]:
    """X, Y (4, 4) with the least sum of squares of both errors, and the derivative of the errors (6 n, 12)."""
    first = hand_eye(A, B)

    def at(x: Array) -> tuple[Array, Array]:
        return _moved(first[0], x[:6]), _moved(first[1], x[6:])

    def off(x: Array) -> Array:
        found = _errors(A, B, *at(x))
        found[:, 3:] *= lever
        return found.ravel()

    solved = least_squares(off, np.zeros(12), method="lm")
    X, Y = at(solved.x)
    return X, Y, np.asarray(solved.jac)


def _variances(left: Array, J: Array, noise: float) -> Array:
    """(12,) variances of what was found, of what is left (n, 6) and its derivative (6 n, 12); `noise`: m, of a place.

    Places and rotations have errors of their own: one common to both would be too small for the larger of the two. What
    is left is M e of the errors e, so each sum of its squares is, on average, so much of one variance and of the other.
    """
    places = np.tile(np.repeat([1.0, 0.0], 3), len(left))
    M = np.square(np.eye(len(J)) - J @ np.linalg.pinv(J))
    both = np.array([places, 1.0 - places])
    place, turn = np.maximum(np.linalg.solve(both @ M @ both.T, both @ np.square(left.ravel())), 0.0)
    found: Array = np.square(np.linalg.pinv(J)) @ (max(place, noise**2) * places + turn * (1.0 - places))
    return found


def _moved(T: Array, by: Array) -> Array:
    """A transform (4, 4), moved by (6,): m, and rad about the parent's axes."""
    made = T.copy()
    made[:3, :3] = Rotation.from_rotvec(by[3:]).as_matrix() @ T[:3, :3]
    made[:3, 3] += by[:3]
    return made


def _errors(A: Array, B: Array, X: Array, Y: Array) -> Array:
    """(n, 6) m, rad: by how much A_i X and Y B_i differ."""
    one, other = A @ X, Y @ B
    turn = Rotation.from_matrix(one[:, :3, :3].transpose(0, 2, 1) @ other[:, :3, :3]).as_rotvec()
    return np.hstack([one[:, :3, 3] - other[:, :3, 3], turn])


def _differ(what: What, numbers: Sequence[int], parent: Array, frame: Array, limits: Thresholds) -> None:
    """Raises MountError: two points or poses are alike, so one of them says nothing."""
    for i, j in combinations(range(len(numbers)), 2):
        if gap := like(what, parent[i], parent[j], limits):
            name = what[:-1]
            raise MountError(
                f"{name} {numbers[j]}", f"it is like {name} {numbers[i]}: {gap}", "Go elsewhere. " + _AGAIN
            )


def like(what: What, one: Array, other: Array, limits: Thresholds) -> str:
    """How little two points or poses differ, if too little; else ""."""
    if what == "points":
        gap = float(np.linalg.norm(one[:3] - other[:3]))
        return f"{1000 * gap:.0f} mm away" if gap < limits.apart else ""
    turn = 2.0 * np.arccos(min(abs(float(one[3:] @ other[3:])), 1.0))
    return f"turned by {turn:.2f} rad" if turn < limits.turned else ""


def _same_size(p: Array, q: Array) -> None:
    """Raises MountError: points (n, 3) aren't of one size, and scaled they would fit each other."""
    P, Q = p - p.mean(axis=0), q - q.mean(axis=0)
    size = float(np.sqrt(np.sum(P**2))) / max(float(np.sqrt(np.sum(Q**2))), 1e-12)
    for factor, whose in ((1000.0, "parent"), (0.001, "frame")):
        if abs(size / factor - 1.0) < 0.1:
            problem = f"the points in the {whose} are 1000 times larger: that looks like millimetres"
            raise MountError("points", problem, "Give all in m")
    plain, scaled = (np.sum((P - c * Q @ rigid(P, Q)[0].T) ** 2) for c in (1.0, size))
    # One point that is wrong changes the size, too, but then the scaled set fits no better.
    if abs(size - 1.0) > _SCALE and scaled < _MUCH * plain:
        problem = f"the points as measured in the parent are {100 * (size - 1.0):+.1f} % larger than in the frame"
        remedy = "Check the points' coordinates, the tip's length and the motion capture's own calibration"
        raise MountError("points", problem, remedy)


def _outlier(found: Mount, limits: Thresholds) -> list[MountError]:
    """The one point or pose without which the others fit; none if there is no such one."""
    n = len(found.numbers)
    if n - 1 < FEWEST[found.what]:
        return []
    for i in np.argsort(-found.without):
        keep = np.flatnonzero(np.arange(n) != i)
        try:
            rest = fit(
                found.what, [found.numbers[k] for k in keep], found.parent[keep], found.frame[keep], 0.0, limits
            )  # fmt: skip
        except MountError:
            continue
        if (rest.left <= limits.position).all() and (rest.askew <= limits.rotation).all():
            problem = f"it is {1000 * found.without[i]:.0f} mm off where the other {n - 1} say, which fit each other"
            return [MountError(f"{found.what[:-1]} {found.numbers[i]}", problem, _AGAIN)]
    return []


def _leaves(found: Mount, i: int) -> str:
    turn = f" and {found.askew[i]:.3f} rad" if found.what == "poses" else ""
    return f"{1000 * found.left[i]:.1f} mm{turn} are left of it"


def _each_without(
    solve: Callable[[Indices], tuple[Array, Array]], off: Callable[[tuple[Array, Array], int], Array], n: int
) -> Array:
    """(n,) m: how far each is from where the others say."""
    found = []
    for i in range(n):
        keep = np.flatnonzero(np.arange(n) != i)
        found.append(float(np.linalg.norm(off(solve(keep), i))))
    return np.array(found)


def _nearest_rotation(M: Array) -> Array:
    """The rotation (3, 3) nearest to +M or -M, whichever has a positive determinant."""
    U, _, Vt = np.linalg.svd(M * np.sign(np.linalg.det(M) or 1.0))
    found: Array = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return found


def _cross(v: Array) -> Array:
    """(3, 3): [v] with [v] u = v x u."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
