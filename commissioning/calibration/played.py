"""A motion file of capture software in the place of a recording: the cut profile measures it, and the steps follow it.

The person did at the capture system what the procedure asks for. Each step ends as it does live, so the rows bear the
same marks. A kind whose steps a person can't know beforehand says so (`Method.foreseen`); its rows bear no marks.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.commissioning.calibration.guide import Guide
from srl.commissioning.calibration.guided import Procedure
from srl.commissioning.calibration.method import Method
from srl.commissioning.calibration.profile_subset import build
from srl.commissioning.calibration.screen import Plain
from srl.commissioning.calibration.sources import Rows, Stepped
from srl.drivers.replay import Replay
from srl.drivers.replay.config import OPTIONS
from srl.drivers.replay.motion_file import recorded
from srl.runtime.contracts.errors import RequestError
from srl.runtime.profile import profile
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source

REPLAY: Final = "replay"
SYSTEMS: Final[Mapping[str, tuple[str, ...]]] = {
    ".bvh": ("noitom",), ".mvnx": ("xsens-mvn", "noitom"), ".c3d": ("vicon", "natnet"),
}  # fmt: skip
"""The drivers whose place a file of each kind can take, by its ending."""


def is_motion_file(path: Path) -> bool:
    """Whether a file of `--recording` is one of capture software, by its ending."""
    return path.suffix.lower() in OPTIONS


def played(method: Method[Any, Any], path: Path) -> tuple[Any, Rows]:
    """The rows of a motion file, and where the calibration's signals are in them; as `sources.recorded`.

    Raises:
        RequestError: the person isn't named, the profile has no device that it can stand for, or the file ends early.
        RecordingError, HostError: it can't be read.
    """
    if method.personal and method.request.person is None:
        raise RequestError("--person", f"{path.name} doesn't say whose it is", "Give an anonymous id: --person P07")
    made, text = _with_file(*method.subset(method.request.person or ""), path)
    source = Played(made, text, method, path)
    try:
        if not method.foreseen:
            return replace(source.channel_map, mark=None), source.rest()
        guide = Guide(source, method.procedure([]), Plain(method.say), lambda: False)
        guide.run()
        return source.channel_map, np.concatenate(source.rows)
    finally:
        source.close()


def _with_file(made: Profile, text: Source, path: Path) -> tuple[Profile, Source]:
    """The cut profile with the file in the place of its device."""
    ending = path.suffix.lower()
    fitting = [name for name, entry in made.devices.items() if entry.driver in SYSTEMS[ending]]
    if len(fitting) != 1:
        problem = f"it can stand for {' or '.join(SYSTEMS[ending])}, of which the calibration reads {len(fitting)}"
        remedy = "Name a profile that reads one; or put a device `replay` into it, for each"
        raise RequestError(str(path), problem, remedy)
    if others := [name for name, entry in made.devices.items() if name not in fitting and entry.driver != REPLAY]:
        problem = f"the calibration also reads '{others[0]}', which isn't in the file"
        raise RequestError(str(path), problem, f"Put a device `replay` in the place of '{others[0]}'")
    (name,) = fitting
    entry = made.devices[name]
    options = {key: value for key, value in entry.options.items() if key in OPTIONS[ending]}
    if entry.driver == "noitom":
        options["skeleton"] = entry.options.get("skeleton", "axis-neuron")
    new = {"driver": REPLAY, "recording": str(path.absolute()), "at_end": "hold"} | options
    if entry.max_age is not None:
        new["max_age"] = float(entry.max_age)
    override = f"devices.{name}={json.dumps(new)}"
    return profile.parse(text.label, text.text, [*text.overrides, override], text.files)


class Played(Stepped):
    """The motion in lockstep, as fast as it goes.

    Attributes:
        rows: all that were taken, in pieces.
    """

    def __init__(self, made: Profile, text: Source, method: Method[Any, Any], path: Path) -> None:
        graph = build(made, text, False)
        devices = [device for device in graph.devices if isinstance(device, Replay)]
        assert len(devices) == len(graph.devices), "a real device would be opened"
        self._length = max(device.duration for device in devices)
        self._path = path
        self._procedure: Procedure | None = None
        self.rows: list[Rows] = []
        graph.layout.meta["wall"] = recorded(path)
        super().__init__(graph, method.channel_map, text.label, method.say)

    def begin(self, procedure: Procedure) -> None:
        self._procedure = procedure
        self.mark(procedure)

    def take(self) -> Rows:
        procedure = self._procedure
        if self.time > self._length and procedure is not None and not procedure.done:
            problem = f"it ends after {self._length:.1f} s, in the step '{procedure.view().task}'"
            lack = procedure.view().lack or procedure.view().missing
            remedy = f"{lack[:1].upper()}{lack[1:]}. " if lack else ""
            raise RequestError(
                str(self._path), problem, f"{remedy}Record all that the calibration asks for, in its order"
            )
        self.rows.append(super().take())
        return self.rows[-1]

    def rest(self) -> Rows:
        """All rows to the end of the motion."""
        while self.time < self._length:
            self.take()
        return np.concatenate(self.rows)
