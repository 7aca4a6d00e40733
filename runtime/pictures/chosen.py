"""Which of a recording's shapes a picture shows: signals by their names, or parts of the body."""

from __future__ import annotations

from collections.abc import Sequence

from srl.runtime.contracts.errors import RecordingError, nearest
from srl.runtime.recording.solids import Thing


def chosen(things: Sequence[Thing], show: Sequence[str]) -> dict[int, tuple[int, ...]]:
    """For each thing that is shown, by its place in `things`, the rows of it.

    Args:
        things: all that could be shown.
        show: names of signals, or of parts (`Signal.groups`); none: all.
    Raises:
        RecordingError: no signal and no part has such a name.
    """
    parts = list(dict.fromkeys(name for thing in things for name in thing.groups))
    known = [*(thing.name for thing in things), *parts]
    for name in show:
        if name not in known:
            raise RecordingError("--show", f"no signal with a shape and no part is called '{name}'",
                                 nearest(name, known))  # fmt: skip
    found = {}
    for i, thing in enumerate(things):
        # Rows without a group, such as a signal's only point, are all one.
        groups = thing.groups or (thing.name,)
        rows = tuple(k for k, group in enumerate(groups) if not show or group in show or thing.name in show)
        if rows:
            found[i] = rows
    return found
