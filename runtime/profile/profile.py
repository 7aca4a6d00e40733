"""A profile: one YAML file that describes how a system is wired. It is read and checked for form, never executed.

`srl.runtime.profile.wiring` checks whether the parts that it names exist and fit together.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    ConfigDict,
    Field,
    PlainValidator,
    ValidationError,
    WithJsonSchema,
    WrapValidator,
    field_validator,
    model_validator,
)
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import AliasEvent, MappingEndEvent, MappingStartEvent, SequenceEndEvent, SequenceStartEvent

from srl.runtime.contracts import code_file, yaml_text
from srl.runtime.contracts.compiled import Backend
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import OptionError, ProfileError, nearest
from srl.runtime.contracts.files import Files, Typed, read_regular
from srl.runtime.contracts.frames import FrameEntry
from srl.runtime.contracts.signals import Stop
from srl.runtime.models.models import KINDS, Model, of_entry
from srl.runtime.profile import library
from srl.runtime.profile.bus import BusConfig
from srl.runtime.profile.choices import Choices, merge
from srl.runtime.profile.element import Element
from srl.runtime.profile.guard_entry import GuardEntry
from srl.runtime.profile.overrides import apply as apply_override
from srl.runtime.profile.overrides import plain_values
from srl.runtime.profile.pictured import RobotEntry
from srl.runtime.profile.plots import Plot
from srl.runtime.profile.reset import ResetConfig
from srl.runtime.profile.source import Source, first_error
from srl.runtime.profile.wire import Input, Output

SLUG = r"^[a-z][a-z0-9_-]*$"
SIGNAL = r"^[a-z][a-z0-9_-]*(\.[a-z][a-z0-9_-]*)+$"
SPANS = 1e-6, 1e6  # s, the least and the most: the loop counts ns, in which less may be none
Span = Annotated[float, Field(ge=SPANS[0], le=SPANS[1], allow_inf_nan=False)]


PartName = Annotated[str, WrapValidator(lambda given, check: given if isinstance(given, Typed) else check(given))]
"""A registered name, or `FILE.py:CLASS`: one that was typed stays known as such."""


class Part(BaseModel):
    """A section of the profile. Unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class DeviceEntry(BaseModel):
    """`devices.<name>`: the driver, options of the runtime itself, and the driver's own options (all other keys)."""

    model_config = ConfigDict(extra="allow", frozen=True)

    driver: PartName
    max_age: Span | None = Field(None, description="s; older than this a sample is stale")
    robot: RobotEntry | None = Field(
        None, description="for pictures: a description, a model, {axes: ...}, or {urdf: FILE, base: LINK, tip: LINK}"
    )

    @property
    def options(self) -> dict[str, Any]:
        """The driver's own options."""
        return dict(self.model_extra or {})


class ControllerEntry(BaseModel):
    """`controllers[i]`: the control law, its wiring, and its own options (all other keys)."""

    model_config = ConfigDict(extra="allow", frozen=True, populate_by_name=True)

    use: PartName
    name: str | None = Field(None, pattern=SLUG, description="default: the control law's name, or its class's")
    inputs: dict[str, Input] = Field(default_factory=dict, alias="in")
    outputs: dict[str, Output] = Field(default_factory=dict, alias="out")

    @property
    def called(self) -> str:
        """The name by which others mean it."""
        return self.name or (code_file.default_name(self.use) if code_file.is_file(self.use) else self.use)

    @property
    def options(self) -> dict[str, Any]:
        """The controller's own options."""
        return dict(self.model_extra or {})


class SetpointEntry(Part):
    """`setpoints.<owner>.<signal>`: a signal that clients of the bus write."""

    shape: tuple[int, ...]
    unit: str
    max_age: Span = Field(0.5, description="s; older than this it is stale, a loss of intent")
    frame: str | None = None
    labels: tuple[str, ...] = Field((), description="names of its elements; needed where it has several")
    slots: bool = Field(False, description="its rows have no names")
    components: tuple[tuple[str, ...], ...] = Field((), description="names along each further axis")


