"""A glove made of formulas, with hidden characteristics, on a hand that does what a calibration says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from srl.commissioning.calibration.glove.method import ChannelMap, GloveMethod
from srl.commissioning.calibration.held_still import Step
from srl.commissioning.calibration.profile_subset import build
from srl.commissioning.calibration.request import CalibrationRequest
from srl.commissioning.calibration.sources import Rows, RowSource
from srl.runtime.contracts.wearer import Shape
from srl.runtime.ipc.header import CYCLE, DEVICE, LINK_CONNECTED, LINK_STALE, State
from srl.runtime.models.human_hand import SENSORS
from srl.runtime.profile import profile

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


class Gloved(RowSource):
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

    def __init__(
        self, option: Sequence[str] = (), off: Mapping[int, Mapping[str, float]] | None = None,
        dead: Mapping[str, float] | None = None, swapped: Sequence[tuple[str, str]] = (), lost: Sequence[int] = (),
        stale: Sequence[int] = (), stays: Sequence[int] = (), noise: Mapping[str, float] | None = None,
        gain: Mapping[str, float] | None = None, person: str = "P07", settings: Sequence[str] = (),
    ) -> None:  # fmt: skip
        checked, source = profile.parse("worn.yaml", PROFILE, settings)
        order = CalibrationRequest("worn.yaml", "glove", option=option)
        method = GloveMethod(order, checked, source, Path("p07.json"), lambda _: None)
        self.graph = build(*method.subset(person), sim=False)
        self.graph.layout.meta["wall"] = 1_700_000_000_000_000_000
        self.graph.layout.meta["simulated"] = ["glove"]
        self.channel_map = method.channel_map(self.graph.layout, "worn.yaml")
        self._own = [NAMES.index(name) for name in self.channel_map.options.sensors]
        self.off, self.dead, self.swapped = off or {}, dead or {}, swapped
        self.lost, self.stale, self.stays, self.noise = lost, stale, stays, noise or {}
        self.gain = np.array([(gain or {}).get(n, g) for n, g in zip(NAMES, GAIN, strict=True)])
        self.rows, self.closed, self.shaped = list[Rows](), False, 0
        self._random, self._t, self._shape = np.random.default_rng(5), 0, 0
        self._from = self._to = np.zeros(22)
        self._since = -9.0
        self.step: Step | None = None

    def take(self) -> Rows:
        made = np.array([self._next() for _ in range(10)])
        self.rows.append(made)
        return made

    def begin(self, procedure: Any) -> None:
        self.graph.row.views[self.channel_map.parameter][()] = procedure.step.mark
        self.step, self._shape = procedure.step, procedure.step.number
        reported = procedure.instruction()
        if isinstance(reported, Shape) and self._shape not in self.stays:
            self.shaped += 1
            self._from, self._since = self._to, self._t / 50.0
            off = self.off.get(self._shape, {})
            self._to = np.array([reported.angles.get(name, 0.0) + off.get(name, 0.0) for name in NAMES])

    def close(self) -> None:
        self.closed = True

    def _next(self) -> Any:
        self._t += 1
        share = min((self._t / 50.0 - self._since) / 0.5, 1.0)
        counts = OFFSET + (self._from + share * (self._to - self._from)) / self.gain
        counts += self._random.normal(size=22) * [self.noise.get(name, 0.6) for name in NAMES]
        for one, other in self.swapped:
            i, j = NAMES.index(one), NAMES.index(other)
            counts[[i, j]] = counts[[j, i]]
        for name, value in self.dead.items():
            counts[NAMES.index(name)] = value
        row = self.graph.row
        row.devices[0, DEVICE.link] = 0 if self._shape in self.lost else LINK_CONNECTED
        if self._shape in self.stale:
            row.devices[0, DEVICE.link] |= LINK_STALE
        if self._shape not in (*self.lost, *self.stale):
            row.views["glove.raw"][:] = np.clip(np.round(counts[self._own]), 1.0, 255.0)
        row.ints[CYCLE.cycle], row.ints[CYCLE.now], row.ints[CYCLE.state] = self._t, self._t * 20_000_000, State.ACTIVE
        return row.words.copy()
