"""A force/torque sensor's bias and its tool's load by least squares over static poses.

In pose i the sensor shows F_i = F_0 + m g d_i and T_i = T_0 + c x m g d_i: bias F_0, T_0, mass m, centre c, and d_i,
the direction of gravity in the sensor's axes. d_i is found with them, so nothing has to measure how the sensor is
turned: the forces lie on a sphere about F_0 whose radius is the weight. (Sphere by geometric least squares, from the
algebraic solution: Gander, Golub, Strebel 1994, doi:10.1007/BF01934268.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import Field
from scipy.optimize import least_squares

from srl.runtime.contracts.errors import SrlError
from srl.runtime.contracts.gravity import GRAVITY
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array

FEWEST = 6  # poses: with four the load fits any error


class FtError(SrlError):
    """A sensor can't be calibrated from these poses."""


class Thresholds(Options):
    """What a calibration must reach."""

    steady: float = Field(0.2, gt=0, description="N, by which the force may change while a pose is held")
    apart: float = Field(0.3, gt=0, description="N, by which two poses must differ")
    spread: float = Field(0.25, gt=0, lt=0.57, description="how far the directions are from one plane; a ball's: 0.58")
    force: float = Field(0.3, gt=0, description="N, the most that may be left in a pose: admittance's dead band")
    torque: float = Field(0.03, gt=0, description="N m, the most that may be left in a pose: admittance's dead band")


@dataclass(frozen=True)
class Load:
    """What was found, n poses.

    Attributes:
        numbers: (n,) of the poses, as the person knows them.
        wrench: (n, 6) N, N m, as measured.
        bias: (6,) N, N m.
        mass: kg; 0 of one pose.
        com: (3,) m in the sensor's frame.
        down: (n, 3) gravity's direction in the sensor's axes; NaN of one pose.
        left: (n, 6) N, N m, what is left of each pose's wrench.
        spread: how far the directions are from one plane: the least singular value over the root of n.
        uncertain: standard deviations, N, N m, kg, m: of bias (force, torque), mass, centre.
    """

    numbers: tuple[int, ...]
    wrench: Array
    bias: Array
    mass: float
    com: Array
    down: Array
    left: Array
    spread: float
    uncertain: tuple[float, float, float, float]

    @property
    def most(self) -> tuple[float, float]:
        """N, N m: the most that is left in a pose."""
        if not len(self.left):
            return 0.0, 0.0
        return (
            float(np.linalg.norm(self.left[:, :3], axis=1).max()),
            float(np.linalg.norm(self.left[:, 3:], axis=1).max()),
        )


def bias_alone(number: int, wrench: Array, noise: Array) -> Load:
    """What one pose tells: in it the tool's weight can't be told from the bias.

    Args:
        number: of the pose.
        wrench: (6,) N, N m, its mean.
        noise: (6,) N, N m, standard deviation of that mean.
    """
    uncertain = float(np.linalg.norm(noise[:3])), float(np.linalg.norm(noise[3:])), 0.0, 0.0
    none = np.full((1, 3), np.nan)
    return Load((number,), wrench[None], wrench, 0.0, np.zeros(3), none, np.zeros((1, 6)), 0.0, uncertain)


