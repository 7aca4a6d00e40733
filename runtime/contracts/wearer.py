"""What a simulated wearer can be told to do: by a calibration, a study, or the part's own plan.

Pure data. Whoever instructs gives one at a time to `Wearer.instruct`, and asks `Wearer.done` whether it is reached.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Final, Literal, Protocol, get_args

from srl.runtime.contracts.rotation import Quaternion, Vector

Dof = Literal["swivel", "shrug", "protraction"]
"""Motions that leave the hand still: the elbow about the line from shoulder to wrist, the clavicle up, forward."""


@dataclass(frozen=True)
class Rest:
    """Sit still with the forearm in front of the body, or stand at ease. Done when the body is there."""


@dataclass(frozen=True)
class Explore:
    """Move the hand through the whole workspace, the torso still. Done after `seconds`; it goes on until told else."""

    seconds: float = 60.0


@dataclass(frozen=True)
class Hold:
    """Take the hand to a point and hold it there, still in position and orientation. Done when it is there.

    Attributes:
        point: m, of the palm's middle, in the chest's frame.
        move: the DoF to swing through its whole range there and back, again and again, while the hand is held.
        turn: the hand's orientation, w x y z, in the chest's frame; None: straight with the forearm, elbow at rest.
        swivel: where the elbow is held, as a share of its range there: 0 at the trunk, 1 outwards; None: at rest. While
            the share changes and the rest stays, the arm moves in its null space alone.
    """

    point: Vector
    move: Dof | None = None
    turn: Quaternion | None = None
    swivel: float | None = None


@dataclass(frozen=True)
class Follow:
    """Hold the hand where it is (or at `point`), and make the pointers follow displayed curves. Done after the last.

    Attributes:
        times: (T,) s since the instruction, ascending.
        values: (T, k) what the pointers should be, 0 to 1; linear between, constant outside.
        dofs: (k,) the DoF that drives each pointer.
        point: m, as in `Hold`; None: where the hand is.
    """

    times: Sequence[float]
    values: Sequence[Sequence[float]]
    dofs: tuple[Dof, ...] = ("swivel",)
    point: Vector | None = None


Action = Literal[
    "overhead", "forward", "reach-left", "reach-right", "carry", "bend", "squat", "turn-left", "turn-right", "wave"
]
"""What the whole body can do; the ten are ours, and docs/intention.md says how each goes."""


@dataclass(frozen=True)
class Perform:
    """Do this with the whole body, from standing at ease, and go on. Done once the body is there."""

    action: Action


@dataclass(frozen=True)
class Walk:
    """Walk about at an easy pace. Done once it walks; it goes on until told else."""


@dataclass(frozen=True)
class Turn:
    """Take what is in the hands, turn it, and hold it still: this direction of its own is up. Done when it is so.

    Attributes:
        up: (3,) of any length, in the axes of what is held.
        again: how often this was told before; a person never turns a thing twice the same way.
    """

    up: Vector
    again: int = 0


@dataclass(frozen=True)
class Lead:
    """Lead the arm by hand to a posture unlike those before, and let go. Done when it is there.

    Attributes:
        number: of the posture, from 1; told again, it is another one.
    """

    number: int


@dataclass(frozen=True)
class Shape:
    """Take the hand to a shape and hold it. Done when it is there.

    Attributes:
        angles: rad, by the name of a glove's sensor; all others 0, as of a flat hand.
    """

    angles: Mapping[str, float]


@dataclass(frozen=True)
class Contract:
    """Contract one muscle as hard as you can, and hold it. Done when it is there; `Rest` relaxes all.

    Attributes:
        muscle: its name.
    """

    muscle: str


@dataclass(frozen=True)
class Return:
    """Walk back to where you stood at first, face as you did then, and stand at ease. Done once it stands there.

    Who hasn't walked stands already.
    """


@dataclass(frozen=True)
class Everyday:
    """Move as one does all day, and mean nothing by it: reach for things with one arm or the other, and rest."""


@dataclass(frozen=True)
class Drive:
    """Move one joint of a limb by held keys until it stands as said. Done when it stands there and the keys are free.

    Attributes:
        joint: index in the command's order.
        angle: rad, that whoever looks at the joint sees; None: `commanded` counts.
        commanded: rad, that the screen shows.
    """

    joint: int
    angle: float | None
    commanded: float | None = None


@dataclass(frozen=True)
class Do:
    """Do what a package of others needs and the rest doesn't say. Done when it is reached; `Rest` ends it.

    Attributes:
        what: a word that the package's own part knows: "grip".
    """

    what: str


Instruction = (
    Drive | Everyday | Rest | Explore | Hold | Follow | Perform | Walk | Turn | Shape | Lead | Contract | Return | Do
)
_KINDS: Final = {kind.__name__: kind for kind in get_args(Instruction)}


def written(instruction: Instruction) -> str:
    """The instruction as one line of JSON, for another process."""
    return json.dumps({type(instruction).__name__: asdict(instruction)}, default=list)


def instruction_of(text: str) -> Instruction:
    """The instruction that `written` wrote. Raises ValueError: it is none."""
    content = json.loads(text)
    if not isinstance(content, dict) or len(content) != 1 or next(iter(content)) not in _KINDS:
        raise ValueError(f"expected one of {', '.join(sorted(_KINDS))}")
    ((name, values),) = content.items()
    try:
        made: Instruction = _KINDS[name](**values)
    except TypeError:
        raise ValueError(f"{name} has other fields") from None
    return made


class Wearer(Protocol):
    """A simulated wearer, as who instructs it knows it. A cell's part that has one offers it as `wearer`."""

    @property
    def done(self) -> bool:
        """Whether the last instruction is reached."""

    def instruct(self, instruction: Instruction) -> None:
        """Ends what it is doing and begins this, from the present instant of the world on."""

    def see(self, pointers: Sequence[float]) -> None:
        """Shows it the pointers (k,), 0 to 1, as they are on the screen now; it perceives them with its own delay."""
