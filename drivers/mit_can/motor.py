"""One motor of the bus as the driver knows it: what it said last, what has left for it, and how far it is armed."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

from srl.drivers.mit_can.config import MotorConfig
from srl.drivers.mit_can.plausible import Plausible
from srl.drivers.mit_can.silent_release import SilentRelease


class Stage(IntEnum):
    """How far a motor is on its way to commands: it gets none, it was told to enable, it gets them."""

    OFF = 0
    WAKING = 1
    ARMED = 2


@dataclass
class Motor:
    """One motor.

    Attributes:
        number: in the profile's order.
        config: of the profile.
        damp, slack: the frames that damp it, and that take its torque away.
        position: rad, the newest, as the drive says it.
        heard: ns, of its newest reply; -1 before the first `read`.
        on: a Damiao: it said that it is enabled. A CubeMars always counts as that.
        stage: how far it is armed.
        since: ns, of the present stage.
        asked: ns, of the last attempt to enable it.
        first: the command with which it was armed, in the axis' unit.
        last: the newest command that left; b"" if none has since it was armed.
        value: that command, in the axis' unit.
        at: ns, when it left.
        held: the frame that holds it there, at rest.
        plausible: whether its velocity is that of its position.
        release: whether it may have let go unseen.
    """

    number: int
    config: MotorConfig
    damp: bytes
    slack: bytes
    position: float
    on: bool
    heard: int = -1
    stage: Stage = Stage.OFF
    since: int = 0
    asked: int = 0
    first: float = 0.0
    last: bytes = b""
    value: float = 0.0
    at: int = -1
    held: bytes = field(init=False)
    plausible: Plausible = field(default_factory=Plausible)
    release: SilentRelease = field(default_factory=SilentRelease)

    def __post_init__(self) -> None:
        self.held = self.damp

    @property
    def armed(self) -> bool:
        """Whether it gets commands."""
        return self.stage is Stage.ARMED

    def wake(self, now: int, long_ago: int) -> None:
        """It is to be enabled; `long_ago`: ns, a last attempt that lets the next begin at once."""
        self.stage, self.since, self.asked = Stage.WAKING, now, long_ago

    def arm(self, now: int, first: float) -> None:
        """It gets commands from now on."""
        self.stage, self.since, self.last, self.first = Stage.ARMED, now, b"", first

    def disarm(self) -> None:
        """It gets no command before it was armed again; until then no stop frame repeats its last one."""
        self.stage, self.last, self.held = Stage.OFF, b"", self.damp
        self.release.forget()

    def left(self, frame: bytes, value: float, held: bytes, now: int) -> None:
        """A command has left. One that the bus refused changes nothing: neither its stop frame nor its speed."""
        self.last, self.value, self.held, self.at = frame, value, held, now
