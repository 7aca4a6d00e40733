"""A glove made of formulas, with hidden characteristics, on a hand that does what a calibration says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

import numpy as np

from helpers.acted_calibration import Acted
from srl.commissioning.calibration.glove.method import ChannelMap, GloveMethod
from srl.commissioning.calibration.request import CalibrationRequest
from srl.runtime.contracts.wearer import Shape
from srl.runtime.ipc.header import DEVICE, LINK_CONNECTED, LINK_STALE
from srl.runtime.models.human_hand import SENSORS

NAMES = SENSORS[22]
_SHIPPED = (files("srl.profiles") / "sixth-finger.yaml").read_text()
PROFILE = _SHIPPED.replace("sensors: 22}", "sensors: 22, calibration: p07.json}")
assert PROFILE != _SHIPPED
_random = np.random.default_rng(17)
OFFSET = _random.uniform(60.0, 190.0, 22)
"""(22,) counts of the flat hand."""
GAIN = np.where(OFFSET > 125.0, -1.0, 1.0) * _random.uniform(0.013, 0.02, 22)
GAIN *= [0.4 if name.endswith("abduction") else 1.0 for name in NAMES]
"""(22,) rad a count, of both signs, so that no joint comes to an end of the scale."""


class Gloved(Acted):
    """Rows of the glove. What else may happen is by shape, from 1 on.

    Attributes:
        off: rad by sensor, by which the hand isn't as told in these shapes.
        dead: counts at which these sensors stay.
        swapped: pairs of sensors whose cables are exchanged.
        lost, stale: shapes in which the glove is gone, or its last record stays.
        stays: shapes in which the hand stays as it was.
        settings: KEY=VALUE, of the profile.
        step: the last that was begun.
    """

    channel_map: ChannelMap
    period, look = 20_000_000, 10

    def __init__(
        self, option: Sequence[str] = (), off: Mapping[int, Mapping[str, float]] | None = None,
        dead: Mapping[str, float] | None = None, swapped: Sequence[tuple[str, str]] = (), lost: Sequence[int] = (),
        stale: Sequence[int] = (), stays: Sequence[int] = (), noise: Mapping[str, float] | None = None,
        gain: Mapping[str, float] | None = None, person: str = "P07", settings: Sequence[str] = (),
    ) -> None:  # fmt: skip
        request = CalibrationRequest("worn.yaml", "glove", person, option=option)
        super().__init__(GloveMethod, request, PROFILE, "glove", settings)
        self._own = [NAMES.index(name) for name in self.channel_map.options.sensors]
        self.off, self.dead, self.swapped = off or {}, dead or {}, swapped
        self.lost, self.stale, self.stays, self.noise = lost, stale, stays, noise or {}
        self.gain = np.array([(gain or {}).get(n, g) for n, g in zip(NAMES, GAIN, strict=True)])
        self.shaped = 0
        self._random, self._shape = np.random.default_rng(5), 0
        self._from = self._to = np.zeros(22)
        self._since = -9.0

    def instruct(self, step: Any, instruction: Any) -> None:
        self._shape = step.number
        if isinstance(instruction, Shape) and self._shape not in self.stays:
            self.shaped += 1
            self._from, self._since = self._to, self._t / 50.0
            off = self.off.get(self._shape, {})
            self._to = np.array([instruction.angles.get(name, 0.0) + off.get(name, 0.0) for name in NAMES])

    def fill(self, row: Any) -> None:
        share = min((self._t / 50.0 - self._since) / 0.5, 1.0)
        counts = OFFSET + (self._from + share * (self._to - self._from)) / self.gain
        counts += self._random.normal(size=22) * [self.noise.get(name, 0.6) for name in NAMES]
        for one, other in self.swapped:
            i, j = NAMES.index(one), NAMES.index(other)
            counts[[i, j]] = counts[[j, i]]
        for name, value in self.dead.items():
            counts[NAMES.index(name)] = value
        row.devices[0, DEVICE.link] = 0 if self._shape in self.lost else LINK_CONNECTED
        if self._shape in self.stale:
            row.devices[0, DEVICE.link] |= LINK_STALE
        if self._shape not in (*self.lost, *self.stale):
            row.views["glove.raw"][:] = np.clip(np.round(counts[self._own]), 1.0, 255.0)