class SimEntry(BaseModel):
    """`sim`: the world, the fakes' options by device, and the world's own options (all other keys)."""

    model_config = ConfigDict(extra="allow", frozen=True)

    world: str
    start: Literal["auto", "manual"] | None = Field(None, description="in place of the profile's, if nothing is real")
    devices: dict[str, dict[str, Any]] = Field(default_factory=dict)

    @field_validator("world")
    @classmethod
    def _once_whole(cls, value: str) -> str:
        if value == "augmented-hand":
            raise OptionError(
                "the world 'augmented-hand' is made of parts now",
                "Write world: cell, parts: {hand: {part: human-hand, wearer: ...}, finger: {part: robotic-finger}, "
                "can: {part: object, ...}}, and frames, as sixth-finger does (docs/simulation.md)",
            )
        return value

    @property
    def options(self) -> dict[str, Any]:
        """The world's own options."""
        return dict(self.model_extra or {})


ModelEntry = Annotated[
    Model,
    PlainValidator(of_entry),
    WithJsonSchema({"oneOf": [kind.model_json_schema() for kind in KINDS.values()]}),
]
Reaction = Stop | Literal["stop"]  # "stop": each actuator's own category


class OverrunEscalation(Part):
    """The reactions to overruns: none up to `tolerate` in `window`, then less telemetry, a safe stop at `stop`."""

    tolerate: int = Field(5, ge=0)
    window: Span = Field(1.0, le=10.0, description="s")
    stop: int = Field(20, ge=1, description="overruns in the window that stop the limb; at most half of its cycles")

    @model_validator(mode="after")
    def _rises(self) -> Self:
        if self.tolerate >= self.stop and {"tolerate", "stop"} <= self.model_fields_set:
            problem = f"stop ({self.stop}) isn't above tolerate ({self.tolerate})"
            raise OptionError(problem, "Give the number that stops the limb; fewer only halve the telemetry")
        return self

    def at(self, rate: Fraction) -> OverrunEscalation:
        """As it holds at this rate (Hz): a loop that misses every other cycle is stopped, whatever is written."""
        stop = min(self.stop, max(int(Fraction(self.window) * rate / 2), 1))
        return self.model_copy(update={"stop": stop, "tolerate": min(self.tolerate, stop - 1)})


class Faults(Part):
    """`faults`: the reaction to each fault."""

    intent_loss: Reaction = Field("stop", alias="intent-loss")
    device_loss: Reaction = Field("stop", alias="device-loss")
    device_fault: Reaction = Field("stop", alias="device-fault")
    driver_error: Reaction = Field("stop", alias="driver-error")
    controller_error: Reaction = Field("stop", alias="controller-error")
    contact: Reaction = "stop"
    following_error: Reaction = Field("stop", alias="following-error")
    bus_loss: Reaction | Literal["ignore"] = Field("ignore", alias="bus-loss")
    overrun: OverrunEscalation = OverrunEscalation()


class EmergencyInput(Element):
    """`emergency[i]`: an e-stop or enabling switch: an element of a device's state, or of a setpoint, of one axis."""

    when: float = Field(1.0, description="the value that stops; an enabling switch stops at 0")
    category: Reaction = "stop"


class Keep(Part):
    """`record.keep`: which recordings of a folder are kept. Without it, all."""

    days: float | None = Field(None, gt=0, allow_inf_nan=False, description="older ones are deleted")
    gigabytes: float | None = Field(None, gt=0, allow_inf_nan=False, description="a folder's, at most")


class Record(Part):
    """`record`: what a recording shows in addition to the signals themselves, and how long recordings are kept."""

    plots: tuple[Plot, ...] = ()
    keep: Keep | None = None


