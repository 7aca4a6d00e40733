"""How one thing is calibrated: what a session asks of it."""

from __future__ import annotations

import datetime
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Generic, TypeVar, cast

from pydantic import ValidationError

from srl.commissioning.calibration.guided import Procedure
from srl.commissioning.calibration.held_still import LEFT_OUT
from srl.commissioning.calibration.live import Live
from srl.commissioning.calibration.marks import MarkedSamples, ended, joined
from srl.commissioning.calibration.profile_subset import find
from srl.commissioning.calibration.request import CalibrationRequest
from srl.commissioning.calibration.result import Result
from srl.commissioning.calibration.run_channels import RunChannels
from srl.commissioning.calibration.screen import Screen
from srl.commissioning.calibration.sources import RowSource, Simulated
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import OptionError, ProfileError, RequestError, SrlError, nearest
from srl.runtime.contracts.validation import CORRECT, refusal
from srl.runtime.ipc.layout import Layout
from srl.runtime.models.record_file import NAME
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source

T = TypeVar("T", bound=RunChannels)
F = TypeVar("F")
M = TypeVar("M", bound=BaseModel)
Say = Callable[[str], None]


class Method(ABC, Generic[T, F]):
    """How one thing is calibrated: from channels `T` that are read of a run, to what is found, `F`.

    Attributes:
        name: what `srl calibrate PROFILE` calls it; by default that of the law.
        law: the law that uses the file.
        option: of the law, that names the file.
        record_type: what the file holds.
        error: what `compute` raises where nothing can be computed.
        groups: what `--option` sets, by name; all kinds have "plan" and "thresholds".
        fixed: those groups that stay as an earlier recording has them, whatever is typed.
        channels: what is read of a run.
        next: the keys at the end, besides those that every method has.
        thing: what `--redo` counts.
        report: the module whose `lines`, `metrics` and `draw` tell of a result; else these are the method's own.
        counted: the marks of what counts.
        personal: whether it is a person's calibration, with an id; else a device's.
        foreseen: whether a person can know the steps beforehand, so that a motion file can hold them.
        instructed: whether the simulated person takes instructions, so that it can stand beside twins; else the user's
            keys move what is on its twin.
    """

    name: ClassVar[str] = ""
    law: ClassVar[str] = ""
    option: ClassVar[str] = "calibration"
    record_type: ClassVar[type[BaseModel]]
    error: ClassVar[type[SrlError]]
    groups: ClassVar[Mapping[str, type[BaseModel]]]
    fixed: ClassVar[Collection[str]] = ()
    channels: ClassVar[type[RunChannels]]
    next: ClassVar[str] = ""
    thing: ClassVar[str]
    report: ClassVar[ModuleType]
    counted: ClassVar[range] = range(1, LEFT_OUT)
    personal: ClassVar[bool] = True
    foreseen: ClassVar[bool] = True
    instructed: ClassVar[bool] = True

    def __init_subclass__(cls) -> None:
        cls.name = cls.name or cls.law

    def __init__(self, request: CalibrationRequest, checked: Profile, source: Source, target: Path, say: Say) -> None:
        """Reads what the command line says. Raises RequestError."""
        self.request, self.checked, self.source, self.target, self.say = request, checked, source, target, say
        self._settings = settings(request, self.groups)

    @property
    def _plan(self) -> Any:
        return self._settings["plan"]

    @property
    def _thresholds(self) -> Any:
        return self._settings["thresholds"]

    @classmethod
    def named(cls, request: CalibrationRequest, checked: Profile, source: Source) -> Path | None:
        """The file that the profile names, if it names one. Raises ProfileError."""
        law = find(checked, source, cls.law)
        return file_of(source, checked.controllers[law].options.get(cls.option), f"controllers.{law}.{cls.option}")

    @abstractmethod
    def subset(self, person: str) -> tuple[Profile, Source]:
        """The part of the profile that the calibration needs. Raises ProfileError, WiringError."""

    def _entry(self, **options: Any) -> dict[str, Any]:
        """The profile's entry of the marks' law, with its options and those settings that are among them."""
        law, known = self.channels.law, self.channels.config.model_fields
        own = {name: value.model_dump(mode="json") for name, value in self._settings.items() if name in known}
        return {"use": law, "name": law} | options | own

    def simulated(self, made: Profile, text: Source) -> RowSource:
        """Where its rows come from with `--sim`. Raises SrlError."""
        return Simulated(made, text, self.channel_map, self.say, self.request.record)

    def live(self, text: Source, name: str, record: Path, screen: Screen) -> RowSource:
        """Where they come from live; `name`: the instance's. Raises SrlError: it doesn't start."""
        request = self.request
        return Live(
            text, self.channel_map, name, record, request.view, self.say, twins=request.twins, instruct=request.instruct
        )  # fmt: skip

    def channel_map(self, layout: Layout, place: str) -> T:
        """Where the calibration's signals are in a layout. Raises RecordingError."""
        return cast(T, self.channels.of(layout, place, self.name))

    @abstractmethod
    def same(self, one: T, other: T) -> bool:
        """Whether two recordings may be of one calibration."""

    def take(self, older: T) -> T:
        """Takes the settings of an earlier calibration, but those that the command line says. Raises RequestError."""
        self._check(older, "--from" if self.request.redo else "--recording")
        update = {}
        for name, typed in self._settings.items():
            if (own := getattr(older.options, name, None)) is not None:
                update[name] = own if name in self.fixed else kept(own, typed)
        self._settings |= update
        return replace(older, options=older.options.model_copy(update=update))

    def _check(self, channel_map: T, place: str) -> None:
        """Raises RequestError, at `place`: a recording isn't of what the profile calibrates."""

    def ended(self, samples: Any) -> MarkedSamples:
        """The samples of a whole recording, without the trial in which the recording stops."""
        found: MarkedSamples = ended(samples, self._counts)
        return found

    def _counts(self, mark: int) -> bool:
        """Whether samples with this mark are of a trial."""
        return mark in self.counted

    def ready(self, channel_map: T) -> None:
        """Checks, before anybody begins, what must fit what is recorded. Raises RequestError."""
        self._check(channel_map, "--recording")

    @abstractmethod
    def procedure(self, before: Sequence[Any]) -> Procedure:
        """What leads through it; `before`: samples of an earlier one, of which something is done again."""

    @abstractmethod
    def compute(self, channel_map: T, parts: Sequence[Any], date: datetime.date) -> Result[F]:
        """Computes it from runs, in their order. Raises `error`."""

    def command(self, result: Any, typed: str) -> Result[F] | None:
        """Does what was typed at the end; None: that is no command. Raises RequestError."""
        return None

    def choices(self, result: Any) -> Sequence[tuple[str, str]]:
        """What `command` knows, whole, each with its words: the buttons of a page that nobody types on."""
        return ()

    def lines(self, result: Any) -> list[str]:
        """The report as text."""
        found: list[str] = self.report.lines(result)
        return found

    def metrics(self, result: Any) -> dict[str, Any]:
        """The report as JSON types; SI units."""
        refused = [{"place": r.place, "problem": r.problem} for r in result.refusals]
        common = {"date": result.date.isoformat(), "simulated": result.simulated, "refusals": refused}
        return ({"person": result.person} if self.personal else {}) | common | self._figures(result)

    def _figures(self, result: Any) -> dict[str, Any]:
        """What is the kind's own in `metrics`."""
        found: dict[str, Any] = self.report.metrics(result)
        return found

    def draw(self, result: Any, png: Path) -> None:
        """Draws the report. Raises RecordError."""
        self.report.draw(result, png)

    @abstractmethod
    def record(self, result: Any) -> BaseModel:
        """What the file holds. Raises RecordError."""


