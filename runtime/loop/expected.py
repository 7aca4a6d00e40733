"""What a device's samples can be: what its driver knows, where its joints are led to, how fast a person is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf
from typing import Final

import numpy as np

from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.signals import Array, Command, Kind, Limits, Signal
from srl.runtime.contracts.terms import PLANAR_TWIST, POSITION_OF
from srl.runtime.guard.samples import SPEED, SampleCheck
from srl.runtime.profile.graph import Actuator

FASTEST: Final = 40.0  # rad/s, of a person's joints: the fastest, of a throw, turn at 20 to 40


def expect(samples: SampleCheck, driver: Driver, actuators: Sequence[Actuator], limits: Mapping[str, Limits]) -> None:
    """Has `samples` judge what is known of this device, once it is open.

    Args:
        samples: of the driver's states.
        driver: the driver.
        actuators: its commands.
        limits: by command name, what the guard keeps to.
    Raises:
        DeviceError: the driver's `ranges` are of no state of it, or aren't ranges.
    """
    signals = {s.name: s for s in driver.states}
    for name, given in driver.ranges.items():
        samples.narrow(name, *_range(driver, signals.get(name), name, given))
    for actuator in actuators:
        feedback, most = signals.get(actuator.command.feedback or ""), limits[actuator.name].velocity
        if feedback is not None and most is not None:
            samples.expect(feedback.name, speed_of(feedback, actuator.command, most), actuator.command.slides or ())
    torque = any(a.command.kind is Kind.TORQUE for a in actuators)  # it damps the measured velocity
    for signal in driver.states:
        if not actuators and signal.unit == "rad":
            samples.expect(signal.name, np.full(signal.size, FASTEST / SPEED))
        for other in driver.states if torque else ():
            of_it = signal.labels and (other.labels, other.shape) == (signal.labels, signal.shape)
            if of_it and other.unit == f"{signal.unit}/s":
                samples.compare(signal.name, other.name)


def _range(driver: Driver, signal: Signal | None, name: str, given: tuple[Array, Array]) -> tuple[Array, Array]:
    try:
        low, high = (np.broadcast_to(np.asarray(v, np.float64), signal.shape).ravel() for v in given)  # type: ignore[union-attr]
        if (low < high).all():
            return low, high
    except (AttributeError, TypeError, ValueError):
        pass
    problem = f"its driver declares no usable range of '{name}': {given}"
    states = ", ".join(s.name for s in driver.states)
    raise DeviceError(driver.name, problem, f"Give `ranges` the least and the greatest value of one of: {states}")


def speed_of(feedback: Signal, command: Command, most: Array) -> Array:
    """(size,) of the feedback: the greatest speed of each of its elements that this command asks; inf: of the others.

    Args:
        feedback: the state that measures the command's joints.
        command: the command.
        most: its velocity limit, of the command's shape.
    """
    limit = most.ravel().tolist()
    if feedback.size == command.size == 1:
        return np.array(limit)
    if command.labels == PLANAR_TWIST:  # the base's axes turn in the frame of the pose
        limit[:2] = [max(limit[:2])] * 2
    names = [POSITION_OF.get(n, n) if command.labels == PLANAR_TWIST else n for n in command.labels]
    of = dict(zip(names, limit, strict=True)) if names else {}
    if of and feedback.labels:
        return np.array([of.get(name, of.get(POSITION_OF.get(name, ""), inf)) for name in feedback.labels])
    return np.array(limit) if feedback.size == command.size else np.full(feedback.size, inf)
