"""Finds the transforms that a control law needs in the profile's tree of frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.frames import FrameError, Path
from srl.runtime.contracts.rotation import Pose
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.transforms import Place, Transform
from srl.runtime.profile.builder import Builder
from srl.runtime.profile.names import Link


@dataclass(frozen=True)
class Found:
    """One transform of a law.

    Attributes:
        need: what the law asked for.
        path: the way through the tree.
        pose: its value; with measured frames on the way, the value for measurements of zero.
        signals: the signals that measure frames on the way; none for a fixed transform.
    """

    need: Transform
    path: Path
    pose: Pose
    signals: tuple[str, ...]

    @property
    def origin(self) -> str:
        """Where it comes from, for people: `frames.tool, frames.handle`."""
        return ", ".join(f"frames.{name}" for name in (*reversed(self.path.down), *self.path.up)) or "the same frame"


def find(b: Builder, controller: Controller, inputs: Mapping[str, Link], path: str) -> tuple[Found, ...]:
    """Returns the law's transforms.

    Args:
        b: what is there so far: signals that measure frames must be among it.
        controller: the law.
        inputs: its input wires.
        path: of the controller's entry, for errors.
    Raises:
        WiringError: a port says nothing about its frame, or the tree doesn't connect the two.
    """
    found = []
    for need in controller.transforms:
        place = b.source.place(path)
        into, of = (_frame(b, controller, inputs, end, need, place) for end in (need.into, need.of))
        try:
            way = b.frames.path(into, of)
        except FrameError as error:
            raise WiringError(place, f"{controller.name} needs {need.text}: {error.problem}", error.remedy) from None
        signals = tuple(b.frames.entries[n].pose or "" for n in b.frames.measuring(way))
        if signals and not need.moves:
            problem = f"{controller.name} needs {need.text}, which must be fixed, and '{signals[0]}' measures it"
            raise WiringError(place, problem, "Give the frame a fixed place, without `pose:`")
        for signal in signals:
            if signal not in b.signals:
                problem = f"{controller.name} needs {need.text}, and '{signal}', which measures it, isn't made before"
                raise WiringError(place, problem, "List this controller after the one that makes that signal")
        found.append(Found(need, way, b.frames.fixed(way), signals))
    return tuple(found)


def _frame(
    b: Builder, controller: Controller, inputs: Mapping[str, Link], end: Place, need: Transform, place: str
) -> str:
    """The name of the frame that a law means."""
    if end.kind == "frame":
        return end.name
    wire = inputs[end.name]
    if end.kind == "device":
        owners = {name.partition(".")[0] for name in wire.far}
        if len(owners) == 1 and (device := owners.pop()) in b.profile.devices:
            return f"{device}/{end.link}" if end.link else device
        problem = f"{controller.name} needs {need.text}, and `{end.name}` isn't given by one device"
        raise WiringError(place, problem, f"Wire `{end.name}` to the state of a device")
    for name in wire.far:
        signal = b.signals[name]
        known = signal.frame if end.kind == "in" else signal.of or b.measured_by(name)
        if known is not None:
            return known
    if end.kind == "in":
        problem = f"{controller.name} needs {need.text}, and '{wire.far[0]}' says nothing of the frame it is in"
        raise WiringError(place, problem, f"Give the device of '{wire.far[0]}' the option `frame:`")
    problem = f"{controller.name} needs {need.text}, and no frame is measured by '{wire.far[0]}'"
    raise WiringError(place, problem, f"Give a frame under `frames:` the key `pose: {wire.far[0]}`")


def in_frames(signal: Signal, inputs: Mapping[str, Signal]) -> Signal:
    """A law's signal whose `=INPUT` is replaced by what this input's signal has."""
    changes = {}
    for key in ("frame", "of"):
        value = getattr(signal, key)
        if value is not None and value.startswith("="):
            changes[key] = getattr(inputs[value[1:]], key)
    return replace(signal, **changes) if changes else signal
