"""An arm's declaration, and the conditions that keep it from obeying: for the driver and for its fake alike."""

from __future__ import annotations

import numpy as np

from srl.drivers.ur.config import UrConfig
from srl.drivers.ur.models import JOINTS, REACH, fastest
from srl.drivers.ur.registers import ScriptState
from srl.drivers.ur.sample import Words
from srl.drivers.ur.status import RobotMode, RuntimeState, name_of, safety_words
from srl.runtime.contracts.signals import Command, Kind, Limits, Signal, Stop
from srl.runtime.contracts.terms import POSE, WRENCH

NEAR = 0.2  # rad, by which a joint may be measured beyond its end
FASTEST = 15.0  # rad/s, of any joint of any model: 4 is the most that one is commanded to
FORCE = np.array([500.0] * 3 + [100.0] * 3)  # N, N m: more than an arm stands
WINDOW = 0.1  # rad: its joints are stiff
PERIOD = 0.02  # s, ten cycles of the controller: commands go every cycle, two may be unanswered


def states(config: UrConfig, name: str) -> tuple[Signal, ...]:
    """Returns the states of the arm called `name`; the frame of the controller's `base` has its name."""
    found = [
        Signal(name="position", shape=(6,), unit="rad", labels=JOINTS, plausible=(-REACH - NEAR, REACH + NEAR)),
        Signal(name="velocity", shape=(6,), unit="rad/s", labels=JOINTS, plausible=(-FASTEST, FASTEST)),
        Signal(name="effort", shape=(6,), unit="N m", labels=JOINTS),
        Signal(name="wrench", shape=(6,), unit="N, N m", frame=name, labels=WRENCH),
        Signal(name="pose", shape=(7,), unit="m", frame=name, labels=POSE),
        Signal(name="speed_scaling", shape=(1,), unit="1"),
    ]
    if config.buttons:
        found.append(Signal(name="buttons", shape=(len(config.buttons),), unit="1", labels=tuple(config.buttons)))
    return tuple(found)


def commands(config: UrConfig) -> tuple[Command, ...]:
    """Returns the arm's command, selected by its interface; none of `none`."""
    if config.interface == "none":
        return ()
    kind, unit = {
        "velocity": (Kind.VELOCITY, "rad/s"),
        "position": (Kind.POSITION, "rad"),
    }[config.interface]
    made = Command(
        name=f"{config.interface}_command", shape=(6,), unit=unit, labels=JOINTS, kind=kind,
        feedback="position", stops=(Stop.HOLD, Stop.BRAKE), period=PERIOD, timeout=config.timeout, ordered=True,
        window=WINDOW if kind is Kind.POSITION else None,
    )  # fmt: skip
    return (made,)


def limits(config: UrConfig) -> Limits:
    """Returns an arm's own limits: those of its model, and the controller's acceleration limit if it has one."""
    reach = np.full(6, REACH)
    acceleration = np.full(6, config.acceleration) if config.interface == "velocity" else None
    return Limits(lower=-reach, upper=reach, velocity=fastest(config.model), acceleration=acceleration)


def measured(robot_mode: int) -> bool:
    """Whether the joints' own electronics are on: what the controller says of their angles is then measured."""
    return robot_mode in (RobotMode.IDLE, RobotMode.BACKDRIVE, RobotMode.RUNNING)


def remark(words: Words) -> str:
    """Returns what is to be known of an arm that is only read; "" if nothing is."""
    if measured(words.robot_mode):
        return safety_words(words.safety_bits)
    return f"the joints aren't measured (robot mode {name_of(RobotMode, words.robot_mode)}): switch the arm on"


def fault(words: Words, nonce: int, timeout: float) -> str:
    """Returns what keeps the arm from obeying; "" if nothing does."""
    if found := safety_words(words.safety_bits):
        return found
    if words.robot_mode != RobotMode.RUNNING:
        return f"the arm isn't ready to move (robot mode {name_of(RobotMode, words.robot_mode)})"
    if words.nonce != nonce:
        return "the control program isn't loaded"
    if words.state == ScriptState.TIMED_OUT:
        return f"the arm stopped itself: no command came for {timeout:g} s"
    if words.state not in (ScriptState.READY, ScriptState.FOLLOWING):
        return "the control program has ended"
    if words.runtime_state != RuntimeState.PLAYING:
        return f"the control program doesn't run ({name_of(RuntimeState, words.runtime_state)})"
    return ""
