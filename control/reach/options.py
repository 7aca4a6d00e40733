"""Options of the law `reach`."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from srl.control.skeleton.ranges import RangeOptions
from srl.runtime.contracts.controller import ControllerConfig
from srl.runtime.contracts.errors import OptionError


class MarginOptions(RangeOptions):
    """What is kept from the body; the figures of the arm's `clear:`, so that the arm goes where the guard lets it."""

    least: float = Field(0.02, ge=0.005, lt=1, description="m, always kept; as the clearance's, or more")
    uncertainty: float = Field(0.02, ge=0, lt=1, description="m, of body and arm together")
    noise: float = Field(0.0, ge=0, lt=1, description="m, by which errors may change within `span`; as the clearance's")
    horizon: float = Field(
        0.1, gt=0, le=1, description="s in which an arm that hardly moves stands still: latency, lag and two periods"
    )
    body_acceleration: float = Field(1.0, ge=0.5, le=10, description="factor on the segments' a_e, as the clearance's")
    span: float = Field(0.05, ge=0.01, lt=0.5, description="s, over which a segment's velocity is a mean")


class ReachConfig(MarginOptions, ControllerConfig):
    """Options of `reach`."""

    target: Literal["joints", "point"] = Field(
        "joints", description="a goal of the joints, or a place of the arm's end"
    )
    other: bool = Field(
        False, description="input `other`: the joints of the wearer's other arm, which is kept clear of"
    )
    give_way: float | None = Field(
        None, gt=0, le=60, description="s of not coming nearer before it goes back for the other arm; null: never"
    )
    progress_timeout: float = Field(0.3, gt=0, le=10, description="s without coming nearer before it looks for a way")
    leave_timeout: float = Field(0.6, gt=0, le=10, description="s of the same before it leaves what is too near")
    iterations: int = Field(1, ge=1, le=20, description="turns of the search for a way in a cycle")
    max_iterations: int = Field(400, ge=10, le=10_000, description="turns after which a search is given up")

    @model_validator(mode="after")
    def _two(self) -> Self:
        if self.other and len(self.arms.arms.sides) < 2:
            raise OptionError("`other` is set, and the model has one arm", "Leave it out, or give the model `sides`")
        return self
