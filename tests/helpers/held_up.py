"""What a host under load does to a run in real time: it is told apart from a fault, and the run is made again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

HELD_UP: Final = (
    "the loop gave no sign of life"  # for longer than the supervisor allows, 0.12 s, and it rightly ends it
)
_TIMES: Final = 5


def unless_held_up(body: Callable[[Path], None], folder: Path) -> None:
    """Calls `body` with a folder of its own; again, where it failed because the host held up the loop."""
    for attempt in range(_TIMES):
        (made := folder / str(attempt)).mkdir()
        try:
            body(made)
        except AssertionError as error:
            if attempt == _TIMES - 1 or HELD_UP not in str(error):
                raise
        else:
            return
