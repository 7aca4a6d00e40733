"""What is asked of `srl calibrate`. It loads nothing else, as every start of `srl` reads it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from srl.runtime.contracts.wearer import Instruction

METHODS: Final = {
    "ikns": "ikns.IknsMethod",
    "intention": "intention.IntentionMethod",
    "independent-operation": "task.TaskMethod",
    "ft": "ft.FtMethod",
    "glove": "glove.GloveMethod",
    "frames": "frames.FrameMethod",
    "emg": "emg.EmgMethod",
    "suit": "suit.SuitMethod",
    "servos": "servos.ServoMethod",
}
"""`FOLDER.CLASS` of each kind: `commissioning/calibration/FOLDER/method.py` has the class."""
KINDS: Final = tuple(METHODS)
"""What can be calibrated."""
_IKNS: Final = {"only": "ikns"}


@dataclass(frozen=True)
class CalibrationRequest:
    """What is wanted; the options of `srl calibrate`. `only` in an option's metadata: the kind whose alone it is.

    Attributes:
        sim: a simulated person does it.
        simulated: the devices that `--sim` names; none where it names none.
        twins: the devices that are on their twins.
        instruct: tells the simulated person beside them what to do.
        check_twins: raises HostError once they have ended.
    """

    profile: str
    kind: str = "ikns"
    person: str | None = None
    out: Path | None = None
    yes: bool = False
    sim: bool = False
    simulated: Sequence[str] = ()
    twins: frozenset[str] = frozenset()
    instruct: Callable[[Instruction], None] | None = None
    check_twins: Callable[[], None] = lambda: None
    record: Path | None = None
    view: bool = False
    recording: Sequence[Path] | None = None
    before: Sequence[Path] | None = None
    redo: Sequence[int] | None = None
    dofs: str | None = field(default=None, metadata=_IKNS)
    points: int | None = field(default=None, metadata=_IKNS)
    flip: Sequence[str] = field(default=(), metadata=_IKNS)
    direction: Path | None = field(default=None, metadata=_IKNS)
    actions: str | None = field(default=None, metadata={"only": "intention"})
    option: Sequence[str] = ()
    set: Sequence[str] = ()
    instance: str | None = None
    json: bool = False
    panel: bool = False
