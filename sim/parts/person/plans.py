"""A simulated person's plans: steps from the profile, and plans for the four SUPER-MAN experiments."""

from __future__ import annotations

from math import sqrt
from typing import Annotated, Literal, Self

from pydantic import ConfigDict, Field, field_validator, model_validator

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.files import ProfilePath

_Vector = tuple[float, float, float]
_Quaternion = tuple[float, float, float, float]


class _Step(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class GoTo(_Step):
    """Moves the tool to a pose, by sight, and stays there for `dwell`. Needs one of position, target, by."""

    do: Literal["go_to"]
    position: _Vector | None = Field(default=None, description="m, of the tool in the world")
    target: str | None = Field(default=None, description="a site or body of the cell, PART/NAME")
    by: _Vector | None = Field(default=None, description="m, from where the tool was last meant to be, world axes")
    offset: _Vector = Field(default=(0.0, 0.0, 0.0), description="m, added to the target, in the target's own axes")
    quaternion: _Quaternion | None = Field(
        default=None, description="w, x, y, z of the tool in the world; null: as it is"
    )
    align: bool = Field(default=False, description="take the target's orientation")
    tolerance: float = Field(default=0.005, gt=0, description="m, of what is seen")
    angle: float = Field(default=0.1, gt=0, description="rad, tolerance of the orientation")
    dwell: float = Field(default=0.2, ge=0, description="s, without a break within the tolerances")
    speed: float | None = Field(default=None, gt=0, description="m/s, greatest; null: the person's own")
    patience: float = Field(default=20.0, gt=0, description="s after the motion; then it counts as missed")

    @model_validator(mode="after")
    def _one(self) -> Self:
        if sum(v is not None for v in (self.position, self.target, self.by)) != 1:
            raise ValueError("give one of 'position', 'target' and 'by'")
        if self.align and self.target is None:
            raise ValueError("'align' needs a 'target'")
        return self


class Hold(_Step):
    """Keeps the tool at its last intended pose, by sight."""

    do: Literal["hold"]
    seconds: float = Field(gt=0, description="s")


class Wait(_Step):
    """Rests: the hand follows the handle and has no intention."""

    do: Literal["wait"]
    seconds: float = Field(gt=0, description="s")


class _Pushing(_Step):
    direction: _Vector = Field(description="world axes; any length")
    depth: float = Field(gt=0, description="m, from where the tool is at the beginning")
    force: float = Field(gt=0, description="N along the direction, the most that the hand exerts")
    speed: float = Field(default=0.02, gt=0, description="m/s")
    patience: float = Field(default=20.0, gt=0, description="s beyond depth / speed; then it counts as missed")

    @field_validator("direction")
    @classmethod
    def _unit(cls, direction: _Vector) -> _Vector:
        size = sqrt(sum(v * v for v in direction))
        if size < 1e-9:
            raise ValueError("a direction has a length")
        return (direction[0] / size, direction[1] / size, direction[2] / size)


class Insert(_Pushing):
    """Pushes the tool in along a direction: sight corrects across the direction, force limits the push along it."""

    do: Literal["insert"]


class Withdraw(_Pushing):
    """Pulls the tool out; like `insert`, with the direction pointing out."""

    do: Literal["withdraw"]


class Follow(_Step):
    """Moves the tool along a curve. Needs one of along, points, file, circle."""

    do: Literal["follow"]
    along: str | None = Field(default=None, description="sites PREFIX0, PREFIX1, ... of the cell, such as wire/path_")
    points: tuple[_Vector, ...] | None = Field(default=None, description="m, world; two at least")
    file: ProfilePath | None = Field(default=None, description="CSV with columns x, y, z, m, world")
    circle: float | None = Field(default=None, gt=0, description="m, radius, in the world's x-y plane, from here")
    speed: float = Field(default=0.05, gt=0, description="m/s")
    width: float | None = Field(
        default=None, gt=0, description="m, play of the tool across the curve: the steering law sets speed and caution"
    )
    turning: bool = Field(default=False, description="turn the tool with the curve's tangent")
    pauses: tuple[Annotated[float, Field(gt=0, lt=1)], ...] = Field(
        default=(), description="shares of the curve's length at which to stop, on both ways"
    )
    pause: float = Field(default=10.0, ge=0, description="s of a stop")
    back: bool = Field(default=False, description="there and back again")
    caution: float = Field(default=0.02, gt=0, description="m, seen error at which the motion along the curve stops")
    patience: float = Field(default=20.0, gt=0, description="s of standing still for that; then it counts as missed")

    @model_validator(mode="after")
    def _one(self) -> Self:
        if sum(v is not None for v in (self.along, self.points, self.file, self.circle)) != 1:
            raise ValueError("give one of 'along', 'points', 'file' and 'circle'")
        if self.points is not None and len(self.points) < 2:
            raise ValueError("a curve needs two points at least")
        if any(a >= b for a, b in zip(self.pauses, self.pauses[1:], strict=False)):
            raise ValueError("pauses must rise")
        return self


class Press(_Step):
    """Presses a button of the panel while the hand keeps its position."""

    do: Literal["press"]
    button: str = Field(description="its name on the board")
    seconds: float = Field(default=0.2, gt=0, description="s")


Step = Annotated[GoTo | Hold | Wait | Insert | Withdraw | Follow | Press, Field(discriminator="do")]
Plan = tuple[Step, ...]


# -- the four experiments; positions are those of the fixtures' sites (sim/parts)


def wire_path(
    wire: str = "wire",
    speed: float = 0.03,
    pauses: tuple[float, ...] = (0.25, 0.5, 0.75),
    turning: bool = True,
    width: float | None = None,
    pause: float = 10.0,
) -> Plan:
    """Prolonged manipulation: along the wire and back, 10 s at each marked point, three each way (ours; Fig. 5a).

    Args:
        turning: the ring turns with the wire; the robot must allow this.
        width: m, the ring's play about the wire: the steering law sets the speed in place of `speed`.
        pause: s at each point.
    """
    mode = (Press(do="press", button="mode"),) if turning else ()
    return (
        Press(do="press", button="admittance"),
        *mode,
        GoTo(do="go_to", target=f"{wire}/path_0", tolerance=0.005),
        Follow(
            do="follow", along=f"{wire}/path_", speed=speed, width=width, turning=turning, pauses=pauses, pause=pause,
            back=True,
        ),
        *mode,
        Press(do="press", button="admittance"),
    )  # fmt: skip


def drilling(plate: str = "plate", holes: int = 20, depth: float = 0.04, below: float = 0.05) -> Plan:
    """Overhead drilling: 5 s in each hole, the tip `depth` m above the plate's lower face."""
    steps: list[Step] = [Press(do="press", button="admittance")]
    for k in range(holes):
        at = f"{plate}/hole_{k}"
        steps += [
            GoTo(do="go_to", target=at, offset=(0.0, 0.0, -below), tolerance=0.01),
            GoTo(do="go_to", target=at, offset=(0.0, 0.0, depth), tolerance=0.015),
            Hold(do="hold", seconds=5.0),
            GoTo(do="go_to", target=at, offset=(0.0, 0.0, -below), tolerance=0.02, dwell=0.0),
        ]
    return (*steps, Press(do="press", button="admittance"))


def peg_in_hole(hole: str = "hole", depth: float = 0.03, force: float = 15.0, above: float = 0.02) -> Plan:
    """Peg in hole: move above the mouth, insert, rest for one second, withdraw."""
    down, up = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)
    return (
        Press(do="press", button="admittance"),
        GoTo(do="go_to", target=f"{hole}/mouth", offset=(0.0, 0.0, above), tolerance=0.003, dwell=0.5),
        Insert(do="insert", direction=down, depth=above + depth, force=force),
        Hold(do="hold", seconds=1.0),
        Withdraw(do="withdraw", direction=up, depth=above + depth, force=2 * force),
        Press(do="press", button="admittance"),
    )