class Profile(Part):
    """The whole profile file."""

    name: str = Field(pattern=SLUG, description="of the system, and of an instance of it on the bus")
    summary: str = Field("", description="a line for `srl list`")
    rate: Fraction = Field(description="Hz; 100, or '1000/3'")
    start: Literal["auto", "manual"] = Field("auto", description="manual: the limb waits for `srl start`")
    seed: int = Field(0, description="of the simulated world's noise")
    meant: tuple[str, ...] = Field(
        (), description="places whose numbers are meant as they stand, though they look like another unit"
    )
    backend: Backend = Field("auto", description="what computes laws and guards: 'auto', 'c' or 'python'")
    clock: str = Field("monotonic", description="'monotonic', or the device whose own tick paces the loop")
    devices: dict[str, DeviceEntry] = Field(min_length=1, description="by name: the driver and its options")
    setpoints: dict[str, SetpointEntry] = Field(
        default_factory=dict, description="by name: what clients of the bus may send, and how old it may be"
    )
    controllers: tuple[ControllerEntry, ...] = Field((), description="control laws in the order in which they compute")
    guard: dict[str, GuardEntry] = Field(default_factory=dict, description="by command: the limits that hold always")
    frames: dict[str, FrameEntry] = Field(default_factory=dict, description="by name: where it is in its parent")
    models: dict[str, ModelEntry] = Field(default_factory=dict, description="by name: robots and limbs of the laws")
    sim: SimEntry | None = Field(None, description="the simulated world, for `--sim` and twins")
    stop: dict[str, Stop] = Field(default_factory=dict, description="by device: its stop category")
    faults: Faults = Field(Faults(), description="the reaction to each fault")
    emergency: tuple[EmergencyInput, ...] = Field((), description="inputs that stop the limb until a reset")
    reset: ResetConfig = Field(ResetConfig(), description="who may reset, and where the limb begins then")
    bus: BusConfig | None = Field(default_factory=BusConfig, description="null: no bus")
    record: Record = Field(Record(), description="plots, and how long recordings are kept")
    choices: Choices = Field(default_factory=dict, description="merged when the file is read, so empty afterwards")

    @field_validator("rate", mode="before")
    @classmethod
    def _rate(cls, value: Any) -> Any:
        try:
            rate = value
            if isinstance(value, int | str | float):
                text = str(value)
                if len(text) > 40 or "e" in text.lower():  # a power of ten has as many digits as it says
                    raise ValueError
                rate = Fraction(text)
        except (ValueError, ZeroDivisionError):
            raise ValueError("must be a number of Hz or a fraction such as '1000/3'") from None
        if isinstance(rate, Fraction) and not Fraction(1) <= rate <= Fraction(10_000):
            raise ValueError("must be from 1 to 10000 Hz")
        return rate

    @field_validator("devices", "setpoints")
    @classmethod
    def _slugs(cls, value: dict[str, Any]) -> dict[str, Any]:
        for name, entry in value.items():
            if not re.match(SIGNAL if isinstance(entry, SetpointEntry) else SLUG, name):
                raise ValueError(f"'{name}' isn't a valid name: lower-case letters, digits, - and _ only")
        return value

    @field_validator("models")
    @classmethod
    def _names(cls, value: dict[str, Model]) -> dict[str, Model]:
        for name in value:
            if not re.match(SLUG, name):
                raise ValueError(f"'{name}' isn't a valid name: lower-case letters, digits, - and _ only")
        return value


def find(name: str) -> tuple[str, str, Path]:
    """Returns the label, text and folder of a profile, found by its name under profiles/ or by its path."""
    path = Path(name)
    if path.suffix in (".yaml", ".yml") or "/" in name:
        try:
            return str(path), read_regular(path).decode("utf-8"), path.absolute().parent
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "it isn't UTF-8 text"
            raise ProfileError(name, f"the profile can't be read: {reason}", "Give an existing YAML file") from None
    known = library.files()
    if name not in known:
        if os.path.isfile(f"{name}.yaml"):
            raise ProfileError(name, "no profile has this name", f"Did you mean {name}.yaml, which is here?")
        raise ProfileError(name, "no profile has this name", nearest(name, known) + ". A path must end in .yaml")
    with resources.as_file(known[name]) as path:
        return f"{name}.yaml", path.read_text(encoding="utf-8"), path.absolute().parent


def load(name: str, overrides: Sequence[str] = (), run_code: bool = True) -> tuple[Profile, Source]:
    """Finds, reads and checks a profile, with `--set key.path=value` applied.

    `run_code`: whether what wires it may run code in files that it names. Reading it runs none.
    """
    label, text, folder = find(name)
    return parse(label, text, overrides, Files(folder, run_code=run_code))


