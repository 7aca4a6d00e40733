"""A device that is calibrated: which it is, the file that it names, and how it is left alone in a profile."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from srl.commissioning.calibration.method import F, FittedMethod, Say, T, file_of, settings
from srl.commissioning.calibration.profile_subset import subset_of_devices
from srl.commissioning.calibration.request import CalibrationRequest
from srl.runtime.contracts.errors import ProfileError, RequestError, WiringError, nearest
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source


def device(checked: Profile, source: Source, what: str, chosen: str = "") -> str:
    """The device that is calibrated.

    Args:
        checked, source: the whole profile.
        what: what `srl calibrate` calls its calibration, `Driver.calibrated`.
        chosen: its name, if it was said.
    Raises:
        ProfileError: there is none. RequestError: there are several, or `chosen` is none of them.
    """
    found = [
        name
        for name, entry in checked.devices.items()
        if source.load("drivers", entry.driver, f"devices.{name}.driver").calibrated == what
    ]
    if not found:
        problem = f"none of its devices is calibrated by '{what}'"
        raise ProfileError(source.place("devices"), problem, "Name a profile that has one")
    if chosen:
        if chosen not in found:
            problem = f"'{chosen}' is no device that is calibrated by '{what}'"
            raise RequestError("--option device", problem, nearest(chosen, found))
        return chosen
    if len(found) > 1:
        problem = f"the profile has {len(found)} such devices: {', '.join(found)}"
        raise RequestError("--option device", problem, f"Name one: --option device={found[0]}")
    return found[0]


class DeviceMethod(FittedMethod[T, F]):
    """How a device is calibrated whose driver says so (`Driver.calibrated`). Its plan has an option `device`."""

    def __init__(self, request: CalibrationRequest, checked: Profile, source: Source, target: Path, say: Say) -> None:
        super().__init__(request, checked, source, target, say)
        self._device = device(checked, source, self.name, self._plan.device)

    @classmethod
    def named(cls, request: CalibrationRequest, checked: Profile, source: Source) -> Path | None:
        name = device(checked, source, cls.name, settings(request, cls.groups)["plan"].device)
        return file_of(source, checked.devices[name].options.get(cls.option), f"devices.{name}.{cls.option}")


class WornMethod(DeviceMethod[T, F]):
    """How a device that a person wears is calibrated: it alone is left of the profile, with a simulated person.

    Attributes:
        part: the simulated part that it measures.
    """

    part: ClassVar[str]

    def subset(self, person: str) -> tuple[Profile, Source]:
        marks = partial(self._marks, person)
        return subset_of_devices(self.checked, self.source, {self._device}, marks, self.request.sim, self._bare)

    @abstractmethod
    def _marks(self, person: str, graph: Graph) -> dict[str, Any]:
        """The entry of the marks' law. Raises WiringError: the device doesn't give what is calibrated."""

    def _own_options(self) -> Any:
        """The options of the marks' law, as the profile has them now."""
        (entry,) = self.subset(self.request.person or "P0")[0].controllers
        return self.channels.config.model_validate(entry.options)

    def _signal(self, graph: Graph, signal: str, elements: str, remedy: str) -> Sequence[str]:
        """The names of the elements of the device's signal. Raises WiringError: it has no such signal."""
        field = graph.layout.fields.get(signal)
        if field is None or not field.labels:
            place = self.source.place(f"devices.{self._device}")
            raise WiringError(place, f"there is no '{signal}' of named {elements}", remedy)
        return field.labels

    def _bare(self, plain: dict[str, Any]) -> None:
        """The device as it is without its file, and, simulated, what it measures; nothing else is there."""
        plain["frames"] = {}
        plain["devices"][self._device].pop(self.option, None)
        if not self.request.sim:
            plain.pop("sim", None)
            return
        sim = plain.get("sim") or {}
        name, part = part_of(sim, self._device, self.part, self.source.place("sim.parts"))
        sim["parts"] = {name: self._instructed(part)}

    @abstractmethod
    def _instructed(self, part: dict[str, Any]) -> dict[str, Any]:
        """The options of the simulated part, set so that it follows the calibration's steps."""


def part_of(sim: Mapping[str, Any], device: str, kind: str, place: str) -> tuple[str, dict[str, Any]]:
    """The name and the options of the simulated part of a kind that a device measures.

    Raises ProfileError, at `place`: there is none, or there are several and none is the device's.
    """
    parts: dict[str, Any] = sim.get("parts") or {}
    fitting = [name for name, part in parts.items() if part.get("part") == kind]
    named = (sim.get("devices") or {}).get(device, {}).get("part", device)
    own = named if named in fitting else fitting[0] if len(fitting) == 1 else None
    if own is None:
        problem = f"the simulated world has {len(fitting)} parts '{kind}', and none is called '{device}'"
        raise ProfileError(place, problem, f"Add one, or name it: sim.devices.{device}.part")
    return own, dict(parts[own])
