"""Options of a simulated wearer."""

from __future__ import annotations

from math import pi
from typing import Annotated, Final, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.wearer import Dof, Explore, Follow, Hold, Instruction, Rest
from srl.runtime.models.body import Side, Vector
from srl.runtime.models.models import BodyOption, named
from srl.sim.world.part import PartConfig

_APART: Final = 1e-6  # rad, least distance of a pointer's ends
_Angle = Annotated[float, Field(ge=-pi, le=pi)]


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    seconds: float = Field(gt=0, description="s until the next step")


class RestStep(_Entry):
    """Sit still."""

    do: Literal["rest"]

    def instruction(self) -> Instruction:
        """What it tells the wearer."""
        return Rest()


class ExploreStep(_Entry):
    """Move the hand through the workspace."""

    do: Literal["explore"]

    def instruction(self) -> Instruction:
        """What it tells the wearer."""
        return Explore(self.seconds)


class HoldStep(_Entry):
    """Hold the hand at a point, and swing a DoF."""

    do: Literal["hold"]
    point: Vector = Field(description="m, in the chest's frame")
    move: Dof | None = None

    def instruction(self) -> Instruction:
        """What it tells the wearer."""
        return Hold(self.point, self.move)


class FollowStep(_Entry):
    """Make the pointers follow curves."""

    do: Literal["follow"]
    times: tuple[float, ...] = Field(min_length=1, description="s, ascending")
    values: dict[Dof, tuple[float, ...]] = Field(min_length=1, description="0 to 1, one at each time, by DoF")
    point: Vector | None = Field(default=None, description="m, in the chest's frame; null: where the hand is")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if any(len(values) != len(self.times) for values in self.values.values()):
            raise ValueError("every DoF needs one value for each of 'times'")
        if any(b <= a for a, b in zip(self.times, self.times[1:], strict=False)):
            raise ValueError("'times' must ascend")
        return self

    def instruction(self) -> Instruction:
        """What it tells the wearer."""
        rows = tuple(zip(*self.values.values(), strict=True))
        return Follow(self.times, rows, tuple(self.values), self.point)


Step = Annotated[RestStep | ExploreStep | HoldStep | FollowStep, Field(discriminator="do")]


class Slip(BaseModel):
    """A marker that moves on the skin."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    by: Vector = Field(description="m, in its segment's frame")
    at: float = Field(default=0.0, ge=0, description="s of world time")


class Watched(BaseModel):
    """A joint of the cell that the wearer sees as the pointer of a DoF."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    joint: str = Field(description="PART/JOINT, such as finger/flexion_1")
    open: float = Field(description="rad, where the pointer is 0")
    closed: float = Field(description="rad, where it is 1")

    @model_validator(mode="after")
    def _apart(self) -> Self:
        if abs(self.closed - self.open) < _APART:
            raise ValueError("'open' and 'closed' are the same place: the pointer couldn't move")
        return self


class Tracking(BaseModel):
    """How the wearer makes a pointer follow a displayed curve."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    model: Literal["preview", "pursuit"] = Field(
        default="preview", description="sees the curve ahead; or reacts to the pointer's error alone"
    )
    lag: float = Field(
        default=0.125, ge=0.04, le=0.5, description="s that remain with preview; the muscles' own are 0.04"
    )
    crossover: float = Field(default=3.8, gt=0, le=6, description="rad/s, of pursuit")
    delay: float = Field(default=0.20, ge=0.06, le=0.45, description="s, from what is seen to the motion")
    correction: float = Field(default=1.0, ge=0, le=3, description="1/s, of seen errors that preview leaves")
    gain_error: float = Field(default=0.1, ge=0, le=0.5, description="sd of the first belief of the pointer's gain")
    learning: float = Field(default=5.0, gt=0.5, description="s, over which the belief is formed")


class UpperBodyConfig(PartConfig):
    """Options. The part stands with its chest (the jugular notch), x forward, z up.

    The source of each number is in docs/simulated-person.md.
    """

    model: BodyOption = named("body")
    side: Side = Field(default="right", description="the arm that moves; another one rests")
    subject: str | None = Field(default=None, description="its name in the capture system; null: the part's name")
    plan: tuple[Step, ...] = Field(default=(), description="what the wearer does, one step after another")
    again: bool = Field(default=False, description="begin the plan anew after its end")
    watches: dict[Dof, Watched] = Field(
        default_factory=dict, description="what it sees move with its DoFs; left out: what it is shown, or nothing"
    )
    tracking: Tracking = Tracking()
    elbow: float = Field(default=0.6, ge=0, le=1.5, description="rad, swivel angle of a resting arm")
    swing: tuple[_Angle, _Angle] = Field(
        default=(0.0, 1.7), description="rad, least and greatest swivel angle: the trunk, and the shoulder's height"
    )
    effort: float = Field(default=0.9, gt=0.2, le=1, description="share of a DoF's range that is used")
    speed: float = Field(default=0.5, gt=0, le=2, description="m/s, mean of a reach")
    pace: float = Field(default=0.6, gt=0, le=3, description="rad/s, mean of a swing through a DoF's range")
    reaction: float = Field(default=0.25, ge=0, le=1, description="s, from an instruction to its motion")
    wander: float = Field(default=0.0015, ge=0, le=0.03, description="m rms per axis, of a hand that is held")
    wander_turn: float = Field(default=0.015, ge=0, le=0.3, description="rad rms per axis, the same")
    direction_error: float = Field(
        default=0.087,
        ge=0,
        le=0.7,
        description="rad, of the joints' motion from the one that leaves the hand still",
    )
    noise: float = Field(default=0.15, ge=0, le=0.6, description="rms of each joint's speed error, share of its speed")
    carried: float = Field(
        default=1.0, ge=0, le=1, description="share of both that acts on motion that carries the hand elsewhere"
    )
    feedback: float = Field(default=3.0, ge=0, le=4, description="1/s, of the hand's error as it is felt; 0: none")
    feel: float = Field(default=0.12, ge=0.02, le=0.35, description="s, delay of what is felt")
    sway: float = Field(default=0.0, ge=0, le=0.3, description="rad rms of the torso's yaw, lean and side; 0: held")
    slip: dict[str, Slip] = Field(default_factory=dict, description="markers that slip on the skin")
    contact: bool = Field(default=False, description="forearm and hand can be touched")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        body = self.model.body
        if self.side not in body.sides:
            raise ValueError(f"the body has no {self.side} arm; it has {', '.join(body.sides)}")
        for marker in self.slip:
            if marker not in body.markers:
                raise ValueError(f"slip.{marker}: the body has no such marker; it has {', '.join(body.markers)}")
        if not self.swing[0] < self.elbow < self.swing[1]:
            raise ValueError("'elbow' must be within 'swing'")
        return self
