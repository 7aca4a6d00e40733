"""What the panel needs to know of a run that moves joints under a key: which joints, and where they are."""

from __future__ import annotations

import math
from typing import Any, Final

from srl.runtime.contracts.terms import POSITION_OF
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.ipc.run_folder import RunFolder

LAW: Final = "jog"  # as `srl.commissioning.jog.profile_subset` calls it
GUIDED: Final = "servo-marks"  # beside it, of `srl calibrate PROFILE servos`
WAY: Final = "terminal.way"


def joints(layout: Layout) -> list[dict[str, Any]]:
    """Name, unit, bounds (None: none) and whether it is measured, of each joint; empty where `srl jog` doesn't run."""
    laws = [entry["use"] for entry in layout.meta.get("controllers", [])]
    commands = list(layout.meta.get("commands", {}))
    if laws not in ([LAW], [LAW, GUIDED]) or WAY not in layout.fields or len(commands) != 1:
        return []
    names = layout.fields[WAY].labels
    field = layout.fields[commands[0]]
    limits = layout.meta.get("limits", {}).get(commands[0], {})
    bounds = [_padded(limits.get(key), len(names)) for key in ("lower", "upper")]
    unit, measured = field.unit.removesuffix("/s"), _measured(layout, commands[0])
    return [
        {"name": name, "unit": unit, "lower": lower, "upper": upper, "measured": measured}
        for name, lower, upper in zip(names, *bounds, strict=True)
    ]


def places(layout: Layout, row: Words) -> list[float | None]:
    """Where each joint is in a row (width,): as measured, else as commanded; None where nobody knows."""
    (command,) = layout.meta["commands"]
    names = layout.fields[WAY].labels
    source = f"{command}.applied"
    if _measured(layout, command):
        source = _position(command)
    elif layout.fields[command].unit.endswith("/s"):
        return [None] * len(names)  # a velocity says nothing of where it is
    values, labels = layout.value(row, source).ravel().tolist(), layout.fields[source].labels
    found = dict(zip(labels or names, values, strict=False))
    given = [found.get(name, found.get(POSITION_OF.get(name, ""), math.nan)) for name in names]
    return [value if math.isfinite(value) else None for value in given]


def _position(command: str) -> str:
    return f"{command.partition('.')[0]}.position"


def _measured(layout: Layout, command: str) -> bool:
    return _position(command) in layout.fields


def takes_presses(run_folder: RunFolder) -> bool:
    """Whether the run's presses come from the panel (`srl jog --panel`), and not from a terminal."""
    return run_folder.press_socket.exists()


def _padded(values: Any, count: int) -> list[float | None]:
    flat: list[Any] = []
    pending = [values if values is not None else []]
    while pending:
        first = pending.pop(0)
        if isinstance(first, list):
            pending = [*first, *pending]
        else:
            flat.append(first)
    finite = [v if isinstance(v, (int, float)) and math.isfinite(v) else None for v in flat]
    return (finite + [None] * count)[:count]
