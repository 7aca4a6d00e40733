"""Computes the fingertips of the human hand from a data glove's joint angles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Final, Literal, cast

import numpy as np
from pydantic import Field

from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT
from srl.runtime.models.human_hand import BEYOND, FINGERS, JOINTS, POINTS, SENSORS
from srl.runtime.models.models import HandOption, named
from srl.runtime.models.point_series import PointSeries

_DIP: Final = 2.0 / 3.0  # DIP angle divided by PIP angle, for a glove that doesn't measure the DIP


class HandKinematicsConfig(ControllerConfig):
    """Options of `hand-kinematics`."""

    gone: ClassVar[Mapping[str, str]] = dict.fromkeys(
        ("side", "hand_length"), "write models: {hand: {kind: hand, side: right, length: 0.189}}"
    )

    sensors: Literal[22, 18] = Field(22, description="the CyberGlove's number of sensors")
    frame: str = Field("hand", description="frame of the hand: its origin is at the wrist's centre")
    hand: HandOption = named("hand")  # the one that wears the glove


class HandKinematics(Controller):
    """Forward kinematics of the 20-DoF hand.

    Input `angles` (22,) or (18,) rad in the glove's sensor order. Outputs `angles` (20,) rad of the model's
    joints, `tips` (5, 3) m and `skeleton` (21, 3) m, both in the hand's frame.

    Angles are clamped to the ranges of the hand's model. A glove that slips, or was calibrated on someone else, gives
    angles beyond anatomy; the clamp keeps every fingertip where a hand can reach. `metrics` says how often
    this happens.
    """

    Config = HandKinematicsConfig
    summary = "fingertips of a 20-DoF human hand from a CyberGlove's joint angles"

    def __init__(self, name: str, config: HandKinematicsConfig) -> None:
        super().__init__(name, config)
        self._points = PointSeries(*config.hand.geometry())
        self._M = glove_matrix(config.sensors)
        self._lower, self._upper = np.ascontiguousarray(config.hand.ranges.T)
        self._cycles = self._beyond = 0
        self.inputs = (Signal(name="angles", shape=(config.sensors,), unit="rad", labels=SENSORS[config.sensors]),)
        self.outputs = (
            Signal(name="angles", shape=(20,), unit="rad", labels=JOINTS),
            tips_signal(config.frame),
            points_signal(config.frame),
        )

    def reset(self) -> None:
        self._cycles = self._beyond = 0
        self._fill()

    def update(self, dt: float) -> None:
        self._fill()

    def _fill(self) -> None:
        q, skeleton = self.output["angles"], self.output["skeleton"]
        measured: Array = self._M.dot(self.input["angles"])
        np.minimum(np.maximum(measured, self._lower), self._upper, out=q)
        self._cycles += 1
        self._beyond += max(map(abs, (measured - q).tolist())) > BEYOND
        # The first row has no length, so it ends at the base. The wrist is the origin.
        skeleton[0] = 0.0
        skeleton[1:] = self._points.at(q)
        self.output["tips"][:] = skeleton[4::4]

    def metrics(self) -> dict[str, object]:
        """Returns beyond_range: the share of cycles with a joint angle more than 2 degrees outside its range."""
        return {"beyond_range": self._beyond / max(self._cycles, 1)}


def tips_signal(frame: str) -> Signal:
    """`tips` (5, 3), m."""
    return Signal(name="tips", shape=(5, 3), unit="m", frame=frame, labels=FINGERS, components=(POINT,))


def points_signal(frame: str) -> Signal:
    """`skeleton` (21, 3), m: the wrist, then each finger from its root to its tip."""
    links = tuple((0, *range(1 + 4 * i, 5 + 4 * i)) for i in range(5))
    return Signal(
        name="skeleton", shape=(21, 3), unit="m", frame=frame, labels=POINTS, components=(POINT,), visual="points",
        links=links,
    )  # fmt: skip


def glove_matrix(sensors: int) -> Array:
    """The matrix (20, sensors) from the glove's sensors to the model's joints.

    Abduction sensors measure the angle between neighbouring fingers, and the middle finger is the zero. So ring and
    little finger abduct by the (negative) sums. Palm arch and wrist are not among the 20 degrees of freedom.
    """
    M = np.zeros((20, sensors))
    full = sensors == 22
    M[0, 3] = M[1, 0] = M[2, 1] = M[3, 2] = 1.0  # abduction, roll, MPJ, IJ
    step = 3 if full else 2
    middle = 4 + step
    ring = middle + step + 1
    little = ring + step + 1
    for first, sensor in zip((4, 8, 12, 16), (4, middle, ring, little), strict=True):
        M[first + 1, sensor] = M[first + 2, sensor + 1] = 1.0
        M[first + 3, sensor + 2 if full else sensor + 1] = 1.0 if full else _DIP
    M[4, middle + step] = 1.0
    M[12, ring + step] = -1.0
    M[16, ring + step] = M[16, little + step] = -1.0
    return cast(Array, M)
