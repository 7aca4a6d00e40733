"""The signals of a bus: names and units of its states and its command, and how it can stop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from srl.drivers.servo_bus.config import AxisConfig
from srl.runtime.contracts.signals import Command, Kind, Signal, Stop

STATES: Final = ("position", "velocity", "effort", "temperature", "voltage")
COMMANDS: Final = ("position_command", "velocity_command", "effort_command")
KINDS: Final = dict(zip(COMMANDS, (Kind.POSITION, Kind.VELOCITY, Kind.TORQUE), strict=True))
_STOPS: Final = {
    Kind.POSITION: (Stop.HOLD, Stop.RETRACT, Stop.LIMP),
    Kind.VELOCITY: (Stop.HOLD, Stop.BRAKE, Stop.RETRACT),
    Kind.TORQUE: (Stop.HOLD, Stop.DAMP, Stop.LIMP),
}
PERIOD: Final = 0.06  # s: an exchange over USB with a latency timer of 16 ms each way, a second one between samples
ROTARY: Final = {"position": "rad", "velocity": "rad/s", "effort": "N m", "temperature": "degC", "voltage": "V"}
LINEAR: Final = ROTARY | {"position": "m", "velocity": "m/s", "effort": "N"}


def _units(axes: Mapping[str, AxisConfig]) -> dict[str, str]:
    """Returns one unit per signal: that of linear motion only if all axes are prismatic."""
    return LINEAR if all(axis.m_per_rad is not None for axis in axes.values()) else ROTARY


def states(axes: Mapping[str, AxisConfig]) -> tuple[Signal, ...]:
    """The states, each (n,)."""
    units, labels, slides = _units(axes), tuple(axes), sliding(axes)
    return tuple(
        Signal(
            name=key, shape=(len(labels),), unit=units[key], labels=labels,
            slides=slides if key in ("position", "velocity", "effort") else None,
        )
        for key in STATES
    )  # fmt: skip


def sliding(axes: Mapping[str, AxisConfig]) -> tuple[str, ...]:
    """The prismatic axes."""
    return tuple(name for name, axis in axes.items() if axis.m_per_rad is not None)


def command_of(axes: Mapping[str, AxisConfig], name: str, unit: Sequence[float], timeout: float | None) -> Command:
    """The command with this name, one of COMMANDS, (n,); `unit` (n,): of the goal's register, in the command's unit."""
    kind = KINDS[name]
    homed = all(axis.home is not None for axis in axes.values())
    return Command(
        name=name,
        shape=(len(axes),),
        unit=_units(axes)[name.removesuffix("_command")],
        labels=tuple(axes),
        kind=kind,
        feedback="position",
        stops=tuple(stop for stop in _STOPS[kind] if stop is not Stop.RETRACT or homed),
        slides=sliding(axes),
        period=PERIOD,
        timeout=timeout,
        resolution=tuple(abs(x) for x in unit),
    )
