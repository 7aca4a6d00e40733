"""Whether a stream is the one that the profile means, and which of its channels are which."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from srl.drivers.lsl.config import LslConfig, LslSignal
from srl.drivers.lsl.units import factor
from srl.runtime.contracts.errors import DeviceError, nearest
from srl.runtime.contracts.signals import Array

_PROFILE = "Correct the profile, or the sender's settings"


@dataclass(frozen=True)
class Picked:
    """A signal's channels.

    Attributes:
        columns: (n,), of the stream's values, from 0.
        factors: (n,), by which they become SI.
    """

    columns: np.ndarray
    factors: Array


def match(place: str, config: LslConfig, description: dict[str, Any]) -> dict[str, Picked]:
    """Compares a stream's description, as the process tells it, with the profile. Returns the channels by signal.

    Raises:
        DeviceError: another rate or number of channels, no such label or one that is there twice, a unit that is
            unknown, another one than the profile says, or not stated at all.
    """
    rate, count = float(description["rate"]), int(description["count"])
    if abs(rate - config.rate) > 1e-3 * max(config.rate, 1e-3):
        there, here = (f"{value:g} Hz" if value else "irregular" for value in (rate, config.rate))
        raise DeviceError(place, f"the stream's rate is {there}, the profile's {here}", _PROFILE)
    if config.count is not None and count != config.count:
        raise DeviceError(place, f"the stream has {count} channels, the profile says {config.count}", _PROFILE)
    return {name: _picked(place, name, entry, description) for name, entry in config.signals.items()}


def _picked(place: str, name: str, entry: LslSignal, description: dict[str, Any]) -> Picked:
    labels, units = list(map(str, description["labels"])), list(map(str, description["units"]))
    columns = [_column(place, name, where, labels) for where in entry.channels.values()]
    factors = []
    for label, column in zip(entry.channels, columns, strict=True):
        stated, unit = (units[column].strip() if units else ""), entry.unit_of(label)
        channel = f"the channel {labels[column] if labels else column + 1} of '{name}'"
        by = factor(stated, unit) if stated else None
        if stated and by is None:
            problem = f"{channel} is in '{stated}', the profile wants '{unit}'"
            raise DeviceError(
                place, problem, "Correct `unit`, or the sender's; units that are known: docs/devices/lsl.md"
            )
        if unit != entry.unit:  # a quaternion's, which has no other
            factors.append(by or 1.0)
            continue
        by_profile = factor(entry.sent, unit) if entry.sent is not None else None
        if by is None and by_profile is None:
            problem = f"{channel} has no unit: whether volts or microvolts is a factor of a million"
            raise DeviceError(place, problem, f"Say it as `sent` of the signal '{name}'")
        if by is not None and by_profile is not None and by != by_profile:
            raise DeviceError(place, f"{channel} is in '{stated}', the profile says '{entry.sent}'", "Correct `sent`")
        factors.append(by_profile if by is None else by)  # type: ignore[arg-type]
    return Picked(np.array(columns), np.array(factors))


def _column(place: str, name: str, where: str | int, labels: Sequence[str]) -> int:
    if isinstance(where, int):
        return where - 1
    if not labels:
        problem = f"the stream names none of its channels, and '{name}' wants '{where}'"
        raise DeviceError(place, problem, "Give their numbers, from 1, and `count`")
    if where not in labels:
        raise DeviceError(place, f"the stream has no channel '{where}' for '{name}'", nearest(where, labels))
    if labels.count(where) > 1:
        problem = f"{labels.count(where)} channels of the stream are called '{where}'"
        raise DeviceError(place, problem, "Give its number, from 1, and `count`")
    return labels.index(where)
