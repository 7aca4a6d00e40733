"""From a person's recorded null-space motion to the directions that read it: IKNS calibration.

Lisini Baldi et al., Exploiting intrinsic kinematic null space for supernumerary robotic limbs control, 2023, section
III. What differs from it, and why: docs/ikns.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.control.ikns.clusters import Indices, box_points, hand_speed, k_means, trimmed
from srl.control.ikns.delaunay import SitesError, delaunay
from srl.control.ikns.thresholds import LEAST_CONDITION, Thresholds
from srl.runtime.contracts.errors import SrlError
from srl.runtime.contracts.signals import Array

_SIDEWAYS: Final = 0.3  # cosine between directions of neighbouring points below which their sense is a guess
_REACH: Final = 2.0  # m
_SPAN: Final = 4 * np.pi  # rad
_ANGLE: Final = 20 * np.pi  # rad; a torso's yaw is unwrapped
_LOST: Final = 0.2  # share of samples without angles or hand


class CalibrationError(SrlError):
    """A recording from which no control can be calibrated."""


@dataclass(frozen=True)
class Recording:
    """Samples at the calibration points. Values that weren't measured are not finite.

    Attributes:
        times: (T,) s, ascending.
        angles: (T, n) rad, unwrapped.
        hand: (T, 3) m, position in the frame in which the law will get it.
        dof: (T,), the DoF that was to move in each sample's trial: 0 to k - 1.
        point: (T,), the point at which each sample's trial was, 0 to N - 1, where that is known. k-means then begins at
            the mean of each point's samples instead of on the surface of the box.
    """

    times: Array
    angles: Array
    hand: Array
    dof: Indices
    point: Indices | None = None


@dataclass(frozen=True)
class Calibration:
    """What the law needs, and what tells its quality. N points, k DoFs, n joints.

    Attributes:
        sites: (N, 3) m, where the hand was.
        directions: (N, k, n), B: the DoF's coordinate is B q, rad. Rows of unit length for one DoF; dual for several.
        lower, upper: (N, k) rad, m and M: the coordinate's range in the DoF's own trial.
        travel: (N, k, n) rad, how far each joint went in the DoF's own trial.
        samples: (N, k), number of samples kept.
        explained: (N, k), share of the variance along the trial's direction.
        wander: (N,) m, rms distance of the kept samples' hand from the site.
        condition: (N, k), sine of the angle between a trial's direction and the space of the others'; 1 for one DoF.
        crosstalk: (N, k, k), [i, j]: how far DoF i goes, from its least to its greatest, in the trials of j, of its
            range; 1 for i = j.
        agreement: (N,), least cosine between the trials' directions here and at the point they were signed by; 1 at the
            first.
        still: share of the samples in which the hand was slow enough.
        lost: share of the samples that weren't finite.
        jumps: number of steps between samples in which an angle jumped by more than half a turn.
    """

    sites: Array
    directions: Array
    lower: Array
    upper: Array
    travel: Array
    samples: Indices
    explained: Array
    wander: Array
    condition: Array
    crosstalk: Array
    agreement: Array
    still: float
    lost: float
    jumps: int


def calibrate(recording: Recording, thresholds: Thresholds | None = None) -> Calibration:
    """Computes a calibration, good or bad; `refusals` says what is wrong with it.

    Points without samples get directions that aren't finite. Neither the order of samples of equal speed nor the signs
    of principal components matter. Raises CalibrationError if nothing at all is kept.
    """
    th = thresholds or Thresholds()
    measured = np.column_stack([recording.angles, recording.hand])
    seen = np.asarray(np.isfinite(measured).all(axis=1))
    steps = np.abs(np.diff(recording.angles[seen], axis=0))
    speed = hand_speed(recording.times, recording.hand)
    kept = seen & (speed < th.speed)
    if not kept.any():
        raise CalibrationError(
            "recording",
            f"no sample of {len(seen)} is left: {int((~seen).sum())} without angles or hand, the others faster than "
            f"{th.speed} m/s",
            "Hold the hand still at each point, and move only the arm",
        )
    q, hand, dof = recording.angles[kept], recording.hand[kept], recording.dof[kept]
    if recording.point is None:
        begin = box_points(hand, th.points, th.up)
    else:
        begin = _middles(recording.hand, seen, recording.point)
    sites, cluster = k_means(hand, begin)
    sites, cluster = trimmed(hand, sites, cluster, th.radius)
    n, N, k = q.shape[1], len(sites), int(recording.dof.max()) + 1
    Z = np.full((N, k, n), np.nan)
    explained, samples = np.full((N, k), np.nan), np.zeros((N, k), dtype=np.intp)
    components: list[list[Array | None]] = [[None] * k for _ in range(N)]
    for i in range(N):
        for j in range(k):
            chosen = q[(cluster == i) & (dof == j)]
            samples[i, j] = len(chosen)
            if len(chosen) > n:
                components[i][j] = _components(chosen, th)
    agreement = np.ones(N)
    for i, parent in _tree(sites, [all(c is not None for c in row) for row in components]):
        for j in range(k):
            own = components[i][j]
            assert own is not None
            base = components[parent][j] if parent >= 0 else None
            components[i][j] = own = _signed(own, base)
            total = own.sum(axis=0)
            Z[i, j] = total / np.linalg.norm(total)
            if parent >= 0:
                agreement[i] = min(agreement[i], float(Z[i, j] @ Z[parent, j]))
    B, condition = _dual(Z)
    lower, upper, travel = np.full((N, k), np.nan), np.full((N, k), np.nan), np.full((N, k, n), np.nan)
    wander, crosstalk = np.full(N, np.nan), np.full((N, k, k), np.nan)
    for i in range(N):
        here = cluster == i
        if here.any():
            wander[i] = np.sqrt(((hand[here] - sites[i]) ** 2).sum(axis=1).mean())
        for j in range(k):
            if (chosen := here & (dof == j)).any():
                explained[i, j] = _explained(q[chosen], Z[i, j])
                along = q[chosen] @ B[i].T
                lower[i, j], upper[i, j] = along[:, j].min(), along[:, j].max()
                travel[i, j] = np.ptp(q[chosen], axis=0)
                crosstalk[i, :, j] = np.ptp(along, axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            crosstalk[i] /= (upper[i] - lower[i])[:, None]
    return Calibration(
        sites, B, lower, upper, travel, samples, explained, wander, condition, crosstalk, agreement,
        still=float(kept.sum() / max(seen.sum(), 1)), lost=float(1.0 - seen.mean()), jumps=int((steps > np.pi).sum()),
    )  # fmt: skip


def flipped(found: Calibration, dof: int) -> Calibration:
    """Returns the calibration with the sense of one DoF (0 to k - 1) turned round: its c becomes 1 - c."""
    sense = np.ones(found.lower.shape[1])
    sense[dof] = -1.0
    return replace(
        found,
        directions=sense[:, None] * found.directions,
        lower=np.where(sense > 0.0, found.lower, -found.upper),
        upper=np.where(sense > 0.0, found.upper, -found.lower),
    )


def refusals(
    found: Calibration, thresholds: Thresholds | None = None, numbers: Sequence[int] | None = None
) -> tuple[CalibrationError, ...]:
    """Returns every reason for which a calibration can't work, with its remedy. Empty: it can be used.

    `numbers`: by which each point is called; 1, 2, ... by default.
    """
    return tuple(_refusals(found, thresholds or Thresholds(), numbers or range(1, len(found.sites) + 1)))


def _refusals(found: Calibration, th: Thresholds, numbers: Sequence[int]) -> Iterator[CalibrationError]:
    if found.lost > _LOST:
        yield CalibrationError(
            "recording",
            f"{found.lost:.0%} of the samples lack angles or hand: markers were missing",
            "See that every marker is seen from all places of the arm, and record it again",
        )
    if found.jumps:
        yield CalibrationError(
            "recording", f"angles jump by more than half a turn {found.jumps} times", "Record them unwrapped"
        )
    around: list[set[int]] = [set() for _ in found.sites]
    try:
        for facet in delaunay(found.sites).facets:
            for i in facet:
                around[i] |= {int(j) for j in facet if j != i}
    except SitesError as error:
        yield CalibrationError("points", error.problem, error.remedy)
    for i in range(len(found.sites)):
        for j in range(found.samples.shape[1]):
            yield from _refused(found, th, i, j, numbers[i])
        yield from _impossible(found, i, numbers[i])
        yield from _reversed(found, around[i], i, numbers)
        if found.wander[i] > th.wander:
            yield CalibrationError(
                f"point {numbers[i]}",
                f"the hand wandered by {1e3 * found.wander[i]:.0f} mm rms, {1e3 * th.wander:.0f} mm are allowed",
                "Redo the point with the hand at a support",
            )
        if found.agreement[i] < _SIDEWAYS:
            angle = np.rad2deg(np.arccos(found.agreement[i]))
            yield CalibrationError(
                f"point {numbers[i]}",
                f"its motion is turned by {angle:.0f} degrees against that of its neighbour, so its sense is a guess",
                "Redo the point with the same motion as at the others, or add a point between them",
            )


def _refused(found: Calibration, th: Thresholds, i: int, j: int, number: int) -> Iterator[CalibrationError]:
    """What is wrong with DoF j at point i, which is called `number`."""
    place = f"point {number}" if found.samples.shape[1] == 1 else f"point {number}, DoF {j + 1}"
    span = found.upper[i, j] - found.lower[i, j]
    if found.samples[i, j] < th.samples or not np.isfinite(found.directions[i, j]).all():
        yield CalibrationError(
            place,
            f"samples kept: {found.samples[i, j]}, needed: {th.samples}; the hand was faster than {th.speed} m/s or "
            f"farther than {1e3 * th.radius:.0f} mm from the point; {found.still:.0%} of all samples were slow enough",
            "Redo the point, longer or with the hand stiller",
        )
    elif span < th.range:
        yield CalibrationError(
            place,
            f"the range is {span:.2f} rad, {th.range} rad are needed",
            "Redo the point and move the arm as far as it goes with the hand still, or choose a point where it goes "
            "farther: not with the arm stretched",
        )
    elif found.explained[i, j] < th.least_explained:
        yield CalibrationError(
            place,
            f"the direction explains {found.explained[i, j]:.0%} of the motion, {th.least_explained:.0%} are needed",
            "Redo the point with one motion there and back, and the hand neither moved nor turned",
        )
    elif found.condition[i, j] < th.condition:
        angle = np.rad2deg(np.arcsin(found.condition[i, j]))
        yield CalibrationError(
            place,
            f"its motion is only {angle:.0f} degrees apart from the other DoFs' motions",
            "Redo its trial with this DoF alone, or do without it",
        )
    else:
        for other in range(found.samples.shape[1]):
            if other != j and found.crosstalk[i, j, other] > th.crosstalk:
                talk = found.crosstalk[i, j, other]
                yield CalibrationError(
                    place,
                    f"it moves through {talk:.0%} of its range in the trial of DoF {other + 1}; {th.crosstalk:.0%} are "
                    "allowed",
                    f"Redo the trial of DoF {other + 1} with this DoF still",
                )


def _impossible(found: Calibration, i: int, number: int) -> Iterator[CalibrationError]:
    """Numbers that no arm gives: a file that was edited, or in other units."""
    place, remedy = f"point {number}", "Calibrate again"
    if np.linalg.norm(found.sites[i]) > _REACH:
        yield CalibrationError(place, f"it is farther than {_REACH:g} m from the chest; is it in mm?", remedy)
    length = np.linalg.norm(found.directions[i], axis=1)
    one = len(length) == 1
    if (length < 0.99).any() or (length > (1.01 if one else 1.01 / LEAST_CONDITION)).any():
        yield CalibrationError(place, f"its directions have the lengths {length.round(3).tolist()}", remedy)
    spans = np.concatenate([found.upper[i] - found.lower[i], found.travel[i].ravel()])
    size = np.abs(found.directions[i])
    far = np.abs(np.stack([found.lower[i], found.upper[i]])) > _ANGLE * size.sum(axis=1)
    wide = found.upper[i] - found.lower[i] > (size * found.travel[i]).sum(axis=1) + 1e-6  # B q goes no farther
    if (spans > _SPAN).any() or (spans < 0.0).any() or far.any() or wide.any():
        yield CalibrationError(place, "its ranges are no motion of an arm; are they in degrees?", remedy)


def _reversed(found: Calibration, around: set[int], i: int, numbers: Sequence[int]) -> Iterator[CalibrationError]:
    """Neighbours, whose directions are interpolated, with opposite senses. The tree of signs doesn't pass them all."""
    around = around if np.isfinite(found.directions[i]).all() else set()
    for j in sorted(k for k in around if np.isfinite(found.directions[k]).all()):
        # The motions themselves: of several degrees of freedom, the dual of the directions that read them.
        a, b = np.linalg.pinv(found.directions[i]).T, np.linalg.pinv(found.directions[j]).T
        size = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
        cosine = (a * b).sum(axis=1) / np.maximum(size, 1e-300)
        if i < j and (cosine < 0.0).any():
            yield CalibrationError(
                f"points {numbers[i]} and {numbers[j]}",
                f"their motions are turned by {np.rad2deg(np.arccos(max(cosine.min(), -1.0))):.0f} degrees, so between "
                "them the sense turns round",
                "Redo both with the same motion as at the others",
            )


