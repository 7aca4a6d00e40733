"""Converts a frame's centimetres and degrees to the states."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, sin

import numpy as np

from srl.drivers.noitom.config import NoitomConfig
from srl.drivers.noitom.heading import load
from srl.drivers.noitom.protocol import Frame
from srl.drivers.noitom.skeleton import JOINTS, Skeleton
from srl.runtime.contracts.rotation import EulerQuaternions, product, turned
from srl.runtime.contracts.signals import Array


class Pose:
    """Fills `rotation` and `translation`. If a frame has no displacements, it uses the default body's bones, scaled.

    With a calibration, the hips are turned back about the vertical through the origin by its heading, so that z is
    where the person faced in the calibration.

    Attributes:
        calibration: what its file holds; None: none is named.
    """

    def __init__(self, config: NoitomConfig, skeleton: Skeleton) -> None:
        self._offsets = skeleton.offsets * config.scale
        self.calibration = None if config.calibration is None else load(config.calibration)
        half = 0.0 if self.calibration is None else -0.5 * self.calibration.heading
        self._back = (cos(half), 0.0, sin(half), 0.0)
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
        if self.calibration is not None:
            w, x, y, z = states["rotation"][0].tolist()
            states["rotation"][0] = product(self._back, (w, x, y, z))
            x, y, z = place[0].tolist()
            place[0] = turned(self._back, (x, y, z))