def parse(label: str, text: str, overrides: Sequence[str] = (), files: Files | None = None) -> tuple[Profile, Source]:
    """Checks a profile's text.

    Args:
        label: its name for errors.
        text: YAML.
        overrides: the `--set` options.
        files: where the files are that its options name; left out: beside `label`.
    Raises:
        ProfileError: the first error, with its place.
    """
    plain, source = tree(label, text, overrides, files)
    try:
        return Profile.model_validate(plain, context={"files": source.files}), source
    except ValidationError as error:
        raise first_error(error, source, "", Profile, plain) from None


def tree(
    label: str, text: str, overrides: Sequence[str] = (), files: Files | None = None
) -> tuple[dict[str, Any], Source]:
    """The keys of a profile's text as plain values, with its choices made and the overrides; arguments: `parse`.

    Raises:
        ProfileError: it isn't valid YAML, or a choice can't be made.
    """
    try:
        lines, plain = _read(label, text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f" line {mark.line + 1}" if mark else ""
        problem = " ".join(str(error.problem or error.context).split())
        raise ProfileError(f"{label}{line}", f"this isn't valid YAML: {problem}", "Mend the text there") from None
    except YAMLError as error:
        raise ProfileError(label, f"this isn't valid YAML: {error}", "Mend the text") from None
    source = Source(label, text, tuple(overrides), dict(lines), files or Files(Path(label).parent))
    plain = plain_values(plain)  # a copy: the overrides change it
    # What a choice brings can be overridden like the rest of the profile, so the choices are made in between.
    words = plain.get("choices")
    before = {"choices", *(words if isinstance(words, dict) else ())}
    first = [override for override in overrides if override.partition("=")[0].split(".")[0].strip() in before]
    for override in first:
        apply_override(plain, override)
    merged = merge(plain, source, Profile.model_fields)
    source = replace(source, chosen=merged.words, moved=merged.moved)
    for override in overrides:
        if override not in first:
            apply_override(merged.tree, override)
    return merged.tree, source


@lru_cache(maxsize=64)  # reading takes longer than wiring, and a study, as the tests, comes back to the shipped texts
def _read(label: str, text: str) -> tuple[dict[str, int], dict[str, Any]]:
    """The line of each key path, and the keys as plain values: not to be changed."""
    _refuse_nested_aliases(label, text)
    read = yaml_text.load(text, "rt")
    if not isinstance(read, CommentedMap):
        raise ProfileError(label, "the profile isn't a mapping of keys to values", "Start from one under profiles/")
    lines: dict[str, int] = {}
    _note_lines(read, "", lines)
    return lines, plain_values(read)


def _refuse_nested_aliases(label: str, text: str) -> None:
    """An alias within what has an anchor may double the text with every line, until no memory is left."""
    yaml_text.check(text)
    if "*" not in text:
        return  # no alias; looking for one takes as long as reading
    anchored: list[bool] = []  # of the collections that are open
    for event in YAML(typ="rt", pure=True).parse(text):
        if isinstance(event, MappingStartEvent | SequenceStartEvent):
            anchored.append(event.anchor is not None)
        elif isinstance(event, MappingEndEvent | SequenceEndEvent):
            anchored.pop()
        elif isinstance(event, AliasEvent) and any(anchored):
            line = event.start_mark.line + 1
            problem = f"the alias '*{event.anchor}' stands within a part that has an anchor itself"
            raise ProfileError(f"{label} line {line}", problem, "Write one of the two out")


def _note_lines(node: Any, path: str, lines: dict[str, int]) -> None:
    items: Any = ()
    if isinstance(node, CommentedMap):
        items = ((str(key), key, value) for key, value in node.items())
    elif isinstance(node, CommentedSeq):
        items = ((str(i), i, value) for i, value in enumerate(node))
    for name, key, value in items:
        below = f"{path}.{name}" if path else name
        try:
            lines[below] = (node.lc.key(key) if isinstance(node, CommentedMap) else node.lc.item(key))[0] + 1
        except (KeyError, TypeError, AttributeError):
            pass  # a merged or generated key has no line of its own
        _note_lines(value, below, lines)
