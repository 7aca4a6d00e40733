"""Computes the fingertips of the human hand from landmarks that a camera sees."""

from __future__ import annotations

from typing import Final

import numpy as np
from pydantic import Field

from srl.control.hand.hand_kinematics import points_signal, tips_signal
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT
from srl.runtime.models.human_hand import POINTS
from srl.runtime.models.models import HandOption, named
from srl.runtime.models.point_series import PointSeries

SIZES: Final = (0.5, 2.0)  # of the seen hand by the model's
LONGER: Final = 1.6  # of a segment of a finger by the model's: more is no finger
BEHIND: Final = 0.05  # m, above the back of the hand, for the unscaled model: no three of four fingertips are there
TURNED: Final = 0.5  # cosine of 60 degrees, of a turn from one picture to the next
PALM: Final = (0, 5, 9, 13, 17)  # wrist and the roots of index to little finger: they hardly move in the palm
_TIP: Final = [1 + 4 * finger + k for finger in range(5) for k in (1, 2, 3)]  # ends of the fingers' segments
_ROOT: Final = [k - 1 for k in _TIP]


class HandLandmarksConfig(ControllerConfig):
    """Options of `hand-landmarks`."""

    frame: str = Field("hand", description="frame of the hand: its origin is at the wrist's centre")
    hand: HandOption = named("hand")  # the one that is seen
    off: float = Field(0.012, gt=0, le=0.1, description="m rms by which the palm may differ from the hand's")
    max_hold: float = Field(0.3, ge=0.0, le=5.0, description="s for which landmarks that are no hand are waited for")


class HandLandmarks(Controller):
    """Where the fingers are in the hand's own frame, whichever way the hand is turned in the picture.

    Input `landmarks` (21, 3) m in any right-handed axes. Outputs `tips` (5, 3) m and `skeleton` (21, 3) m in the hand's
    frame, `size` (1,): the seen hand's size divided by the model's, `off` (1,) m: rms of the palm after the fit.

    Rotation R, scale s and shift t of the model's palm a_i onto the seen one b_i, min sum |b_i - (s R a_i + t)|^2, are
    those of Umeyama (1991). A camera alone sees no size, so the fingers get that of `hand`: p = R^T (b - t) / s.
    Where the palm doesn't fit, a finger is too long, most fingertips are behind the hand (a mirrored picture), or the
    hand has turned by 60 degrees from one picture to the next, the outputs stay; after `max_hold` that is a loss.
    """

    Config = HandLandmarksConfig
    summary = "fingertips of a human hand from 21 landmarks that a camera sees"

    def __init__(self, name: str, config: HandLandmarksConfig) -> None:
        super().__init__(name, config)
        rest = PointSeries(*config.hand.geometry()).at(np.zeros(20))
        whole = np.vstack([np.zeros(3), rest])
        model = whole[list(PALM)]
        self._middle = model.mean(axis=0)
        self._A = model - self._middle  # (5, 3)
        self._spread = float((self._A**2).sum())
        self._off, self._max_hold = config.off, config.max_hold
        self._longest = LONGER * np.linalg.norm(whole[_TIP] - whole[_ROOT], axis=1)  # (15,) m, of the fingers' segments
        self._behind = BEHIND * config.hand.scale
        self._R: Array | None = None  # of the picture before
        self._unknown = 0.0  # s
        self.inputs = (Signal(name="landmarks", shape=(21, 3), unit="m", labels=POINTS, components=(POINT,)),)
        one = ("hand",)
        self.outputs = (
            tips_signal(config.frame), points_signal(config.frame),
            Signal(name="size", shape=(1,), unit="1", labels=one), Signal(name="off", shape=(1,), unit="m", labels=one),
        )  # fmt: skip

    def reset(self) -> None:
        self._unknown, self.lost, self._R = 0.0, False, None
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
        self._R, s, skeleton, off = found
        self.output["skeleton"][:] = skeleton
        self.output["tips"][:] = skeleton[4::4]
        self.output["size"][0], self.output["off"][0] = s, off

    def _fit(self, landmarks: Array) -> tuple[Array, float, Array, float] | None:
        """Rotation (3, 3), scale, points (21, 3) m in the hand's frame, and rms m of the palm; None: it is no hand."""
        seen = landmarks[list(PALM)]
        middle = seen.mean(axis=0)
        B = seen - middle
        U, D, Vt = np.linalg.svd(B.T @ self._A)
        sign = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
        R = (U * sign) @ Vt
        s = float((D * sign).sum()) / self._spread
        if not SIZES[0] < s < SIZES[1]:
            return None
        if self._R is not None and (np.trace(self._R.T @ R) - 1.0) / 2.0 < TURNED:
            return None
        off = float(np.sqrt(((B @ R / s - self._A) ** 2).sum() / len(PALM)))
        if off > self._off:
            return None
        skeleton = (landmarks - middle) @ R / s + self._middle
        if (np.linalg.norm(skeleton[_TIP] - skeleton[_ROOT], axis=1) > self._longest).any():
            return None
        if (skeleton[8::4, 2] > self._behind).sum() >= 3:
            return None
        return R, s, skeleton, off
