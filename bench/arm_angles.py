"""Joint angles from markers: one frame of `arm-angles`' fit against scipy's least squares on the same chain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from bench.pairs import Row, measure, there_and_back
from srl.control.ikns.markers import MarkerFit, Mask
from srl.runtime.contracts.signals import Array
from srl.runtime.models.body import Body, average

_FRAMES = 50
_AIM = 150.0  # us


def run() -> list[Row]:
    """One arm (15 degrees of freedom, 11 markers) and both (24, 18), some rad/s at 100 Hz, 1 mm of noise."""
    rows = []
    for what, body in (("one arm", average(1.75, ("right",))), ("both arms", average(1.75))):
        points = _motion(body)
        fit = MarkerFit(body)
        everything = np.ones(len(fit.names), bool)
        fit.solve(points[0], everything, starts=6)

        def ours(fit: MarkerFit = fit, points: Array = points, everything: Mask = everything) -> dict[str, float]:
            def once(i: int) -> None:
                fit.solve(points[i], everything)

            return there_and_back(once, _FRAMES)

        def scipys(fit: MarkerFit = fit, points: Array = points) -> dict[str, float]:
            q = fit.q

            def once(i: int) -> None:
                nonlocal q
                q = _least_squares(fit, points[i], q)

            return there_and_back(once, _FRAMES)

        pairs = measure(ours, {"scipy least_squares": scipys})
        row = pairs.row("arm-angles", f"{what}, one frame", "p50", "scipy least_squares", "us")
        one = len(body.sides) == 1  # what the law fits
        rows.append(replace(row, aim=f"at most {_AIM:g} us", holds=row.ours <= _AIM) if one else row)
    return rows


def _motion(body: Body) -> Array:
    """(frames, k, 3) m."""
    rng, t = np.random.default_rng(0), np.arange(_FRAMES) / 100.0
    bent = np.deg2rad([30.0 if "abduction" in n else 70.0 if "elbow" in n else 0.0 for n in body.names])
    phase = rng.uniform(0.0, 2 * np.pi, len(body.names))
    made = []
    for q in bent + 0.3 * np.sin(2 * np.pi * t[:, None] + phase):
        poses = body.forward(q)
        made.append([poses[m.segment][:3, :3] @ m.at + poses[m.segment][:3, 3] for m in body.markers.values()])
    moved: Array = np.array(made) + rng.normal(0.0, 1e-3, np.shape(made))
    return moved


def _least_squares(fit: MarkerFit, points: Array, q: Array) -> Array:
    def left(x: Array) -> Array:
        return (fit.predicted(x) - points).ravel()

    found: Array = least_squares(left, q, fit.jacobian, method="lm", xtol=1e-4, ftol=1e-4).x
    return found
