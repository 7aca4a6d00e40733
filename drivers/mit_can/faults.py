"""What keeps MIT-mode actuators from moving, in words and by motor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from srl.drivers.mit_can.config import MitCanConfig, MotorConfig
from srl.drivers.mit_can.plausible import Plausible
from srl.runtime.contracts.signals import Array

LONG: Final = 300_000_000  # ns above `hot` before it is a fault
NEAR: Final = 10.0  # K below it at which a person is told


class MitFaults:
    """The faults that are present. What was seen once stays until `clear`.

    Attributes:
        errors: the drive's own errors, in words.
        silent: motors that don't answer.
        limp: motors that are disabled though nobody here disabled them.
        jumped: by how much a position jumped, rad of the shaft.
        far: motors whose first command was too far away, by how much, in the axis' unit.
        asleep: motors that don't enable.
        hot: temperatures, degC.
        foreign: motors that another program commands.
        doubled: motors for which another one answers, too.
    """

    def __init__(self, motors: Mapping[str, MotorConfig]) -> None:
        self._names = [f"'{name}' (id {motor.id})" for name, motor in motors.items()]
        self._since: dict[int, int] = {}
        self.clear()

    def clear(self) -> None:
        """Removes all faults."""
        self.errors: dict[int, str] = {}
        self.silent: set[int] = set()
        self.limp: set[int] = set()
        self.jumped: dict[int, float] = {}
        self.far: dict[int, float] = {}
        self.asleep: set[int] = set()
        self.hot: dict[int, float] = {}
        self.foreign: set[int] = set()
        self.doubled: set[int] = set()
        self._since.clear()

    @property
    def doubtful(self) -> bool:
        """A motor must be looked at anew before it moves: it may be another one, or stand a turn away."""
        return bool(self.silent or self.limp or self.jumped or self.foreign or self.doubled or self.asleep)

    def concerns(self, i: int) -> bool:
        """Returns whether motor `i` must not be enabled or commanded anew."""
        sets = self.errors, self.silent, self.limp, self.jumped, self.far, self.asleep, self.foreign, self.doubled
        return any(i in found for found in sets)

    def judge(self, i: int, temperature: float, hot: float, now: int) -> None:
        """Takes a temperature; `hot`: degC."""
        if not temperature >= hot:
            self._since.pop(i, None)
        elif now - self._since.setdefault(i, now) >= LONG:
            self.hot[i] = temperature

    def text(self) -> str:
        """Returns all faults for the user; "" if there is none."""
        parts = [f"{self._names[i]}: {what}" for i, what in sorted(self.errors.items())]
        parts += [f"{self._names[i]} doesn't answer: check its cable and its power" for i in sorted(self.silent)]
        parts += [
            f"{self._names[i]} was disabled: its supply dipped, or another program did it"
            for i in sorted(self.limp - self.errors.keys())
        ]
        parts += [
            f"{self._names[i]}: its position jumped by {by:+.2f} rad: its supply dipped, or its zero was moved"
            for i, by in sorted(self.jumped.items())
        ]
        parts += [
            f"{self._names[i]} is {by:.2f} from its first command, too far: bring it near by hand"
            for i, by in sorted(self.far.items())
        ]
        parts += [f"{self._names[i]} doesn't enable: check its supply" for i in sorted(self.asleep)]
        parts += [
            f"{self._names[i]} is at {t:.0f} degC: let it cool, and ask less of it" for i, t in sorted(self.hot.items())
        ]
        parts += [
            f"another program commands {self._names[i]}: end it, since both would be obeyed"
            for i in sorted(self.foreign)
        ]
        parts += [
            f"two motors answer as {self._names[i]}: one was plugged in, or two buses are joined. Take it away"
            for i in sorted(self.doubled)
        ]
        return "; ".join(parts)


def warnings(config: MitCanConfig, temperature: Array, plausible: Sequence[Plausible]) -> list[str]:
    """Which motors are warm, (n,) degC, and whose velocity isn't that of its position."""
    found = []
    for name, t, judge in zip(config.motors, temperature.tolist(), plausible, strict=True):
        if config.maker == "damiao" and t >= config.hot - NEAR:
            found.append(f"{name} is at {t:.0f} degC (stops at {config.hot:g})")
        if implausible := judge.implausible:
            found.append(f"{name}: {implausible}")
    return found
