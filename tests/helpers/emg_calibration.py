"""EMG made of formulas: two muscles with hidden gains, and a person who contracts what a calibration says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy import signal

from helpers.acted_calibration import Acted
from srl.commissioning.calibration.emg.method import ChannelMap, EmgMethod
from srl.commissioning.calibration.request import CalibrationRequest
from srl.runtime.contracts.wearer import Contract
from srl.runtime.ipc.header import DEVICE, LINK_CONNECTED

NAMES = ("biceps", "triceps")
GAINS = {"biceps": 6e-4, "triceps": 1.5e-4}
"""V, RMS at the greatest contraction."""
PROFILE = """
name: worn
rate: 20
devices:
  emg: {driver: trigno, port: tcp://192.168.1.30, channels: {biceps: 3, triceps: 4}, block: 128}
controllers:
  - {use: emg-activation, calibration: p07.json, block: 128, in: {samples: emg.samples, count: emg.count}}
"""
QUICK = ("read=0.5", "rest=1", "hold=1", "pause=1", "repeats=2", "patience=2")
_CYCLE = 100  # samples


class Electrodes(Acted):
    """Rows of a Trigno.

    Attributes:
        gains: V, by muscle.
        hum: V, amplitude of 50 Hz, by muscle.
        limit: V, at which a muscle's samples are cut.
        dead: muscles whose channel gives one value.
        contracts: what the person contracts when told a muscle.
        crossed: pairs of muscles whose electrodes are exchanged.
        strengths: of the contractions of a muscle, one after another; then 1.
        tone: of a muscle at rest.
        hole: numbers of rows that never come.
        gone: rows in which the device isn't there.
        step: the last that was begun.
    """

    channel_map: ChannelMap
    period, look = 50_000_000, 4

    def __init__(
        self, option: Sequence[str] = QUICK, gains: Mapping[str, float] = GAINS, hum: Mapping[str, float] | None = None,
        limit: Mapping[str, float] | None = None, dead: Sequence[str] = (), contracts: Mapping[str, str] | None = None,
        crossed: bool = False, strengths: Mapping[str, Sequence[float]] | None = None,
        tone: Mapping[str, float] | None = None, hole: Sequence[int] = (), gone: Sequence[int] = (),
        person: str = "P07", settings: Sequence[str] = (), seed: int = 5,
    ) -> None:  # fmt: skip
        request = CalibrationRequest("worn.yaml", "emg", person, option=option)
        super().__init__(EmgMethod, request, PROFILE, "emg", settings)
        self.gains, self.hum, self.limit, self.dead = gains, hum or {}, limit or {}, dead
        self.contracts, self.crossed, self.tone = contracts or {}, crossed, tone or {}
        self.strengths = {name: list(each) for name, each in (strengths or {}).items()}
        self.hole, self.gone = set(hole), set(gone)
        self.reported = list[str]()
        self._random, self._count = np.random.default_rng(seed), 0
        self._sections = signal.butter(4, (20, 450), "bandpass", output="sos", fs=2000)
        self._state = np.zeros((len(self._sections), 2, 2))
        self._goal, self._active = np.zeros(2), np.zeros(2)

    def instruct(self, step: Any, instruction: Any) -> None:
        self._goal = np.array([self.tone.get(name, 0.002) for name in NAMES])
        if isinstance(instruction, Contract):
            name = self.contracts.get(instruction.muscle, instruction.muscle)
            self.reported.append(instruction.muscle)
            strength = self.strengths[instruction.muscle].pop(0) if self.strengths.get(instruction.muscle) else 1.0
            self._goal = np.maximum(self._goal, 0.1 * strength)
            self._goal[NAMES.index(name)] = strength

    def fill(self, row: Any) -> None:
        slots = row.views["emg.samples"]
        self._active += 0.4 * (self._goal - self._active)
        white, self._state = signal.sosfilt(self._sections, self._random.normal(size=(_CYCLE, 2)), 0, self._state)
        active = self._active[::-1] if self.crossed else self._active
        made = white / 0.656 * active * [self.gains[name] for name in NAMES]
        made += 2e-6 * self._random.normal(size=made.shape)
        when = (self._t * _CYCLE + np.arange(_CYCLE)) / 2000.0
        for i, name in enumerate(NAMES):
            made[:, i] += self.hum.get(name, 0.0) * np.sin(2.0 * np.pi * 50.0 * when)
            most = self.limit.get(name, 0.011)
            made[:, i] = 3e-6 if name in self.dead else np.clip(made[:, i], -most, most)
        self._count += _CYCLE
        if self._t not in self.hole:
            slots[:] = np.concatenate([slots[_CYCLE:], made])
            row.views["emg.count"][0] = self._count
        row.devices[0, DEVICE.link] = 0 if self._t in self.gone else LINK_CONNECTED
