"""Converts a frame's centimetres and degrees to the states."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from drivers.noitom.config import NoitomConfig
from drivers.noitom.protocol import Frame
from drivers.noitom.skeleton import JOINTS, Skeleton
from runtime.contracts.rotation import EulerQuaternions
from runtime.contracts.signals import Array


class Pose:
    """Fills `rotation` and `translation`. If a frame has no displacements, it uses the default body's bones, scaled."""

    def __init__(self, config: NoitomConfig, skeleton: Skeleton) -> None:
        self._offsets = skeleton.offsets * config.scale
        self._quaternions = EulerQuaternions(config.order, JOINTS, np.pi / 180)

    def fill(self, frame: Frame, states: Mapping[str, Array]) -> None:
        """Fills the states from a frame.

        Args:
            frame: the frame as received.
            states: `rotation` (59, 4), w x y z, and `translation` (59, 3), m.
        """
        translations, degrees = frame.split()
        self._quaternions.fill(degrees, states["rotation"])
        place = states["translation"]
        if not frame.displacement:
            place[1:] = self._offsets[1:]
        np.multiply(translations, 0.01, out=place[: len(translations)])
