"""The law `emg-activation`: how much of its greatest voluntary contraction each muscle gives now.

Band-pass, rectify, low-pass, as in `processing`; a person's file says what is rest and what is the greatest
contraction. See docs/calibrate-emg.md.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from srl.control.emg import record
from srl.control.emg.blocks import GONE, Stream
from srl.control.emg.processing import normalise
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.files import FileOption, KeptFile
from srl.runtime.contracts.signals import Signal

_MARGIN = 0.1  # s, that the first samples may take beside the filters


class EmgActivationConfig(ControllerConfig):
    """Options of `emg-activation`."""

    calibration: Annotated[KeptFile, FileOption("Make it with `srl calibrate PROFILE emg`, or name another")] = Field(
        description="the person's file, beside the profile"
    )
    block: int = Field(64, gt=GONE, le=512, description="as the device has it: samples in a row")
    hold: float = Field(
        0.5, ge=0.25, le=2, description="s for which the last activation stands while samples are missing, or more"
    )


class EmgActivation(Controller):
    """Normalises surface EMG, causally.

    Inputs: `samples` (block, n) V, the newest samples of n muscles, oldest first, and `count` (1,), how many there
    have been: the device's, with its option `block`.
    Output: `activation` (n,), 0 at rest (and below) to 1 at the greatest voluntary contraction (and above).

    It lags by the low-pass (45 ms with a cut-off of 5 Hz), beside what the device needs. It begins at 0, for as long as
    the filters need to settle. Where samples are missing (more came than a block holds, the device began anew, a
    sensor's are exact zeros), the last activation stands until the filters have settled again; after `hold` the limb
    stops (`intent_loss`): an arm that gives way because a battery is empty would be worse.
    """

    Config = EmgActivationConfig
    summary = "each muscle's activation, 0 at rest to 1 at its greatest voluntary contraction"

    def __init__(self, name: str, config: EmgActivationConfig) -> None:
        super().__init__(name, config)
        made = self._record = record.parse(config.calibration.content, str(config.calibration.path))
        muscles = tuple(made.muscles)
        n = len(muscles)
        self.inputs = (
            Signal(name="samples", shape=(config.block, n), unit="V", slots=True, components=(muscles,)),
            Signal(name="count", shape=(1,), unit="1"),
        )
        self.outputs = (Signal(name="activation", shape=(n,), unit="1", labels=muscles),)
        self.simulated = "calibration" if made.simulated else ""
        self.fed_as = {"samples": {"rate": made.rate} | ({"channels": made.channels} if made.channels else {})}
        self._rest = np.array([each.rest for each in made.muscles.values()])
        self._span = np.array([each.mvc for each in made.muscles.values()]) - self._rest
        self._stream = Stream(n, made.filters())
        self._hold = max(config.hold, self._stream.settles + _MARGIN)  # else it could never begin
        self._clear()

    def _clear(self) -> None:
        self._stream.forget()
        self._away, self._gaps, self._above, self._cycles = 0.0, 0, np.zeros(len(self._rest)), 0

    def reset(self) -> None:
        """Begins anew at 0: what the filters held is of before."""
        self._clear()
        self.lost = False
        self._stream.take(self.input["samples"], float(self.input["count"][0]))
        self.output["activation"][:] = 0.0

    def update(self, dt: float) -> None:
        was = self._stream.settled
        found = self._stream.take(self.input["samples"], float(self.input["count"][0]))
        self._away += dt
        if found is None:
            self._gaps += was
        elif self._stream.fresh and self._stream.settled:
            self._away = 0.0
            share = normalise(np.maximum(found[-1:] - self._rest, 0.0), self._span)[0]
            self._above += share > 1.0
            self._cycles += 1
            np.minimum(share, 1.0, out=self.output["activation"])
        self.lost = self._away > self._hold

    def metrics(self) -> dict[str, object]:
        """Returns the figures since the last reset.

        person, date: of the file; gaps: how often samples were missing; above: by muscle, the share of the cycles above
        its greatest contraction: more than a little means that the calibration's was weak.
        """
        above = self._above / max(self._cycles, 1)
        return {
            "person": self._record.person,
            "date": self._record.date.isoformat(),
            "gaps": self._gaps,
            "above": dict(zip(self._record.muscles, above.round(4).tolist(), strict=True)),
        }