def _middles(hand: Array, seen: NDArray[np.bool_], point: Indices) -> Array:
    """(N, 3) m: the mean of each point's samples."""
    found = np.empty((int(point.max()) + 1, 3))
    for i in range(len(found)):
        there = seen & (point == i)
        if not there.any():
            raise CalibrationError(f"point {i + 1}", "none of its samples has angles and hand", "Redo the point")
        found[i] = hand[there].mean(axis=0)
    return found


def _explained(q: Array, Z: Array) -> float:
    """The share of the variance of q (T, n) that is along Z (n,), of unit length."""
    away = q - q.mean(axis=0)
    return float(((away @ Z) ** 2).sum() / max((away**2).sum(), 1e-300))


def _components(q: Array, th: Thresholds) -> Array:
    """Principal components (c, n) weighted by the share of the variance that they explain."""
    away = q - q.mean(axis=0)
    variances, vectors = np.linalg.eigh(away.T @ away / len(q))
    shares = np.maximum(variances[::-1], 0.0) / max(variances.sum(), 1e-300)
    count = 1 if th.components == "first" else int(np.searchsorted(shares.cumsum(), th.share - 1e-12)) + 1
    weighted: Array = shares[:count, None] * vectors.T[::-1][:count]
    return weighted


def _signed(components: Array, base: Array | None) -> Array:
    """Gives each component (c, n) the sign of the one in `base` that it resembles most.

    Without a base, or beyond its components, the largest element becomes positive.
    """
    senses = np.ones(len(components))
    left = [] if base is None else list(base)
    for i, component in enumerate(components):
        if left:
            unit = [component @ b / np.linalg.norm(b) for b in left]
            best = int(np.argmax(np.abs(unit)))
            sense = unit[best]
            del left[best]
        else:
            sense = component[np.abs(component).argmax()]
        senses[i] = -1.0 if sense < 0.0 else 1.0
    return senses[:, None] * components


