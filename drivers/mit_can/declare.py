"""The signals of MIT-mode actuators: their command, how it can stop, and its limits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from srl.drivers.mit_can import protocol
from srl.drivers.mit_can.config import MitCanConfig
from srl.drivers.mit_can.models import Range
from srl.drivers.servo_bus import declare
from srl.drivers.servo_bus.config import bounds
from srl.runtime.contracts.driver import EXTENDED
from srl.runtime.contracts.signals import Command, Kind, Limits, Signal, Stop

STATES: Final = ("position", "velocity", "effort", "temperature")
COMMANDS: Final = ("position_command", "velocity_command", "effort_command")
KINDS: Final = {"position": Kind.POSITION, "velocity": Kind.VELOCITY, "torque": Kind.TORQUE}
PERIOD: Final = 0.02  # s between two commands: one leaves each cycle
# A velocity has no stiffness: gravity moves a joint on, so its stop is damping and nothing more.
_STOPS: Final = {
    Kind.POSITION: (Stop.HOLD, Stop.DAMP, Stop.RETRACT, Stop.LIMP),
    Kind.VELOCITY: (Stop.DAMP,),
    Kind.TORQUE: (Stop.DAMP, Stop.HOLD, Stop.LIMP),
}
_MEASURED: Final = {"position": "position", "velocity": "velocity", "torque": "effort"}


def states(config: MitCanConfig) -> tuple[Signal, ...]:
    """The states, each (n,)."""
    return tuple(signal for signal in declare.states(config.motors) if signal.name in STATES)


def command(config: MitCanConfig) -> Command:
    """The command of the profile's `interface`, (n,)."""
    motors, measured, kind = config.motors, _MEASURED[config.interface], KINDS[config.interface]
    unit = next(signal.unit for signal in states(config) if signal.name == measured)
    homed = all(motor.home is not None for motor in motors.values())
    return Command(
        name=f"{measured}_command",
        shape=(len(motors),),
        unit=unit,
        labels=tuple(motors),
        kind=kind,
        feedback="position",
        stops=tuple(stop for stop in _STOPS[kind] if stop is not Stop.RETRACT or homed),
        slides=declare.sliding(motors),
        period=PERIOD,
        resolution=tuple(_steps(config)),
    )


def identifiers(config: MitCanConfig) -> tuple[dict[int, str], frozenset[int]]:
    """What the motors obey and send, for `Traffic`: all of it, and what the motors of another device may have, too."""
    found = dict[int, str]()
    for name, motor in config.motors.items():
        if config.generation == "v3":  # it is in servo mode at the same time
            found |= dict.fromkeys((EXTENDED | mode << 8 | motor.id for mode in range(16)), f"commands for '{name}'")
            found[EXTENDED | config.reply_id(motor)] = f"the status of '{name}'"
            continue
        if config.maker == "damiao":  # after a power-off it may be in another mode, in which it obeys these
            found |= dict.fromkeys(
                (mode << 8 | motor.id for mode in (1, 2, 3)), f"commands of other modes for '{name}'"
            )
        found[config.reply_id(motor)] = f"replies of '{name}'"
        found[motor.id] = f"commands for '{name}'" + (" and its replies" if config.maker == "cubemars" else "")
    if config.generation == "v3":
        return found, frozenset()
    common = protocol.REGISTERS if config.maker == "damiao" else 0
    found[common] = "questions for its motors" if common else "replies of its motors"
    return found, frozenset((common,))


def _steps(config: MitCanConfig) -> list[float]:
    """By how much what leaves differs from the command, in its unit: a step of the wire's field."""
    found = []
    for motor in config.motors.values():
        span, scale = motor.span(config.generation), abs(motor.scale)
        found.append(
            {
                "position": 2 * span.position / protocol.WORD * scale,
                "velocity": 2 * span.velocity / protocol.FIELD * scale,
                "torque": 2 * span.torque / protocol.FIELD / scale,
            }[config.interface]
        )
    return found


def limits(config: MitCanConfig, spans: Sequence[Range]) -> Limits:
    """The joints' travel, and what the wire carries of speed and torque."""
    travel = bounds(config.motors)
    scale = np.abs([motor.scale for motor in config.motors.values()])
    return Limits(
        lower=travel.lower,
        upper=travel.upper,
        velocity=np.array([span.velocity for span in spans]) * scale,
        effort=np.array([span.torque for span in spans]) / scale,
    )
