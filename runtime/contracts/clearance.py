"""The contract of a clearance: it says whether a limb's braking motion keeps clear of something that moves.

A guard asks it before each command (docs/guard.md, "Keeping clear"). It is pure mathematics: no I/O, no clock.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array, Arrays, Command, Signal

NEVER = -1  # a stamp: no sample has been taken yet, or nobody computes the signal at present


class ClearanceConfig(Options):
    """A clearance's options in the profile. Unknown keys are errors."""


@dataclass(frozen=True, slots=True)
class Braking:
    """A motion that ends at rest, in samples: what the next command and the stop after it would do.

    Between two samples each joint goes from the one value to the other and doesn't turn back. With a bounded jerk it
    may, by 0.1 mm of the limb where the jerk is 5 A/s or more (A: the acceleration), and 1.4 mm where it is A/s.

    Attributes:
        path: (m, n) rad or m, positions of the command's n elements; the first is where the limb is commanded now.
        until: (m,) s from now, rising: the latest instant at which the limb may still be on its way to this sample.
        velocity: (n,) rad/s or m/s, the largest speed of each element on the way.
        slack: (n,) rad or m, by which the limb's own elements may be beside the commanded ones.
        rates: (r, n) rad/s or m/s. Up to the second sample the velocity is a mixture of these; after it, it is a share
            of the last one, which only falls. None: nothing is known beside `velocity`.
        spread: (n,) rad/s or m/s, by which the limb's own velocities may be beside those, as one joint is later than
            another.
    """

    path: Array
    until: Array
    velocity: Array
    slack: Array
    rates: Array | None = None
    spread: Array = field(default_factory=lambda: np.zeros(0))


class Clearance(ABC):
    """Judges the braking motions of one command. Life cycle: `bind` -> cycles of `begin` and any number of `clear`.

    After `bind` neither method blocks, and neither depends on anything but the inputs that it was given. An error in
    one of them counts as "not clear".

    Attributes:
        inputs: the signals it reads. The profile's `in:` must bind every one.
        reach: (n,) m for each rad or m: no point of the limb moves by more than the sum of `reach_i |dq_i|`.
        creep: m/s: a limb that closes no distance at more than this may leave what it is too near to. One whose sum of
            `reach_i |v_i|` is at most this never does: the guard asks for such a motion when no faster one is clear.
        limb: the limb that the options describe, comparable; None where they describe none. No two devices have the
            same one.
        stroke: (n,) rad or m: it is right about the limb while no element is farther from 0 than this; infinite where
            that doesn't matter. The guard's limits must keep within it.
        extent: (n,), (n,) rad or m, lowest and highest: the guard sets it in each cycle if the clearance is `watched`.
            The limb is between them, and stays there until the guard sets others: what was commanded within its lag,
            the motion that was accepted last and its stop, and by how much it may be beside that. None: nobody knows.
        watched: another clearance reads the extent.
        unmet: limbs of the profile that it should compare with its own, and can't; a line each, for `srl check`.
        margin: m, set by `clear`: how much more distance there was than needed, at the worst instant; below 0: not
            clear. NaN where nothing is known.
    """

    Config: type[ClearanceConfig] = ClearanceConfig
    summary: str = ""

    def __init__(self, place: str, config: ClearanceConfig, command: Command) -> None:
        """
        Args:
            place: of its entry in the profile, for errors.
            config: its options.
            command: whose motions it judges; a path has its elements in its order.
        Raises:
            WiringError: the command isn't one of the limb that the options describe.
        """
        self.place, self.config, self.command = place, config, command
        self.inputs: tuple[Signal, ...] = ()
        self.input: Mapping[str, Array] = {}
        self.reach: Array = np.zeros(command.size)
        self.creep = 0.0
        self.limb: object = None
        self.stroke: Array = np.full(command.size, np.inf)
        self.extent: tuple[Array, Array] | None = None
        self.watched = False
        self.unmet: tuple[str, ...] = ()
        self.margin = float("nan")

    def meet(self, others: Iterable[Clearance]) -> None:
        """Takes the other clearances of the profile, once, before `bind`. Their limbs may come near this one."""

    def bind(self, input: Mapping[str, Array]) -> None:
        """Takes the arrays by input name, which the runtime allocates once."""
        self.input = Arrays(input)

    @abstractmethod
    def begin(self, now: int, stamps: Mapping[str, int]) -> bool:
        """Takes the inputs, once a cycle.

        Args:
            now: ns.
            stamps: by input name, when its sample was taken, ns; NEVER for none. What a law computed is as old as the
                oldest of the devices behind it.
        Returns:
            Whether they can be used: False for what is missing, not finite or old. Nothing is clear then.
        """

    @abstractmethod
    def clear(self, motion: Braking) -> bool:
        """Whether the whole motion keeps clear, whatever the other side does within its own limits. Sets `margin`."""

    def why(self) -> str:
        """Returns what made the last `begin` or `clear` say no, for people: the pair and its distance."""
        return ""

    def remarks(self) -> list[str]:
        """Returns lines for `srl check`: what is compared, and what is left out and why."""
        return []
