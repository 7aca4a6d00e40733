"""The signals of one profile as they are collected: each step of `srl.runtime.profile.wiring` adds its own.

What is added is checked against what is there: one writer a signal, known frames; shapes, units and frames equal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

from pydantic import ValidationError

from srl.runtime.contracts import code_file
from srl.runtime.contracts.code_file import CodeError
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import ProfileError, WiringError, nearest, refused
from srl.runtime.contracts.frames import FrameError, Frames
from srl.runtime.contracts.signals import Signal
from srl.runtime.ipc.layout import Layout
from srl.runtime.models.models import context
from srl.runtime.profile.calibrated_frames import placed
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source, first_error

T = TypeVar("T")


class Builder:
    """Collects the signals of one profile; each step adds its own and checks them against those before."""

    def __init__(self, profile: Profile, source: Source, sim: Iterable[str] | None) -> None:
        frames, files, self.calibrated = placed(profile, source)
        read = {name: entry.model_copy(update={"calibration": files.get(name)}) for name, entry in frames.items()}
        self.profile, self.source = profile.model_copy(update={"frames": read}), source
        self.layout = Layout()
        self.signals: dict[str, Signal] = {}
        self.writers: dict[str, str] = {}
        self.simulated = self._simulated(sim)
        parts = profile.sim.options.get("parts") if profile.sim is not None else None
        self.parts: list[str] = list(parts) if isinstance(parts, dict) else []  # of the simulated world
        try:
            self.frames = Frames(frames, [*profile.devices, *self.parts])
        except FrameError as error:
            raise ProfileError(source.place("frames"), error.problem, error.remedy) from None

    def _simulated(self, sim: Iterable[str] | None) -> list[str]:
        if sim is None:
            return []
        chosen = list(dict.fromkeys(sim)) or list(self.profile.devices)
        for name in chosen:
            if name not in self.profile.devices:
                remedy = nearest(name, self.profile.devices)
                raise ProfileError(f"--sim {name}", f"{self.source.label} has no device '{name}'", remedy)
        if self.profile.sim is None:
            raise ProfileError(
                f"{self.source.place('')}", "the profile has no `sim:` section, so nothing can be simulated",
                "Add one that names a world, or run on the real devices",
            )  # fmt: skip
        return chosen

    def options(self, model: type[BaseModel], values: dict[str, Any], path: str) -> Any:
        """A part's own options, checked by its model. Entries of `models:` and files that they name are put in."""
        try:
            return model.model_validate(values, context=context(self.profile.models) | {"files": self.source.files})
        except ValidationError as error:
            raise first_error(error, self.source, path, model, values) from None

    def make(self, cls: Callable[..., T], *given: object, what: str, path: str) -> T:
        """Makes a device, law or clearance. `what`: it and the name by which the profile uses it; `path`: its entry.

        Raises:
            WiringError: it refuses what it is given with a ValueError.
            CodeError: it is a class in a file whose constructor isn't as it must be.
        """
        try:
            made = cls(*given)
        except ValueError as error:
            problem, remedy = refused(error)
            raise WiringError(self.source.place(path), f"{what} can't be made: {problem}", remedy) from error
        except TypeError as error:
            if not code_file.is_of_file(cls) or code_file.fault(error) is not None:
                raise
            raise CodeError(self.source.place(path), f"{what} can't be made: {error}", code_file.MEND) from error
        if code_file.is_of_file(cls) and not hasattr(made, "name"):
            problem = f"{what} doesn't make what it is derived from"
            raise CodeError(
                self.source.place(path), problem, "Begin its `__init__` with super().__init__(name, config)"
            )
        return made

    def add(self, name: str, signal: Signal, role: str, writer: str, place: str) -> None:
        """Gives a signal its place in the row."""
        if name in self.writers:
            raise WiringError(
                self.source.place(place),
                f"'{name}' has two writers: {self.writers[name]} and {writer}",
                "Let only one of them write it, or give the other another name under `out:`",
            )
        self.named(signal, name, place)
        for frame in (signal.frame, signal.of):
            if frame is not None and self.profile.frames and not self.frames.has(frame):
                raise WiringError(
                    self.source.place(place), f"'{name}' is in frame '{frame}', which `frames:` doesn't have",
                    nearest(frame, [*self.profile.frames, *self.profile.devices]),
                )  # fmt: skip
        self.writers[name] = writer
        self.signals[name] = signal
        self.layout.add(
            name, role, signal.shape, signal.unit,
            frame=signal.frame, labels=signal.labels, visual=signal.visual, links=signal.links,
            slots=signal.slots, components=signal.components, groups=signal.groups, slides=signal.slides or (),
        )  # fmt: skip

    def measured_by(self, signal: str) -> str | None:
        """The frame whose pose a signal measures, by the profile."""
        return next((name for name, entry in self.profile.frames.items() if entry.pose == signal), None)

    def named(self, signal: Signal, name: str, place: str) -> None:
        """Refuses a signal whose elements have no names: nothing could be wired to them but by place."""
        if fault := signal.naming_fault():
            raise WiringError(
                self.source.place(place),
                f"'{name}' can't be wired by name: {fault}",
                "Where it is declared, give it `labels`, or `slots` for rows that have no names, and `components`",
            )


def form(signal: Signal) -> str:
    """Shape, unit and frame of a signal as text: "5x3 m in hand"."""
    shape = "x".join(map(str, signal.shape))
    return f"{shape} {signal.unit}" + (f" in {signal.frame}" if signal.frame else "")
