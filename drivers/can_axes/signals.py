"""The signals of drives on a CAN bus: names and units of their states and their command, and how they can stop."""

from __future__ import annotations

from typing import Final

from srl.runtime.contracts.signals import Command, Kind, Signal, Stop

UNITS: Final = {"position": "rad", "velocity": "rad/s", "effort": "N m", "temperature": "degC", "voltage": "V"}
COMMANDS: Final = ("position_command", "velocity_command", "torque_command")
PERIOD: Final = 0.05  # s: commands leave each cycle; a bus with a full queue may refuse some
_STOPS: Final = {
    "position": (Stop.HOLD, Stop.RETRACT, Stop.LIMP),
    "velocity": (Stop.HOLD, Stop.BRAKE, Stop.RETRACT, Stop.LIMP),
    "torque": (Stop.HOLD, Stop.DAMP, Stop.LIMP),
}
_KIND_UNIT: Final = {
    "position": (Kind.POSITION, "rad"),
    "velocity": (Kind.VELOCITY, "rad/s"),
    "torque": (Kind.TORQUE, "N m"),
}


def command_of(mode: str) -> str:
    """The name of a mode's command."""
    return f"{mode}_command"


def states(names: tuple[str, ...], labels: tuple[str, ...]) -> tuple[Signal, ...]:
    """States with these names, each (n,)."""
    return tuple(
        Signal(
            name=name, shape=(len(labels),), unit=UNITS[name], labels=labels,
            slides=() if name in ("position", "velocity", "effort") else None,
        )
        for name in names
    )  # fmt: skip


def command(mode: str, labels: tuple[str, ...], homed: bool, resolution: tuple[float, ...]) -> Command:
    """The command of a mode, (n,); `resolution` in its unit."""
    kind, unit = _KIND_UNIT[mode]
    return Command(
        name=command_of(mode),
        shape=(len(labels),),
        unit=unit,
        labels=labels,
        kind=kind,
        feedback="position",
        stops=tuple(stop for stop in _STOPS[mode] if stop is not Stop.RETRACT or homed),
        slides=(),
        period=PERIOD,
        resolution=resolution,
    )
