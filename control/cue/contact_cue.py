"""What the limb touches becomes what its wearer feels."""

from __future__ import annotations

from collections.abc import Iterator
from math import hypot, isnan
from typing import Literal, Self

from pydantic import Field, model_validator

from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.cue import Cue
from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.signals import Signal

RELEASES = 0.8  # of the threshold: a contact lasts until the load has fallen to this


class ContactCueConfig(ControllerConfig):
    """Options of `contact-cue`."""

    labels: tuple[str, ...] = Field(min_length=1, description="of the input's elements, such as [fx, fy, fz]")
    unit: str = Field("N", description="of the input: N of a sensor, N m or A of servos that measure")
    motors: tuple[str, ...] = Field(
        min_length=1, description="labels of the output; with `each` one for each of `labels`"
    )
    combine: Literal["norm", "each"] = Field(
        "norm", description="norm: all motors give the input's magnitude; each: a motor for each element"
    )
    threshold: float = Field(gt=0, allow_inf_nan=False, description="in the unit: below it nothing is felt")
    full: float = Field(gt=0, allow_inf_nan=False, description="in the unit: from here on the intensity is 1")
    least: float = Field(0.3, ge=0, lt=1, description="the intensity at the threshold")
    tap: float = Field(0.1, ge=0, le=0.5, description="s of full intensity as a contact begins")
    begin: Cue | None = Field(None, description="a cue as the limb begins to follow; left out: none")
    max_hold: float = Field(0.5, ge=0.0, description="s for which an unknown element stays as it was; .inf: for ever")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        for key, names in (("labels", self.labels), ("motors", self.motors)):
            if len(set(names)) < len(names):
                raise OptionError(f"{key}: a name is there more than once", "Name each once")
        if self.combine == "each" and len(self.motors) != len(self.labels):
            problem = f"{len(self.motors)} motors for {len(self.labels)} elements"
            raise OptionError(f"motors: {problem}", "Name one for each of `labels`, or say combine: norm")
        if not self.threshold < self.full:
            raise OptionError(f"full: {self.full:g} isn't above the threshold, {self.threshold:g}", "Raise it")
        return self


class ContactCue(Controller):
    """u = least + (1 - least) (|x| - threshold) / (full - threshold), at most 1; 0 below the threshold.

    Input `load` (k,), output `intensity` (n,), 0 to 1. |x| is the input's norm, or of each element by itself. A contact
    begins at the threshold with a tap of full intensity, since its moment tells more than its strength, and ends at
    0.8 of it. An infinite element is a full one. An unknown one stays as it was; after `max_hold` that is a loss, since
    the wearer would take silence for no contact. One that is known now and then is a loss, too.
    """

    Config = ContactCueConfig
    summary = "vibration for the wearer from the limb's force, torque or current"

    def __init__(self, name: str, config: ContactCueConfig) -> None:
        super().__init__(name, config)
        k, n = len(config.labels), len(config.motors)
        self.inputs = (Signal(name="load", shape=(k,), unit=config.unit, labels=config.labels),)
        self.outputs = (Signal(name="intensity", shape=(n,), unit="1", labels=config.motors),)
        self._options = config
        self._touching = [-1.0] * n  # s since the contact began; -1: there is none
        self._time = self._unknown = 0.0  # s since the reset; s for which an element wasn't known
        self._loads = [0.0] * k  # the newest that is known of each

    def reset(self) -> None:
        self._touching = [-1.0] * len(self._touching)
        self._time, self._unknown, self.lost = 0.0, 0.0, False
        self._loads = [0.0] * len(self._options.labels)
        self.output["intensity"][:] = 0.0

    def update(self, dt: float) -> None:
        config, found = self._options, self.input["load"].tolist()
        self._unknown = self._unknown + dt if any(map(isnan, found)) else max(self._unknown - dt / 4, 0.0)
        loads = self._loads = [old if isnan(new) else new for old, new in zip(self._loads, found, strict=True)]
        self.lost = self._unknown > config.max_hold
        if config.combine == "norm":
            loads = [hypot(*loads)] * len(self._touching)
        begin = config.begin.at(self._time) if config.begin is not None else 0.0
        self._time += dt
        for i, load in enumerate(loads):
            self.output["intensity"][i] = max(begin, self._felt(i, abs(load), dt))

    def _felt(self, i: int, load: float, dt: float) -> float:
        config, since = self._options, self._touching[i]
        if load < config.threshold * (1.0 if since < 0.0 else RELEASES):
            self._touching[i] = -1.0
            return 0.0
        self._touching[i] = since = max(since, 0.0)
        self._touching[i] += dt
        if since + dt / 2 < config.tap:
            return 1.0
        share = max(load - config.threshold, 0.0) / (config.full - config.threshold)
        return min(config.least + (1.0 - config.least) * share, 1.0)

    def warnings(self, dt: float) -> Iterator[tuple[str, str]]:
        """A cue that is too short for the cycles."""
        if self._options.begin is not None and (text := self._options.begin.too_short(dt)):
            yield "begin", text