def _tree(sites: Array, there: list[bool]) -> Iterator[tuple[int, int]]:
    """The shortest tree through the points that are there, from the innermost on: each with its parent, -1 first."""
    left = [i for i, good in enumerate(there) if good]
    if not left:
        return
    middle = sites[left].mean(axis=0)
    root = min(left, key=lambda i: float(np.linalg.norm(sites[i] - middle)))
    yield root, -1
    done = [root]
    left.remove(root)
    while left:
        gaps = np.linalg.norm(sites[left][:, None] - sites[done], axis=2)
        a, b = np.unravel_index(int(gaps.argmin()), gaps.shape)
        yield left[a], done[b]
        done.append(left.pop(int(a)))


def _dual(Z: Array) -> tuple[Array, Array]:
    """B = (Z Z^T)^-1 Z (N, k, n): B_i Z_j is 1 for i = j, else 0. And the sine of Z_i to the space of the others."""
    B, sine = np.full(Z.shape, np.nan), np.full(Z.shape[:2], np.nan)
    for i, rows in enumerate(Z):
        if np.isfinite(rows).all():
            B[i] = np.linalg.pinv(rows.T, rcond=1e-9)
            for j, row in enumerate(rows):
                others = np.delete(rows, j, axis=0).T
                sine[i, j] = np.linalg.norm(row - others @ np.linalg.lstsq(others, row)[0])
    return B, np.minimum(sine, 1.0)