class FittedMethod(Method[T, F]):
    """A kind that is fitted to the samples of all runs at once."""

    def compute(self, channel_map: T, parts: Sequence[Any], date: datetime.date) -> Result[F]:
        found, refusals = self._fit(channel_map, joined(parts))
        return Result(channel_map, found, date, refusals)

    def record(self, result: Any) -> BaseModel:
        common = {"date": result.date, "simulated": result.simulated}
        if self.personal:
            common["person"] = result.person
        return self.record_type.model_validate(common | self._content(result))

    @abstractmethod
    def _fit(self, channel_map: T, samples: Any) -> tuple[F, Sequence[SrlError]]:
        """What is found of all samples, and why it can't be used. Raises `error`."""

    @abstractmethod
    def _content(self, result: Any) -> dict[str, Any]:
        """What is the kind's own in `record`."""


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
        first = refusal(error)
        raise RequestError(f"--option {first.path}".strip(), first.problem, first.remedy or CORRECT) from None


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


def file_of(source: Source, given: object, key: str) -> Path | None:
    """The file that an option of the profile names, if it names one; `key`: of the option. Raises ProfileError."""
    if not isinstance(given, str):
        return None
    try:
        return source.files.find(given)
    except OptionError as error:
        raise ProfileError(source.place(key), error.problem, error.remedy) from None


def kept(own: M, typed: M) -> M:
    """A recording's own thresholds stand, but for those that were typed."""
    return own.model_copy(update={name: getattr(typed, name) for name in typed.model_fields_set})
