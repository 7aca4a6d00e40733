"""How one thing is calibrated: what a session asks of it."""

from __future__ import annotations

import datetime
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from pydantic import ValidationError

from srl.commissioning.calibration.guided import Procedure, Samples
from srl.commissioning.calibration.held_still import IDLE, LEFT_OUT
from srl.commissioning.calibration.live import Live
from srl.commissioning.calibration.marks import stretch_of
from srl.commissioning.calibration.profile_subset import find
from srl.commissioning.calibration.request import CalibrationRequest
from srl.commissioning.calibration.run_channels import RunChannels
from srl.commissioning.calibration.screen import Screen
from srl.commissioning.calibration.sources import RowSource, Simulated
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import OptionError, ProfileError, RequestError, SrlError, nearest
from srl.runtime.ipc.layout import Layout
from srl.runtime.models.record_file import NAME
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source


class Outcome(Protocol):
    """What was computed."""

    @property
    def refusals(self) -> Sequence[SrlError]:
        """Why it can't be used; none if it can."""


T = TypeVar("T", bound=RunChannels)
R = TypeVar("R", bound=Outcome)
M = TypeVar("M", bound=BaseModel)
Say = Callable[[str], None]


class Method(ABC, Generic[T, R]):
    """How one thing is calibrated.

    Attributes:
        name: what `srl calibrate PROFILE` calls it; by default that of the law.
        law: the law that uses the file.
        option: of the law, that names the file.
        record_type: what the file holds.
        error: what `compute` raises where nothing can be computed.
        next: the keys at the end, besides those that every method has.
        thing: what `--redo` counts.
        report: the module whose `lines`, `metrics` and `draw` tell of a result; else these are the method's own.
        counted: the marks of what counts.
        personal: whether it is a person's calibration, with an id; else a device's.
    """

    name: ClassVar[str] = ""
    law: ClassVar[str]
    option: ClassVar[str]
    record_type: ClassVar[type[BaseModel]]
    error: ClassVar[type[SrlError]]
    next: ClassVar[str] = ""
    thing: ClassVar[str]
    report: ClassVar[ModuleType]
    counted: ClassVar[range] = range(1, LEFT_OUT)
    personal: ClassVar[bool] = True

    def __init_subclass__(cls) -> None:
        cls.name = cls.name or cls.law

    def __init__(self, request: CalibrationRequest, checked: Profile, source: Source, target: Path, say: Say) -> None:
        """Reads what the command line says. Raises RequestError."""
        self.request, self.checked, self.source, self.target, self.say = request, checked, source, target, say

    @classmethod
    def named(cls, request: CalibrationRequest, checked: Profile, source: Source) -> Path | None:
        """The file that the profile names, if it names one. Raises ProfileError."""
        return named(checked, source, cls)

    @abstractmethod
    def subset(self, person: str) -> tuple[Profile, Source]:
        """The part of the profile that the calibration needs. Raises ProfileError, WiringError."""

    def simulated(self, made: Profile, text: Source) -> RowSource:
        """Where its rows come from with `--sim`. Raises SrlError."""
        return Simulated(made, text, self.channel_map, self.say, self.request.record)

    def live(self, text: Source, name: str, record: Path, screen: Screen) -> RowSource:
        """Where they come from live; `name`: the instance's. Raises SrlError: it doesn't start."""
        return Live(text, self.channel_map, name, record, self.request.view, self.say)

    @abstractmethod
    def channel_map(self, layout: Layout, place: str) -> T:
        """Where the calibration's signals are in a layout. Raises RecordingError."""

    @abstractmethod
    def same(self, one: T, other: T) -> bool:
        """Whether two recordings may be of one calibration."""

    @abstractmethod
    def take(self, older: T) -> T:
        """Takes the settings of an earlier calibration, but those that the command line says. Raises RequestError."""

    def ended(self, samples: Any) -> Samples:
        """The samples of a whole recording, without the trial in which the recording stops."""
        marks = samples.marks.copy()
        if len(marks) and int(marks[-1]) in self.counted:
            marks[stretch_of(marks, marks[-1])] = IDLE
        return replace(samples, marks=marks)

    def ready(self, channel_map: T) -> None:
        """Checks, before anybody begins, what must fit what is recorded. Raises RequestError."""

    @abstractmethod
    def procedure(self, before: Sequence[Any]) -> Procedure:
        """What leads through it; `before`: samples of an earlier one, of which something is done again."""

    @abstractmethod
    def compute(self, channel_map: T, parts: Sequence[Samples], date: datetime.date) -> R:
        """Computes it from runs, in their order. Raises `error`."""

    def command(self, result: R, typed: str) -> R | None:
        """Does what was typed at the end; None: that is no command. Raises RequestError."""
        return None

    def choices(self, result: R) -> Sequence[tuple[str, str]]:
        """What `command` knows, whole, each with its words: the buttons of a page that nobody types on."""
        return ()

    def lines(self, result: R) -> list[str]:
        """The report as text."""
        found: list[str] = self.report.lines(result)
        return found

    def metrics(self, result: R) -> dict[str, Any]:
        """The report as JSON types; SI units."""
        found: dict[str, Any] = self.report.metrics(result)
        return found

    def draw(self, result: R, png: Path) -> None:
        """Draws the report. Raises RecordError."""
        self.report.draw(result, png)

    @abstractmethod
    def record(self, result: R) -> BaseModel:
        """What the file holds. Raises RecordError."""


