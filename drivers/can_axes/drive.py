"""One drive on the bus, as it was last heard: whether it is alive, where its axis is, and what is wrong with it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from srl.drivers.can_axes.config import CanAxis

FAR: Final = "is too far from its first command"
ANEW: Final = "Support the limb, park it, switch the drives off and on there, and start the run anew"
_SLACK: Final = 0.1  # rad: by this an axis may move while nobody hears it
_QUIET: Final = 100_000_000  # ns without a position, after which a drive may have started anew


@dataclass
class Drive:
    """One drive.

    Attributes:
        name, axis: of the profile.
        absolute: it knows its position after a loss of its supply.
        heard: ns, the newest sign of life; -1 before the first.
        sampled: ns, the newest position; -1 before the first.
        position, velocity, effort, temperature, voltage: rad, rad/s, N m, degC, V of the axis and its drive.
        armed: it has taken its first command, and moves.
        woken: ns, when it was told to begin; -1: it wasn't.
        first: the command that it was woken with; 0 for a velocity or a torque.
        left: ns, when a command last left for it; -1: none has since it was opened.
        refused: ns, since when the bus takes no command for it; -1: it takes them.
        error: what the drive itself says is wrong, in words; "" while it says that all is well.
        dropped: why it stopped to obey, in words; stays until a reset.
        lost: why its position can't be trusted any more; a reset doesn't help, unless it is absolute.
        far: why it couldn't follow its first command; stays until a reset.
        silent: nothing was heard of it for some time.
        details: what it told about its error when it was asked.
    """

    name: str
    axis: CanAxis
    absolute: bool
    heard: int = -1
    sampled: int = -1
    position: float = float("nan")
    velocity: float = 0.0
    effort: float = 0.0
    temperature: float = float("nan")
    voltage: float = float("nan")
    armed: bool = False
    woken: int = -1
    first: float = 0.0
    left: int = -1
    refused: int = -1
    error: str = ""
    dropped: str = ""
    lost: str = ""
    far: str = ""
    silent: bool = False
    details: list[str] = field(default_factory=list)

    @property
    def stopped(self) -> bool:
        """Whether something keeps it from being commanded. A silent drive may still hear."""
        return bool(self.error or self.dropped or self.lost or self.far)

    def trouble(self) -> str:
        """What is wrong, for the user; "" if nothing is."""
        found = [self.lost, self.error, self.dropped if self.dropped != self.error else "", self.far]
        if any(found):
            found += self.details
        if self.silent:
            found.append("is silent: check its cable and its supply. It may be moving")
        words = ", ".join(what for what in found if what)
        return f"{self.name} {words}" if words else ""

    def begin(self, position: float) -> None:
        """Takes the position found while the bus is opened; it must fit to the one before a silence."""
        if self.sampled >= 0 and not self.absolute and abs(position - self.position) > _SLACK:
            self.lost = self.lost or jumped(self.position, position)
        self.position, self.sampled = position, -1

    def move(self, position: float, now: int) -> None:
        """Takes a position. One that no motion explains means that the drive began to count anew: it is lost."""
        span = _QUIET if self.sampled < 0 else max(now - self.sampled, 0)
        most = _SLACK + 2 * abs(self.velocity) * min(span * 1e-9, 0.3)
        if span <= _QUIET:
            most += 2 * self.axis.velocity * span * 1e-9
        if not abs(position - self.position) <= most and not (self.absolute and span > _QUIET):
            self.lost = self.lost or jumped(self.position, position)
        self.position, self.sampled = position, now

    def release(self) -> None:
        """It isn't commanded any more."""
        self.armed, self.woken = False, -1

    def forget(self) -> None:
        """A reset: what a person can answer for is forgotten."""
        self.release()
        self.error = self.dropped = self.far = ""
        if self.absolute:
            self.lost = ""
        self.details.clear()


def jumped(before: float, after: float) -> str:
    """Says that a position isn't the axis' any more."""
    return (
        f"jumped from {before:.2f} to {after:.2f} rad: it lost its supply and with it its position, or it moved while "
        f"nobody heard it. {ANEW}"
    )
