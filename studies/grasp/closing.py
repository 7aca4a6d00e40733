"""How a hand closes around an object, and how the extra finger follows: without time, until each link touches.

As SynGrasp closes hands: a posture is changed in small steps, and what touches stops. The object doesn't move.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.runtime.models.human_hand import FINGERS
from srl.studies.grasp.cell import GraspCell

Closing = Literal["curl", "converge"]
CLOSINGS: Final[tuple[Closing, ...]] = ("curl", "converge")

# Postures by digit, degrees; ours. `FLAT` is as far open as they go, `HALF` a hand before a grasp, `FIST` as far closed
# as the curl goes. The fingers' ratio of flexions is that of the world's scripted hand. The thumb before a grasp is
# searched for (`_opposed`), and it curls in the ratio of joints that takes its tip toward the object.
FLAT: Final = ((30, 0, 0, 0), (8, 0, 0, 0), (0, 0, 0, 0), (-6, 0, 0, 0), (-12, 0, 0, 0))
HALF: Final = (FLAT[0], (6, 15, 18, 10), (0, 15, 18, 10), (-5, 15, 18, 10), (-9, 15, 18, 10))
FIST: Final = (FLAT[0], (0, 80, 95, 62), (0, 80, 95, 62), (0, 80, 95, 62), (0, 80, 95, 62))
OUTWARD: Final = (0, -60, 0, 0)
"""Degrees: the posture toward which the extra finger is opened where its home would be inside the object."""
_THUMBS: Final = tuple((a, f, m, 0) for a in range(-60, 31, 10) for f in range(0, 106, 5) for m in (0, 20, 40))

CLEAR: Final = 0.005  # m between object and digit before it closes; ours
_REACH: Final = 0.012  # m between object and the thumb's tip, at most, if that can be; ours
_OPPOSED: Final = -30  # degrees of abduction of a thumb that is opposed
_THUMB_TURN: Final = np.deg2rad(60.0)  # of the joint that turns most, to the end of the curl; ours
_STEP: Final = 0.0008  # m, at most, that a fingertip goes in a step: less than what counts as touching
_NEAR: Final = 0.05  # share of the way to the object's centre at which converging tips end
_OPENING: Final = 60  # steps of looking for the most closed posture that is clear
_DT: Final = 0.01  # s of a cycle; it only smooths the rate that the law gives beside its angles


@dataclass(frozen=True)
class Motion:
    """A closing hand, step by step.

    Attributes:
        postures: (k, 20) rad, stopped where it touches.
        measured: tips (k, 5, 3) m in the hand's frame, of these postures.
        intended: tips (k, 5, 3) m as they would go on without the object.
    """

    postures: Array
    measured: Array
    intended: Array


def start(cell: GraspCell) -> Array | None:
    """The posture (n,), rad, from which hand and finger close: each digit as closed as `HALF`, or home, if clear.

    Otherwise it is opened until it is clear; None if it isn't clear even then. The thumb goes where it opposes the
    other fingers best.
    """
    q = np.concatenate([np.deg2rad(np.ravel(FLAT)), *[np.deg2rad(OUTWARD) for _ in cell.extra]])
    goal = np.concatenate([np.deg2rad(np.ravel(HALF)), cell.home])
    begin = q.copy()
    for joints in cell.digits.values():
        for share in np.linspace(1.0, 0.0, _OPENING + 1):
            q[joints] = begin[joints] + share * (goal[joints] - begin[joints])
            cell.pose(q)
            if cell.apart()[joints].min() > CLEAR:
                break
        else:
            return None
    return _opposed(cell, q)


def _opposed(cell: GraspCell, q: Array) -> Array:
    """The posture with the thumb where its tip is seen from the object's centre as far as can be from the others'."""
    joints, best, found = cell.digits["thumb"], 6.0, q
    for posture in _THUMBS:
        tried = q.copy()
        tried[joints] = np.deg2rad(posture)
        cell.pose(tried)
        gap = cell.apart()[joints[-1]]
        if cell.apart()[joints].min() <= CLEAR:
            continue
        away = cell.tips() - cell.centre
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        # First come opposed thumbs that are near, then those that are one of it, each from -1 to 1.
        along = float(away[0] @ away[1:].mean(axis=0)) + 2.0 * (gap > _REACH) + 2.0 * (posture[0] > _OPPOSED)
        if along < best:
            best, found = along, tried
    return found


def curl(cell: GraspCell, q: Array, active: Sequence[str]) -> Motion:
    """Every joint goes toward the fist; a link that touches stops the joints before it, and those after it go on."""
    return _stopped(cell, curled(cell, q, active), active, whole=False)


def curled(cell: GraspCell, q: Array, active: Sequence[str]) -> Array:
    """The postures (k, n), rad, of `curl` as they would be without the object."""
    goal = q.copy()
    moving = [joint for digit in active for joint in cell.digits[digit]]
    goal[moving] = np.deg2rad(np.ravel(FIST))[moving]
    thumb = cell.digits["thumb"]
    if "thumb" in active:
        chain = cell.chains[0]
        way = cell.centre - chain.chain.forward(q[thumb].tolist())
        toward, _ = chain.follow(q[thumb].tolist(), (1e-3 * way / np.linalg.norm(way)).tolist(), (0.0, 0.0, 0.0), 0.0)
        turn = np.array(toward) / np.abs(toward).max() * _THUMB_TURN
        goal[thumb] = np.clip(q[thumb] + turn, *cell.limits[thumb].T)
    cell.pose(q)
    tips = [cell.tips()]
    for share in np.linspace(0.0, 1.0, 9)[1:]:  # the way that the longest finger's tip goes
        cell.pose(q + share * (goal - q))
        tips.append(cell.tips())
    way = np.linalg.norm(np.diff(tips, axis=0), axis=2).sum(axis=0).max()
    k = int(np.ceil(1.3 * way / _STEP))
    found: Array = q + np.linspace(0.0, 1.0, k + 1)[:, None] * (goal - q)
    return found


def converge(cell: GraspCell, q: Array, active: Sequence[str]) -> Motion:
    """Every tip goes straight toward the object's centre; a digit that touches stops."""
    return _stopped(cell, converged(cell, q, active), active, whole=True)