def settings(
    request: CalibrationRequest, kinds: Mapping[str, type[BaseModel]], given: Sequence[str] = ()
) -> dict[str, Any]:
    """Groups of options by name, with what `--option KEY=VALUE` says. Raises RequestError.

    Args:
        request: has `option`.
        kinds: the groups.
        given: further `KEY=VALUE`.
    """
    values: dict[str, dict[str, Any]] = {name: {} for name in kinds}
    known = {key: name for name, kind in kinds.items() for key in kind.model_fields}
    for text in (*request.option, *given):
        key, equals, value = text.partition("=")
        if key not in known or not equals:
            raise RequestError(f"--option {text}", "there is no such option", nearest(key, known))
        values[known[key]][key] = value
    try:
        return {name: kind.model_validate(values[name]) for name, kind in kinds.items()}
    except ValidationError as error:
        first = error.errors()[0]
        place = f"--option {'.'.join(map(str, first['loc']))}".strip()
        raise RequestError(place, first["msg"].removeprefix("Value error, "), "Correct the value") from None


def names(option: str, given: str | None, things: str) -> tuple[str, ...]:
    """The names in a list of the command line. Raises RequestError: one is no name, or is named twice."""
    found = tuple(name.strip() for name in (given or "").split(",") if name.strip())
    if len(set(found)) < len(found):
        raise RequestError(option, f"{things} is named twice", "Name each once")
    for name in found:
        if not re.fullmatch(NAME, name):
            problem = f"'{name}' is no name"
            raise RequestError(option, problem, "Use up to 64 letters, digits, '.', '_' and '-'")
    return found


def named(checked: Profile, source: Source, kind: type[Method[Any, Any]]) -> Path | None:
    """The calibration file that the profile names, if it names one. Raises ProfileError."""
    law = find(checked, source, kind.law)
    given = checked.controllers[law].options.get(kind.option)
    if not isinstance(given, str):
        return None
    try:
        return source.files.find(given)
    except OptionError as error:
        raise ProfileError(source.place(f"controllers.{law}.{kind.option}"), error.problem, error.remedy) from None


def kept(own: M, typed: M) -> M:
    """A recording's own thresholds stand, but for those that were typed."""
    return own.model_copy(update={name: getattr(typed, name) for name in typed.model_fields_set})
