"""What a driver declares of its signals: checked before anything is opened."""

from __future__ import annotations

from math import inf

import numpy as np

from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.signals import Array, Command, Signal

LONGEST_PERIOD = 0.25  # s between commands; a slower device can't be told from a stalled link in time


def check_command(command: Command, place: str, driver: str) -> None:
    """Refuses a command whose driver doesn't say how it is sent: a stall couldn't be told from a slow device."""
    widths, period = _numbers(command.resolution), _numbers(command.period)
    if not (period.size == 1 and 0 < period[0] <= LONGEST_PERIOD):
        problem = f"driver '{driver}' doesn't declare how often it sends '{command.name}' (period: {command.period})"
    elif widths.size not in (1, command.size) or not (np.isfinite(widths) & (widths >= 0)).all():
        problem = f"driver '{driver}' declares no usable resolution of '{command.name}': {command.resolution}"
    elif not _usable(command.lag, 1, least=-1e-9, most=LONGEST_PERIOD) or not _usable(command.window, command.size):
        problem = f"driver '{driver}' declares of '{command.name}' a lag of {command.lag}, a window of {command.window}"
        remedy = f"Give a lag of at most {LONGEST_PERIOD:g} s, and a window above 0 in the position's unit, or none"
        raise WiringError(place, problem, remedy)
    else:
        return
    remedy = f"Give its Command a `period` of at most {LONGEST_PERIOD:g} s and a `resolution`, and fill `sent_arrays`"
    raise WiringError(place, problem, remedy)


def _numbers(given: object) -> Array:
    """What a driver declares, as numbers; none if it isn't any."""
    values = np.ravel(np.array(given, dtype=object))
    plain = all(isinstance(v, int | float | np.number) and not isinstance(v, bool) for v in values)
    return values.astype(np.float64) if plain else np.empty(0)


def _usable(given: object, size: int, least: float = 0.0, most: float = inf) -> bool:
    values = _numbers(1.0 if given is None and least == 0.0 else given)
    return values.size in (1, size) and bool((np.isfinite(values) & (values > least) & (values <= most)).all())


def check_range(signal: Signal, place: str, driver: str) -> None:
    """Refuses a state whose driver says of it what no range is."""
    if signal.plausible is None:
        return
    try:
        low, high = (np.broadcast_to(_numbers(v).reshape(np.shape(v)), signal.shape) for v in signal.plausible)
        fits = bool((low < high).all())
    except (TypeError, ValueError):
        fits = False
    if not fits:
        problem = f"driver '{driver}' declares no usable range of '{signal.name}': {signal.plausible}"
        raise WiringError(place, problem, "Give `plausible` the least and the greatest value")
