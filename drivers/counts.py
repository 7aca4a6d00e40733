"""The scale of a force/torque sensor in the profile."""

from __future__ import annotations

from pydantic import ConfigDict, Field

from srl.runtime.contracts.entry import BaseModel


class CountsConfig(BaseModel):
    """Counts per unit, if they aren't to be read from the sensor."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    force: float = Field(gt=0, allow_inf_nan=False, description="counts per N")
    torque: float = Field(gt=0, allow_inf_nan=False, description="counts per N m")