def carrying(load: str, way: tuple[_Vector, ...], speed: float = 0.3, above: float = 0.15) -> Plan:
    """Load carrying: to the grasp point, close, lift, switch to locomotion, along the way, put down, open.

    Args:
        load: the part with the site `grasp`.
        way: m, positions of the tool in the world; the last one is above the place of delivery, at the lifted height.
    """
    lift, down = (0.0, 0.0, above), (0.0, 0.0, -above)
    return (
        Press(do="press", button="admittance"),
        GoTo(do="go_to", target=f"{load}/grasp", offset=lift, tolerance=0.01),
        GoTo(do="go_to", target=f"{load}/grasp", tolerance=0.01, dwell=0.5),
        Press(do="press", button="gripper"),
        Wait(do="wait", seconds=2.0),
        GoTo(do="go_to", by=lift, tolerance=0.02),
        Press(do="press", button="priority"),
        *(GoTo(do="go_to", position=p, tolerance=0.05, dwell=0.0, speed=speed) for p in way),
        Press(do="press", button="priority"),
        GoTo(do="go_to", by=down, tolerance=0.02, dwell=0.5),
        Press(do="press", button="gripper"),
        Wait(do="wait", seconds=2.0),
        GoTo(do="go_to", by=lift, tolerance=0.02),
        Press(do="press", button="admittance"),
    )
