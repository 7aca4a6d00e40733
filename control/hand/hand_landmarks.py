"""Computes the fingertips of the human hand from landmarks that a camera sees."""

from __future__ import annotations

from typing import Final

import numpy as np
from pydantic import Field

from srl.control.hand.hand_kinematics import POINTS, points_signal, tips_signal
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT
from srl.runtime.models.models import HandOption, named
from srl.runtime.models.point_series import PointSeries

PALM: Final = (0, 5, 9, 13, 17)  # wrist and the roots of index to little finger: they hardly move in the palm


class HandLandmarksConfig(ControllerConfig):
    """Options of `hand-landmarks`."""

    frame: str = Field("hand", description="frame of the hand: its origin is at the wrist's centre")
    hand: HandOption = named("hand")  # the one that is seen
    off: float = Field(0.02, gt=0, le=0.1, description="m rms by which the palm may differ from the hand's")
    max_hold: float = Field(0.3, ge=0.0, le=5.0, description="s for which landmarks that are no hand are waited for")


class HandLandmarks(Controller):
    """Where the fingers are in the hand's own frame, whichever way the hand is turned in the picture.

    Input `landmarks` (21, 3) m in any right-handed axes. Outputs `tips` (5, 3) m and `skeleton` (21, 3) m in the hand's
    frame, `size` (1,): the seen hand's size divided by the model's, `off` (1,) m: rms of the palm after the fit.

    Rotation R, scale s and shift t of the model's palm a_i onto the seen one b_i, min sum |b_i - (s R a_i + t)|^2, are
    those of Umeyama (1991). A camera alone sees no size, so the fingers get that of `hand`: p = R^T (b - t) / s.
    Where the palm doesn't fit, the outputs stay, and after `max_hold` that is a loss.
    """

    Config = HandLandmarksConfig
    summary = "fingertips of a human hand from 21 landmarks that a camera sees"

    def __init__(self, name: str, config: HandLandmarksConfig) -> None:
        super().__init__(name, config)
        rest = PointSeries(*config.hand.geometry()).at(np.zeros(20))
        model = np.vstack([np.zeros(3), rest])[list(PALM)]
        self._middle = model.mean(axis=0)
        self._A = model - self._middle  # (5, 3)
        self._spread = float((self._A**2).sum())
        self._off, self._max_hold = config.off, config.max_hold
        self._unknown = 0.0  # s
        self.inputs = (Signal(name="landmarks", shape=(21, 3), unit="m", labels=POINTS, components=(POINT,)),)
        one = ("hand",)
        self.outputs = (
            tips_signal(config.frame), points_signal(config.frame),
            Signal(name="size", shape=(1,), unit="1", labels=one), Signal(name="off", shape=(1,), unit="m", labels=one),
        )  # fmt: skip

    def reset(self) -> None:
        self._unknown, self.lost = 0.0, False
        for output in self.output.values():
            output.fill(np.nan)
        self.update(0.0)

    def update(self, dt: float) -> None:
        landmarks = self.input["landmarks"]
        found = self._fit(landmarks) if np.isfinite(landmarks).all() else None
        self._unknown = 0.0 if found is not None else self._unknown + dt
        self.lost = self._unknown > self._max_hold
        if found is None:
            return
        R, s, t, off = found
        skeleton = self.output["skeleton"]
        np.dot(landmarks - t, R, out=skeleton)
        skeleton /= s
        self.output["tips"][:] = skeleton[4::4]
        self.output["size"][0], self.output["off"][0] = s, off

    def _fit(self, landmarks: Array) -> tuple[Array, float, Array, float] | None:
        """Rotation (3, 3), scale, shift (3,) m, and rms m in the model's size; None: it is no palm."""
        seen = landmarks[list(PALM)]
        middle = seen.mean(axis=0)
        B = seen - middle
        U, D, Vt = np.linalg.svd(B.T @ self._A)
        sign = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
        R = (U * sign) @ Vt
        s = float((D * sign).sum()) / self._spread
        if not s > 1e-3:
            return None
        off = float(np.sqrt(((B @ R / s - self._A) ** 2).sum() / len(PALM)))
        if off > self._off:
            return None
        return R, s, middle - s * R @ self._middle, off
