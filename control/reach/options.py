"""Options of the law `reach`."""

from __future__ import annotations

from pydantic import Field

from srl.control.skeleton.ranges import RangeOptions
from srl.runtime.contracts.controller import ControllerConfig


class MarginOptions(RangeOptions):
    """What is kept from the body; the figures of the arm's `clear:`, so that the arm goes where the guard lets it."""

    least: float = Field(0.02, ge=0.005, lt=1, description="m, always kept; as the clearance's, or more")
    uncertainty: float = Field(0.02, ge=0, lt=1, description="m, of body and arm together")
    horizon: float = Field(
        0.1, gt=0, le=1, description="s in which an arm that hardly moves stands still: latency, lag and two periods"
    )
    body_acceleration: float = Field(1.0, ge=0.5, le=10, description="factor on the segments' a_e, as the clearance's")
    span: float = Field(0.05, ge=0.01, lt=0.5, description="s, over which a segment's velocity is a mean")


class ReachConfig(MarginOptions, ControllerConfig):
    """Options of `reach`."""

    progress_timeout: float = Field(0.3, gt=0, le=10, description="s without coming nearer before it looks for a way")
    leave_timeout: float = Field(0.6, gt=0, le=10, description="s of the same before it leaves what is too near")
    iterations: int = Field(1, ge=1, le=20, description="turns of the search for a way in a cycle")
    max_iterations: int = Field(400, ge=10, le=10_000, description="turns after which a search is given up")
