"""A cue: a few equal pulses that tell the wearer something."""

from __future__ import annotations

from pydantic import ConfigDict, Field

from srl.runtime.contracts.entry import BaseModel


class Cue(BaseModel):
    """Pulses of an intensity. A pulse that is shorter than 30 ms isn't felt as a vibration (Remache-Vinueza, Scientific
    Reports 15:5057, 2025)."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    pulses: int = Field(2, ge=1, le=5)
    on: float = Field(0.15, ge=0.03, le=0.5, description="s, of each pulse")
    off: float = Field(0.25, ge=0.03, le=0.5, description="s between two; a motor that turns needs 0.2 to be still")
    level: float = Field(0.8, gt=0, le=1, description="as the guard's limits let it be")

    @property
    def length(self) -> float:
        """s, from the first pulse's begin to the last one's end."""
        return self.pulses * (self.on + self.off) - self.off

    def at(self, time: float) -> float:
        """The intensity, `time` s after its begin."""
        return self.level if 0.0 <= time < self.length and time % (self.on + self.off) < self.on else 0.0
