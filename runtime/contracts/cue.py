"""A cue: a few equal pulses that tell the wearer something."""

from __future__ import annotations

from typing import Final

from pydantic import ConfigDict, Field

from srl.runtime.contracts.entry import BaseModel

FELT: Final = 0.3  # of full intensity: the least that a cue may have


class Cue(BaseModel):
    """Pulses of an intensity, each of which is felt for itself.

    A vibration must last 30 ms to be felt as one (Remache-Vinueza, Scientific Reports 15:5057, 2025), and a mass that
    turns needs 0.18 s for 95 % of its vibration (Precision Microdrives, step response of the 305-000).
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    pulses: int = Field(2, ge=1, le=5)
    on: float = Field(0.15, ge=0.1, le=0.5, description="s, of each pulse")
    off: float = Field(0.25, ge=0.15, le=0.5, description="s between two")
    level: float = Field(0.8, ge=FELT, le=1, description="as the guard's limits let it be")

    def too_short(self, dt: float) -> str:
        """What is wrong with it in cycles of `dt` s; "" for nothing."""
        least = min(self.on, self.off) if self.pulses > 1 else self.on
        return f"a pulse or pause of {least:g} s is less than two cycles of {dt:g} s" if least < 2 * dt else ""

    @property
    def length(self) -> float:
        """s, from the first pulse's begin to the last one's end."""
        return self.pulses * (self.on + self.off) - self.off

    def at(self, time: float) -> float:
        """The intensity, `time` s after its begin."""
        return self.level if 0.0 <= time < self.length and time % (self.on + self.off) < self.on else 0.0
