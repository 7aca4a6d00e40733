"""How `ikns` is calibrated."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, get_args

from srl.commissioning.calibration import profile_subset
from srl.commissioning.calibration.ikns import marks
from srl.commissioning.calibration.ikns import report as ikns_report
from srl.commissioning.calibration.ikns import result as results
from srl.commissioning.calibration.ikns.channel_map import ChannelMap, channel_map
from srl.commissioning.calibration.ikns.direction import Directions
from srl.commissioning.calibration.ikns.marks import MarksConfig
from srl.commissioning.calibration.ikns.procedure import Plan, Procedure
from srl.commissioning.calibration.ikns.result import Result
from srl.commissioning.calibration.ikns.samples import Samples, joined, seen
from srl.commissioning.calibration.marks import stretch_of
from srl.commissioning.calibration.method import Method, Say, names, settings
from srl.commissioning.calibration.request import CalibrationRequest
from srl.control.ikns import record
from srl.control.ikns.calibration import Calibration, CalibrationError
from srl.control.ikns.thresholds import Thresholds
from srl.runtime.contracts.errors import RequestError, nearest
from srl.runtime.contracts.wearer import Dof
from srl.runtime.ipc.layout import Layout
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source


class IknsMethod(Method[ChannelMap, Calibration]):
    """See the module's docstring."""

    law, record_type, error, channels = profile_subset.LAW, record.Record, CalibrationError, ChannelMap
    groups: ClassVar = {"plan": Plan, "thresholds": Thresholds}
    next, thing = "f DOF flip its direction", "points"
    foreseen = False  # the points are chosen from where the hand has been
    report: ClassVar[ModuleType] = ikns_report

    def __init__(self, request: CalibrationRequest, checked: Profile, source: Source, target: Path, say: Say) -> None:
        super().__init__(request, checked, source, target, say)
        points = [f"points={request.points}"] if request.points is not None else []
        self._settings = settings(request, self.groups, points)
        self._named = names("--dofs", request.dofs, "a degree of freedom")
        self._dofs = self._named or ("swivel",)
        self._turned = list(request.flip)
        for name in self._named if request.sim else ():
            if name not in get_args(Dof):
                problem = f"the simulated wearer knows no motion '{name}'"
                raise RequestError("--dofs", problem, nearest(name, get_args(Dof)))
        file = self.named(request, checked, source)
        self._directions = Directions(request.direction, [target, *([] if file is None else [file])])

    def subset(self, person: str) -> tuple[Profile, Source]:
        return profile_subset.subset(self.checked, self.source, person, self._dofs, self._thresholds, self.request.sim)

    def channel_map(self, layout: Layout, place: str) -> ChannelMap:
        own: MarksConfig | None = None
        if self.request.person is not None:  # a plain run's recording doesn't say whose it is
            dofs = self._named or ("swivel",)
            made, _ = profile_subset.subset(self.checked, self.source, self.request.person, dofs, self._thresholds)
            own = MarksConfig.model_validate(made.controllers[-1].options)
        return channel_map(layout, place, own)

    def same(self, one: ChannelMap, other: ChannelMap) -> bool:
        return (one.joints, one.options.dofs) == (other.joints, other.options.dofs)

    def take(self, older: ChannelMap) -> ChannelMap:
        if self.request.redo and self._named and older.options.dofs != self._named:
            problem = f"they are of {', '.join(older.options.dofs)}"
            raise RequestError("--from", problem, "Name recordings of the same degrees of freedom")
        self._dofs = older.options.dofs
        return super().take(older)

    def _counts(self, mark: int) -> bool:
        return marks.of_trial(mark)

    def ready(self, channel_map: ChannelMap) -> None:
        """Checks what the command line says of the direction."""
        flip, options = self.request.flip, channel_map.options
        for dof in flip:
            if dof not in options.dofs:
                raise RequestError("--flip", f"there is no degree of freedom '{dof}'", nearest(dof, options.dofs))
            if flip.count(dof) > 1:
                raise RequestError("--flip", f"'{dof}' is named twice, which would turn nothing", "Name it once")
        if self._directions.of(options) is None and (self.request.recording or self.request.redo):
            self.say(
                f"No calibration file of {options.person} with these joints stands there, so the direction is "
                "as computed: what was turned round before (--flip, f) isn't in a recording. --direction FILE takes it"
            )

    def procedure(self, before: Sequence[Samples]) -> Procedure:
        explored = None
        if before:
            samples = joined(before)
            explored = seen(samples, stretch_of(samples.marks, marks.EXPLORATION))
        return Procedure(self._dofs, self._thresholds, self._plan, explored)

    def compute(self, channel_map: ChannelMap, parts: Sequence[Any], date: datetime.date) -> Result:
        result = self._directions.kept(results.compute(channel_map, parts, date))
        for dof in self._turned:
            result = result.flipped(dof)
        return result

    def command(self, result: Result, typed: str) -> Result | None:
        word, _, rest = typed.partition(" ")
        if word != "f":
            return None
        name = rest.strip() or (result.dofs[0] if len(result.dofs) == 1 else "")
        result = result.flipped(name)
        self._turned.append(name)
        self.say(f"{name} is turned round: what was 0 is 1")
        return result

    def choices(self, result: Result) -> list[tuple[str, str]]:
        return [(f"f {dof}", f"Flip the direction of {dof}") for dof in result.dofs]

    def record(self, result: Result) -> record.Record:
        return result.record()