def fit(numbers: Sequence[int], wrench: Array, noise: Array, thresholds: Thresholds) -> Load:
    """Bias and load from poses.

    Args:
        numbers: of the poses, for errors.
        wrench: (n, 6) N, N m, the mean of each pose.
        noise: (6,) N, N m, standard deviation of these means.
        thresholds: what the poses must reach to be computed at all.
    Raises:
        FtError: too few poses, two are alike, or they lie in one plane.
    """
    n, force, torque = len(wrench), wrench[:, :3], wrench[:, 3:]
    if n < FEWEST:
        remedy = "Do more; for a sensor that can't be turned: --option poses=1, which finds the bias alone"
        raise FtError("poses", f"{n} are held, {FEWEST} are needed", remedy)
    gaps = np.linalg.norm(force[:, None] - force, axis=2) + np.diag(np.full(n, np.inf))
    i, j = divmod(int(gaps.argmin()), n)
    if gaps[i, j] < thresholds.apart:
        problem = f"it is like pose {numbers[min(i, j)]}: their forces differ by {gaps[i, j]:.2f} N"
        remedy = "Turn the sensor further; with a tool too light to be weighed: --option poses=1"
        raise FtError(f"pose {numbers[max(i, j)]}", problem, remedy)
    zero, weight = _sphere(force)
    down = (force - zero) / np.linalg.norm(force - zero, axis=1)[:, None]
    spread = float(np.linalg.svd(down - down.mean(axis=0), compute_uv=False)[-1] / np.sqrt(n))
    if spread < thresholds.spread:
        problem = f"they lie too near one plane: spread {spread:.2f}, {thresholds.spread:.2f} are needed"
        raise FtError("poses", problem, "Turn the sensor about another axis, too: upside down and on each side")
    # T = T_0 + c x w = T_0 - [w] c, w the weight in the sensor's axes.
    A = np.concatenate([np.hstack([np.eye(3), -_cross(w)]) for w in weight * down])
    solved = np.linalg.lstsq(A, torque.ravel(), rcond=None)[0]
    left = np.hstack([force - zero - weight * down, torque - (A @ solved).reshape(-1, 3)])
    # Of the error of each pose the fit takes the part that its unknowns can follow.
    J = np.hstack([down, np.ones((n, 1))])
    sigma = max(float(np.sqrt(np.sum(left[:, :3] ** 2) / max(n - 4, 1))), float(noise[:3].max()))
    turning = max(float(np.sqrt(np.sum(left[:, 3:] ** 2) / (3 * n - 6))), float(noise[3:].max()))
    of_force = sigma * np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
    of_torque = turning * np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
    size, com = np.linalg.norm, solved[3:]
    # An error of the forces' bias, the same in all poses, makes one of c x that of the torques'.
    common = float(size(com) * size(of_force[:3]) * np.sqrt(2.0 / 3.0))
    uncertain = (
        float(size(of_force[:3])), float(np.hypot(size(of_torque[:3]), common)), float(of_force[3] / GRAVITY),
        float(size(of_torque[3:])),
    )  # fmt: skip
    bias = np.concatenate([zero, solved[:3]])
    return Load(tuple(numbers), wrench, bias, weight / GRAVITY, com, down, left, spread, uncertain)


def refusals(load: Load, thresholds: Thresholds) -> tuple[FtError, ...]:
    """Why the result can't be used; none if it can."""
    found = []
    for number, left in zip(load.numbers, load.left, strict=True):
        force, torque = float(np.linalg.norm(left[:3])), float(np.linalg.norm(left[3:]))
        if force > thresholds.force or torque > thresholds.torque:
            problem = f"{force:.2f} N and {torque:.3f} N m are left of its wrench"
            found.append(FtError(f"pose {number}", problem, "Let nothing touch or pull at the tool; do it again: r N"))
    for value, most, unit, what in (
        (load.uncertain[0], thresholds.force, "N", "force"), (load.uncertain[1], thresholds.torque, "N m", "torque"),
    ):  # fmt: skip
        if value > most:
            problem = f"the {what}'s bias is uncertain by {value:.3g} {unit}, {most:g} {unit} are allowed"
            found.append(FtError("poses", problem, "Turn the sensor further in each pose, or hold it longer"))
    return tuple(found)


def _sphere(points: Array) -> tuple[Array, float]:
    """Centre (3,) and radius of the sphere nearest to points (n, 3)."""
    middle = points.mean(axis=0)
    near = points - middle
    A = np.hstack([2.0 * near, np.ones((len(near), 1))])
    first = np.linalg.lstsq(A, np.sum(near**2, axis=1), rcond=None)[0]
    radius = np.sqrt(max(first[3] + first[:3] @ first[:3], 1e-12))

    def off(x: Array) -> Array:
        far: Array = np.linalg.norm(near - x[:3], axis=1) - x[3]
        return far

    found = least_squares(off, [*first[:3], radius], method="lm")
    return found.x[:3] + middle, abs(float(found.x[3]))


def _cross(v: Array) -> Array:
    """(3, 3): [v] with [v] u = v x u."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
