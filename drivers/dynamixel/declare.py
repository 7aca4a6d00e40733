"""The signals of a bus: names and units of its states and its command, and how it can stop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from drivers.dynamixel.config import DynamixelConfig
from drivers.dynamixel.family import WATCHDOG
from drivers.dynamixel.setup import watchdog_code
from runtime.contracts.signals import Command, Kind, Signal, Stop

STATES: Final = ("position", "velocity", "effort", "temperature", "voltage")
COMMANDS: Final = ("position_command", "velocity_command", "effort_command")
KINDS: Final = dict(zip(COMMANDS, (Kind.POSITION, Kind.VELOCITY, Kind.TORQUE), strict=True))
_STOPS: Final = {
    Kind.POSITION: (Stop.HOLD, Stop.RETRACT, Stop.LIMP),
    Kind.VELOCITY: (Stop.HOLD, Stop.BRAKE, Stop.RETRACT),
    Kind.TORQUE: (Stop.HOLD, Stop.DAMP, Stop.LIMP),
}
PERIOD: Final = 0.06  # s: an exchange over USB with a latency timer of 16 ms each way, a second one between samples
_ROTARY: Final = {"position": "rad", "velocity": "rad/s", "effort": "N m", "temperature": "degC", "voltage": "V"}
_LINEAR: Final = _ROTARY | {"position": "m", "velocity": "m/s", "effort": "N"}


def _units(config: DynamixelConfig) -> dict[str, str]:
    """Returns one unit per signal: that of linear motion only if all axes are prismatic."""
    linear = all(motor.m_per_rad is not None for motor in config.motors.values())
    return _LINEAR if linear else _ROTARY


def states(config: DynamixelConfig) -> tuple[Signal, ...]:
    """The states, each (n,)."""
    units, labels = _units(config), tuple(config.motors)
    slides = sliding(config)
    return tuple(
        Signal(
            name=key, shape=(len(labels),), unit=units[key], labels=labels,
            slides=slides if key in ("position", "velocity", "effort") else None,
        )
        for key in STATES
    )  # fmt: skip


def sliding(config: DynamixelConfig) -> tuple[str, ...]:
    """The prismatic axes."""
    return tuple(name for name, motor in config.motors.items() if motor.m_per_rad is not None)


def command(config: DynamixelConfig, unit: Sequence[float]) -> Command:
    """The command of the profile's `mode`, (n,); `unit` is that of the goal's register, in the command's (n,)."""
    labels, kind = tuple(config.motors), KINDS[config.command]
    homed = all(motor.home is not None for motor in config.motors.values())
    return Command(
        name=config.command,
        shape=(len(labels),),
        unit=_units(config)[config.command.removesuffix("_command")],
        labels=labels,
        kind=kind,
        feedback="position",
        stops=tuple(stop for stop in _STOPS[kind] if stop is not Stop.RETRACT or homed),
        slides=sliding(config),
        period=PERIOD,
        timeout=watchdog_code(config.watchdog) * WATCHDOG if config.protocol == 2 else None,
        resolution=tuple(abs(x) for x in unit),
    )