def converged(cell: GraspCell, q: Array, active: Sequence[str]) -> Array:
    """The postures (k, n), rad, of `converge` as they would be without the object."""
    cell.pose(q)
    ways = cell.centre - cell.tips()
    k = int(np.ceil(np.linalg.norm(ways, axis=1).max() / _STEP))
    wished = np.tile(q, (k + 1, 1))
    for digit in active:
        chain, joints = cell.chains[FINGERS.index(digit)], cell.digits[digit]
        at = q[joints].tolist()
        tip = np.array(chain.chain.forward(at))
        for i in range(1, k + 1):
            goal = tip + min(i / k, 1.0 - _NEAR) * ways[FINGERS.index(digit)]
            dp = (goal - chain.chain.forward(at)).tolist()
            step, _ = chain.follow(at, dp, (0.0, 0.0, 0.0), 0.0)
            at = [a + d for a, d in zip(at, step, strict=True)]
            wished[i, joints] = at
    return wished


MOTIONS: Final[dict[str, Callable[[GraspCell, Array, Sequence[str]], Motion]]] = {"curl": curl, "converge": converge}
PATHS: Final[dict[str, Callable[[GraspCell, Array, Sequence[str]], Array]]] = {"curl": curled, "converge": converged}


def follow(cell: GraspCell, law: str, begin: Array, motion: Motion, tips: Array) -> Array:
    """Runs a law along a motion of the hand; returns the postures (k, n), rad, of both.

    Where a link of an extra finger would go into the object or deeper into the hand or another finger, its joints
    before that link stay. They aren't held for good: a finger that the law takes away leaves the object again.

    Args:
        law: one of the cell's.
        begin: (n,) rad, as of `start`.
        tips: (k, 5, 3) m, what the law sees: the motion's `measured` or `intended`.
    """
    mapping, fingers = cell.laws[law], [cell.digits[name] for name in cell.extra]
    joints = [joint for finger in fingers for joint in finger]
    # Where the law takes the fingers to be: what the guard let through, or its own last output.
    q, where = begin.copy(), mapping.applied.get("q", mapping.output["q"])
    mapping.input["tips"][:] = tips[0]
    where[:] = q[joints]
    mapping.reset()
    found = np.empty((len(tips), cell.n))
    for i, (hand, seen) in enumerate(zip(motion.postures, tips, strict=True)):
        q[:20] = hand
        cell.pose(q)
        least, before = np.minimum(cell.apart(), 0.0), q.copy()
        mapping.input["tips"][:] = seen
        where[:] = q[joints]
        mapping.update(_DT)
        q[joints] = mapping.output["q"]
        for _ in joints:
            cell.pose(q)
            inside = cell.apart() < least
            if not inside[joints].any():
                break
            for own in fingers:
                if len(last := np.flatnonzero(inside[own])[-1:]):
                    stop = own[: int(last[0]) + 1]
                    q[stop] = before[stop]
        found[i] = q
    return found


def _stopped(cell: GraspCell, wished: Array, active: Sequence[str], whole: bool) -> Motion:
    """Follows postures (k, n) until links touch. `whole`: a touch stops all of a digit, not the joints before it."""
    q, free = wished[0].copy(), np.zeros(cell.n, dtype=bool)
    for digit in active:
        free[cell.digits[digit]] = True
    postures, measured, intended = [], [], []
    for posture in wished:
        before = q.copy()
        q[free] = posture[free]
        changed = True
        while changed:
            cell.pose(q)
            gaps, changed = cell.gaps(), False
            for digit in active:
                joints = cell.digits[digit]
                inside = np.flatnonzero(gaps[joints] < 0.0)
                stop = joints if whole and len(inside) else joints[: inside[-1] + 1] if len(inside) else []
                if (q[stop] != before[stop]).any():
                    q[stop], changed = before[stop], True
                free[stop] = False
        postures.append(q[:20].copy())
        measured.append(cell.tips())
        cell.pose(posture)
        intended.append(cell.tips())
    return Motion(np.array(postures), np.array(measured), np.array(intended))
