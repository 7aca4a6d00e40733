"""What is ordered of `srl calibrate`. It loads nothing else, as every start of `srl` reads it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

LAWS: Final = ("ikns", "intention", "independent-operation", "ft", "glove", "frames", "emg", "suit", "servos")
"""What can be calibrated: the names of `runtime.calibration.session.METHODS`."""


@dataclass(frozen=True)
class Order:
    """What is wanted; the options of `srl calibrate`."""

    profile: str
    law: str = "ikns"
    person: str | None = None
    out: Path | None = None
    yes: bool = False
    sim: bool = False
    record: Path | None = None
    view: bool = False
    recording: Sequence[Path] | None = None
    before: Sequence[Path] | None = None
    redo: Sequence[int] | None = None
    dofs: str | None = None
    points: int | None = None
    flip: Sequence[str] = ()
    sense: Path | None = None
    actions: str | None = None
    option: Sequence[str] = ()
    set: Sequence[str] = ()
    instance: str | None = None
    json: bool = False
    panel: bool = False
