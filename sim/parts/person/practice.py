"""What practice leaves of not knowing a tool: the two-state model of motor adaptation."""

from __future__ import annotations

from typing import Final

# Share kept from one trial to the next, and share of the error that is learned, of the fast and of the slow process:
# Smith, Ghazizadeh and Shadmehr, PLoS Biology 4 (2006), e179.
_FAST: Final = (0.59, 0.21)
_SLOW: Final = (0.992, 0.02)


def practised(first: float, trials: int) -> float:
    """Returns the share of a tool's dynamics that a person knows after some trials.

    Args:
        first: the share that was known before; the slow process holds it.
        trials: number of movements with the tool.
    """
    fast, slow = 0.0, first
    for _ in range(trials):
        off = 1.0 - fast - slow
        fast, slow = _FAST[0] * fast + _FAST[1] * off, _SLOW[0] * slow + _SLOW[1] * off
    return fast + slow
