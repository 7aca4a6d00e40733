"""What a calibration of the null-space control keeps, and what it refuses."""

from __future__ import annotations

from typing import Final, Literal

from pydantic import Field

from srl.runtime.contracts.options import Options

LEAST_CONDITION: Final = 0.05  # below that, noise of one DoF is twenty times as large in c


class Thresholds(Options):
    """What a calibration keeps, and what it refuses. A file brings its own: no file goes beyond their bounds."""

    points: int = Field(10, ge=8, le=26, description="calibration points: corners of a box, centres of its faces, ...")
    up: Literal[0, 1, 2] = Field(2, description="axis of the hand's frame that points upwards")
    speed: float = Field(0.05, gt=0.0, le=0.2, description="m/s; samples in which the hand is faster are discarded")
    radius: float = Field(
        0.05, gt=0.0, le=0.15, description="m; samples farther from their point's centroid are discarded"
    )
    components: Literal["first", "sum"] = Field(
        "first", description="first principal component, or the paper's weighted sum of those that explain `share`"
    )
    share: float = Field(0.8, gt=0.0, le=1.0, description="of the variance, for `components: sum`")
    samples: int = Field(100, ge=10, description="least number of samples kept a point and DoF")
    range: float = Field(0.15, ge=0.05, description="rad, least range of motion along the direction, a point and DoF")
    explained: float = Field(0.7, ge=0.3, le=1.0, description="least share of the variance that the direction explains")
    explained_of_sum: float = Field(
        0.5, ge=0.3, le=1.0, description="the same for `components: sum`, which is for motion in several directions"
    )
    wander: float = Field(0.02, gt=0.0, le=0.05, description="m, largest rms distance of the hand from its point")
    condition: float = Field(
        0.25, ge=LEAST_CONDITION, le=1.0, description="least sine of a DoF's direction to all the others'"
    )
    crosstalk: float = Field(
        0.5, gt=0.0, le=1.0, description="of its range, the most that a DoF may move in the trials of another"
    )

    @property
    def least_explained(self) -> float:
        """Of the variance, the share that the direction must explain."""
        return self.explained if self.components == "first" else self.explained_of_sum
